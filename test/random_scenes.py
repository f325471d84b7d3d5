"""Random scenes of every kind, as the plain values of a scene file; a seed always produces the same scene.

Tests and comparisons of two versions of the code draw their scenes from here. So that a seed produces the same scene
on every machine and in every version, this module imports nothing from the package, takes all random numbers from
``Random.random`` (the only method whose numbers Python guarantees) and rounds every number to six significant figures.
It draws each scene once and never consults the code under test: a few scenes in a hundred are rejected (bends that are
too tight, chains that are locked from the start, accuracies beyond floats), as some users' scenes are.

The parts of a scene are drawn in this order:

1. the benches: 1 to 300; all equal, with a longer or shorter head, or mixed; with insets from zero to half a bench,
   which leaves the smallest links; occasionally wide, or long for their track;
2. the track: a single spiral (walked inwards, outwards, or far out, up to 600 turns), an S-turn, a circle, or a
   composite of lines, arcs and spirals. Pitches and radii are drawn for these benches, from less than they need to
   several times as much, so that about half of the runs have a contact, some lock and some reach the end of the track;
   3. the leader: head or tail, forwards or backwards, at a constant speed or by a profile with ramps, jumps, rests and
   reversals; 4. the run, the accuracy, the effects and their settings.

In one scene in ten, all lengths, and therefore the speed, are in another unit, between 35 mm and 14 m: links have any
length in the world.

``./dragon python test/random_scenes.py SEED`` prints a scene as a file (JSON, which is YAML) that every command
accepts.
"""
import json
import sys
from itertools import pairwise
from math import exp, log, pi
from random import Random
from typing import Any, NamedTuple

KINDS = {'in': 34, 'out': 7, 'far': 4, 'turn': 20, 'composite': 27, 'circle': 8}     # kinds of tracks, in percent
UNITS_M = 0.035, 14.0    # links of 0.05 m to 50 m
TIGHTEST = 1.98         # the limit in scene files on curvature times longest link, for composite tracks
_NEEDS = {'clearance': 'benches', 'contact': 'clearance', 'markers': 'contact', 'forces': 'accelerations'}
_EFFECTS = ('velocity', 'benches', 'clearance', 'contact', 'markers', 'accelerations', 'forces', 'noise', 'trails',
            'clock', 'diagnostics')


class Dice:
    """Repeatable random choices."""

    def __init__(self, seed: int) -> None:
        self._random = Random(seed)

    def between(self, low: float, high: float) -> float:
        """A number between two limits."""
        return figures(low + (high - low) * self._random.random())

    def scaled(self, low: float, high: float) -> float:
        """A number between two positive limits; each decade is equally likely."""
        return figures(exp(log(low) + log(high / low) * self._random.random()))

    def whole(self, low: int, high: int) -> int:
        """A whole number between two limits, both included; small numbers are more likely."""
        return min(high, int(exp(log(low) + log((high + 1) / low) * self._random.random())))

    def chance(self, parts: float) -> bool:
        """Return True in a given percentage of cases."""
        return self._random.random() * 100 < parts

    def one(self, *choices: Any) -> Any:
        """One of several choices."""
        return choices[int(self._random.random() * len(choices))]

    def one_by_parts(self, parts: dict[Any, float]) -> Any:
        """One of several choices, drawn by their weights."""
        left = self._random.random() * sum(parts.values())
        for choice, part in parts.items():
            left -= part
            if left < 0:
                return choice
        return choice


def figures(x: float) -> float:
    """A number rounded to six significant figures."""
    return float(f'{x:.6g}')


class Benches(NamedTuple):
    """The properties of the benches that affect the other choices, in metres."""

    section: dict[str, Any]
    lengths_m: list[float]
    inset_m: float
    width_m: float

    @property
    def longest_link_m(self) -> float:
        """Length of the longest link, or a tenth of the longest bench if that is more; used as a scale."""
        return max(*(length - 2 * self.inset_m for length in self.lengths_m), 0.1 * max(self.lengths_m))

    @property
    def chain_m(self) -> float:
        """Length of the whole chain, or of the longest bench if that is longer."""
        return max(sum(length - 2 * self.inset_m for length in self.lengths_m), max(self.lengths_m))

    @property
    def least_radius_m(self) -> float:
        """Radius of the tightest bend on a composite track."""
        return self.longest_link_m / TIGHTEST


class Way(NamedTuple):
    """A track and the motion that the leader can make on it."""

    section: dict[str, Any]
    onwards_m: float                # a useful distance in the direction of ``sense``, where 1 means inwards or onwards
    lead: str = 'head'
    sense: int = 1
    has_end: bool = False           # whether the model ends after this distance


def random_scene(seed: int) -> dict[str, Any]:
    """Return the values of one scene file."""
    dice = Dice(seed)
    unit_m = dice.scaled(*UNITS_M) if dice.chance(10) else 1.0
    kind = dice.one_by_parts(KINDS)
    benches = _benches(dice, kind, unit_m)
    way = _TRACKS[kind](dice, benches)
    speed_m_s = figures(dice.one(unit_m, unit_m * dice.scaled(0.05, 20)))
    head, stop_s, arrives = _head(dice, way, speed_m_s)
    run = _run(dice, way.has_end and arrives, stop_s)
    return {'dragon': benches.section, 'track': way.section, 'head': head, 'run': run, **_ways_to_compute(dice),
            **_effects(dice, unit_m)}


def kind_of(seed: int) -> str:
    """Return the kind of a seed's scene, one of KINDS."""
    dice = Dice(seed)
    if dice.chance(10):
        dice.scaled(*UNITS_M)
    return dice.one_by_parts(KINDS)


def _benches(dice: Dice, kind: str, unit_m: float) -> Benches:
    """Draw the benches: fewer on circles and composites, where each bench is searched for separately."""
    most = 300 if kind in ('in', 'out', 'turn') else 120
    count = dice.one_by_parts({dice.whole(2, 8): 10, dice.whole(8, 40): 50, dice.whole(30, most): 40})
    count = 1 if dice.chance(1) else count
    body = figures(unit_m * dice.one(2.2, dice.between(0.6, 3.5)))
    inset = figures(body * dice.one_by_parts({0.125: 55, 0.0: 15, dice.between(0, 0.2): 28,
                                              dice.between(0.2, 0.45): 2}))
    if dice.chance(1.5):
        inset = 0.5 * body - max(0.03, 0.03 * body)     # the smallest links, and a sixteenth of the bench
    width = figures(body * dice.one_by_parts({0.136364: 55, dice.between(0.03, 0.25): 42, dice.scaled(0.3, 2.0): 3}))
    one = {'width_m': width, 'hole_inset_m': inset}
    least = max(2 * inset + 0.051, 1.07 * 2 * inset, 0.05 * body)    # links of 0.05 m, and a twentieth of the bench
    how = dice.one_by_parts({'longer head': 42, 'equal': 28, 'shorter head': 5, 'mixed': 25})
    if how == 'mixed':
        groups = _groups(dice, count, least, body)
        lengths = [group['length_m'] for group in groups for _ in range(group.get('count', 1))]
        return Benches({'kind': 'mixed', 'groups': groups, **one}, lengths, inset, width)
    head = {'longer head': body * dice.one(1.55, dice.between(1, 3)), 'equal': body,
            'shorter head': max(least, body * dice.between(0.3, 1))}[how]
    head = head if how == 'equal' else figures(head)
    head = max(head, least)
    section = {'benches': count, 'head_length_m': head, 'body_length_m': body, **one}
    return Benches(section if dice.chance(50) else {'kind': 'equal', **section}, [head] + [body] * (count - 1), inset,
                   width)


def _groups(dice: Dice, count: int, least_m: float, body_m: float) -> list[dict[str, Any]]:
    """Draw two to six groups of benches; the last groups may repeat lengths."""
    lengths: list[float] = []
    groups = []
    for left in range(dice.whole(2, 6), 0, -1):
        again = lengths and dice.chance(30)
        length = dice.one(*lengths) if again else max(least_m, figures(body_m * dice.scaled(0.65, 1.8)))
        lengths.append(length)
        some = 1 if dice.chance(30) else max(1, min(count - left, dice.whole(1, max(1, count))))
        count = max(left, count - some)
        groups.append({'length_m': length} if some == 1 and dice.chance(70) else {'count': some, 'length_m': length})
    return groups


def _pitch(dice: Dice, benches: Benches, radius_m: float) -> float:
    """Draw a pitch that is nearly sufficient, too small, or ample for the longest benches at a radius.

    The middle of a bench of length L on a circle of radius r lies L^2 / (8 r) inside the circle.
    """
    width, longest = benches.width_m, max(benches.lengths_m)
    meeting = width + longest**2 / (8 * radius_m * dice.between(0.9, 1.3))
    return figures(dice.one_by_parts({
        meeting: 65, width * dice.between(0.7, 1.1): 2, width * dice.between(1.1, 2.2): 10,
        width + longest * dice.between(0.02, 0.3): 15, longest * dice.scaled(0.4, 6): 8}))


def _inwards(dice: Dice, benches: Benches) -> Way:
    """A single spiral, walked towards the centre from a distance of several links, or as far as the chain extends."""
    wound_m = benches.chain_m * dice.between(0.3, 1) / (2 * pi)     # the dragon winds round at least once
    start_m = max(benches.longest_link_m, dice.one(benches.longest_link_m * dice.between(1, 8), wound_m, wound_m))
    pitch = _pitch(dice, benches, start_m * dice.scaled(0.25, 0.9))
    radius_m = min(max(start_m, pitch * dice.between(0.3, 1.5)), 40 * pitch)
    turns = figures(radius_m / pitch)
    length_m = pi * pitch * turns * turns
    lead, sense = ('tail', -1) if dice.chance(2) else ('head', 1)
    onwards_m = min(length_m * dice.one(1.2, 1.2, 1.2, dice.between(0.1, 1)), 1000 * benches.longest_link_m)
    return Way(_spiral(dice, pitch, turns), onwards_m, lead, sense, sense == 1)


def _spiral(dice: Dice, pitch: float, turns: float) -> dict[str, Any]:
    kind = {} if dice.chance(50) else {'kind': 'spiral'}
    return {**kind, 'pitch_m': pitch, 'start_turns': turns}


def _outwards(dice: Dice, benches: Benches) -> Way:
    """A single spiral that a head leaves by moving back, or a tail by pulling the other handles."""
    start_m = benches.longest_link_m * dice.between(0.8, 4)
    pitch = _pitch(dice, benches, start_m * dice.scaled(0.5, 1.2))
    radius_m = max(start_m, pitch * dice.between(0.5, 2))
    lead, sense = ('head', -1) if dice.chance(40) else ('tail', 1)
    return Way(_spiral(dice, pitch, figures(radius_m / pitch)), benches.longest_link_m * dice.scaled(2, 80), lead,
               sense)


def _far(dice: Dice, benches: Benches) -> Way:
    """A single spiral so far out that polar angles have few digits left."""
    pitch = max(_pitch(dice, benches, 10 * benches.longest_link_m), 0.95 * benches.width_m)
    lead = dice.one('head', 'head', 'tail')
    return Way(_spiral(dice, pitch, dice.scaled(1e2, 600)), benches.longest_link_m * dice.scaled(2, 50), lead,
               dice.one(1, 1, -1))


def _turn(dice: Dice, benches: Benches) -> Way:
    """An S-turn whose tighter arc is random; with b = pitch / 2 pi, the radii add up to hypot(diameter / 2, b).

    The two spirals of the turn interleave, half a pitch apart.
    """
    ratio = dice.one(1.0, 2.0, dice.scaled(0.4, 2.5))
    tighter_m = benches.least_radius_m * dice.one_by_parts({dice.between(0.97, 1.02): 5, dice.between(1.02, 1.6): 65,
                                                            dice.between(1.6, 4): 30})
    lead, sense = dice.one_by_parts({('head', 1): 75, ('head', -1): 8, ('tail', 1): 17})
    layers = dice.between(0.8, 1.6) if (lead, sense) == ('head', 1) else dice.between(1.9, 3)
    pitch = figures(layers * _pitch(dice, benches, tighter_m * (1 + max(ratio, 1 / ratio))))
    sum_m = max(tighter_m * (1 + max(ratio, 1 / ratio)), 1.2 * pitch / (2 * pi))
    diameter_m = figures(2 * (sum_m**2 - (pitch / (2 * pi))**2)**0.5)
    turn_m = 2 * pi * sum_m     # approximate
    before_m = figures(turn_m * dice.between(-0.1, 2)) if (lead, sense) == ('head', 1) else figures(
        -(turn_m + benches.chain_m * dice.between(0, 0.8)))
    onwards_m = abs(before_m) + turn_m + min(benches.chain_m, 40 * benches.longest_link_m) * dice.between(0.4, 1.3)
    section = {'kind': 'turn', 'pitch_m': pitch, 'diameter_m': diameter_m, 'ratio': ratio, 'before_m': before_m}
    return Way(section, min(onwards_m, 250 * benches.longest_link_m), lead, sense)


def _circle(dice: Dice, benches: Benches) -> Way:
    """A circular walk, on a circle alone or from a line into a circle."""
    least = benches.least_radius_m
    radius_m = figures(dice.one(least * dice.between(1.0, 4),
                                max(benches.chain_m * dice.between(0.9, 1.8) / (2 * pi), 1.01 * least)))
    angle = dice.one(1, -1) * dice.between(90, 900)
    arc = {'kind': 'arc', 'radius_m': radius_m, 'angle_deg': figures(angle)}
    line_m = figures(benches.longest_link_m * dice.between(0.2, 20))
    pieces = dice.one([arc], [{'kind': 'line', 'length_m': line_m}, arc],
                      [{'kind': 'line', 'length_m': line_m}, arc, {'kind': 'line', 'length_m': line_m}])
    length_m = sum(_length_m(piece) for piece in pieces)
    return _on_pieces(dice, pieces, length_m, benches)


def _composite(dice: Dice, benches: Benches) -> Way:
    """Lines, arcs and spirals joined end to end; the first line, arc or spiral that winds in is continued backwards."""
    pieces: list[dict[str, Any]] = []
    for _ in range(dice.whole(2, 8)):
        pieces.append(_piece(dice, benches, not pieces))
    if dice.chance(20):
        pieces[0] |= {'at_m': [figures(benches.chain_m * dice.between(-2, 2)), 0.0],
                      'heading_deg': dice.between(-180, 180)}
    return _on_pieces(dice, pieces, sum(_length_m(piece) for piece in pieces), benches)


def _piece(dice: Dice, benches: Benches, first: bool) -> dict[str, Any]:
    """Draw one piece of track."""
    link, least = benches.longest_link_m, benches.least_radius_m
    radius_m = least * dice.one_by_parts({dice.between(0.95, 1.02): 1, dice.between(1.02, 1.5): 50,
                                          dice.between(1.5, 5): 50})
    kinds = {'line': 60, 'arc': 12, 'spiral': 28} if first else {'line': 25, 'arc': 55, 'spiral': 20}
    kind = dice.one_by_parts(kinds)
    if kind == 'line':
        return {'kind': 'line', 'length_m': figures(link * dice.scaled(0.1, 20))}
    if kind == 'arc':
        angle_deg = dice.one(1, -1) * dice.one(dice.between(5, 180), dice.between(90, 540), dice.between(200, 500))
        return {'kind': 'arc', 'radius_m': figures(radius_m), 'angle_deg': figures(angle_deg)}
    pitch = _pitch(dice, benches, radius_m)
    inner = max(1.15 * radius_m / pitch, 0.25)
    outer = inner + dice.one(dice.between(0.2, 1), dice.between(0.5, 4))
    turns = (outer, inner) if first or dice.chance(50) else (inner, outer)
    return {'kind': 'spiral', 'pitch_m': pitch, 'from_turns': figures(turns[0]), 'to_turns': figures(turns[1]),
            'side': dice.one('left', 'right')}


def _length_m(piece: dict[str, Any]) -> float:
    """Return the approximate length of a piece."""
    if piece['kind'] == 'line':
        return float(piece['length_m'])
    if piece['kind'] == 'arc':
        return float(piece['radius_m'] * abs(piece['angle_deg']) * pi / 180)
    return float(pi * piece['pitch_m'] * abs(piece['from_turns']**2 - piece['to_turns']**2))


def _on_pieces(dice: Dice, pieces: list[dict[str, Any]], length_m: float, benches: Benches) -> Way:
    """Draw the head's start on a composite track, the leader and its direction."""
    lead, sense = dice.one_by_parts({('head', 1): 84, ('head', -1): 5, ('tail', 1): 11})
    forward = (lead, sense) == ('head', 1)
    part = dice.one(0.0, 0.0, 0.0, 0.0, dice.between(0, 0.5)) if forward else dice.between(0.5, 0.999)
    start_m = figures(length_m * part)
    section = {'kind': 'joined', 'pieces': pieces, **({} if start_m == 0 and dice.chance(50) else {'start_m': start_m})}
    left_m, part = (length_m - start_m, dice.one(1.1, 1.1, dice.between(0.3, 1))) if forward else (
        start_m, dice.between(0.3, 1.5))
    onwards_m = left_m * part
    return Way(section, min(onwards_m, 200 * benches.longest_link_m), lead, sense, forward)


_TRACKS = {'in': _inwards, 'out': _outwards, 'far': _far, 'turn': _turn, 'circle': _circle, 'composite': _composite}


def _head(dice: Dice, way: Way, speed_m_s: float) -> tuple[dict[str, Any], float, bool]:
    """Draw the head law, the time in which the leader roughly covers the useful distance, and whether it moves on."""
    lead = {'lead': way.lead} if way.lead == 'tail' or dice.chance(20) else {}
    time_s = figures(way.onwards_m / speed_m_s)
    if dice.chance(2):
        return {'speed_m_s': 0.0, **lead}, time_s, False
    if dice.chance(72):
        kind = {'kind': 'constant'} if dice.chance(20) else {}
        return {**kind, 'speed_m_s': way.sense * speed_m_s, **lead}, time_s, True
    knots, ends_s = _knots(dice, way.sense * speed_m_s, time_s)
    ramps = dice.one({}, {'ramps': 'linear'}, {'ramps': 'smooth'})
    return {'kind': 'profile', 'knots': knots, **ramps, **lead}, ends_s, knots[-1][1] * way.sense > 0


def _knots(dice: Dice, speed_m_s: float, time_s: float) -> tuple[list[list[float]], float]:
    """Draw a profile, and the time in which the leader covers about the same distance as at a constant speed."""
    knots = [[0.0, dice.one(0.0, speed_m_s)]]
    for _ in range(dice.whole(1, 7)):
        t_s, before = knots[-1]
        after = figures(speed_m_s * dice.one_by_parts({1.0: 30, dice.between(0.2, 1.5): 30, 0.0: 20,
                                                       dice.between(-1, -0.2): 20}))
        if dice.chance(12):
            knots.append([t_s, after])                                  # a jump
        else:
            later_s = figures(t_s + time_s * dice.between(0.02, 0.5))
            knots.append([later_s, before if dice.chance(25) else after])      # a constant speed (or a rest), or a ramp
    if knots[-1][1] * speed_m_s <= 0 and dice.chance(70):
        knots.append([figures(knots[-1][0] + 0.1 * time_s), speed_m_s])
    gone_s = sum(0.5 * (v0 + v1) * (t1 - t0) for (t0, v0), (t1, v1) in pairwise(knots)) / speed_m_s
    return knots, figures(knots[-1][0] + max(time_s - gone_s, 0.05 * time_s))


def _run(dice: Dice, arrives: bool, stop_s: float) -> dict[str, Any]:
    """Draw when the run starts and stops; a run that reaches an end of the model may have no stop."""
    run: dict[str, Any] = {}
    if not (arrives and dice.chance(40)):
        run['stop_s'] = figures(stop_s * dice.one(1, 1, 1, 1, dice.between(0.1, 1)))
    if dice.chance(15):
        run['start_s'] = figures(0.5 * run.get('stop_s', 0.2 * stop_s) * dice.between(0, 1))
    if dice.chance(30):
        run['rate_hz'] = dice.one(10, 25.0, 29.97, 1000, dice.scaled(0.01, 1000))
    return run


def _ways_to_compute(dice: Dice) -> dict[str, Any]:
    """Draw the accuracy, the solver and the display of benches; defaults are omitted more often than not."""
    values: dict[str, Any] = {}
    if dice.chance(50):
        values['accuracy'] = dice.one_by_parts({'exact': 30, 'fine': 20, 'standard': 20, 'preview': 15,
                                                dice.scaled(1e-11, 0.1): 15})
    if dice.chance(20):
        values['solver'] = dice.one('table', 'march')
    if dice.chance(20):
        values['markers'] = dice.one('cubes', 'triangles')
    return values


def _effects(dice: Dice, unit_m: float) -> dict[str, Any]:
    """Draw effects, the effects that they require, and their settings."""
    if dice.chance(50):
        return {}
    effects = {name for name in _EFFECTS if dice.chance(8 if name in ('accelerations', 'forces') else 30)}
    for name, need in reversed(_NEEDS.items()):
        effects |= {need} if name in effects else set()
    values: dict[str, Any] = {'effects': [name for name in _EFFECTS if name in effects]}
    if 'noise' in effects and dice.chance(60):
        values['noise'] = {'position_m': figures(unit_m * dice.scaled(1e-4, 0.1)), 'seed': dice.whole(1, 10**6)}
    if 'trails' in effects and dice.chance(60):
        values['trails'] = {'seconds': dice.scaled(0.1, 100), 'points': dice.whole(2, 200)}
    return values


def main(seeds: list[str]) -> None:
    """Print the scenes of the given seeds."""
    for seed in seeds:
        print(json.dumps(random_scene(int(seed)), indent=1))


if __name__ == '__main__':
    main(sys.argv[1:])
