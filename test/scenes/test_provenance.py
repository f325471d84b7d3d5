"""A bag documents its run: its scene file reproduces the scene and names the software that wrote the bag."""
import os
import subprocess
from importlib import metadata

import numpy as np
import pytest
import yaml

from dragon_ros import __version__
from dragon_ros.core.chain.dragon import Dragon
from dragon_ros.core.flags import Effect
from dragon_ros.core.scene import Run, Scene
from dragon_ros.messages.cdr import string_message
from dragon_ros.messages.decode import MessageError, read_string
from dragon_ros.scenes import provenance
from dragon_ros.scenes.load import load_scene, strangers_scene
from dragon_ros.scenes.provenance import kernels, other_kernel, run_metadata, scene_file

GIT = ('git', '-c', 'user.name=x', '-c', 'user.email=x@x')
SCENES = [Scene(), Scene(Dragon(benches=7), run=Run(1.5, 3, 1000), accuracy=1e-6, effects=Effect.NONE)]


@pytest.mark.parametrize('scene', SCENES)
def test_a_scene_file_with_its_origin_makes_the_same_scene_again(tmp_path, scene):
    text = scene_file(scene, {'frame_id': 'dragon'})
    assert strangers_scene('a', text) == scene
    (tmp_path / 'again.yaml').write_text(text)
    assert load_scene(str(tmp_path / 'again.yaml')) == scene
    about = yaml.safe_load(text)['about']
    assert about['dragon_ros'] == __version__
    assert about['numpy'] == np.__version__
    assert {key: about[key] for key in kernels()} == kernels()
    assert about['frame_id'] == 'dragon'


def test_another_kernel_is_one_of_which_numpy_or_kernels_are_recorded_and_are_others():
    made = run_metadata(scene_file(SCENES[1]), SCENES[1], {})
    assert other_kernel(made) is None
    assert other_kernel({}) is None
    blas, _, kernel = made['about.blas'].rpartition(' ')
    assert other_kernel(made | {'about.numpy': '1.2', 'about.blas': f'{blas} Z80'}) == (
        f"numpy '1.2', here {np.__version__!r}; blas 'Z80', here {kernel!r}")
    features = made['about.cpu_features']
    assert other_kernel(made | {'about.cpu_features': f'{features} MMX2'}) == "cpu_features 'MMX2', here fewer"


def test_metadata_has_scene_promise_effects_versions_and_recorder_as_text():
    text = scene_file(SCENES[1])
    told = run_metadata(text, SCENES[1], {'output': 'run.mcap'})
    assert told['scene'] == text
    assert (told['promise_m'], told['effects']) == ('2e-12', '')
    assert told['recorder.output'] == 'run.mcap'
    assert told['about.dragon_ros'] == __version__
    assert all(isinstance(value, str) for value in told.values())


@pytest.mark.parametrize('text', ['', 'benches: 3', '[1, 2]', 'about: 5', '{', 'track: {pitch_m: -1}',
                                  f'about: {{a: 0x{"f" * 9000}}}'])
def test_a_scene_that_cannot_be_read_is_kept_as_it_is(text):
    told = run_metadata(text, None, {})
    assert told['scene'] == text
    assert 'promise_m' not in told


@pytest.mark.parametrize('text', ['', 'a', 'abc', 'über: 龙\n'])
def test_text_is_a_message_and_back(text):
    data = string_message(text)
    assert read_string(data) == text
    with pytest.raises(MessageError):
        read_string(data[:6])


def test_reading_the_state_of_the_checkout_writes_nothing_to_it(tmp_path, monkeypatch):
    """A refreshed index is written through index.lock, which would remain if the process were killed."""
    package = tmp_path / 'dragon_ros' / 'scenes' / 'provenance.py'
    package.parent.mkdir(parents=True)
    package.write_text('x')
    for arguments in (['init', '-q'], ['add', '.'], ['commit', '-qm', 'x']):
        subprocess.run([*GIT, *arguments], cwd=tmp_path, check=True)
    os.utime(package, (1e9, 1e9))       # git refreshes the index if the time of a file differs
    index = (tmp_path / '.git' / 'index').read_bytes()
    monkeypatch.setattr(provenance, '__file__', str(package))
    assert len(provenance.versions.__wrapped__()['git']) == 40       # without +: no file is modified
    assert (tmp_path / '.git' / 'index').read_bytes() == index


@pytest.mark.parametrize(('version', 'named', 'distribution'), [
    ('7.1.6', None, 'jazzy'), ('9.1.2', 'jazzy', 'kilted'), ('10.0.1', 'jazzy', 'lyrical'),
    ('11.0.0', 'rolling', 'rolling'), ('11.0.0', None, 'unknown'), (None, 'humble', 'humble'), (None, None, 'unknown')])
def test_the_ros_distribution_is_the_one_that_runs(monkeypatch, version, named, distribution):
    def found(name):
        assert name == 'rclpy'
        if version is None:
            raise metadata.PackageNotFoundError(name)
        return version
    monkeypatch.setattr(metadata, 'version', found)
    monkeypatch.delenv('ROS_DISTRO', raising=False)
    if named:
        monkeypatch.setenv('ROS_DISTRO', named)
    assert provenance.ros_distro() == distribution
