"""The true results of the contest at any time, and the true answers to its questions."""
from dataclasses import replace
from functools import cache
from math import pi
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

import dragon_ros as dr
from dragon_contest.mistakes import SPEED_M_S, START, arc_length, turning, winding
from dragon_ros.cli.inputs import Floats

RESULTS = ('result1', 'result2', 'result4')
_MORE_TURNS = 2                 # number of turns added before the start, for results with shifted times
_BEFORE_S = 300.0               # time (s) added before the turn, for results with shifted times
_LATEST_S = 1000.0


class TrueStates(NamedTuple):
    """Handles (m, shape (T, 224, 2)) and speeds (m/s, shape (T, 224)); nan at times without a state."""

    handles_m: Floats
    speed_m_s: Floats


@cache
def contact_s() -> float:
    """Return the time (s) at which benches first touch."""
    found = dr.compile(winding()).contact()
    assert isinstance(found, dr.Contact)
    return found.t_s


def wound_scene(dragon: dr.Dragon | None = None, pitch_m: float = dr.Spiral.pitch_m) -> tuple[dr.Scene, float]:
    """Return the scene in which the dragon winds in from two turns before its start, and the time (s) of that start."""
    b_m = pitch_m / 2 / pi
    ahead = np.array((START + 2 * pi * _MORE_TURNS, START))
    longer, start = arc_length(ahead).tolist()
    track = dr.Spiral(pitch_m, START / 2 / pi + _MORE_TURNS)
    return dr.Scene(dragon=dragon or dr.Dragon(), track=track), b_m * (longer - start) / SPEED_M_S


def turned_scene(dragon: dr.Dragon | None = None, track: dr.STurn | None = None) -> tuple[dr.Scene, float]:
    """Return the scene of the turning dragon from 300 s before the turn, and the time (s) at which the turn begins."""
    default = turning().track
    assert isinstance(default, dr.STurn)
    run = dr.Run(stop_s=_BEFORE_S + _LATEST_S)
    track = replace(track or default, before_m=_BEFORE_S)
    return dr.Scene(dragon=dragon or dr.Dragon(), track=track, run=run), _BEFORE_S


def state_at(scene: dr.Scene, times_s: Floats) -> TrueStates:
    """Return the states of a scene at many times; they are nan at times outside the run."""
    there = _in_run(scene, times_s)
    handles = np.full((times_s.size, scene.dragon.benches + 1, 2), np.nan)
    speed = np.full(handles.shape[:2], np.nan)
    if there.any():
        times = times_s[there].tolist()
        motion = dr.compile(scene).states(times)
        handles[there], speed[there] = motion.handles_m, motion.speed_m_s
    return TrueStates(handles, speed)


def handles_at(scene: dr.Scene, times_s: Floats) -> Floats:
    """Return the handles (m, shape (T, N+1, 2)) of a scene at many times; they are nan at times outside the run."""
    there = _in_run(scene, times_s)
    handles = np.full((times_s.size, scene.dragon.benches + 1, 2), np.nan)
    if there.any():
        handles[there] = dr.compile(scene).handles_m(times_s[there])
    return handles


def _in_run(scene: dr.Scene, times_s: Floats) -> NDArray[np.bool_]:
    there: NDArray[np.bool_] = (times_s >= 0) & (times_s <= dr.compile(scene).span_s[1])
    return there


@cache
def _scene_of(result: str) -> tuple[dr.Scene, float]:
    return turned_scene() if result == 'result4' else wound_scene()


def truth_at(result: str, times_s: Floats) -> TrueStates:
    """Return the true states of a result at its times; for ``result2``, every state is the state at the contact."""
    scene, offset_s = _scene_of(result)
    return state_at(scene, (np.full(times_s.size, contact_s()) if result == 'result2' else times_s) + offset_s)
