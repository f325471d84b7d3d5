"""A short scene with a contact, bags of this scene, and a browser."""
import pytest
from browser_fixtures import axe, chromium, page  # noqa: F401 - fixtures

from dragon_ros.bags.write.writer import BagWriter
from dragon_ros.core.model import compile_scene
from dragon_ros.core.step import tick
from dragon_ros.messages.channels import channels
from dragon_ros.messages.encode import encoders
from dragon_ros.scenes.load import load_scene

SHORT = ['dragon.benches=30', 'run.start_s=412', 'run.stop_s=413', 'run.rate_hz=20']


@pytest.fixture(scope='session')
def short():
    """The command-line options that set up the scene."""
    return [part for override in SHORT for part in ('--set', override)]


@pytest.fixture(scope='session')
def scene():
    return load_scene('winding', SHORT)


@pytest.fixture(scope='session')
def write_bag(scene):
    """A function that writes a bag as a recorder would, but without the topics in ``skip``."""
    def write(path, skip=(), namespace='/dragon'):
        encode = encoders(scene, 'dragon')
        with BagWriter(path) as bag:
            for name in encode:
                bag.add_channel(f'{namespace}/{name}', channels()[name])
            for k in range(compile_scene(scene).last_tick + 1):
                frame = tick(scene, k)
                for name, encoded in encode.items():
                    if name not in skip:
                        bag.write(f'{namespace}/{name}', bytes(encoded(frame)), frame.t_ns, k)
        return path
    return write


@pytest.fixture(scope='session')
def bag(tmp_path_factory, write_bag):
    return write_bag(tmp_path_factory.mktemp('bags') / 'run.mcap')
