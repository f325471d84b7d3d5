"""A bag that exceeds a budget is rejected with a one-line error that names the budget."""
import numpy as np
import pytest

from dragon_ros.bags.check import contacts
from dragon_ros.bags.read import folder, frames
from dragon_ros.bags.read.reader import BagError, BagReader
from dragon_ros.bags.write.writer import BagOptions, BagWriter
from dragon_ros.core.chain.commanded import walked_from
from dragon_ros.core.chain.dragon import Dragon
from dragon_ros.core.errors import InputError
from dragon_ros.core.model import compile_scene
from dragon_ros.core.scene import NS, Run, Scene
from dragon_ros.core.step import led_tick, tick
from dragon_ros.messages.channels import channels
from dragon_ros.messages.encode import encoders
from dragon_ros.pictures import sources
from dragon_ros.scenes.load import load_scene

SCENE = Scene(dragon=Dragon(3), run=Run(412, 412.2))


def written(path, scene, name, frames, options=None):
    """A bag that contains the messages of several frames on one topic."""
    with BagWriter(path, True, options or BagOptions('none')) as writer:
        writer.add_channel(f'/dragon/{name}', channels()[name])
        for k, frame in enumerate(frames):
            writer.write(f'/dragon/{name}', encoders(scene)[name](frame), scene.run.time_ns(k), k + 1)
    return path


def test_a_folder_of_too_many_files_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(folder, 'FOLDER_FILES', 20)
    for number in range(20):
        (tmp_path / f'{number}.mcap').touch()
    assert len(folder.files_of(tmp_path)) == 20
    (tmp_path / 'one_more.mcap').touch()
    with pytest.raises(BagError, match='has 21 files; the limit is 20'):
        BagReader(tmp_path)


def test_a_bag_of_too_many_ticks_is_not_drawn(tmp_path, monkeypatch):
    path = written(tmp_path / 'a.mcap', SCENE, 'handles', [tick(SCENE, k) for k in range(4)])
    for most, holds in ((4, True), (3, False)):
        monkeypatch.setattr(sources, 'PICTURE_TICKS', most)
        with BagReader(path) as bag:
            source = sources.BagSource(bag, '/dragon')
            if holds:
                assert np.allclose(source.span_s, (412, 412.06))
            else:
                with pytest.raises(InputError, match='has 4 ticks; pictures can show at most 3'):
                    source.span_s    # noqa: B018


def test_a_led_way_is_read_back_for_as_many_ticks_as_the_budget_says(tmp_path, monkeypatch):
    scene = load_scene('led')
    simulation, law, led = compile_scene(scene), walked_from(scene.head, 0.0), []
    for k in range(4):
        law = law.walked_on(scene.run.time_ns(k) / NS, 0.01 * k, 1.0) if k else law
        led.append(led_tick(simulation, law, k))
    path = written(tmp_path / 'led.mcap', scene, 'leader', led)
    with BagReader(path) as bag:
        monkeypatch.setattr(frames, 'LED_TICKS', 4)
        assert frames.walk_in(bag, scene, '/dragon').scene.run.stop_s == scene.run.time_ns(3) / NS
        monkeypatch.setattr(frames, 'LED_TICKS', 3)
        with pytest.raises(InputError, match='led for more than 3 ticks'):
            frames.walk_in(bag, scene, '/dragon')


def test_a_search_in_a_strangers_scene_ends_at_its_budget_unless_it_is_trusted(monkeypatch):
    scene = Scene(dragon=Dragon(5), run=Run(380, 400))
    monkeypatch.setattr(contacts, 'SEARCH_WORK', 20)
    with pytest.raises(InputError, match='of 5 benches; give --trust'):
        contacts.searched(scene, False)
    assert contacts.searched(scene, True).certificate.complete
    monkeypatch.setattr(contacts, 'SEARCHED_BENCHES', 4)
    with pytest.raises(InputError, match='has 5 benches, but only scenes with up to 4 are searched'):
        contacts.searched(scene, False)
