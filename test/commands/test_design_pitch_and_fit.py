"""``design min-pitch`` and ``design fit`` on the command line."""
import json
import re

import numpy as np
import pytest
from properties import thinned

from dragon_ros.__main__ import main


def run(capsys, *arguments):
    try:
        code = main(['design', *arguments])
    except SystemExit as stop:
        code = stop.code
    return code, *capsys.readouterr()


def test_min_pitch_prints_json_alone_with_the_true_figure(capsys):
    code, out, err = run(capsys, 'min-pitch', '--largest', '0.5', '--format', 'json')
    found = json.loads(out)
    assert (code, err) == (0, '')
    assert found['high_m'] == pytest.approx(0.4503373930, abs=1e-10)
    assert (found['benches'], found['radius_m']) == ([0, 19], pytest.approx(4.5726, abs=1e-4))


def test_min_pitch_takes_the_dragon_of_a_scene_and_another_circle(capsys):
    code, out, _ = run(capsys, 'min-pitch', '--set', 'dragon.benches=40', '--diameter', '6', '--within', '1e-6')
    assert code == 0
    assert 'the smallest pitch is 0.51338' in out


@pytest.mark.parametrize(('arguments', 'says'), [
    (['--smallest', '0.46'], '--smallest: 0.46 is not valid: no benches touch at this pitch; give a smaller pitch'),
    (['--set', 'venue={obstacles: [], inside: [[-99, -99], [99, -99], [0, 99]]}'],
     'venue: min-pitch does not take obstacles into account; omit the venue (--set venue=null)'),
    (['--within', '2'], '--within: 2.0 is not valid')])
def test_min_pitch_names_an_option_that_it_cannot_use(capsys, arguments, says):
    code, out, err = run(capsys, 'min-pitch', '--set', 'dragon.benches=40', *arguments)
    assert (code, out) == (2, '')
    assert says in err


@pytest.mark.parametrize(('side', 'says'), [('24', 'the dragon fits\n'), ('23.8', 'fits only off the centre'),
                                            ('23.7', 'does not fit')])
def test_fit_says_whether_it_does(capsys, side, says):
    code, out, _ = run(capsys, 'fit', '--set', 'run.stop_s=30', '--square', side)
    assert code == 0
    assert says in out
    assert '23.99411132' in out


@pytest.mark.parametrize(('margin_m', 'code', 'says'), thinned([
    ('0.9', 0, 'the dragon fits, with a gap of at least 0.9 m to all obstacles'),
    ('1.2', 1, 'the dragon does not fit, because the gap is less than 1.2 m to lamp post\n'),
    ('2', 1, 'to lamp post, left wall, right wall\n')], lambda case: case[0] == '1.2'))
def test_fit_in_a_venue_tells_each_gap_and_what_lacks_margin(capsys, margin_m, code, says):
    scene = '--scene', 'street', '--set', 'dragon.benches=8', '--set', 'run.stop_s=75'
    found, out, _ = run(capsys, 'fit', *scene, '--set', f'venue.margin_m={margin_m}')
    assert (found, out.splitlines()[0][:22]) == (code, 'lamp post: 0.939000 m,')
    assert says in out
    said = out
    found, out, _ = run(capsys, 'fit', *scene, '--set', f'venue.margin_m={margin_m}', '--format', 'json')
    assert (found, json.loads(out)['venue'][0]['name']) == (code, 'lamp post')
    room = json.loads(out)['room']
    width, at = max(zip(np.add(room['left_m'], room['right_m']), room['at_m'], strict=True))
    text = re.search(r'at least ([.\d]+) m wide, at (\d+) m along .* sampled', said)
    assert (float(text[1]), float(text[2])) == (pytest.approx(width, abs=6e-4), at)
    assert np.diff(room['at_m']).tolist() == [1.0] * (len(room['at_m']) - 1)
    code, _, err = run(capsys, 'fit', '--scene', 'street', '--square', '9')
    assert (code, '--square: it is not available for a scene with a venue' in err) == (2, True)


@pytest.mark.parametrize(('arguments', 'says'), [
    (['min-pitch', '--largest', '0.1'], '--largest: 0.1 '),
    (['min-pitch', '--diameter', 'nan'], "--diameter: 'nan' is not a finite number"),
    (['min-pitch', '--within', '0'], '--within: 0.0 '),
    (['min-pitch', '--set', 'track.start_turns=5'], 'track.start_turns: 5'),
    (['fit', '--square', '-3'], '--square'), (['fit', '--set', 'head.speed_m_s=-1'], 'run.stop_s'),
])
def test_what_cannot_be_answered_exits_with_2_and_a_clear_line(capsys, arguments, says):
    code, out, err = run(capsys, *arguments)
    assert (code, out) == (2, '')
    assert says in err
