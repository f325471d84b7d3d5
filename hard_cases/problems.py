"""The hard cases on one spiral, in series that approach each singularity; ``dances`` contains the others."""
from dataclasses import dataclass, replace
from functools import lru_cache
from math import pi

from dragon_ros.core.chain.dragon import AnyDragon, Dragon, Group, Mixed
from dragon_ros.core.chain.head_law import Head
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.tracks.spec import Spiral


@dataclass(frozen=True)
class Problem:
    """A scene, the times at which it is hard, and the handles in the reference, including the worst handle."""

    name: str
    scene: Scene
    times_s: tuple[float, ...]
    handles: tuple[int, ...]
    why: str


_CLASSIC = Scene()
_LOCK_S = 432.91792422838296     # lock of the classic dragon, rounded to a float; a test compares it with the model
_ALL = tuple(range(224))
MIXED = Mixed((Group(3.41), Group(2.2, 10), Group(1.1), Group(4.0, 2), Group(0.55), Group(0.9, 15), Group(2.2, 10)))
_LONG_FOURTH, _FOURTH_LOCKS_S = Mixed((Group(1.1, 3), Group(3.9), Group(1.6, 6))), 430.61003584845963


def _some(benches: int) -> tuple[int, ...]:
    """Return some handles of a long dragon, including the first and the last."""
    near = (k for k in (0, 1, 2, 3, 10) if k < benches)
    return tuple(sorted({*near, *(benches * k // 20 for k in range(1, 21))}))


def _scaled(scale: float) -> Scene:
    """Return the classic dragon with 40 benches, with every length multiplied by ``scale``."""
    d = Dragon(40)
    return Scene(dragon=Dragon(40, d.head_length_m * scale, d.body_length_m * scale, d.width_m * scale,
                               d.hole_inset_m * scale),
                 track=Spiral(0.55 * scale, 16.0), head=Head(scale))


def _with(name: str, why: str, times_s: tuple[float, ...], dragon: AnyDragon | None = None, track: Spiral | None = None,
          speed_m_s: float = 1.0) -> Problem:
    dragon = dragon or Dragon(40)
    scene = Scene(dragon=dragon, track=track or Spiral(), head=Head(speed_m_s), run=Run(0, max(times_s)))
    return Problem(name, scene, times_s, _some(dragon.benches), why)


@lru_cache(maxsize=1)
def problems() -> tuple[Problem, ...]:
    """Return every hard case."""
    twenty = replace(_CLASSIC, dragon=Dragon(20))
    diameter = _diameter_start()
    return (
        Problem('classic', _CLASSIC, (0.0, 60.0, 120.0, 180.0, 240.0, 300.0, 360.0, 400.0, 412.47), _ALL,
                'the contest scene, all handles'),
        *(Problem(f'lock-1e-{k}', twenty, (_LOCK_S - 10.0 ** -k,), tuple(range(21)),
                  f'1e-{k} s before the smallest root of the chord equation vanishes') for k in range(0, 13, 2)),
        _with('across', 'the first link is almost perpendicular to the track: its follower stops and turns back',
              (432.0, 432.3, 432.5, 432.6, 432.7, 432.8), Dragon(20)),
        _with('inner-turn', 'short links down to the last turn before the centre', (0.0, 2.5, 3.0, 3.1),
              Dragon(40, 0.7, 0.65), Spiral(0.55, 1.4)),
        _with('centre', 'the head reaches the centre itself', (0.0, 6.0, 6.425), Dragon(6, 0.6, 0.6), Spiral(1.0, 1.4)),
        _with('link-beyond-diameter', 'a head link longer than the diameter at its front end', (432.85, 432.9),
              Dragon(20)),
        _with('link-is-diameter', 'a head link equal to the diameter 2 theta + pi', (0.0,), Dragon(20), diameter),
        _with('tiny-pitch', 'eight thousand turns that are almost circles', (0.0, 100.0, 1000.0, 1.9e5), None,
              Spiral(1e-3, 8000.0)),
        _with('huge-pitch', 'an almost straight track', (0.0, 100.0, 500.0), None, Spiral(1e3, 2.0)),
        *(Problem(f'scale-{scale:g}', _scaled(scale), (0.0, 300.0, 412.0), _some(40),
                  f'every length and the speed times {scale:g}') for scale in (1e-7, 1e-3, 1e3, 1e7)),
        _with('long', 'a hundred thousand links', (0.0, 400.0), Dragon(100_000)),
        _with('far-1e4', 'polar angles near 1e4 rad', (0.0, 300.0, 4.37e6), None, Spiral(0.55, 1e4 / (2 * pi))),
        _with('far-1e6', 'polar angles near 1e6 rad', (0.0, 300.0), None, Spiral(0.55, 1e6 / (2 * pi))),
        _with('far-1e9', 'polar angles near 1e9 rad', (0.0, 300.0), None, Spiral(0.55, 1e9 / (2 * pi))),
        _with('joined-handles', 'body links of zero length', (0.0, 300.0), Dragon(10, 3.41, 0.55)),
        _with('almost-joined', 'body links one nanometre long', (0.0, 300.0), Dragon(10, 3.41, 0.55 + 1e-9)),
        _with('mixed', 'benches of six lengths, one of them with coinciding handles', (0.0, 300.0, 412.0, 432.0),
              MIXED),
        _with('mixed-lock', 'a long fourth link that locks first; 1e-2 to 1e-8 s before the lock',
              tuple(_FOURTH_LOCKS_S - 10.0 ** -k for k in (2, 4, 6, 8)), _LONG_FOURTH),
        _with('rest', 'a head at rest', (0.0, 1e6), None, None, 0.0),
        _with('crawl', 'a head at 1e-9 m/s', (0.0, 1e9), None, None, 1e-9),
        _with('rush', 'a head at 1e6 m/s', (0.0, 1e-4, 4.12e-4), None, None, 1e6),
        _with('outwards', 'winding out', (0.0, 300.0, 1e5), None, Spiral(0.55, 4.0), -1.0),
    )


def _diameter_start() -> Spiral:
    """Return the classic track, started so that the head link equals the diameter 2 theta + pi in units of b."""
    theta = 0.5 * (Dragon().head_link_m / Spiral().b_m - pi)
    return Spiral(0.55, theta / (2 * pi))
