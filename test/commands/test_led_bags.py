"""Commands examine all recorded ticks of a led dragon, or say up to which tick they did and exit with 3."""
import json

import pytest

import dragon_ros as dr
from dragon_ros.__main__ import main
from dragon_ros.bags.read.frames import law_on
from dragon_ros.bags.write.writer import BagWriter
from dragon_ros.core.geometry.near_pairs import closeness
from dragon_ros.core.model import compile_scene
from dragon_ros.core.step import led_tick
from dragon_ros.messages.cdr import string_message
from dragon_ros.messages.channels import channels
from dragon_ros.messages.encode import encoders
from dragon_ros.messages.markers import track_marker
from dragon_ros.scenes.load import load_scene
from dragon_ros.scenes.provenance import run_metadata, scene_file

LED = load_scene('led', ['dragon.benches=60', 'track.start_turns=4.4', 'run.rate_hz=10', 'run.stop_s=100'])
ENCODE = encoders(LED)


def walk(ticks, speed_m_s=0.5):
    law = None
    for k in range(ticks):
        law = law_on(LED, law, LED.run.time_ns(k), speed_m_s * (k > 0))
        yield k, led_tick(compile_scene(LED), law, k)


def write(path, *runs, copies=lambda name, k: 1):
    """Write the ticks of one or several runs, each message as often as ``copies`` says."""
    text, sent = scene_file(LED), 0
    with BagWriter(path) as bag:
        bag.describe('dragon_ros', run_metadata(text, LED, {}))
        for name, data in {'scene': string_message(text), 'track': track_marker(LED, 'dragon')}.items():
            bag.add_channel(f'/dragon/{name}', channels()[name])
            bag.write(f'/dragon/{name}', data, LED.run.start_ns, 1)
        for name in ENCODE:
            bag.add_channel(f'/dragon/{name}', channels()[name])
        for k, frame in (row for run in runs for row in run):
            sent += 1
            for name in ENCODE:
                for _ in range(copies(name, k)):
                    bag.write(f'/dragon/{name}', bytes(ENCODE[name](frame)), frame.t_ns, sent, 10**18 + sent)
    return path


@pytest.fixture(scope='module')
def touching():
    """The number of the first recorded tick in which benches touch."""
    return next(k for k, frame in walk(400) if closeness(frame.chain.p, frame.benches).clearance_m < 0)


def run(capsys, *words):
    code = main([str(word) for word in words])
    return code, *capsys.readouterr()


def test_a_whole_led_bag_is_examined_to_its_last_tick(capsys, tmp_path, touching):
    bag = write(tmp_path / 'a.mcap', walk(touching + 5))
    code, out, _ = run(capsys, 'contact', bag, '--certificate', tmp_path / 'proof.json')
    assert (code, 'first contact at' in out, (tmp_path / 'proof.json').exists()) == (0, True, True)
    before = write(tmp_path / 'b.mcap', walk(touching - 5))
    assert run(capsys, 'contact', before)[:1] == (0,)


def test_a_missing_speed_ends_the_examination_with_a_word_and_exit_code_3(capsys, tmp_path, touching):
    lost = touching // 2
    bag = write(tmp_path / 'a.mcap', walk(touching + 5), copies=lambda name, k: (name, k) != ('leader', lost))
    code, out, err = run(capsys, 'contact', bag, '--certificate', tmp_path / 'proof.json')
    examined = f'examined only to {(lost - 1) / 10:.9f} of {(touching + 4) / 10:.9f} s'
    assert code == 3
    assert out.startswith(f'no contact; {examined}, because the speed of the leader')
    assert f'no certificate is written: {examined}' in err
    assert not (tmp_path / 'proof.json').exists()
    code, out, _ = run(capsys, 'contact', bag, '--format', 'json')
    found = json.loads(out)
    assert (code, found['certified'], found['examined_s'], found['recorded_s']) == (
        3, False, (lost - 1) / 10, (touching + 4) / 10)
    code, out, _ = run(capsys, 'inspect', bag)
    assert (code, f'first contact: unknown; {examined}' in out) == (3, True)
    assert run(capsys, 'inspect', bag, '--check')[0] == 1


def test_a_speed_recorded_twice_hides_no_tick(capsys, tmp_path, touching):
    bag = write(tmp_path / 'a.mcap', walk(touching + 5), copies=lambda name, k: 1 + ((name, k) == ('leader', 7)))
    code, out, _ = run(capsys, 'contact', bag)
    assert (code, 'first contact at' in out) == (0, True)
    assert run(capsys, 'inspect', bag, '--check')[0] == 1


def test_two_runs_in_one_bag_are_never_mixed(capsys, tmp_path):
    bag = write(tmp_path / 'a.mcap', walk(30), walk(20, -0.3))
    says = 'the run was reset or sought back while it was recorded: the bag holds several runs'
    for words in (['contact', bag], ['table', bag, '--times', '1', '--handles', '0'],
                  ['plot', 'clearance', '--bag', bag, '--output', tmp_path / 'a.png'],
                  ['export', bag, '--output', tmp_path / 'a.csv']):
        code, _, err = run(capsys, *words)
        assert (code, says in err, len(err.splitlines())) == (2, True, 1), words
    code, out, _ = run(capsys, 'inspect', bag)
    assert (code, says in out) == (3, True)
    assert run(capsys, 'inspect', bag, '--check')[0] != 0
    with dr.read_bag(bag) as recorded, pytest.raises(dr.InputError, match='several runs'):
        recorded.arrays()


def test_a_tick_recorded_twice_is_no_second_run(tmp_path):
    bag = write(tmp_path / 'a.mcap', walk(10), copies=lambda name, k: 1 + (k == 4))
    with dr.read_bag(bag) as recorded:
        assert recorded.arrays().t_s.tolist() == [k / 10 for k in range(10)]
