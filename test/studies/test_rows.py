"""A row has the searches' answers or the reasons why they are missing, and is the same alone and in any batch."""
import pytest
from properties import thinned

import dragon_ros as dr
from dragon_ros.core.chain.dragon import Dragon
from dragon_ros.core.model import compile_scene
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.search.bounding_box import bounding_box
from dragon_ros.core.search.first_contact import first_contact
from dragon_ros.core.search.max_speed import max_speed
from dragon_ros.core.search.min_pitch import coming_in, min_pitch
from dragon_ros.core.search.near_misses import near_misses
from dragon_ros.core.tracks.spec import Arc, Composite, Line, Spiral
from dragon_ros.core.venue import LineObstacle, Venue
from dragon_ros.scenes.load import changed_scene, scene_of
from dragon_ros.scenes.yaml import Document
from dragon_studies.questions import QUESTIONS, Asked
from dragon_studies.rows import columns_of, row_of, rows_of
from dragon_studies.sampling import scene_values_of, values_of

SMALL = {'dragon': {'benches': 24}, 'run': {'start_s': 405, 'stop_s': 413}}
ALL = """
set: {dragon: {benches: 24}, run: {start_s: 405, stop_s: 413}}
vary: {dragon.width_m: [0.3, 0.2]}
ask:
  contact:
  near_misses: {below_m: 0.1}
  clearance: {at_s: 410}
  fit: {square_m: 20}
  max_speed: {limit_m_s: 3}
  lock:
"""


@pytest.fixture(scope='module')
def alone(study):
    """The rows of the study above, each computed alone."""
    return [row_of(study(ALL), index) for index in range(2)]


def test_answers_are_those_of_the_engines(alone):
    row, scene = alone[0], changed_scene('winding', SMALL)
    found = first_contact(scene)
    assert (row['contact'], row['contact_t_s'], row['contact_inner'], row['contact_outer']) == (
        True, found.t_s, *found.benches)
    assert row['contact_high_s'] - row['contact_low_s'] == pytest.approx(2 * found.uncertainty_s, rel=0.1)
    assert row['contact_proved'] is True
    near = near_misses(scene, found, 0.1)
    assert row['near_misses'] == near.count
    assert row['near_miss_gap_m'] == (near.nearest[0].gap_m if near.nearest else None)
    assert row['fit_centred_low_m'] == bounding_box(scene).centred_m[0]
    assert (row['fits_centred'], row['fits_free']) == (True, True)
    assert row['max_speed_ratio'] == max_speed(scene).ratio
    assert row['max_speed_high_m_s'] == 3 / max_speed(scene).ratio
    assert row['lock_t_s'] == compile_scene(scene).limit.t_s
    assert row['clearance_low_m'] < row['clearance_m'] < row['clearance_high_m']
    assert (row['status'], row['reason']) == ('ok', None)


def test_a_run_without_a_contact_says_how_it_ends(study):
    row = row_of(study(ALL.replace('stop_s: 413', 'stop_s: 406')), 1)
    assert (row['contact'], row['contact_t_s'], row['run_end'], row['run_end_s']) == (False, None, 'stop', 406.0)


def test_rows_are_the_same_alone_and_in_any_batch(study, alone, without_times):
    assert without_times(rows_of(study(ALL), [1, 0])) == without_times(alone)
    assert alone[0]['scene_sha256'] != alone[1]['scene_sha256']


def test_every_row_has_every_column(study, alone):
    one = study(ALL)
    assert list(alone[0]) == list(columns_of(one))
    assert {question.columns.keys() <= columns_of(one).keys() for question in one.ask} == {True}


def test_a_scene_that_is_refused_is_a_row_that_says_why(study):
    row = row_of(study('vary: {track.pitch_m: [-1]}\nask: [lock]'), 0)
    assert row['status'] == 'refused'
    assert 'track.pitch_m: -1 is not valid' in row['reason']
    assert row['lock_t_s'] is None


def test_a_question_that_is_refused_leaves_the_others_their_answers(study):
    row = row_of(study('set: {dragon: {benches: 3}}\nvary: {track.pitch_m: [0.55]}\nask: [max_speed, lock]'), 0)
    assert row['status'] == 'refused'
    assert row['reason'].startswith('max_speed: ')
    assert row['lock_t_s'] == pytest.approx(432.9179, abs=1e-3)


def test_a_row_over_its_budget_says_so(study):
    one = study('vary: {track.pitch_m: [0.55]}\nask: [contact, lock]\nbudget_s: 1e-6')
    row = row_of(one, 0)
    assert (row['status'], row['reason']) == ('over_budget', 'contact: it took more than its budget of 1e-06 s')
    assert row['lock_t_s'] is None


def test_a_defect_of_one_scene_is_a_row_and_not_the_end_of_a_study(study, monkeypatch):
    def broken(self, asked):
        raise ZeroDivisionError('planted')
    monkeypatch.setattr(QUESTIONS['lock'], 'answer', broken)
    row = row_of(study(), 0)
    assert (row['status'], row['reason']) == ('failed', 'lock: ZeroDivisionError: planted')


SMALL_CIRCLE = 'diameter_m: 4, start_turns: 5, largest_m: 0.9, within_m: 0.01'


def test_the_smallest_pitch_of_equal_benches_is_proved_and_searched_once_for_one_dragon(study, monkeypatch):
    calls, search = [], dr.design.min_pitch
    monkeypatch.setattr(type(dr.design), 'min_pitch', staticmethod(
        lambda *given, **named: calls.append(given) or search(*given, **named)))
    rows = rows_of(study('set: {dragon: {benches: 30}}\nvary: {track.pitch_m: [0.5, 0.6]}\n'
                         f'ask: {{min_pitch: {{{SMALL_CIRCLE}}}}}'), range(2))
    found = min_pitch(changed_scene('winding', {'dragon': {'benches': 30}}).dragon, 4, 5, 0.9, 0.01)
    for row in rows:
        assert (row['min_pitch_low_m'], row['min_pitch_m']) == (found.low_m, found.high_m)
        assert row['min_pitch_proved'] is True
    assert len(calls) == 1


@pytest.mark.parametrize(('head_m', 'inner'), thinned([(3.41, 0), (1.2, 1)], lambda case: case[1] == 0))
def test_the_smallest_pitch_of_mixed_benches_is_a_bracket_proved_above_if_the_head_touches_first(study, head_m, inner):
    groups = f'[{{length_m: {head_m}}}, {{count: 28, length_m: 2.2}}, {{length_m: 2.2001}}]'
    one = study(f'set: {{dragon: {{kind: mixed, groups: {groups}}}}}\nvary: {{track.pitch_m: [0.5]}}\n'
                f'ask: {{min_pitch: {{{SMALL_CIRCLE}, smallest_m: 0.45}}}}')
    row = row_of(one, 0)
    assert row['reason'] is None
    assert row['min_pitch_proved'] is True
    assert row['min_pitch_inner'] == inner      # a short head passes where the body touches itself
    if inner == 0:
        known = min_pitch(changed_scene('winding', {'dragon': {'benches': 30}}).dragon, 4, 5, 0.9, 1e-4)
        assert row['min_pitch_low_m'] <= known.high_m <= row['min_pitch_high_m'] + 1e-3
    assert row['min_pitch_high_m'] - row['min_pitch_low_m'] <= 0.01
    dragon = scene_of(Document('row', scene_values_of(one, values_of(one, 0)))).dragon
    for pitch_m, touches in ((row['min_pitch_low_m'], True), (row['min_pitch_high_m'], False)):
        assert hasattr(first_contact(coming_in(dragon, pitch_m, 5, 4)), 'benches') is touches


@pytest.mark.parametrize(('options', 'why'), [
    (', smallest_m: 0.2', 'head starts inside the circle'),
    (', smallest_m: 0.89', 'no benches touch'),
    (', smallest_m: 0.45, largest_m: 0.5', 'benches touch at this pitch')])
def test_a_bracket_of_mixed_benches_that_holds_no_pitch_is_refused(study, options, why):
    groups = '[{length_m: 3.41}, {count: 28, length_m: 2.2}, {length_m: 2.2001}]'
    given = SMALL_CIRCLE.replace(', largest_m: 0.9', '') if 'largest' in options else SMALL_CIRCLE
    row = row_of(study(f'set: {{dragon: {{kind: mixed, groups: {groups}}}}}\nvary: {{track.pitch_m: [0.5]}}\n'
                       f'ask: {{min_pitch: {{{given}{options}}}}}'), 0)
    assert row['status'] == 'refused'
    assert why in row['reason']


def test_the_clearance_is_that_of_all_benches_however_far_apart():
    scene = Scene(dragon=Dragon(3, 5.0, 5.0), track=Spiral(50.0, 4.0), run=Run(0, 1))
    row = QUESTIONS['clearance'](at_s=0.0).answer(Asked(scene, lambda states: None))
    assert row['clearance_m'] == pytest.approx(4.45 - 2 * 0.275, abs=0.05)      # the track is nearly straight
    assert (row['clearance_inner'], row['clearance_outer']) == (0, 2)


def test_tolerances_of_a_venue_have_the_gap_the_obstacle_and_the_first_touch():
    """The gap to a wall shrinks by half the additional width, and a wide dragon touches a wall in its way."""
    rows = []
    for width_m in (0.3, 0.4, 0.6):
        wall = LineObstacle('wall', ((21.0, 0.25), (40.0, 0.25)))
        scene = Scene(Dragon(4, width_m=width_m), Composite((Line(60.0),), 20.0), run=Run(stop_s=20.0),
                      venue=Venue((wall, LineObstacle('other', ((21.0, -1.0), (40.0, -1.0)))), margin_m=0.06))
        asked = Asked(scene, lambda states: None)
        rows.append({key: value for name in ('contact', 'near_misses', 'clearance', 'fit')
                     for key, value in QUESTIONS[name]().answer(asked).items()})
    assert [row['fit_gap_high_m'] for row in rows] == pytest.approx([0.1, 0.05, -0.05], abs=1e-12)
    assert all(row['fit_gap_low_m'] <= row['fit_gap_high_m'] and row['fit_proved'] for row in rows)
    assert [row['fits_venue'] for row in rows] == [True, False, False]
    assert {row['fit_obstacle'] for row in rows} == {row['clearance_obstacle'] for row in rows} == {'wall'}
    assert [row['clearance_m'] for row in rows] == pytest.approx([0.1, 0.05, -0.05], abs=1e-12)
    assert [row['contact'] for row in rows] == [False, False, True]
    assert (rows[2]['contact_inner'], rows[2]['contact_obstacle']) == (0, 'wall')
    assert rows[2]['contact_t_s'] == pytest.approx(21.0 - 20.275, abs=1e-9)
    assert rows[2].get('contact_outer') is None


def test_the_smallest_pitch_is_not_claimed_among_obstacles(study):
    row = row_of(study('set: {dragon: {benches: 3}, venue: {inside: [[-99, -99], [99, -99], [0, 99]]}}\n'
                       'vary: {track.pitch_m: [0.55]}\nask: [min_pitch]'), 0)
    assert (row['status'], row['min_pitch_m']) == ('refused', None)
    assert 'min_pitch does not take obstacles into account; omit the venue' in row['reason']


def test_a_near_miss_of_an_obstacle_names_it():
    post = LineObstacle('post', ((30.0, 0.2), (30.0, -1.0)))
    bend = Composite((Line(25.0), Arc(20.0, 20.0), Line(20.0)), 20.0)
    row = QUESTIONS['near_misses'](below_m=0.5).answer(Asked(
        Scene(Dragon(3), bend, run=Run(stop_s=15.0), venue=Venue((post,))), lambda states: None))
    assert row['near_misses'] >= 1
    assert row['near_miss_obstacle'] == 'post'
