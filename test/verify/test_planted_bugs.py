"""The checker catches bugs planted anywhere in the solver that make it miss or misdate a contact."""
import sys
from dataclasses import replace
from functools import cached_property, lru_cache
from math import pi

import numpy as np
import pytest
from certificates import proved, refusal, written
from properties import thinned

from dragon_ros.core import model
from dragon_ros.core.chain import dragon as dragon_module
from dragon_ros.core.chain import head_law as head_module
from dragon_ros.core.chain.dragon import Dragon, Group, Mixed
from dragon_ros.core.chain.head_law import Head, Profile
from dragon_ros.core.geometry import rectangles as benches_module
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.search import conservative_advancement, search_domain
from dragon_ros.core.tracks import composite, s_turn
from dragon_ros.core.tracks.segments import AHEAD
from dragon_ros.core.tracks.spec import Arc, Composite, Line, Spiral, SpiralArc, STurn

SHORT = Scene(dragon=Dragon(12), run=Run(411.0, 413.0))
LOCKING = Scene(dragon=Dragon(12), run=Run(410.0))
CROSSING = Dragon(14, 0.9, 2.9, 0.2)
LOOP = Scene(dragon=Dragon(14), track=Composite((Line(5.0), Arc(3.0, 400.0), Arc(3.0, -90.0))), run=Run(10, 24))
WOUND = Scene(dragon=Dragon(14), run=Run(22, 40), track=Composite((
    Line(5.0), SpiralArc(0.6, 6.0, 5.5, 'left'), Arc(2.0, 300.0), Arc(2.0, 400.0))))
LAW = Scene(dragon=CROSSING, track=Spiral(0.55, 4.28), run=Run(0, 9),
            head=Profile(((0.0, 0.0), (5.0, -1.0), (9.0, -1.0)), 'smooth'))
THERE_AND_BACK = replace(LAW, head=Profile(((0.0, 1.5), (5.0, -1.6))))
TAIL = Scene(dragon=CROSSING, track=Spiral(0.55, 4.28), head=Head(1.0, 'tail'), run=Run(0, 5))
MIXED = Scene(dragon=Mixed((Group(2.0), Group(1.4, 9), Group(2.9, 2))), track=Spiral(0.5, 4.0), run=Run(0, 60))
TURN = Scene(dragon=Dragon(18), track=STurn(0.8, before_m=100.0), run=Run(110, 114))
PASSING = Scene(dragon=Dragon(12, width_m=0.30101), run=Run(408.5, 411))     # benches 0 and 11 overlap for a moment


def lock(patch):
    """A lock at 27 rad, long before the true lock."""
    patch.setattr(model, 'head_lock_angle', lambda chords: (27.0, 0))


def start(patch):
    """A head that starts a thousandth of a turn too far in."""
    patch.setattr(Spiral, 'start', property(lambda self: 2 * pi * (self.start_turns - 1e-3)))


def end(patch):
    """A run that ends a second early."""
    true = model.Simulation.end.func
    patch.setattr(model.Simulation, 'end', cached_property(lambda self: replace(true(self), t_s=true(self).t_s - 1.0)))
    model.Simulation.end.__set_name__(model.Simulation, 'end')


def stop(patch):
    """A run without a stop that is claimed to stop at 411 s."""
    patch.setattr(model.Simulation, 'end', cached_property(lambda self: model.End(411.0, 'stop')))
    model.Simulation.end.__set_name__(model.Simulation, 'end')


def law_integral(patch):
    """Smooth ramps that are integrated as linear ones."""
    true = head_module.Legs.travelled_m
    patch.setattr(head_module.Legs, 'travelled_m', lambda self, t_s: true(replace(self, smooth=False), t_s))


def rest_of_a_ramp(patch):
    """A law that is assumed to move in one direction only."""
    patch.setattr(head_module.Profile, 'breaks_s', cached_property(lambda self: [0.0, self.knots[-1][0]]))
    head_module.Profile.breaks_s.__set_name__(head_module.Profile, 'breaks_s')


def tail_lead(patch):
    """A tail that starts as if there were one link fewer."""
    true = model.Leader

    def leader(track, links, start_m, direction):
        return true(track, links, start_m - (0.05 if direction == AHEAD else 0.0), direction)
    patch.setattr(model, 'Leader', leader)


def order_of_groups(patch):
    """Groups of benches that are read starting from the tail."""
    def lengths(self):
        rows = [group.length_m for group in reversed(self.groups) for _ in range(group.count)]
        return dragon_module.read_only(np.array(rows))
    patch.setattr(Mixed, 'bench_lengths_m', cached_property(lengths))
    Mixed.bench_lengths_m.__set_name__(Mixed, 'bench_lengths_m')


def side_of_an_arc(patch):
    """Arcs that turn to the wrong side."""
    true = composite.ArcSegment
    patch.setattr(composite, 'ArcSegment', lambda start, direction, radius_m, side, *ends: true(
        start, direction, radius_m, -side, *ends))


def joint(patch):
    """Pieces that begin a centimetre away from the end of the preceding piece."""
    true = composite._segment
    patch.setattr(composite, '_segment', lambda piece, start, heading, open_ended: true(
        piece, start + (0.01j * heading if isinstance(piece, Arc) else 0.0), heading, open_ended))


def arcs_of_a_turn(patch):
    """An S-turn whose first arc is a thousandth too tight."""
    true = s_turn.ArcSegment
    patch.setattr(s_turn, 'ArcSegment', lambda start, direction, radius_m, side, *ends: true(
        start, direction, radius_m * (0.999 if side < 0 else 1.0), side, *ends))


def width(patch):
    """Benches that are a tenth of a millimetre too narrow."""
    sizes(patch, 0.0, -5e-5)


def inset(patch):
    """Holes a millimetre too close to the ends, so that benches are too short for their links."""
    sizes(patch, -1e-3, 0.0)


def sizes(patch, length_m, width_m):
    true = benches_module.Benches

    def made(centre, axis, half_length, half_width):
        return true(centre, axis, half_length + length_m, half_width + width_m)
    for name, module in list(sys.modules.items()):
        if name.startswith('dragon_ros.core') and getattr(module, 'Benches', None) is true:
            patch.setattr(module, 'Benches', made)


def constant_of_the_second_order_bound(patch):
    """B h^2 / 8000 in place of B h^2 / 8."""
    true = conservative_advancement.second_derivatives
    patch.setattr(conservative_advancement, 'second_derivatives',
                  lambda *given: tuple(1e-3 * each for each in true(*given)))


def constant_of_the_lipschitz_bound(patch):
    """Benches whose travel and curvature are assumed to be a thousandth of the true values."""
    space = conservative_advancement.ChainIntervals
    true = space._moved
    patch.setattr(space, '_moved', lambda *given: 1e-3 * true(*given))


def first_passage(patch):
    """Positions whose times are half a microsecond late."""
    domain = search_domain.SearchDomain
    time_s, travel_m = domain.time_s, domain.travel_m
    patch.setattr(domain, 'time_s', lambda self, place: time_s(self, place) + 5e-7)
    patch.setattr(domain, 'travel_m', lambda self, t_s: travel_m(self, t_s - 5e-7))


BUGS = [(lock, LOCKING), (start, SHORT), (end, SHORT), (end, TURN), (stop, LOCKING), (law_integral, LAW),
        (rest_of_a_ramp, THERE_AND_BACK), (tail_lead, TAIL), (order_of_groups, MIXED), (side_of_an_arc, WOUND),
        (joint, LOOP), (joint, WOUND), (arcs_of_a_turn, TURN), (width, SHORT), (width, LOOP), (width, TAIL),
        (inset, SHORT), (inset, TURN), (constant_of_the_second_order_bound, PASSING),
        (constant_of_the_lipschitz_bound, LOOP), (first_passage, SHORT), (first_passage, WOUND), (first_passage, TAIL)]
FURTHER = [(end, TURN), (joint, WOUND), (width, LOOP), (width, TAIL), (inset, TURN), (first_passage, SHORT),
           (first_passage, TAIL)]      # of a bug that other runs show


def again(run):
    """Return the same run with empty caches."""
    return replace(run, dragon=replace(run.dragon), track=replace(run.track), head=replace(run.head))


@lru_cache
def honest(run):
    """Return the certificate that the solver writes without a bug, after the checker has accepted it."""
    values = written(again(run))
    assert proved(values)
    return values


@pytest.mark.parametrize(('bug', 'run'), thinned(BUGS, lambda case: case not in FURTHER),
                         ids=[f'{n} {bug.__name__}' for n, (bug, _) in enumerate(BUGS)])
def test_a_bug_in_the_solver_is_caught(monkeypatch, bug, run):
    with monkeypatch.context() as patch:
        patch.setattr(model, '_COMPILED', model._Compiled())
        bug(patch)
        values = written(again(run))
    assert values['contact'] != honest(run)['contact']
    assert refusal(values)
