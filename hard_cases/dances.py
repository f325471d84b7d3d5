"""The named hard cases with composite tracks, head laws or a leading tail; ``problems`` contains the others.

Most of these cases are hard at the joints: a link spans one or several joints, or a handle is exactly on a joint. In
others, the track returns to itself so that a chord has several roots, or a bend is almost too tight to follow.
"""
from dataclasses import replace
from functools import lru_cache

from dragon_ros.core.chain.dragon import AnyDragon, Dragon
from dragon_ros.core.chain.head_law import Head, Profile
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.tracks.spec import Arc, Composite, Line, Piece, Spiral, SpiralArc, STurn
from hard_cases.problems import MIXED, Problem

_TURNING = Scene(track=STurn(before_m=100.0), run=Run(0, 200))
_SHORT = Dragon(12, 2.2, 2.2)
_EXIT_S = 113.62124490682112        # the time (s) at which the head of ``turning`` leaves the turn
_WIGGLE: tuple[Piece, ...] = (Line(2.0), *(Arc(1.6, (-1) ** k * 20.0) for k in range(12)), Line(0.25), Line(0.25),
                              Arc(1.6, 5.0), Line(9.0))


def _on(name: str, why: str, pieces: tuple[Piece, ...], times_s: tuple[float, ...],
        dragon: AnyDragon | None = None) -> Problem:
    dragon = dragon or Dragon(12)
    return Problem(name, Scene(dragon=dragon, track=Composite(pieces), run=Run(0, max(times_s))), times_s,
                   tuple(range(dragon.benches + 1)), why)


def _like(name: str, why: str, scene: Scene, times_s: tuple[float, ...], handles: int = 30) -> Problem:
    scene = replace(scene, run=Run(0, max(times_s)))
    last = scene.dragon.benches
    return Problem(name, scene, times_s, (*range(min(handles, last)), last), why)


@lru_cache(maxsize=1)
def dances() -> tuple[Problem, ...]:
    """Return every hard case."""
    law = Profile(((0.0, 0.0), (8.0, 2.0), (60.0, 2.0), (67.0, -1.5), (80.0, -1.5), (80.0, 0.0), (90.0, 0.0),
                   (93.0, 1.0)), 'smooth')
    return (
        Problem('turning', _TURNING, (0.0, 50.0, 100.0, 100.5, 102.86, 109.0, _EXIT_S, 114.47997, 150.0, 200.0),
                tuple(range(224)), "the contest's turn with all handles, also with the head at both ends of the turn"),
        _like('tight', 'the second arc almost too tight for the head link', replace(_TURNING, track=STurn(
            ratio=2.12, before_m=10.0)), (0.0, 20.0, 22.0, 23.62, 25.0, 26.0)),
        _like('equal-arcs', 'two arcs of equal radius', replace(_TURNING, track=STurn(ratio=1.0)), (3.0, 8.0, 14.0)),
        *(_like(f'turn-{scale:g}', f'every length and the speed multiplied by {scale:g}', _scaled(scale),
                (0.0, 9.0, 20.0))
          for scale in (1e-3, 1e3)),
        _like('turn-joined-handles', 'links of zero length on a turn',
              replace(_TURNING, dragon=Dragon(8, 3.41, 0.55), track=STurn()), (1.0, 10.0, 15.0)),
        _on('joint-at-handles', 'head and handle 1 exactly on joints, one of which is between collinear lines',
            (Line(10.0), Line(2.86), Arc(2.0, 90.0), Line(10.0)), (10.0, 12.86, 14.0, 20.0)),
        _on('wiggle', 'segments shorter than a link, so that a link spans up to five joints', _WIGGLE,
            (2.0, 3.0, 5.0, 7.1, 8.6, 9.5, 12.0)),
        _on('loop', 'the track crosses itself: many positions are one link away, and the first one counts',
            (Line(5.0), Arc(1.0, 360.0), Line(1.0), Arc(0.9, -540.0), Line(9.0)), (5.0, 8.0, 11.3, 12.0, 15.0, 22.0),
            _SHORT),
        _on('hairpin', 'a half turn almost too tight to follow', (Line(5.0), Arc(1.45, 180.0), Line(9.0)),
            (6.0, 8.0, 9.5, 9.6, 12.0)),
        _on('spirals', 'outwards on one spiral and inwards on another, then a spiral to the left',
            (Line(4.0), SpiralArc(1.0, 2.0, 4.0, 'right'), SpiralArc(2.0, 2.0, 1.0, 'right'),
             SpiralArc(3.0, 0.8, 2.0, 'left')),
            (4.5, 20.0, 60.0, 81.0, 92.5)),
        _on('circle', 'several laps of a circle that is extended backwards', (Arc(3.0, 90.0), Line(4.0)),
            (0.0, 4.0, 7.0), Dragon(40)),
        _like('law', 'ramps, a reversal, a jump and a stop; times inside ramps',
              replace(_TURNING, head=law), (3.0, 8.0, 59.0, 61.3, 64.1, 70.0, 85.0, 91.7, 100.0)),
        _like('unwinding', 'the tail leads, on one spiral', Scene(track=Spiral(0.55, 6.0), head=Head(1.0, 'tail')),
              (0.0, 0.1, 60.0, 300.0), 224),
        _like('far-by-the-tail', 'the tail leads 55 km from the centre; rounding angles there causes µm errors',
              Scene(dragon=Dragon(30), track=Spiral(0.55, 100000.1), head=Head(1.0, 'tail')), (0.0, 20.0)),
        _on('far-joined', 'a spiral 16 km from its centre, between a line and an arc',
            (Line(5.0), SpiralArc(0.55, 30000.3, 30000.2999), Arc(4.0, 700.0)), (3.0, 9.0, 20.0, 30.0)),
        _like('a-year-of-rounds', 'the tail leads a million rounds backwards on a circle',
              Scene(dragon=Dragon(30), track=Composite((Arc(49.5, 360.0), Line(2.0)), start_m=100.0),
                    head=Head(10.0, 'tail')), (0.0, 86_400.0, 31_536_000.0)),
        _like('after-a-long-way', 'joints behind 171 km of spiral, where the float spacing of a distance is 29 pm',
              Scene(dragon=Dragon(30), track=Composite(
                  (SpiralArc(0.62, 24.2, 297.8), Arc(1.6, 350.0), SpiralArc(1.1, 17.7, 12.2, 'right')),
                  start_m=171_580.0)), (0.0, 15.0, 300.0, 580.0)),
        _like('mixed-by-the-tail', 'benches of six lengths on a turn, led by the tail',
              Scene(dragon=MIXED, track=STurn(2.2, 12.0, 1.0, -40.0), head=Head(1.0, 'tail')), (0.0, 10.0, 45.0), 40),
        _like('turn-by-the-tail', 'the tail leads back through a turn that the head has left',
              replace(_TURNING, dragon=Dragon(30), track=STurn(before_m=-20.0), head=Head(0.7, 'tail')),
              (0.0, 5.0, 20.0, 40.0)),
    )


def _scaled(scale: float) -> Scene:
    d = Dragon(30)
    dragon = Dragon(30, d.head_length_m * scale, d.body_length_m * scale, d.width_m * scale, d.hole_inset_m * scale)
    return Scene(dragon=dragon, track=STurn(1.7 * scale, 9.0 * scale, 2.0), head=Head(scale))
