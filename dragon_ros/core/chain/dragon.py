"""The benches of a dragon: their number, lengths and width, and the positions of the holes for the handles."""
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from dragon_ros.core.checks import Settings, number, settle
from dragon_ros.core.domain import BENCHES, LINK, LONGEST_BENCH, WIDTH
from dragon_ros.core.errors import FieldError
from dragon_ros.core.numerics.types import Floats, read_only


class _Lengths(Settings):
    """Quantities derived from the lengths of the benches, which may or may not be equal."""

    width_m: float
    hole_inset_m: float

    @cached_property
    def bench_lengths_m(self) -> Floats:
        """Full length of each bench (m, shape (benches,))."""
        raise NotImplementedError

    @cached_property
    def link_lengths_m(self) -> Floats:
        """Handle spacing of each bench (m, shape (benches,))."""
        return read_only(self.bench_lengths_m - 2 * self.hole_inset_m)

    @cached_property
    def half_sizes_m(self) -> tuple[Floats, Floats]:
        """Half the length and half the width of each bench (m, each of shape (benches,))."""
        return (read_only(0.5 * self.bench_lengths_m),
                read_only(np.full(self.bench_lengths_m.shape, 0.5 * self.width_m)))


@dataclass(frozen=True)
class Dragon(_Lengths):
    """A head bench and ``benches - 1`` equal body benches, with ``benches + 1`` handles in all.

    All lengths are in metres. The defaults are the values of the contest problem behind the paper (CUMCM 2024 A).
    """

    benches: int = 223
    head_length_m: float = 3.41
    body_length_m: float = 2.20
    width_m: float = 0.30
    hole_inset_m: float = 0.275

    def __post_init__(self) -> None:
        """Reject invalid numbers, lengths and widths."""
        settle(self, benches=BENCHES.counted('dragon.benches', self.benches))
        _settle_common(self)
        settle(self, **{name: _length(f'dragon.{name}', getattr(self, name), self.hole_inset_m)
                        for name in ('head_length_m', 'body_length_m')})

    @cached_property
    def bench_lengths_m(self) -> Floats:
        """Full length of each bench (m, shape (benches,))."""
        return read_only(np.array([self.head_length_m] + [self.body_length_m] * (self.benches - 1)))


@dataclass(frozen=True)
class Group:
    """Consecutive benches of equal length."""

    length_m: float
    count: int = 1


@dataclass(frozen=True)
class Mixed(_Lengths):
    """Benches of different lengths and equal width, joined by handles; ``groups`` are in order from the head."""

    groups: tuple[Group, ...]
    width_m: float = Dragon.width_m
    hole_inset_m: float = Dragon.hole_inset_m

    def __post_init__(self) -> None:
        """Reject invalid numbers, lengths and widths."""
        _settle_common(self)
        if not 1 <= len(self.groups) <= BENCHES.high:
            raise FieldError('dragon.groups', len(self.groups), f'a dragon has 1 to {BENCHES.high} groups',
                             'list its benches, such as [{length_m: 3.41}, {count: 222, length_m: 2.2}]')
        settle(self, groups=tuple(self._group(n, group) for n, group in enumerate(self.groups, 1)))
        if self.benches > BENCHES.high:
            raise FieldError('dragon.groups', f'{self.benches} benches', f'the limit is {BENCHES.high}',
                             'reduce the counts')

    def _group(self, n: int, group: Group) -> Group:
        """Return a group with its values checked."""
        count = BENCHES.counted(f'dragon.groups.{n}.count', group.count)
        return Group(_length(f'dragon.groups.{n}.length_m', group.length_m, self.hole_inset_m), count)

    def __hash__(self) -> int:
        """Return the hash of the fields, cached for looking up models, because there may be thousands of groups."""
        return self._hash

    @cached_property
    def _hash(self) -> int:
        return hash((self.groups, self.width_m, self.hole_inset_m))

    @cached_property
    def benches(self) -> int:
        """Number of benches."""
        return sum(group.count for group in self.groups)

    @cached_property
    def bench_lengths_m(self) -> Floats:
        """Full length of each bench (m, shape (benches,))."""
        lengths, counts = zip(*((group.length_m, group.count) for group in self.groups), strict=True)
        return read_only(np.repeat(np.array(lengths, dtype=np.float64), counts))


AnyDragon = Dragon | Mixed


def is_even(lengths_m: Floats) -> bool:
    """Return whether all lengths (N,) after the first are equal, as they are in the classic dragon."""
    return bool(np.all(lengths_m[1:] == lengths_m[-1]))


def _settle_common(dragon: AnyDragon) -> None:
    settle(dragon, width_m=WIDTH.checked('dragon.width_m', dragon.width_m),
           hole_inset_m=number('dragon.hole_inset_m', dragon.hole_inset_m, low=0.0,
                               high=0.5 * LONGEST_BENCH.high * LINK.high))


def _length(field: str, length_m: float, hole_inset_m: float) -> float:
    """Return the length of a bench whose link lies within the world. Raises FieldError."""
    length, holes = number(field, length_m, above=0.0), 2 * hole_inset_m
    link_m = round(length - holes, 12)      # decimals are rarely floats
    if not LINK.low <= link_m <= LINK.high:
        raise FieldError(field, length, f'its link, the distance between its handles, would be {link_m:.6g} m; '
                         f'links are {LINK.low:g} to {LINK.high:g} m long', f'give {holes + LINK.low:.6g} to '
                         f'{holes + LINK.high:.6g} m, or change dragon.hole_inset_m')
    if length > LONGEST_BENCH.high * link_m:
        raise FieldError(field, length, f'it would be {length / link_m:.4g} times as long as its link; the limit is '
                         f'{LONGEST_BENCH.high:g}', 'make dragon.hole_inset_m smaller')
    return length
