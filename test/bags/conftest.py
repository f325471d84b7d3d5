"""Bags that contain half a second of the model; shared by the tests of writers and readers."""
import pytest
from recorded import introduce

from dragon_ros.bags.write.writer import BagWriter
from dragon_ros.core.model import compile_scene
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.step import tick
from dragon_ros.messages.channels import channels
from dragon_ros.messages.encode import encoders

SCENE = Scene(run=Run(412, 412.5))


def _write_bag(path, ticks=range(compile_scene(SCENE).last_tick + 1)):
    encode = encoders(SCENE)
    with BagWriter(path) as bag:
        for name, row in channels().items():
            bag.add_channel(f'/dragon/{name}', row)
        introduce(bag, SCENE)
        for k in ticks:
            frame = tick(SCENE, k)
            for name in encode:
                bag.write(f'/dragon/{name}', encode[name](frame), frame.t_ns, k)
    return path


@pytest.fixture(scope='session')
def write_bag():
    return _write_bag


@pytest.fixture(scope='session')
def bag_bytes(tmp_path_factory):
    return _write_bag(tmp_path_factory.mktemp('bag') / 'a.mcap').read_bytes()
