"""The named hard cases: ladders towards each singularity, joints, and the corners of the world (``core.domain``)."""
from dataclasses import dataclass, replace
from functools import lru_cache
from math import pi

from dragon_ros.core.chain.dragon import AnyDragon, Dragon, Group, Mixed
from dragon_ros.core.chain.head_law import Head, Profile
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.tracks.spec import Arc, Composite, Line, Piece, Spiral, SpiralArc, STurn


@dataclass(frozen=True)
class Problem:
    """A scene, the times at which it is hard, and the handles in the reference, including the worst handle."""

    name: str
    scene: Scene
    times_s: tuple[float, ...]
    handles: tuple[int, ...]
    why: str


LOCK_S = 432.91792422838296      # lock of the classic dragon; a test compares it with the model
_ALL = tuple(range(224))
MIXED = Mixed((Group(3.41), Group(2.2, 10), Group(1.1), Group(4.0, 2), Group(0.6), Group(0.9, 15), Group(2.2, 10)))
_LONG_FOURTH, _FOURTH_LOCKS_S = Mixed((Group(1.1, 3), Group(3.9), Group(1.6, 6))), 430.61003584845963
_SMALLEST = Dragon(10, 3.41, 0.6)       # body links of 0.05 m
_TURNING = Scene(track=STurn(before_m=100.0), run=Run(0, 200))
_SHORT = Dragon(12, 2.2, 2.2)
_EXIT_S = 113.62124490682112        # the time (s) at which the head of ``turning`` leaves the turn
_WIGGLE: tuple[Piece, ...] = (Line(2.0), *(Arc(1.6, (-1) ** k * 20.0) for k in range(12)), Line(0.25), Line(0.25),
                              Arc(1.6, 5.0), Line(9.0))


def _some(benches: int) -> tuple[int, ...]:
    """Return some handles of a long dragon, including the first and the last."""
    near = (k for k in (0, 1, 2, 3, 10) if k < benches)
    return tuple(sorted({*near, *(benches * k // 20 for k in range(1, 21))}))


def _with(name: str, why: str, times_s: tuple[float, ...], dragon: AnyDragon | None = None, track: Spiral | None = None,
          head: Head | None = None) -> Problem:
    dragon = dragon or Dragon(40)
    scene = Scene(dragon=dragon, track=track or Spiral(), head=head or Head(), run=Run(0, max(times_s)))
    return Problem(name, scene, times_s, _some(dragon.benches), why)


def _on(name: str, why: str, pieces: tuple[Piece, ...], times_s: tuple[float, ...], dragon: AnyDragon | None = None,
        start_m: float = 0.0) -> Problem:
    dragon = dragon or Dragon(12)
    return Problem(name, Scene(dragon=dragon, track=Composite(pieces, start_m), run=Run(0, max(times_s))), times_s,
                   tuple(range(dragon.benches + 1)), why)


def _like(name: str, why: str, scene: Scene, times_s: tuple[float, ...], handles: int = 30) -> Problem:
    scene = replace(scene, run=Run(0, max(times_s)))
    last = scene.dragon.benches
    return Problem(name, scene, times_s, (*range(min(handles, last)), last), why)


def _scaled_dragon(benches: int, scale: float) -> Dragon:
    d = Dragon(benches)
    return Dragon(benches, d.head_length_m * scale, d.body_length_m * scale, d.width_m * scale, d.hole_inset_m * scale)


def _diameter_start() -> Spiral:
    """Return the classic track, started so that the head link equals the diameter 2 theta + pi in units of b."""
    theta = 0.5 * (Dragon().link_lengths_m.item(0) / Spiral().b_m - pi)
    return Spiral(0.55, theta / (2 * pi))


@lru_cache(maxsize=1)
def hard_cases() -> tuple[Problem, ...]:
    """Return every hard case: one spiral, turns and joined tracks, then the corners of the world."""
    return *_on_a_spiral(), *_on_joined_tracks(), *_corners()


def _on_a_spiral() -> tuple[Problem, ...]:
    twenty = replace(Scene(), dragon=Dragon(20))
    return (
        Problem('classic', Scene(), (0.0, 60.0, 120.0, 180.0, 240.0, 300.0, 360.0, 400.0, 412.47), _ALL,
                'the contest scene, all handles'),
        *(Problem(f'lock-{metres}', twenty, (LOCK_S - float(metres),), tuple(range(21)),
                  f'{metres} m before the smallest root of the chord equation vanishes')
          for metres in ('1e-0', '1e-2', '1e-4', '2e-6')),
        _with('across', 'the first link is almost perpendicular to the track: its follower stops and turns back',
              (432.0, 432.3, 432.5, 432.6, 432.7, 432.8), Dragon(20)),
        _with('inner-turn', 'short links down to the last turn before the centre', (0.0, 2.5, 3.0, 3.1),
              Dragon(40, 0.7, 0.65), Spiral(0.55, 1.4)),
        _with('centre', 'the head reaches the centre itself', (0.0, 6.0, 6.425), Dragon(6, 0.6, 0.6), Spiral(1.0, 1.4)),
        _with('link-beyond-diameter', 'a head link longer than the diameter at its front end', (432.85, 432.9),
              Dragon(20)),
        _with('link-is-diameter', 'a head link equal to the diameter 2 theta + pi', (0.0,), Dragon(20),
              _diameter_start()),
        *(_with(f'scale-{scale:g}', f'every length and the speed times {scale:g}', (0.0, 300.0, 412.0),
                _scaled_dragon(40, scale), Spiral(0.55 * scale, 16.0), Head(scale)) for scale in (0.1, 10.0)),
        _with('smallest-links', 'links of 0.05 m behind a long head', (0.0, 300.0), _SMALLEST),
        _with('mixed', 'benches of six lengths, one of them with the smallest link', (0.0, 300.0, 412.0, 432.0), MIXED),
        _with('mixed-lock', 'a long fourth link that locks first; 1e-2 to 1e-6 m before the lock',
              tuple(_FOURTH_LOCKS_S - 10.0 ** -k for k in (2, 4, 6)), _LONG_FOURTH),
        _with('rest', 'a head at rest', (0.0, 1e6), None, None, Head(0.0)),
        _with('crawl', 'a head at 1e-9 m/s', (0.0, 1e6), None, None, Head(1e-9)),
        _with('outwards', 'winding out', (0.0, 300.0, 1e5), None, Spiral(0.55, 4.0), Head(-1.0)),
        _like('unwinding', 'the tail leads, on one spiral', Scene(track=Spiral(0.55, 6.0), head=Head(1.0, 'tail')),
              (0.0, 0.1, 60.0, 300.0), 224),
    )


def _on_joined_tracks() -> tuple[Problem, ...]:
    law = Profile(((0.0, 0.0), (8.0, 2.0), (60.0, 2.0), (67.0, -1.5), (80.0, -1.5), (80.0, 0.0), (90.0, 0.0),
                   (93.0, 1.0)), 'smooth')
    return (
        Problem('turning', _TURNING, (0.0, 50.0, 100.0, 100.5, 102.86, 109.0, _EXIT_S, 114.47997, 150.0, 200.0),
                _ALL, "the contest's turn with all handles, also with the head at both ends of the turn"),
        _like('tight', 'the second arc almost too tight for the head link', replace(_TURNING, track=STurn(
            ratio=2.12, before_m=10.0)), (0.0, 20.0, 22.0, 23.62, 25.0, 26.0)),
        _like('equal-arcs', 'two arcs of equal radius', replace(_TURNING, track=STurn(ratio=1.0)), (3.0, 8.0, 14.0)),
        *(_like(f'turn-{scale:g}', f'every length and the speed multiplied by {scale:g}',
                Scene(dragon=_scaled_dragon(30, scale), track=STurn(1.7 * scale, 9.0 * scale, 2.0), head=Head(scale)),
                (0.0, 9.0, 20.0)) for scale in (0.1, 10.0)),
        _like('turn-smallest-links', 'links of 0.05 m on a turn', replace(_TURNING, dragon=_SMALLEST, track=STurn()),
              (1.0, 10.0, 15.0)),
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
        _on('far-joined', 'a spiral 418 m from its centre, between a line and an arc',
            (Line(5.0), SpiralArc(0.55, 760.3, 760.2985), Arc(4.0, 700.0)), (3.0, 9.0, 20.0, 30.0)),
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


def _corners() -> tuple[Problem, ...]:
    smallest = Dragon(40, 0.05, 0.05, 0.01, 0.0)
    return (
        _with('smallest-pitch', 'five thousand turns that are almost circles', (0.0, 300.0, 7.8e5), None,
              Spiral(0.01, 5000.0)),
        _with('largest-pitch', 'an almost straight track', (0.0, 100.0, 500.0), None, Spiral(100.0, 2.0)),
        _with('smallest-link-far-out', 'the smallest link at the largest radius of a spiral', (0.0, 300.0), smallest,
              Spiral(100.0, 56.4)),
        _on('far-corner', 'the smallest links in the corner of the square of coordinates',
            (Line(5.0, (7060.0, 7060.0), 45.0), Arc(0.06, 170.0), Arc(1e7, 1e-5)), (2.0, 5.1, 6.0), smallest),
        _with('longest-links', 'links of 50 m down to the centre', (0.0, 300.0, 5000.0),
              Dragon(20, 50.55, 50.55), Spiral(30.0, 8.0)),
        _with('most-benches', 'twenty thousand links', (0.0, 400.0), Dragon(20_000)),
        _with('longest-chain', 'twenty thousand links of 49 m', (0.0,), Dragon(20_000, 49.55, 49.55),
              Spiral(100.0, 6.0)),
        _with('longest-track', 'a spiral of 998 km, walked for eleven days', (0.0, 300.0, 9.9e5), None,
              Spiral(0.55, 760.0)),
        _like('longest-track-by-the-tail', 'the tail leads 418 m from the centre', Scene(
            dragon=Dragon(30), track=Spiral(0.55, 760.1), head=Head(1.0, 'tail')), (0.0, 20.0)),
        _like('longest-joined-track', 'joints behind 983 km of spiral', Scene(dragon=Dragon(30), track=Composite(
            (SpiralArc(0.62, 24.2, 711.0), Arc(1.6, 350.0), Line(20.0)), start_m=983_470.0)), (0.0, 15.0, 30.0)),
        _on('tightest-bend', 'the tightest legal bend', (Line(5.0), Arc(1.4445, 180.0), Line(9.0)),
            (6.0, 8.0, 9.5, 9.6, 12.0)),
        _with('fastest', 'a head at 100 m/s', (0.0, 1.0, 4.12), None, None, Head(100.0)),
        _like('longest-run-of-rounds', 'the tail leads a million seconds backwards on a circle',
              Scene(dragon=Dragon(30), track=Composite((Arc(49.5, 360.0), Line(2.0)), start_m=100.0),
                    head=Head(1.5, 'tail')), (0.0, 86_400.0, 1e6)),
    )
