"""The proof that no dragon of a family on one spiral touches itself up to a stated time.

In units of b = pitch / 2 pi the spiral is r = theta. A box consists of five intervals of floats: the polar angle of the
front handle of a bench, the angle by which the front handle of another bench is further out, 1 / b, and the link
lengths of both benches in metres. A box is halved until one edge separates the benches everywhere in the box, or until
nothing in the box can occur, because the head would have travelled too far or because no number of links can join one
bench to the other. The proof of this method is in docs/contact.md.
"""
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property, lru_cache
from itertools import pairwise
from math import hypot, inf, isfinite, nextafter, pi

from flint import acb, arb

from dragon_ros.verify.balls import above, below, direction, exact, half_turn, size
from dragon_ros.verify.cover import Progress
from dragon_ros.verify.errors import Refused
from dragon_ros.verify.law import Law
from dragon_ros.verify.reading import FamilyClaims, Spiral
from dragon_ros.verify.segments import about_span

_BOXES = 60_000         # maximum number of boxes; the proof of a family needs about ten thousand
_LINKS = 100            # number of placed links that count as one box
_FIRST_RAD = 2.0        # angle about the centre that each of the first boxes covers
_LEAST = 1e-9           # width of the narrowest box, relative to the variable
_BENT = Fraction(109, 100)      # the curvature of any spiral is at most 1.09 / r
_NEAR = 1e-11           # distance of the first tested bound from a span, relative to the span
_BELOW, _ABOVE = -1, 1  # the side of a value on which a float provably lies
_PASSES = 6             # number of iterations that bound the head's position, given the handle behind it
_HALF = Fraction(1, 2)

Interval = tuple[float, float]
Box = tuple[Interval, Interval, Interval, Interval, Interval]
THETA, AHEAD, SCALE, LINK, OTHER = range(5)


@dataclass(frozen=True)
class Family:
    """The exact ranges (smallest, largest) of the dragons' dimensions in metres; the claim holds until ``until_s``."""

    benches: int
    start_turns: Fraction
    pitch_m: tuple[Fraction, Fraction]
    head_link_m: tuple[Fraction, Fraction]
    body_link_m: tuple[Fraction, Fraction]
    width_m: Fraction
    overhang_m: Fraction
    law: Law
    start_s: Fraction
    until_s: Fraction


def prove_family(claims: FamilyClaims, effort: float, progress: Progress) -> int:
    """Prove that no dragon touches itself, and return the number of boxes. Raises Refused if there is no proof."""
    return _Proof(_family_of(claims), int(effort * _BOXES), progress).run()


def _family_of(claims: FamilyClaims) -> Family:
    """Return the family of a certificate. Raises Refused for scenes that are not supported."""
    scene, within = claims.scene, {key: Fraction(value) for key, value in claims.within.items()}
    track, lengths = scene.track, scene.lengths_m
    if not isinstance(track, Spiral) or scene.tail_leads:
        raise Refused('scene: family proofs support only a single spiral, with the head as leader')
    if len(set(lengths[1:])) > 1 or len(lengths) < 3:
        raise Refused('scene.dragon: family proofs require three or more benches, all equal behind the head')
    inset = _around(scene.inset_m, within.get('dragon.hole_inset_m', Fraction(0)))
    ends = (_around(length_m, within.get(key, Fraction(0))) for key, length_m in (
        ('dragon.head_length_m', lengths[0]), ('dragon.body_length_m', lengths[1])))
    head, body = ((low - 2 * inset[1], high - 2 * inset[0]) for low, high in ends)
    pitch = _around(track.pitch_m, within.get('track.pitch_m', Fraction(0)))
    if not min(head[0], body[0], pitch[0]) > 0:
        raise Refused('within: a link or the pitch may be zero')
    return Family(len(lengths), Fraction(track.start_turns), pitch, head, body,
                  Fraction(scene.width_m) + within.get('dragon.width_m', Fraction(0)), inset[1], scene.law,
                  Fraction(scene.start_s), Fraction(claims.proved_s))


def _around(value: float, tolerance: Fraction) -> tuple[Fraction, Fraction]:
    return max(Fraction(value) - tolerance, Fraction(0)), Fraction(value) + tolerance


def _floats(low: Fraction | arb, high: Fraction | arb) -> Interval:
    """Return two floats that enclose two numbers."""
    return below(exact(low) if isinstance(low, Fraction) else low), above(
        exact(high) if isinstance(high, Fraction) else high)


def _ball(interval: Interval) -> arb:
    return arb(interval[0]).union(arb(interval[1]))


def _excess(theta: arb, delta: arb, chord: arb) -> arb:
    """Return F(theta, delta) - c^2 / 2."""
    sine = (delta / 2).sin()
    return delta * delta / 2 + 2 * theta * (theta + delta) * (sine * sine) - chord * chord / 2


@lru_cache(maxsize=65536)
def _span(theta: float, chord: float, sense: int) -> float:
    """Return a float that is provably below or above (``sense``) the span of a chord.

    ``theta`` is the polar angle at the start of the chord. Up to pi the chord grows with the span, so the sign of F -
    c^2 / 2 shows on which side of the root a span is.
    """
    near = about_span(theta, chord)
    wider = _NEAR
    while near is not None and wider < 1e-6:
        span = near * (1 + sense * wider)
        if span < pi and _excess(arb(theta), arb(span), arb(chord)) * sense > 0:
            return span
        wider *= 8
    raise Refused('the position of a link of the family could not be proved')


def _next(theta: float, chord: float, sense: int) -> float:
    """Return a float that is provably below or above (``sense``) the angle of the handle one chord behind ``theta``."""
    return nextafter(theta + _span(theta, chord, sense), sense * inf)


def _spans(theta: Interval, scale: Interval, link: Interval) -> arb:
    """Return a ball that contains the spans of links with front handles between two angles (lemma 1)."""
    short, long = below(arb(scale[0]) * arb(link[0])), above(arb(scale[1]) * arb(link[1]))
    return arb(_span(theta[1], short, _BELOW)).union(arb(_span(theta[0], long, _ABOVE)))


def _added(one: Interval, other: Interval) -> Interval:
    return below(arb(one[0]) + arb(other[0])), above(arb(one[1]) + arb(other[1]))


class _Proof:
    """Clears the boxes of a family one by one, always starting with the last one."""

    def __init__(self, family: Family, most: int, progress: Progress) -> None:
        self._family, self._most, self._tell, self._links = family, most, progress, 0
        least_m, most_m = family.pitch_m
        self._scale = _floats(2 * half_turn() / exact(most_m), 2 * half_turn() / exact(least_m))
        self._head, self._body = _floats(*family.head_link_m), _floats(*family.body_link_m)
        self._half, self._over = above(exact(family.width_m * _HALF)), above(exact(family.overhang_m))
        self._start = 2 * half_turn() * exact(family.start_turns)
        gone = family.law.extent_m(family.start_s, family.until_s)
        if gone[0] < family.law.gone_m(family.start_s):
            raise Refused('proved_s: the head moves backwards before this time, which family proofs do not support')
        self._gone_m = exact(gone[0]), exact(gone[1])

    @cached_property
    def _arc_start(self) -> arb:
        return self._arc(self._start)

    @staticmethod
    def _arc(theta: arb) -> arb:
        """Return twice the arc length from the centre, in units of b."""
        return theta * (1 + theta * theta).sqrt() + theta.asinh()

    def _gone_by(self, theta: float, scale: float) -> arb:
        """Return the distance (m) that the head has travelled when it is at a polar angle."""
        return (self._arc_start - self._arc(arb(theta))) / (2 * arb(scale))

    def run(self) -> int:
        """Carry out the proof, and return its number of boxes."""
        first = self._first()
        lengths_m = [(arb(box[THETA][1])**2 - arb(box[THETA][0])**2) / (2 * arb(self._scale[1])) for _, box in first]
        whole_m, done_m, done = float(sum(lengths_m, arb(0))), 0.0, 0
        for (lead, box), length_m in zip(first, lengths_m, strict=True):
            done += self._clear(lead, box, done)
            done_m += float(length_m)
            self._tell(done_m, whole_m, '')
        return done

    def _first(self) -> list[tuple[int, Box]]:
        """Return boxes for all positions of the head (marked 0) and of all front handles behind it (marked 1)."""
        inner, outer = self._innermost(), above(self._start)
        rear = _next(inner, below(arb(self._scale[0]) * arb(self._head[0])), _BELOW)
        first = [(0, box) for box in self._row(inner, outer, self._head)]
        if self._family.benches > 3:        # of three benches, only the head has two benches behind it
            first += [(1, box) for box in self._row(rear, self._last(outer), self._body)]
        return first

    def _last(self, theta: float) -> float:
        """Return the front handle's angle for the last bench with two benches behind it, if the head is at ``theta``.

        By lemma 6, this angle is largest for the longest links.
        """
        for link in [self._head[1], *[self._body[1]] * (self._family.benches - 4)]:
            theta = _next(theta, above(arb(self._scale[1]) * arb(link)), _ABOVE)
        return theta

    def _clear(self, lead: int, box: Box, before: int) -> int:
        """Clear a box, after ``before`` others, and return the number of boxes that were processed. Raises Refused."""
        boxes, done = [box], 0
        while boxes:
            here = boxes.pop()
            done += 1
            if before + done + self._links // _LINKS > self._most:
                raise Refused(f'no proof within {self._most} boxes: at a polar angle of {here[THETA][1]:.9g} rad '
                              'benches may touch; give --effort above 1')
            left = self._occurring(lead, here)
            if left is not None and (cut := self._unclear(left)) is not None:
                boxes += self._halves(left, cut)
        return done

    def _innermost(self) -> float:
        """Return an angle that no head of the family has passed at the claimed time.

        Further out, the curvature times each link is below 2, so no link locks and all handles move in one direction.
        """
        gone, scale = self._gone_m[1], self._scale[1]
        low, high = 0.0, above(self._start)
        for _ in range(200):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if self._gone_by(middle, scale) > gone else (low, middle)
        if not (self._gone_by(low, scale) > gone
                and arb(2 * low) > exact(_BENT) * arb(scale) * arb(max(self._head[1], self._body[1]))):
            raise Refused('proved_s: by then the head of a dragon of the family may be so close to the centre that '
                          'links might lock')
        return low

    def _row(self, first: float, last: float, link: Interval) -> list[Box]:
        count = 1 + int((last - first) / _FIRST_RAD)
        if count > self._most:
            raise Refused(f'the dragon extends over {count} parts of the track; the limit is {self._most}; give '
                          '--effort above 1')
        ends = [first + (last - first) * n / count for n in range(count)] + [last]
        return [((low, high), (0.0, inf), self._scale, link, self._body)
                for low, high in pairwise(ends)]

    def _occurring(self, lead: int, box: Box) -> Box | None:
        """Return the part of a box that can occur, or None if no part can."""
        theta, ahead, scale, link, other = box
        head = theta[1]
        if lead:
            chord = below(arb(scale[0]) * arb(self._head[0]))
            for _ in range(_PASSES):
                head = above(arb(theta[1]) - arb(_span(head, chord, _BELOW)))
        elif above(self._start) > theta[0] and self._gone_by(theta[0], scale[0]) < self._gone_m[0]:
            return None     # before the start of the run
        if arb(head) < self._start and self._gone_by(head, scale[1]) > self._gone_m[1]:
            return None     # after the claimed time
        most = above(arb(scale[1]) * arb(link[1]))
        over = above(arb(scale[1])) * hypot(self._over, self._half) * (1 + 1e-12)
        reach = theta[1] + _span(theta[0], most, _ABOVE) + 2 * over
        far = hypot(reach, above(arb(scale[1]) * arb(other[1]))) * (1 + 1e-12) - theta[0]
        low, high = self._strips(lead, (theta, (ahead[0], min(ahead[1], far)), scale, link, other))
        return (theta, (low, high), scale, link, other) if low <= high else None

    def _strips(self, lead: int, box: Box) -> Interval:
        """Return the range of angles by which another bench may be further out in a box, for all numbers of links."""
        theta, ahead, scale, link, _ = box
        near = _next(theta[1], below(arb(scale[0]) * arb(link[0])), _BELOW)
        far = _next(theta[0], above(arb(scale[1]) * arb(link[1])), _ABOVE)
        short, long = below(arb(scale[0]) * arb(self._body[0])), above(arb(scale[1]) * arb(self._body[1]))
        low, high = inf, -inf
        for _ in range(2, self._family.benches - lead):
            near = _next(near, short, _BELOW)
            far = _next(far, long, _ABOVE)
            least, most = nextafter(near - theta[1], -inf), nextafter(far - theta[0], inf)
            self._links += 1
            if self._links > _LINKS * self._most:
                raise Refused(f'no proof after {self._links} links were placed; give --effort above 1')
            if least > ahead[1]:
                break
            if most >= ahead[0]:
                low, high = min(low, max(least, ahead[0])), max(high, min(most, ahead[1]))
        return low, high

    @staticmethod
    def _halves(box: Box, cut: int) -> list[Box]:
        """Return the halves of a box that is cut along a variable. Raises Refused if the box is too narrow."""
        low, high = box[cut]
        middle = 0.5 * (low + high)
        if not high - low > _LEAST * max(1.0, abs(high)):
            raise Refused(f'at a polar angle of {box[THETA][1]:.9g} rad benches may touch within the tolerances')
        first, second = list(box), list(box)
        first[cut], second[cut] = (low, middle), (middle, high)
        return [tuple(first), tuple(second)]  # type: ignore[list-item]

    def _unclear(self, box: Box) -> int | None:
        """Return None if the benches are apart everywhere in a box, else the variable along which to cut the box."""
        middle = [arb(0.5 * (low + high)) for low, high in box]
        reach = [max(above(high - mid), above(mid - low)) for (low, high), mid in zip(box, middle, strict=True)]
        here = _Pair(middle, [(float(mid), float(mid)) for mid in middle])
        edge = max(range(8), key=lambda n: min(float(one) for one in here.distances(n, self._half, self._over)[0]))
        everywhere = _Pair([_ball(one) for one in box], list(box))
        apart, slopes = here.distances(edge, self._half, self._over)[0], everywhere.distances(
            edge, self._half, self._over, True)[1]
        spreads = [[size(slope) * wide for slope, wide in zip(corner, reach, strict=True)] for corner in slopes]
        low = [below(one) - sum(spread) * (1 + 1e-12) for one, spread in zip(apart, spreads, strict=True)]
        if all(one > 0 for one in low):
            return None
        if not all(isfinite(one) for one in low):       # the box is too wide for derivatives
            return max((THETA, AHEAD), key=lambda row: box[row][1] - box[row][0])
        worst = spreads[min(range(4), key=low.__getitem__)]
        return max(range(5), key=worst.__getitem__)


class _Pair:
    """Two benches for all values in a box: their handles as complex numbers, and the derivatives of the handles.

    Polar angles are measured from the front handle of the inner bench. ``ends`` holds the bounds of the variables.
    """

    def __init__(self, values: list[arb], ends: list[Interval]) -> None:
        theta, ahead, scale, link, other = values
        self._scale = scale
        self._chords = scale * link, scale * other
        self._chord_slopes = ({SCALE: link, LINK: scale}, {SCALE: other, OTHER: scale})
        far = theta + ahead
        far_ends = _added(ends[THETA], ends[AHEAD])
        near_rear = self._rear(theta, arb(0), ends[THETA], ends[SCALE], ends[LINK], 0, {THETA: (1, 0)})
        far_rear = self._rear(far, ahead, far_ends, ends[SCALE], ends[OTHER], 1, {THETA: (1, 0), AHEAD: (1, 1)})
        turn = direction(ahead)
        self._handles = ((acb(theta), near_rear[0]), (turn * far, far_rear[0]))
        self._slopes = (({THETA: acb(1)}, near_rear[1]),
                        ({THETA: turn, AHEAD: turn * acb(arb(1), far)}, far_rear[1]))

    def _rear(self, theta: arb, angle: arb, theta_ends: Interval, scale_ends: Interval, link_ends: Interval, which: int,
              moves: dict[int, tuple[int, int]]) -> tuple[acb, dict[int, acb]]:
        """Return the rear handle of a bench whose front handle is at a radius and an angle, and the derivatives.

        ``moves`` holds the derivatives of that radius and angle.
        """
        delta = _spans(theta_ends, scale_ends, link_ends)
        sine = delta.sin()
        versine = 2 * (delta / 2).sin() ** 2
        by_delta = delta + theta * versine + theta * (theta + delta) * sine
        by_theta = -(2 * theta + delta) * versine / by_delta
        turn, outer = direction(angle + delta), theta + delta
        spans = {row: self._chords[which] * slope / by_delta for row, slope in self._chord_slopes[which].items()}
        for row, (radius, _) in moves.items():
            spans[row] = by_theta * radius
        out = {}
        for row, slope in spans.items():
            radius, turned = moves.get(row, (0, 0))
            out[row] = turn * acb(slope + radius, outer * (slope + turned))
        return turn * outer, out

    def distances(self, edge: int, half_m: float, over_m: float,
                  with_slopes: bool = False) -> tuple[list[arb], list[list[arb]]]:
        """Return how far each corner of a bench is beyond an edge of the other bench, and the derivatives.

        Edges 0 to 3 are the left, right, front and rear edges of the inner bench; edges 4 to 7 are those of the other
        bench.
        """
        one, two, side = edge // 4, 1 - edge // 4, edge % 4
        (front, rear), (other_front, other_rear) = self._handles[one], self._handles[two]
        back, forth = ((front - rear) / self._chords[one]).conjugate(), (other_front - other_rear) / self._chords[two]
        factors = [acb(over_m, half_m), acb(over_m, -half_m), acb(-over_m, half_m), acb(-over_m, -half_m)]
        arms = [(handle, factor) for handle, factor in zip((0, 0, 1, 1), factors, strict=True)]
        away = [self._handles[two][handle] + forth * factor * self._scale - front for handle, factor in arms]
        apart = [self._beyond(side, back * one_away, self._scale, self._chords[one], half_m, over_m)
                 for one_away in away]
        if not with_slopes:
            return apart, []
        slopes: list[list[arb]] = [[] for _ in arms]
        for row in range(5):
            grown = arb(1 if row == SCALE else 0)
            back_slope = self._axis_slope(one, row, back.conjugate()).conjugate()
            forth_slope = self._axis_slope(two, row, forth)
            for corner, (handle, factor) in enumerate(arms):
                moved = (self._slopes[two][handle].get(row, acb(0)) - self._slopes[one][0].get(row, acb(0))
                         + (forth_slope * self._scale + forth * grown) * factor)
                slopes[corner].append(self._beyond(side, back_slope * away[corner] + back * moved, grown,
                                                   self._chord_slopes[one].get(row, arb(0)), half_m, over_m))
        return apart, slopes

    def _axis_slope(self, which: int, row: int, axis: acb) -> acb:
        """Return a derivative of the unit vector from the rear to the front handle of a bench."""
        front, rear = (slopes.get(row, acb(0)) for slopes in self._slopes[which])
        return (front - rear - axis * self._chord_slopes[which].get(row, arb(0))) / self._chords[which]

    @staticmethod
    def _beyond(side: int, place: acb, scale: arb, chord: arb, half_m: float, over_m: float) -> arb:
        """Return how far a point, relative to a bench's front handle, is beyond an edge (linear in all arguments)."""
        if side < 2:
            return (place.imag if side == 0 else -place.imag) - scale * half_m
        return place.real - scale * over_m if side == 2 else -place.real - chord - scale * over_m
