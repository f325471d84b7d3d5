"""First contacts of mixed benches: the classic list has the classic contact; others are compared with shapely."""
import numpy as np
import pytest
from apart import smallest
from certificates import proved
from hypothesis import assume, given
from hypothesis import strategies as st
from properties import examples

from dragon_ros.core.chain.dragon import Group, Mixed
from dragon_ros.core.chain.head_law import Head
from dragon_ros.core.errors import DragonError
from dragon_ros.core.model import compile_scene
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.search.certificate import Contact, NoContact
from dragon_ros.core.search.first_contact import first_contact
from dragon_ros.core.search.near_misses import near_misses
from dragon_ros.core.tracks.spec import Spiral
from dragon_ros.scenes import certificate
from dragon_ros.scenes.load import load_scene

CLASSIC, SPELT = Scene(), Scene(dragon=Mixed((Group(3.41), Group(2.2, 100), Group(2.2, 122))))
LONG_FOURTH = Mixed((Group(1.1, 3), Group(3.9), Group(1.6, 6)), 0.02)
MIDDLE = Mixed((Group(1.2, 6), Group(3.6), Group(1.2, 25)))

group = st.builds(Group, st.one_of(st.floats(0.6, 4), st.sampled_from([0.6, 1.0, 2.2])), st.integers(1, 9))
mixed = st.builds(Mixed, st.lists(group, min_size=2, max_size=6).map(tuple), st.floats(0.05, 0.4))


def test_a_list_that_spells_out_the_classic_dragon_has_its_first_contact_and_certificate():
    assert first_contact(SPELT) == first_contact(CLASSIC)


@examples(8)
@given(mixed, st.floats(0.4, 1.6), st.floats(3, 6), st.sampled_from([1.0, 1.0, -1.0]), st.floats(5, 60))
def test_nothing_touches_before_the_first_contact_of_a_mixed_dragon(dragon, pitch, turns, speed, stop_s):
    try:
        scene = Scene(dragon=dragon, track=Spiral(pitch, turns), head=Head(speed), run=Run(0, stop_s))
        found = first_contact(scene)
    except DragonError:
        assume(False)
    before_s = (found.t_s if isinstance(found, Contact) else compile_scene(scene).end.t_s) - 1e-6
    assert all(smallest(scene, t_s) > 0 for t_s in np.linspace(0, before_s, 40) if before_s > 0)
    if isinstance(found, Contact) and not found.grazing_m:
        assert smallest(scene, found.t_s) < 1e-9


@pytest.mark.parametrize(('scene', 'pair'), [
    pytest.param(load_scene('mixed', ['run.start_s=394.5']), (40, 71), marks=pytest.mark.long),
    pytest.param(Scene(dragon=MIDDLE, track=Spiral(0.5, 7.0), run=Run(56.0)), (0, 6), marks=pytest.mark.long),
    (Scene(dragon=Mixed((Group(3.41), *(Group(length) for _ in range(12) for length in (2.2, 1.7)))), run=Run(405)),
     (0, 9)),
    (Scene(dragon=Mixed((Group(1.2, 4), Group(2.0), Group(1.2, 9))), track=Spiral(0.6, 2.5), head=Head(-1.0),
           run=Run(0, 40)), None)],
    ids=['a long tail', 'a long bench in the middle', 'two alternating lengths', 'winding out'])
def test_mixed_dragons_have_certificates_that_the_checker_accepts(scene, pair):
    found = first_contact(scene)
    assert found.certificate.complete
    assert getattr(found, 'benches', None) == pair
    assert len(found.certificate.intervals) > 0
    assert proved(certificate.as_values(scene, found))


def test_a_run_in_which_a_link_behind_the_second_turns_back_is_proved_to_its_end():
    scene = Scene(dragon=LONG_FOURTH, run=Run(420))
    found = first_contact(scene)
    assert isinstance(found, NoContact)
    assert found.certificate.complete
    assert proved(certificate.as_values(scene, found))


@pytest.mark.long       # by default, test_near_misses.py compares those of a mixed dragon with a dense scan
def test_near_misses_of_a_mixed_dragon_are_the_smallest_gaps_of_its_head():
    scene = load_scene('mixed', ['run.start_s=390'])
    misses = [miss for miss in near_misses(scene, first_contact(scene), 0.05).nearest if miss.benches[0] == 0]
    assert [miss.bench for miss in misses][:2] == [13, 11]
    assert misses[0].gap_m == pytest.approx(0.03515, abs=1e-5)


def test_the_tail_of_the_example_touches_first():
    found = first_contact(load_scene('mixed'))
    assert (found.benches, found.certificate.complete) == ((40, 71), True)
    assert found.t_s == pytest.approx(395.622364981, abs=1e-9)
