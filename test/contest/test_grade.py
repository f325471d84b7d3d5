"""`grade` names the mistakes in a result and no others, despite noise and rounding."""
import json
from dataclasses import replace
from math import pi

import numpy as np
import pytest
from properties import thinned

from dragon_contest import mistakes
from dragon_contest.grade import team
from dragon_contest.grade.diagnosis import _along_track, answer_findings, nice, rounded_to, share
from dragon_contest.grade.layout import GivenResult
from dragon_contest.grade.tables import (
    COLUMNS,
    causes_of,
    csv_text,
    json_text,
    keys_of,
    lacks_of,
    looks_like,
    text_of,
)
from dragon_contest.grade.team import Problem, Team, TeamGrade, answer_grade, grade_team, grades_of
from dragon_contest.grade.truth import contact_s, state_at, truth_at, turned_scene, wound_scene
from dragon_contest.mistakes import (
    along,
    arc_length,
    chord,
    differences,
    euler,
    grid,
    links_of,
    placed_angles,
    points,
    solved,
)
from dragon_ros.core.chain.dragon import Dragon
from dragon_ros.core.step import state
from dragon_ros.core.tracks.spec import STurn

TIMES = np.arange(0.0, 301.0, 25.0)
TURNING = np.arange(-100.0, 101.0, 10.0)
EXACT = solved(arc_length)


def given(p, speed=None, times=TIMES):
    speed = np.full(p.shape[:2], np.nan) if speed is None else speed
    return GivenResult(times, np.concatenate((p, speed[..., None]), axis=-1))


def right(result='result1', times=TIMES):
    return truth_at(result, times)


def wound(head=EXACT, rule=None, links=None, times=TIMES):
    return points(placed_angles(head(times), rule or chord(), links or links_of()))


def polar(scale):
    """Return positions computed from angles that were passed to cos and sin in the wrong unit."""
    radius = np.hypot(*np.moveaxis(right().handles_m, -1, 0))
    angle = radius * 2 * pi / 0.55 * scale
    return radius[..., None] * np.stack((np.cos(angle), np.sin(angle)), axis=-1)


def turned(angle, mirrored=False, shift=(0.0, 0.0)):
    p = right().handles_m * (1, -1 if mirrored else 1)
    c, s = np.cos(angle), np.sin(angle)
    return p @ np.array(((c, s), (-s, c))) + shift


def shifted(p, by):
    return np.concatenate((p[:, by:], p[:, -1:] + np.arange(by)[:, None] + 1), axis=1)


def one_pitch(pitch_m):
    times = np.arange(0.0, 41.0)
    p = points(placed_angles(solved(arc_length, pitch_m=pitch_m)(times), chord(pitch_m=pitch_m), links_of()), pitch_m)
    return p, times


POSITIONS = {
    'radial_arc': lambda: wound(solved(mistakes.without_radial)),
    'bracket_slip': lambda: wound(mistakes.bracket_slip()),
    'euler(step=1)': lambda: wound(euler(1.0)),
    'euler(step=0.01)': lambda: wound(euler(0.01)),
    'euler_radial(step=0.01)': lambda: wound(euler(0.01, radial=False)),
    'along': lambda: wound(rule=along),
    'chord_short(short=0.01)': lambda: wound(rule=chord(0.01)),
    'chord_short(short=0.0001)': lambda: wound(rule=chord(0.0001)),
    'body_link_for_head': lambda: wound(links=links_of(1.65)),
    'head_link_for_body': lambda: wound(links=links_of(2.86, 2.86)),
    'whole_benches': lambda: wound(links=links_of(3.41, 2.2)),
    'links(head=2.86, body=1.7)': lambda: wound(links=links_of(2.86, 1.7)),
    'grid(step=0.01, within=0.01)': lambda: wound(rule=grid(0.01, 0.01)),
    'grid_past(step=0.001, within=0)': lambda: wound(rule=grid(0.001, 0.0)),
    'paper': lambda: np.stack([state(replace(mistakes.winding(), accuracy='paper'), t_s).p for t_s in TIMES.tolist()]),
    'time_shift(shift=1)': lambda: wound(lambda t_s: EXACT(t_s + 1)),
    'start_turns(turns=17)': lambda: wound(solved(arc_length, start=34 * pi)),
    'speed(speed=1.01)': lambda: wound(lambda t_s: EXACT(1.01 * t_s)),
    'outward': lambda: wound(lambda t_s: EXACT(-t_s)),
    'euler(step=0.5) + chord_short(short=0.001)': lambda: wound(euler(0.5), chord(0.001)),
    'centimetres': lambda: 100 * right().handles_m,
    'radians_as_degrees': lambda: polar(pi / 180),
    'degrees_as_radians': lambda: polar(180 / pi),
    'mirrored_x': lambda: right().handles_m * (1, -1),
    'swapped': lambda: right().handles_m[..., ::-1],
    'rotated_90': lambda: turned(pi / 2),
    'rotated_rigid(angle=30, dx=0.5, dy=-0.25)': lambda: turned(pi / 6, shift=(0.5, -0.25)),
    'mirrored_rigid(angle=30, dx=0, dy=0)': lambda: turned(pi / 6, True),
    'rows_reversed': lambda: right().handles_m[:, ::-1],
    'handles_shifted(by=1)': lambda: shifted(right().handles_m, 1),
    'mirrored_y + chord_short(short=0.01)': lambda: wound(rule=chord(0.01)) * (-1, 1),
    'rows_mixed': lambda: np.moveaxis(right().handles_m, 1, -1).reshape(len(TIMES), 224, 2),
}


def plain(findings):
    """Return the keys of all findings except ``rounded``, with parameters rounded to five decimals."""
    kept = [one._replace(parameters={name: round(value, 5) + 0.0 if isinstance(value, float) else value
                                     for name, value in one.parameters.items()}) for one in findings]
    return keys_of(one for one in kept if one.key != 'rounded')


USUAL = ('bracket_slip', 'euler(step=0.01)', 'euler_radial(step=0.01)', 'along', 'chord_short(short=0.0001)',
         'whole_benches', 'links(head=2.86, body=1.7)', 'grid(step=0.01, within=0.01)', 'paper', 'time_shift(shift=1)',
         'euler(step=0.5) + chord_short(short=0.001)', 'radians_as_degrees',
         'rotated_rigid(angle=30, dx=0.5, dy=-0.25)', 'handles_shifted(by=1)', 'mirrored_y + chord_short(short=0.01)',
         'rows_mixed')


@pytest.mark.parametrize('key', thinned(POSITIONS, USUAL.__contains__))
def test_a_remade_mistake_is_named_with_its_parameter_in_spite_of_six_decimals(key):
    positions, _ = grades_of('result1', given(np.round(POSITIONS[key](), 6)))
    assert plain(positions.findings) == key
    assert positions.explains >= 0.99
    assert positions.worst > 1e-5


@pytest.mark.parametrize(('key', 'noise_m', 'digits'), thinned([
    ('euler(step=1)', 1e-3, 6), ('chord_short(short=0.01)', 1e-4, 6), ('along', 1e-3, 6), ('along', 0.0, 3),
    ('euler(step=1)', 0.0, 2), ('mirrored_x', 1e-3, 3), ('body_link_for_head', 1e-3, 3)],
    lambda case: case[0] == 'chord_short(short=0.01)' or case[1:] in ((0.0, 2), (1e-3, 3))))
def test_noise_and_rounding_do_not_hide_a_mistake(key, noise_m, digits):
    p = POSITIONS[key]() + np.random.default_rng(1).normal(0, noise_m, (len(TIMES), 224, 2))
    positions, _ = grades_of('result1', given(np.round(p, digits)))
    assert key in plain(positions.findings)
    assert ('rounded' in {one.key for one in positions.findings}) == (digits < 6)
    assert positions.explains >= 0.99


def test_a_pitch_that_differs_is_fitted():
    p, times = one_pitch(0.5)
    positions, _ = grades_of('result1', given(np.round(p, 6), times=times))
    assert plain(positions.findings) == 'pitch(pitch=0.5)'


@pytest.mark.parametrize('p', [
    pytest.param(lambda rng: right().handles_m + rng.normal(0, 0.1, (len(TIMES), 224, 2)), id='noise'),
    pytest.param(lambda rng: rng.uniform(-9, 9, (len(TIMES), 224, 2)), id='anywhere'),
    pytest.param(lambda rng: wound(lambda t_s: EXACT(t_s + 0.3 * np.sin(t_s))), id='swinging head'),
    pytest.param(lambda rng: np.cumsum(rng.normal(0, 0.2, (len(TIMES), 224, 2)), axis=1), id='walk'),
    pytest.param(lambda rng: right().handles_m * (1.2, 1.0), id='stretched')])
def test_what_no_mistake_explains_is_unknown(p):
    positions, _ = grades_of('result1', given(p(np.random.default_rng(2))))
    assert positions.findings[-1].key == 'unknown'
    assert positions.explains < 0.99
    assert looks_like(positions, 'en').startswith('unknown')


def test_a_tolerance_that_scatters_is_seen_and_not_called_an_explanation():
    rng = np.random.default_rng(3)
    p = wound(rule=lambda theta, link_m: chord()(theta, link_m + rng.uniform(-1e-3, 1e-3)) + rng.uniform(
        -1e-4, 1e-4, theta.shape))
    positions, _ = grades_of('result1', given(p))
    assert [one.key for one in positions.findings] == ['tolerance', 'unknown']


def test_the_truth_is_right_if_no_cell_is_missing():
    times = np.arange(301.0)
    p, speed = (np.round(one, 6) for one in right(times=times))
    assert [(one.verdict, one.findings, one.within) for one in grades_of('result1', given(p, speed, times))] == [
        ('right', (), (1.0, 1.0, 1.0))] * 2
    p[3, 5, 0] = np.nan
    assert [(one.verdict, one.expected - one.cells, one.findings)
            for one in grades_of('result1', given(p, speed, times))] == [('incomplete', 1, ()), ('right', 0, ())]
    assert [one.verdict for one in grades_of('result1', given(p[:-1], speed[:-1], times[:-1]))] == ['incomplete'] * 2


def test_a_few_wrong_cells_are_counted():
    p, speed = (np.round(one, 6) for one in right())
    p[3, 5, 0] += 0.5
    positions, _ = grades_of('result1', given(p, speed))
    assert plain(positions.findings) == 'few_cells(count=1, handle=5, t=75)'
    assert (positions.worst, positions.handle, positions.t_s) == (pytest.approx(0.5, abs=1e-6), 5, 75.0)


def test_a_wrong_cell_of_result_2_is_placed_at_the_contact():
    truth = right('result2', np.array([np.nan]))
    p = truth.handles_m.copy()
    p[0, 3, 0] += 0.5
    sheets = tuple(grades_of('result2', given(p, truth.speed_m_s, np.array([np.nan]))))
    assert sheets[0].findings[0].parameters == {'count': 1, 'handle': 3, 't': contact_s()}
    text = json_text([TeamGrade('a', (), sheets, ())])
    json.loads(text, parse_constant=pytest.fail)


@pytest.mark.parametrize('value', [0.0, 1.0, 3.0, 0.1234567, 1e100])
def test_a_table_of_one_number_is_not_explained_by_a_motion_or_by_rounding(value):
    p = np.full((len(TIMES), 224, 2), value)
    sheets = grades_of('result1', given(p, p[..., 0] + 2.0))
    assert [(one.findings[-1].key, one.explains < 0.99) for one in sheets] == [('unknown', True)] * 2


@pytest.mark.parametrize('result', ['result1', 'result2', 'result4'])
@pytest.mark.parametrize('damage', thinned([
    lambda p: np.where(np.arange(224)[:, None] < 30, 0.0, p), lambda p: 0.0 * p,
    lambda p: np.where(np.arange(224)[:, None] > 200, np.nan, p), lambda p: p * (1, np.nan),
    lambda p: p[:, :1] + 0 * p, lambda p: 1e99 * p], lambda damage: damage(np.ones((1, 224, 2)))[0, 0, 0] == 0))
def test_any_table_of_numbers_gets_a_finite_verdict(result, damage):
    times = {'result1': TIMES[::4], 'result2': np.array([np.nan]), 'result4': TURNING[::5]}[result]
    truth = right(result, times)
    sheets = tuple(grades_of(result, given(damage(truth.handles_m), damage(truth.handles_m)[..., 0], times)))
    json.loads(json_text([TeamGrade('a', (), sheets, ())]), parse_constant=pytest.fail)


def without_a_head(p):
    """Handles counted from 1: the head is missing, and the chords of the others are too long."""
    return np.concatenate((np.full_like(p[:, :1], np.nan), 1.1 * p[:, :-1]), axis=1)


@pytest.mark.parametrize('spoil', [
    without_a_head, lambda p: np.where(np.arange(224)[:, None] == 1, np.nan, p * 1.1),
    lambda p: np.where(np.arange(224)[:, None] > 0, np.nan, p * (1.1, 1)), lambda p: p[:, 5:6] + 0 * p + 9,
    lambda p: np.where(np.isin(np.arange(224), (0, 1, 51, 101, 151, 201, 223))[:, None], 1.01 * p, np.nan)])
@pytest.mark.parametrize('result', ['result1', 'result4'])
def test_what_cannot_be_fitted_is_unknown_and_ends_no_grading(result, spoil):
    times = TIMES if result == 'result1' else TURNING
    positions, speeds = grades_of(result, given(spoil(right(result, times).handles_m), times=times))
    assert (positions.verdict, positions.findings[-1].key, speeds.verdict) == ('wrong', 'unknown', 'missing')
    assert 0 <= positions.explains < 0.99


def test_a_fit_that_fails_ends_neither_the_grading_nor_the_team(monkeypatch):
    def fail(*_):
        raise np.linalg.LinAlgError('SVD did not converge')
    monkeypatch.setattr(team, 'diagnose_positions', fail)
    truth = right()
    positions, speeds = grades_of('result1', given(truth.handles_m + 1, truth.speed_m_s))
    assert (positions.verdict, positions.findings[-1].key, speeds.findings) == ('wrong', 'unknown', ())


@pytest.mark.parametrize('factor', [1e3, 1e12])
def test_times_at_which_there_is_no_state_are_not_graded(factor):
    sheets = grades_of('result4', given(right('result4', TURNING).handles_m, times=TURNING * factor))
    assert [(one.sheet, one.cells) for one in sheets] == [('positions', 2 * 224), ('speeds', 0)]


@pytest.mark.parametrize('digits', [0, 1])
def test_wrong_values_in_centimetres_are_not_explained_by_their_unit(digits):
    p, speed = (np.round(100 * one, digits) for one in right())
    sheets = grades_of('result1', given(p, speed))
    assert [(plain(one.findings), one.explains) for one in sheets] == [('centimetres', 1.0)] * 2
    rng = np.random.default_rng(4)
    sheets = grades_of('result1', given(p + 30 * rng.integers(-1, 2, p.shape), speed + 5 * rng.integers(-1, 2,
                                                                                                   speed.shape)))
    assert [one.findings[-1].key for one in sheets] == ['rest', 'unknown']


@pytest.mark.parametrize('digits', [0, 2, 4])
def test_rounded_digits_alone_are_all_that_is_wrong(digits):
    positions, _ = grades_of('result1', given(*(np.round(one, digits) for one in right())))
    assert plain(positions.findings) == ''
    assert positions.findings[0].parameters == {'digits': digits}
    assert positions.explains == 1.0


SPEEDS = {
    'all_one': lambda: np.ones((len(TIMES), 224)),
    'centimetres': lambda: 100 * right().speed_m_s,
    'negative': lambda: -right().speed_m_s,
    'differences(kind=forward, step=1)': lambda: by_differences(1.0, 'forward'),
    'differences(kind=backward, step=0.1)': lambda: by_differences(0.1, 'backward'),
    'differences(kind=central, step=1)': lambda: by_differences(1.0, 'central'),
    'inverted': lambda: 1 / right().speed_m_s,
    'power_law': lambda: power_law(),
    'rows_reversed': lambda: right().speed_m_s[:, ::-1],
}


def by_differences(step_s, kind):
    scene, offset_s = wound_scene()
    return differences(scene, TIMES + offset_s, step_s, kind)


def power_law():
    radius = np.hypot(*np.moveaxis(right().handles_m, -1, 0))
    return (radius[:, :1] / radius) ** 0.02


@pytest.mark.parametrize('key', SPEEDS)
def test_a_mistake_of_speeds_is_named(key):
    _, speeds = grades_of('result1', given(right().handles_m, np.round(SPEEDS[key](), 8)))
    assert plain(speeds.findings) == key
    assert speeds.explains >= 0.99


def test_a_cause_that_is_found_in_the_positions_explains_the_speeds_that_follow_from_them():
    theta = placed_angles(EXACT(TIMES), chord(0.01), links_of())
    _, speeds = grades_of('result1', given(points(theta), mistakes.projected(theta)))
    assert plain(speeds.findings) == 'chord_short(short=0.01)'


def test_speeds_that_follow_from_inexplicable_positions_are_said_to_agree_with_them():
    theta = placed_angles(EXACT(TIMES + 0.3 * np.sin(TIMES)), chord(), links_of())
    positions, speeds = grades_of('result1', given(points(theta), mistakes.projected(theta)))
    assert (positions.findings[-1].key, plain(speeds.findings)) == ('unknown', 'speeds_of_given')


@pytest.mark.parametrize(('t_s', 'keys'), [
    (413.0, 'moment(t=413) + looked(step=1)'), (412.5, 'moment(t=412.5) + looked(step=0.1)'),
    (412.0, 'moment(t=412) + looked_before(step=1)'), (410.1234, 'moment(t=410.123)'),
    (412.48, 'moment(t=412.48) + looked(step=0.01)')])
def test_result_2_says_which_moment_it_is_and_what_ends_there(t_s, keys):
    p = np.round(wound(times=np.array([t_s])), 6)
    positions, _ = grades_of('result2', given(p, times=np.array([np.nan])))
    assert keys_of(positions.findings).startswith(keys)
    assert positions.explains >= 0.99


def test_result_2_of_short_chords_is_the_contact_of_these():
    t_s = mistakes.touch_s(EXACT, chord(0.001))
    p = np.round(wound(rule=chord(0.001), times=np.array([t_s])), 8)
    positions, _ = grades_of('result2', given(p, times=np.array([np.nan])))
    assert {'chord_short', 'moment_of_links'} <= {one.key for one in positions.findings} | {
        'moment_of_links' if one.key == 'chord_short' else one.key for one in positions.findings}


@pytest.mark.parametrize(('dragon', 'track', 'shift_s', 'keys'), thinned([
    ({}, {'ratio': 1.0}, 0.0, 'turn_ratio(ratio=1)'), ({}, {'diameter_m': 9.1}, 0.0, 'turn_diameter(diameter=9.1)'),
    ({}, {}, 1.0, 'turn_shift(shift=1)'),
    ({'body_length_m': 2.21, 'head_length_m': 3.42}, {}, 0.0, 'chord_long(long=0.01)'),
    ({}, {'diameter_m': 9.1, 'ratio': 1.5}, 0.0, 'turn_both(ratio=1.5, diameter=9.1)')],
    lambda case: case[-1].startswith(('turn_both', 'turn_shift', 'chord_long'))))
def test_a_mistake_on_the_turn_is_fitted(dragon, track, shift_s, keys):
    scene, offset_s = turned_scene(Dragon(**dragon), STurn(**track))
    p, speed = state_at(scene, TURNING + shift_s + offset_s)
    positions, _ = grades_of('result4', given(np.round(p, 6), speed, TURNING))
    assert plain(positions.findings) == keys
    assert positions.explains >= 0.99


@pytest.mark.parametrize('step_s', [1.0, 0.1])
def test_euler_steps_on_both_spirals_of_the_turn_are_named(step_s):
    scene, offset_s = turned_scene()
    p, _ = state_at(scene, mistakes.euler_on_turn_m(TURNING, step_s) + offset_s)
    positions, _ = grades_of('result4', given(np.round(p, 6), times=TURNING))
    assert plain(positions.findings) == f'euler(step={step_s:g})'
    assert positions.explains >= 0.99


def test_links_along_the_turn_are_named_alone_and_behind_a_late_head():
    for shift_s, keys in ((0.0, 'turn_along'), (1.0, 'turn_shift(shift=1) + turn_along')):
        p = mistakes.along_turn(TURNING + shift_s, links_of(), STurn())
        positions, _ = grades_of('result4', given(np.round(p, 6), times=TURNING))
        assert plain(positions.findings) == keys
        assert positions.explains >= 0.99


@pytest.mark.parametrize(('step', 'within_m', 'of_angle', 'shift_s', 'keys'), thinned([
    (0.01, 0.01, True, 0.0, 'grid(step=0.01, within=0.01)'),
    (0.01, 0.0, False, 0.0, 'turn_grid_past(step=0.01, within=0)'),
    (0.001, 0.01, False, 1.0, 'turn_shift(shift=1) + turn_grid(step=0.001, within=0.01)')],
    lambda case: case[3] > 0))
def test_coarse_steps_on_the_turn_are_named(step, within_m, of_angle, shift_s, keys):
    p = mistakes.grid_on_turn(TURNING + shift_s, links_of(), STurn(), step, within_m, of_angle)
    positions, _ = grades_of('result4', given(np.round(p, 6), times=TURNING))
    assert plain(positions.findings) == keys
    assert positions.explains >= 0.99


def test_steps_on_the_turn_are_as_their_recipe_says():
    """Each handle is a whole number of steps behind the previous one; with one step fewer, the chord is too short."""
    angle, step = mistakes.TurnAngle(STurn()), 0.01
    metres = np.linspace(-300.0, 100.0, 401)
    np.testing.assert_allclose(angle.metres(angle.of(metres)), metres, atol=1e-11)
    np.testing.assert_allclose(np.diff(angle.joints), STurn().length_m / (3 * 1.5027088), rtol=1e-6)
    links = links_of(handles=60)
    p = mistakes.grid_on_turn(TURNING, links, STurn(), step, 0.0, False)
    chords = np.hypot(*np.moveaxis(np.diff(p, axis=1), -1, 0)) - links
    assert 0 <= chords.min() < 1e-3 < 0.009 < chords.max() < step


def test_steps_of_angles_restart_where_a_piece_of_the_turn_ends():
    angle, step = mistakes.TurnAngle(STurn()), 0.2
    times = np.linspace(-5.0, 30.0, 36)
    p = mistakes.grid_on_turn(times, links_of(handles=12), STurn(), step, 0.0, True)
    at = angle.of(_along_track(p, times, STurn())[0])
    crossed, ended = 0, 0
    for front, rear in zip(at[:, :-1].ravel(), at[:, 1:].ravel(), strict=True):
        joints = [joint for joint in angle.joints if rear < joint - 1e-6 and joint + 1e-6 < front]
        crossed += len(joints)
        count = ((joints[0] if joints else front) - rear) / step
        if np.min(np.abs(angle.joints - rear)) < 1e-6:      # the step would lead beyond the end of a piece
            ended += 1
        else:
            assert count == pytest.approx(round(count), abs=1e-4)
    assert (crossed > 20, ended > 0) == (True, True)


def test_a_stretch_of_the_turn_is_neither_euler_steps_nor_links_along_it():
    positions, _ = grades_of('result4', given(right('result4', TURNING).handles_m * (1.05, 1.0), times=TURNING))
    assert positions.findings[-1].key == 'unknown'


def test_times_that_count_from_0_are_read_as_result_4_shifted():
    scene, offset_s = turned_scene()
    p, speed = state_at(scene, TURNING + offset_s)
    positions, _ = grades_of('result4', given(np.round(p, 6), speed, TURNING + 100))
    assert plain(positions.findings) == 'turn_shift(shift=-100)'


def test_a_wrong_parameter_explains_less():
    p, true = wound(euler(1.0)), right().handles_m
    assert share(p, wound(euler(1.0)), true) == 1.0
    assert share(p, wound(euler(0.5)), true) < 0.8
    assert share(p, true, true) == 0.0


@pytest.mark.parametrize(('question', 'value', 'verdict', 'keys'), [
    ('t_s', 412.473838, 'right', ''), ('t_s', 412.47, 'right', 'right_to(digits=2)'),
    ('t_s', 412.48, 'close', 'looked(step=0.01)'), ('t_s', 412.5, 'wrong', 'looked(step=0.1)'),
    ('t_s', 412.0, 'wrong', 'looked_before(step=1)'),
    ('t_s', 412.474054, 'close', 'bracket_slip_short'),
    ('t_s', 413.0, 'wrong', 'looked(step=1)'), ('t_s', 412.3, 'wrong', 'paper_contact'),
    ('t_s', 409.700394, 'wrong', 'near_counts(near=0.001)'), ('t_s', 400.0, 'wrong', 'unknown'),
    ('pitch_m', 0.450337, 'right', ''), ('pitch_m', 0.45034, 'right', 'right_to(digits=5)'),
    ('pitch_m', 0.45, 'right', 'right_to(digits=2)'), ('turn_m', 13.62, 'right', 'right_to(digits=2)'),
    ('turn_m', 14.1372, 'wrong', 'half_turns'), ('speed_m_s', 1.25, 'right', 'right_to(digits=2)'),
    ('pitch_m', 0.417138, 'wrong', 'on_circle'),
    ('turn_m', 13.621245, 'right', ''), ('turn_m', 13.7146, 'wrong', 'angle_and_radii'),
    ('speed_m_s', 1.246266, 'right', ''), ('speed_m_s', 1.406277, 'wrong', 'speed_looked(step=1)')])
def test_answers_in_one_number_are_graded(question, value, verdict, keys):
    grade = answer_grade(question, value)
    assert (grade.verdict, keys_of(grade.findings)) == (verdict, keys)


def test_nice_numbers_are_taken_only_close_to_the_fitted_ones():
    assert [nice(value) for value in (0.0101, 0.98, 0.37)] == [0.01, 1.0, 0.37]
    assert [rounded_to(np.array(values)) for values in ([1.5, 2.25], [1.0], [0.1234567])] == [2, 0, None]
    assert answer_findings('pitch_m', 0.3) == []
    assert contact_s() == pytest.approx(412.473837682115, abs=1e-9)


def graded():
    speed = right().speed_m_s
    sheets = grades_of('result1', given(np.round(wound(rule=chord(0.01)), 6), speed))
    return TeamGrade('=team "1"', ('result1.xlsx',), tuple(sheets), (answer_grade('t_s', 412.3),),
                     (('sheet_empty', {'sheet': 'a'}),), (Problem('b.xlsx', 'empty_file', {}),))


def test_json_and_csv_have_the_keys_that_are_documented():
    values = json.loads(json_text([graded()]))
    assert list(values) == ['format', 'bounds', 'teams']
    team = values['teams'][0]
    assert list(team) == ['team', 'files', 'results', 'answers', 'causes', 'notes', 'problems']
    assert [(one['key'], [sheet['sheet'] for sheet in one['in']]) for one in team['causes']] == [
        ('chord_short', ['positions'])]
    assert list(team['results'][0]) == ['result', 'sheet', 'verdict', 'cells', 'expected', 'worst', 'handle', 't_s',
                                        'within', 'explains', 'findings', 'lacks', 'reason']
    assert team['results'][0]['findings'][0]['key'] == 'chord_short'
    head, row = csv_text([graded()]).splitlines()
    assert tuple(head.split(',')) == COLUMNS
    assert row.startswith('"\'=team')
    assert len(COLUMNS) == 1 + 6 * 8 + 4 * 4 + 1


def test_text_says_what_it_looks_like_and_how_much_that_explains():
    said = text_of([graded()], 'en')
    assert 'looks like: the first angle whose chord is within 0.01 m of the link (explains 100.00% of' in said
    assert "the paper's own answer" in said
    assert '弦长容差 0.01 m' in text_of([graded()], 'zh')


def test_a_team_without_anything_has_nothing():
    assert grade_team(Team('a', [])) == TeamGrade('a', (), (), ())


ENTERING = np.arange(0.0, 301.0, 10.0)


def entering(body, head=EXACT, rule=None):
    """Return positions and speeds (T, 224, ...) of a dragon whose body is not wound on the spiral at 0 s."""
    theta = placed_angles(head(ENTERING), rule or chord(), links_of())
    p, v, links = points(theta), mistakes.projected(theta), links_of()
    for row in range(len(ENTERING)):
        for k in np.flatnonzero(theta[row] > 32 * pi):
            if body == 'on_a_line':         # upwards from A
                before = p[row, k - 1]
                p[row, k] = 8.8, before[1] + np.sqrt(links[k - 1] ** 2 - min(8.8 - before[0], links[k - 1]) ** 2)
                v[row, k] = v[row, k - 1]
            else:
                p[row, k], v[row, k] = {'at_a_point': ((8.8, 0.0), 0.0), 'left_empty': (np.nan, np.nan),
                                        'elsewhere': ((9.5 * np.cos(k), 9.5 * np.sin(k)), 1.0)}[body]
    return np.round(p, 6), np.round(v, 6)


@pytest.mark.parametrize('body', ['on_a_line', 'at_a_point', 'left_empty', 'elsewhere'])
def test_a_body_that_is_not_on_the_spiral_at_the_start_is_named_in_positions_and_speeds(body):
    sheets = grades_of('result1', given(*entering(body), ENTERING))
    for one in sheets:
        assert one.findings[0].key == 'enters_at_a'
        assert one.findings[0].parameters['body'] == body
        assert [finding.key for finding in one.findings[1:]] == []
        assert one.verdict == 'incomplete' if body == 'left_empty' else one.verdict in ('wrong', 'close')
    assert (sheets[0].explains is None) == (body == 'left_empty')
    assert body in ('left_empty', 'elsewhere') or sheets[0].explains > 0.999
    assert '从龙头的出发点（A 点）进入' in looks_like(sheets[0], 'zh')
    assert 'enters where the head starts' in looks_like(sheets[1], 'en')


def test_a_body_that_enters_late_does_not_hide_another_mistake():
    sheets = grades_of('result1', given(*entering('at_a_point', rule=chord(0.001)), ENTERING))
    assert [[finding.key for finding in one.findings] for one in sheets] == [['enters_at_a', 'chord_short']] * 2
    assert min(one.explains for one in sheets) > 0.99


@pytest.mark.parametrize('blank', [(15.0, 0.0), (np.nan, np.nan)])
def test_a_body_that_waits_outside_before_the_turn_is_named(blank):
    truth = right('result4', TURNING)
    waits = np.hypot(*np.moveaxis(truth.handles_m, -1, 0)) > np.hypot(*truth.handles_m[0, 0])
    p = np.where(waits[..., None], blank, truth.handles_m)
    sheets = grades_of('result4', given(p, np.where(waits, 0 * blank[0], truth.speed_m_s), TURNING))
    assert [one.findings[0].key for one in sheets] == ['enters_at_a'] * 2


def test_the_first_handles_alone_are_not_taken_for_a_body_that_enters_late():
    p, v = right(times=ENTERING)
    some = np.arange(224) < 100
    sheets = grades_of('result1', given(np.where(some[:, None], p, np.nan), np.where(some, v, np.nan), ENTERING))
    assert [(one.verdict, one.findings) for one in sheets] == [('incomplete', ())] * 2


@pytest.mark.parametrize(('cause', 'make'), [
    ('turn_shift', lambda scene, offset_s: (scene, TURNING + 100 + offset_s, 1.0)),
    ('turn_speed', lambda scene, offset_s: (scene, 1.1 * TURNING + offset_s, 1.1)),
    ('turn_ratio', lambda *_: (turned_scene(Dragon(), STurn(ratio=1.0))[0], TURNING + turned_scene()[1], 1.0))])
def test_a_cause_of_the_turn_is_found_in_positions_and_speeds(cause, make):
    scene, times, pace = make(*turned_scene())
    p, v = state_at(scene, times)
    sheets = grades_of('result4', given(np.round(p, 6), np.round(pace * v, 6), TURNING))
    assert [[one.key for one in sheet.findings] for sheet in sheets] == [[cause]] * 2
    (found,) = causes_of(TeamGrade('a', (), tuple(sheets), ()))
    assert [(one.sheet, share > 0.99) for one, share in found[1]] == [('positions', True), ('speeds', True)]
    line = text_of([TeamGrade('a', (), tuple(sheets), ())], 'en').splitlines()[-1]
    assert line.startswith('  cause: ')
    assert 'result4 positions 100.00%, result4 speeds 100.00%' in line


@pytest.mark.parametrize(('cause', 'pitch_m', 'head', 'times'), [
    ('pitch', 0.5, solved(arc_length, pitch_m=0.5), np.arange(0.0, 41.0)), ('euler', 0.55, euler(1.0), TIMES)])
def test_a_cause_of_winding_is_found_in_positions_and_speeds(cause, pitch_m, head, times):
    theta = placed_angles(head(times), chord(pitch_m=pitch_m), links_of())
    p, v = points(theta, pitch_m), mistakes.projected(theta)
    sheets = grades_of('result1', given(np.round(p, 6), np.round(v, 6), times))
    assert [[one.key for one in sheet.findings] for sheet in sheets] == [[cause]] * 2


def bisected(tolerance):
    """Return the rule that bisects for the next angle until the bracket is narrower than a tolerance (rad)."""
    def following(theta, link_m):
        low, high = theta, theta + 3 * link_m * 2 * pi / 0.55 / theta
        while np.max(high - low) > tolerance:
            middle = 0.5 * (low + high)
            short = np.hypot(*np.moveaxis(points(middle) - points(theta), -1, 0)) < link_m
            low, high = np.where(short, middle, low), np.where(short, high, middle)
        return 0.5 * (low + high)
    return following


@pytest.mark.parametrize('tolerance', [1e-4, 1e-5, 1e-6])
def test_a_root_finder_with_a_loose_tolerance_is_named(tolerance):
    positions, _ = grades_of('result1', given(np.round(wound(rule=bisected(tolerance)), 6)))
    (found,) = positions.findings
    assert found.key == 'loose_root'
    assert tolerance / 10 <= found.parameters['tolerance'] <= tolerance
    assert looks_like(positions, 'en').startswith('looks like: a root finder with a tolerance')


def test_the_right_speed_of_the_head_is_no_mistake():
    rng = np.random.default_rng(5)
    positions, _ = grades_of('result1', given(wound(lambda t_s: EXACT((1 + 1e-7) * t_s)) + rng.normal(0, 0.1, (
        len(TIMES), 224, 2))))
    assert not {'speed', 'time_shift'} & {one.key for one in positions.findings}


@pytest.mark.parametrize('first', [0.0, np.nan])
def test_differences_without_a_first_time_are_named(first):
    times = np.arange(0.0, 21.0)
    p = right(times=times).handles_m
    v = np.full((21, 224), first)
    v[1:] = np.hypot(*np.moveaxis(np.diff(p, axis=0), -1, 0))
    _, speeds = grades_of('result1', given(p, np.round(v, 6), times))
    assert [one.key for one in speeds.findings] == ['differences', *(['zero_times'] if first == 0 else [])]
    assert speeds.explains > 0.99


def test_central_differences_with_one_sided_ends_are_named():
    times = np.arange(0.0, 21.0)
    p = right(times=times).handles_m
    v = np.hypot(*np.moveaxis(np.gradient(p, axis=0), -1, 0))
    _, speeds = grades_of('result1', given(p, np.round(v, 6), times))
    assert plain(speeds.findings) == 'differences(kind=central, step=1)'


def test_many_wrong_cells_are_no_cause():
    p = right().handles_m.copy()
    p.reshape(-1)[np.random.default_rng(0).choice(p.size, p.size // 60, replace=False)] += 0.5
    positions, _ = grades_of('result1', given(np.round(p, 6)))
    assert [one.key for one in positions.findings[-2:]] == ['few_cells', 'unknown']
    assert looks_like(positions, 'en').startswith('unknown; seen: ')


def test_centimetres_with_four_decimals_are_not_rounded():
    p, speed = (np.round(100 * one, 4) for one in right())
    assert [[one.key for one in sheet.findings] for sheet in grades_of('result1', given(p, speed))] == [
        ['centimetres']] * 2


def test_speeds_that_are_all_one_are_not_close():
    _, speeds = grades_of('result1', given(right().handles_m, np.ones((len(TIMES), 224))))
    assert (speeds.verdict, speeds.worst < 0.01) == ('wrong', True)


def test_an_incomplete_sheet_says_which_handles_and_times_it_lacks():
    times = np.arange(301.0)
    p, v = right(times=times)
    p[:, [3, 4, 5, 9]] = np.nan
    p[7, 200] = np.nan
    positions, speeds = grades_of('result1', given(p[:-2], v[:-2], times[:-2]))
    assert lacks_of(positions, 'en').split('; ') == [
        'without handles 3..5, 9', 'without the times 299..300 s', 'other empty cells: 1, the first at handle 200, 7 s']
    assert lacks_of(speeds, 'zh') == '缺少时刻 299..300 s'
