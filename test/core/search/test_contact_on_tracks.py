"""Contacts on composite tracks and under head laws: the candidates, and the classic contact followed over time."""
from dataclasses import replace

import numpy as np
import pytest

from dragon_ros.core.chain.dragon import Dragon
from dragon_ros.core.chain.head_law import Profile
from dragon_ros.core.geometry.broad_phase import box_pairs, candidates, default_reach_m
from dragon_ros.core.geometry.rectangles import axes_of, benches_of
from dragon_ros.core.geometry.signed_distance import gaps
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.search.certificate import Contact, NoContact
from dragon_ros.core.search.first_contact import first_contact
from dragon_ros.core.step import state
from dragon_ros.core.tracks.spec import Arc, Composite, Line, STurn

TURNING = Scene(track=STurn(before_m=100.0), run=Run(0, 200))


@pytest.mark.parametrize('t_s', [0.0, 95.0, 101.0, 107.0, 113.0, 116.0, 130.0, 200.0])
def test_the_candidates_on_a_turn_have_every_pair_within_reach(t_s):
    chain = state(TURNING, t_s)
    benches = benches_of(chain, TURNING.dragon, axes_of(chain))
    i, j = box_pairs(benches, default_reach_m(benches))
    near = gaps(benches, i, j) <= default_reach_m(benches)
    found = set(zip(*(pairs.tolist() for pairs in candidates(chain.p, benches)), strict=True))
    assert set(zip(i[near].tolist(), j[near].tolist(), strict=True)) <= found


def test_followed_in_time_the_classic_contact_is_the_one_that_is_proved():
    proved = first_contact(Scene(run=Run(405, 413)))
    followed = first_contact(Scene(run=Run(405, 413), head=Profile(((0.0, 1.0),))))
    assert isinstance(followed, Contact)
    assert followed.t_s == pytest.approx(proved.t_s, abs=1e-10)
    assert (followed.benches, followed.witness.corner) == (proved.benches, proved.witness.corner)
    assert followed.certificate.complete
    slower = first_contact(Scene(run=Run(810, 826), head=Profile(((0.0, 0.5),))))
    assert slower.t_s == pytest.approx(2 * proved.t_s, abs=1e-9)


def test_a_turn_has_no_contact_and_a_loop_in_its_own_body_has():
    assert isinstance(first_contact(replace(TURNING, run=Run(112, 118))), NoContact)
    loop = Scene(dragon=Dragon(20), track=Composite((Line(5.0), Arc(3.0, 720.0))), run=Run(0, 30))
    hit = first_contact(loop)
    assert isinstance(hit, Contact)
    chain = state(loop, hit.t_s)
    gap = gaps(benches_of(chain, loop.dragon, axes_of(chain)), *(np.array([n]) for n in hit.benches))
    assert abs(gap[0]) < 1e-9
