"""Pairs of benches that stand as another pair stood earlier in the same search (docs/contact-lemmas.md, lemma 9).

The benches behind a bench depend only on the place of its front handle and on the lengths of their links (ahead of a
leading tail: on the place of its rear handle). Consider benches i and j, and the benches i - n and j - n, whose links
and those in between have the same lengths. While the dragon moves forwards, benches i - n and j - n are ahead. If their
front handle started behind the present place of the front handle of bench i, it has passed this place since the start,
and the two benches stood there as benches i and j do now. A search in the order of the travel has therefore cleared
this pair already. If the dragon moves backwards, benches i + n and j + n come first.

Here n is the period of the dragon: 1 if most links equal their neighbours, 2 if short and long benches alternate.
"""
import numpy as np

from dragon_ros.core.numerics.types import Array, Floats, Ints
from dragon_ros.core.search.search_domain import Pair, SearchDomain
from dragon_ros.core.tracks.segments import BEHIND

_LONGEST = 8            # longest period that is looked for, in benches
_MARGIN = 4             # how far a bench must have passed a place, as a multiple of the position error


class Repeats:
    """The pairs of a domain that repeat earlier ones: those of benches i and j up to a limit for each i."""

    def __init__(self, domain: SearchDomain, margin_m: float = 0.0) -> None:
        """Find the period of the dragon and where its benches start.

        A bench counts as past a place only if it started at least ``margin_m`` before it.
        """
        links_m = domain.dragon.link_lengths_m
        self._behind = domain.leader.direction == BEHIND
        self._period = _period(links_m)
        self._start_m = self._places(domain.along_m(domain.start_m))
        lead = 0 if self._behind else -1
        self._forwards = bool(self._places(domain.along_m(domain.stop_m))[lead] > self._start_m[lead])
        self._margin_m = max(margin_m, _MARGIN * domain.error_m)
        # Bench i repeats with benches before limit[i]; the links from i up to there equal those one period earlier.
        ends = _ends_of_runs(links_m[self._period:] == links_m[:-self._period])
        none = np.zeros(min(self._period, links_m.size), dtype=np.int64)
        self.limit: Ints = np.concatenate((none, ends + self._period) if self._forwards else (ends, none))

    def first(self, one_m: Floats, two_m: Floats) -> Ints:
        """Return, for each bench (R, N), the first bench with which its pairs do not repeat between two states.

        ``one_m`` and ``two_m`` (R, N+1) are the distances of handles along the track. The result is 0 ahead of a
        leading tail, where ``repeated`` decides for each pair.
        """
        again = self._passed(one_m, two_m) if self._behind else np.zeros(one_m[:, 1:].shape, dtype=bool)
        return np.where(again, self.limit, 0)

    def repeated(self, one_m: Floats, two_m: Floats, i: Ints, j: Ints) -> Array:
        """Return whether pairs (i, j) repeat between two states with handles at distances (N+1,) along the track."""
        again = self._passed(one_m[None], two_m[None])[0]
        out: Array = again[i if self._behind else j] & (j < self.limit[i])
        return out

    def all_of(self, pair: Pair) -> list[Pair]:
        """Return a pair and those that repeat it, in the order in which they do."""
        (i, j), step, out = pair, self._period if self._forwards else -self._period, [pair]
        while i + step >= 0 and j + step < min(self.limit.size, self.limit[i + step]):
            i, j = i + step, j + step
            out.append((i, j))
        return out

    def place_of(self, pair: Pair) -> int:
        """Return the handle whose place determines where both benches of a pair are."""
        return pair[0] if self._behind else pair[1] + 1

    def _places(self, along_m: Floats) -> Floats:
        """Return the places (..., N) of the handles that determine the benches behind (or ahead of) them."""
        return along_m[..., :-1] if self._behind else along_m[..., 1:]

    def _passed(self, one_m: Floats, two_m: Floats) -> Array:
        """Return whether the bench one period ahead has passed all places of each bench (R, N) between two states."""
        low, high = (each(self._places(one_m), self._places(two_m)) for each in (np.minimum, np.maximum))
        n, out = self._period, np.zeros(low.shape, dtype=bool)
        if self._forwards:
            out[:, n:] = low[:, n:] >= self._start_m[:-n] + self._margin_m
        else:
            out[:, :-n] = high[:, :-n] <= self._start_m[n:] - self._margin_m
        return out


def _period(links_m: Floats) -> int:
    """Return the number of benches after which the most links repeat."""
    return max(range(1, _LONGEST + 1), key=lambda n: np.count_nonzero(links_m[n:] == links_m[:-n]))


def _ends_of_runs(same: Array) -> Ints:
    """Return, for each index, the index behind the last True of its run of True values; the index itself if False."""
    index = np.arange(same.size)
    stops = np.where(same, same.size, index)
    out: Ints = np.minimum.accumulate(stops[::-1])[::-1]
    return out
