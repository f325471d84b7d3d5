"""Velocities and accelerations of short chains, computed as a reference by finite differences with 40 digits."""
import mpmath
import numpy as np
from mpmath import mp, mpc, mpf

from dragon_ros.core.model import compile_scene
from dragon_ros.core.tracks.segments import BEHIND, ArcSegment, LineSegment

DIGITS, STEP = 40, mpf(10) ** -10     # second-order differences have an error of STEP^2, so 20 digits are correct


def point(segment, u):
    """Return the point at a coordinate of a segment, which may be beyond the segment's ends."""
    if isinstance(segment, LineSegment):
        return mpc(segment.start) + mpc(segment.direction) * u
    if isinstance(segment, ArcSegment):
        side = 1j * segment.side
        spoke = -side * mpf(segment.radius_m) * mpc(segment.direction)
        return mpc(segment.start) + spoke * (mpmath.expj(segment.side * u) - 1)
    b = mpf(segment.curve.pitch_m) / (2 * mp.pi)
    return mpc(segment.centre) + mpc(segment.rotation) * b * u * mpmath.expj(segment.side * u)


def metres(segment, u):
    """Return the arc length up to a coordinate, positive in the head's direction."""
    if isinstance(segment, LineSegment):
        return u
    if isinstance(segment, ArcSegment):
        return u * mpf(segment.radius_m)
    b = mpf(segment.curve.pitch_m) / (2 * mp.pi)
    return segment.winding * b / 2 * (u * mpmath.sqrt(1 + u * u) + mpmath.asinh(u))


def root(function, start):
    """Find a simple root by the secant method; its order of 1.6 turns 12 digits into 40 in three steps."""
    a, b = start, start + mpf(10) ** -8
    at_a, at_b = function(a), function(b)
    for _ in range(60):
        if at_b == at_a or abs(b - a) <= mpf(10) ** (3 - DIGITS) * (1 + abs(b)):
            return b
        a, b, at_a = b, b - at_b * (b - a) / (at_b - at_a), at_b
        at_b = function(b)
    raise ArithmeticError(f'no root near {start}')


def handles(chain, segments, links, forward_m):
    """Return the handles as complex numbers on fixed segments, with the leader ``forward_m`` further along.

    Segments continue beyond their ends: at a joint the result applies to the side of the requested segment.
    """
    track, order = chain.track, range(len(segments)) if chain.leader == 0 else range(len(segments) - 1, -1, -1)
    out = [None] * len(segments)
    before = None
    for i in order:
        segment, u = track.segments[segments[i]], chain.starts[i]
        if before is None:
            goal = metres(segment, u) + forward_m
            u = root(lambda x, segment=segment, goal=goal: metres(segment, x) - goal, u)
        else:
            length = links[min(i, before)]
            u = root(lambda x, segment=segment, length=length, here=out[before]:
                     abs(point(segment, x) - here) - length, u) if length else u
        out[i] = out[before] if before is not None and not links[min(i, before)] else point(segment, u)
        before = i
    return out


class Guess:
    """Initial guesses for the roots, taken from a chain of the package, with each handle on the requested segment."""

    def __init__(self, chain, segments):
        self.track, self.leader = chain.track, chain.leader
        self.starts = [mpf(float(u)) for u in chain.u]
        for i, k in enumerate(segments):
            if k != chain.segment[i]:     # the handle is at the joint between the two segments
                self.starts[i] = mpf(float(chain.track.segments[k].first if k > chain.segment[i] else
                                           chain.track.segments[k].last))


def rates(scene, t_s, segments=None):
    """Return the velocities and accelerations of a scene's handles, on the given segments or on their actual ones."""
    with mp.workdps(DIGITS):
        model = compile_scene(scene).model
        chain = model.march(scene.head.travelled_m(t_s))
        segments = chain.segment.tolist() if segments is None else segments
        links = [mpf(float(length)) for length in scene.dragon.link_lengths_m]
        guess = Guess(chain, segments)
        back, here, on = (handles(guess, segments, links, sign * STEP) for sign in (-1, 0, 1))
        way = 1 if model.direction == BEHIND else -1
        speed, rate = way * mpf(scene.head.speed_at_m_s(t_s)), way * mpf(scene.head.acceleration_at_m_s2(t_s))
        v, a = [], []
        for p, q, r in zip(back, here, on, strict=True):
            slope, bend = (r - p) / (2 * STEP), (r - 2 * q + p) / STEP ** 2
            v.append(slope * speed)
            a.append(bend * speed ** 2 + slope * rate)
        return tuple(np.array([[float(z.real), float(z.imag)] for z in row]) for row in (v, a))
