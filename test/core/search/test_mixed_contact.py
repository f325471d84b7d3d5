"""First contacts of mixed benches: the classic list has the classic contact; others are compared with shapely."""
from dataclasses import replace

import numpy as np
import pytest
from apart import smallest
from certificates import proved
from hypothesis import assume, given
from hypothesis import strategies as st
from properties import examples

from dragon_ros.core.chain.dragon import Group, Mixed
from dragon_ros.core.chain.head_law import Head
from dragon_ros.core.enclosures.on_spiral import BenchSampler, beyond, bounds, further
from dragon_ros.core.errors import ChainLockError, DragonError, FieldError
from dragon_ros.core.geometry.rectangles import axes_of, benches_of
from dragon_ros.core.model import compile_scene
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.search.certificate import Contact, NoContact
from dragon_ros.core.search.first_contact import first_contact
from dragon_ros.core.search.near_misses import near_misses
from dragon_ros.core.step import state
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


@examples(20)
@given(mixed, st.floats(2.5, 9), st.floats(0, 2))
def test_benches_beyond_the_bound_of_all_further_ones_are_there(dragon, theta, way):
    pitch = 1.6
    try:
        scene = Scene(dragon=dragon, track=Spiral(pitch, 4.0))
        track = compile_scene(scene).model.track
        sampler = BenchSampler(track, dragon, (0,), dragon.benches, lambda states: None, 0.0)
        views = [sampler.sample(np.array([2 * theta + turned])) for turned in (0.0, way)]
    except ChainLockError:
        assume(False)
    bound = further(*views, sampler.sizes, beyond(*views, sampler.sizes))[0]
    if not np.any(sampler.sizes.longest_m):
        return
    for view in views:
        chain = Scene(dragon=dragon, track=Spiral(pitch, view.places[0] / (2 * np.pi)))
        corners = benches_of(state(chain, 0.0), dragon, axes_of(state(chain, 0.0))).corners
        ends = corners[2:], np.roll(corners[2:], 1, axis=1)
        share = np.linspace(0, 1, 200)[:, None, None, None]
        nearest = np.min(np.hypot(*np.moveaxis(ends[0] + share * (ends[1] - ends[0]), -1, 0)), axis=(0, 2))
        furthest = np.max(np.hypot(*np.moveaxis(corners[0], -1, 0)))
        assert np.all(bound <= np.minimum.accumulate(nearest[::-1])[::-1] - furthest + 1e-9)


def test_links_of_nearly_no_length_are_cleared_class_by_class():
    dragon = Mixed((Group(1.0), Group(1.4, 5), Group(0.6)), 1.0)     # too wide for the bound from layers
    assert first_contact(Scene(dragon=dragon, track=Spiral(1.6, 12.0), run=Run(0, 1))).states


@examples(6)
@given(mixed, st.floats(2.5, 9), st.floats(1e-3, 2))
def test_benches_sampled_together_are_as_if_each_were_alone_and_their_bounds_hold_in_between(dragon, theta, way):
    assume(dragon.benches > 3 and np.min(dragon.link_lengths_m) > 1e-3)
    places = 2 * theta + way * np.linspace(0, 1, 9)
    leads, ends = tuple(range(dragon.benches - 2)), [np.array([n]) for n in (0, 8)]

    def sampler(*leads):
        return BenchSampler(track, dragon, leads, dragon.benches - leads[0], lambda states: None, 0.0)

    try:
        track = compile_scene(Scene(dragon=dragon, track=Spiral(1.6, 4.0))).model.track
        together = sampler(*leads)
        for number, lead in enumerate(leads):
            count, alone = dragon.benches - lead, sampler(lead).sample(places)
            seen = together.sample(places, np.full(9, number))
            assert np.allclose(seen.theta[:, :count + 1], alone.theta, rtol=0, atol=1e-12)
            assert np.allclose(seen.apart[:, :count - 2], alone.apart, rtol=0, atol=1e-12)
            low, _ = bounds(*(seen.rows(end) for end in ends), together.sizes, np.array([count - 1]))
            assert low[0] <= np.min(alone.apart) + 1e-12
    except ChainLockError:
        assume(False)


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
    values = certificate.as_values(scene, found)
    assert len(values['intervals']) > 0
    assert proved(values)


def test_where_a_link_behind_the_second_turns_back_the_run_is_refused_with_the_time_to_stop_at():
    scene = Scene(dragon=LONG_FOURTH, run=Run(420))
    with pytest.raises(FieldError, match=r'run\.stop_s.*stop at 430\.\d+ s or before') as refused:
        first_contact(scene)
    stop_s = float(str(refused.value).split('stop at ')[1].split()[0])
    early = replace(scene, run=Run(420, stop_s))
    found = first_contact(early)
    assert isinstance(found, NoContact)
    assert found.certificate.complete


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
