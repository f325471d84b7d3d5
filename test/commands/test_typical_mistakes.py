"""Errors for typical mistakes of newcomers, students, teachers and Jupyter users name the value, limit and cure."""
import re

import pytest

import dragon_ros as dr
from dragon_ros.__main__ import main

# The command as typed, and the words that the answer must contain.
COMMANDS = {
    'tabel': 'did you mean table', 'table --time soon': "'soon' is neither a number", 'table --times 0-': 'write '
                                                                                                          '0,60,300',
    'table --times 500': '432.917923', 'table --handles 300': '0 to 223', 'table --handles 1,,2': 'is neither a number',
    'table --times 10:0:1': 'step must be positive', 'table --set dragon.benches 5': 'without a space',
    'table --set dragon.benches=-3': 'give at least 1', 'table --set dragon.bench=5': 'did you mean benches',
    'table --set track.pitch_m=0': 'at least 0.01', 'table --scene windig': 'did you mean winding',
    'table --scene bad.yaml': 'bad.yaml:1: dragon.benches', 'table --scene text.txt': 'not a mapping',
    'table --scene nowhere.yaml': 'cannot be read', 'table --accuracy quick': 'the names are',
    'table --output t.xls': 'the formats are', 'table --output t.xlsx --format csv': 'conflicts',
    'table --output nowhere/t.csv': 'cannot be written', 'table a.mcap': 'is not an MCAP file',
    'table winding': 'write --scene winding',
    'contact --within dragon.width_m=0.005': './dragon study tolerances',
    'contact --set run.stop_s=-1': 'give a later stop', 'design': 'QUESTION', 'design turns': "choose from 'turn'",
    'design turn --set track.diameter_m=5': 'give more than 5.752', 'design min-pitch --diameter 0': 'above 0',
    'design max-speed --scene winding': 'stop earlier', 'design fit --rectangle 3': 'design fit --help', 'plot': 'KIND',
    'plot speeds --time 9999': 'choose a time in', 'plot dragon --output a.bmp': 'must be one of .png, .svg, .pdf',
    'design fit winding': 'write --scene winding', 'contact --scene WINDING': 'did you mean winding',
    'inspect': 'BAG', 'inspect nowhere.mcap': 'cannot be read', 'export a.mcap': '--output',
    'simulate --output a.mcap': '--force', 'simulate --rate fast --output b.mcap': 'write a number such as 0.5',
    'view --port 99999999': '0 to 65535', 'cost --scene nowhere': 'is not known'}


@pytest.mark.parametrize('line', COMMANDS)
def test_a_mistake_on_the_command_line_is_one_line_with_its_cure_and_exit_code_2(line, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'bad.yaml').write_text('dragon: {benches: "40"}\n')
    (tmp_path / 'text.txt').write_text('hello')
    (tmp_path / 'a.mcap').write_bytes(b'x')
    before = sorted(tmp_path.iterdir())
    try:
        code = main(line.split())
    except SystemExit as end:
        code = end.code
    said = capsys.readouterr().err
    assert code == 2
    assert said.count('\n') == 1, said
    assert COMMANDS[line] in said
    assert sorted(tmp_path.iterdir()) == before


def run():
    return dr.compile(dr.scene('winding', dragon={'benches': 20}))


CALLS = {
    'compile': (lambda: dr.compile('winding'), "write dr.scene('winding')"),
    'states': (lambda: run().states(5), 'give for example'),
    'state list': (lambda: run().state([1, 2]), 'give a number'),
    'state text': (lambda: run().state('1'), 'without quotes'), 'state late': (lambda: run().state(1e9), '432.9'),
    'state nan': (lambda: run().state(float('nan')), 'finite'), 'state early': (lambda: run().state(-1), 'at least 0'),
    'frame': (lambda: run().frame(1.5), 'whole number'), 'frame late': (lambda: run().frame(10**9), 'has ticks'),
    'out': (lambda: run().states([1.0], out=5), 'give arrays for handles and velocities'),
    'scene': (lambda: dr.scene('windig'), 'did you mean winding'), 'scene 5': (lambda: dr.scene(5), 'give a string'),
    'scene key': (lambda: dr.scene(track={'pitch': 1}), 'did you mean pitch_m'),
    'scene section': (lambda: dr.scene(dragon=5), 'write a mapping'),
    'read_bag': (lambda: dr.read_bag('nowhere'), 'nowhere'),
    'plot': (lambda: dr.plot(5), "write dr.scene('winding')"),
    'fit': (lambda: dr.design.fit('winding'), 'write dr.scene'),
    'min_pitch': (lambda: dr.design.min_pitch(diameter_m='9'), 'without quotes'),
    'turn': (lambda: dr.design.turn(dr.scene('winding')), 'whose track.kind is turn'),
    'max_speed': (lambda: dr.design.max_speed(None), 'write dr.scene'),
    'track_m': (lambda: run().track_m(0), 'at least 1e-09'),
    'batches': (lambda: next(run().batches([1.0], 0)), 'at least 1')}


@pytest.mark.parametrize('name', CALLS)
def test_a_mistake_in_a_call_is_a_dragon_error_with_its_cure(name):
    call, says = CALLS[name]
    with pytest.raises(dr.DragonError, match=re.escape(says)) as raised:
        call()
    assert '\n' not in str(raised.value)
