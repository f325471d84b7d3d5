"""The dragon's benches: how many, how long, how wide, and where their handle holes are."""
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from dragon_ros.core.checks import number, whole
from dragon_ros.core.errors import FieldError
from dragon_ros.core.types import Floats, read_only


@dataclass(frozen=True)
class Dragon:
    """A head bench and ``benches - 1`` equal body benches, joined at ``benches + 1`` handles.

    Every length is in metres. Defaults are those of the contest problem behind the paper (CUMCM 2024 A).
    """

    benches: int = 223
    head_length_m: float = 3.41
    body_length_m: float = 2.20
    width_m: float = 0.30
    hole_inset_m: float = 0.275

    def __post_init__(self) -> None:
        """Refuse benches that cannot be built."""
        whole('dragon.benches', self.benches, low=1, high=1_000_000)
        number('dragon.hole_inset_m', self.hole_inset_m, low=0.0, high=1e12)
        number('dragon.width_m', self.width_m, above=0.0, high=1e12)
        for name in ('head_length_m', 'body_length_m'):
            length = number(f'dragon.{name}', getattr(self, name), above=0.0, high=1e12)
            if length < 2 * self.hole_inset_m:
                raise FieldError(f'dragon.{name}', length,
                                 f'a bench must hold its two holes, 2 x {self.hole_inset_m} m from the ends',
                                 'make the bench longer or dragon.hole_inset_m smaller')

    @property
    def head_link_m(self) -> float:
        """Distance between the two handles of the head bench."""
        return self.head_length_m - 2 * self.hole_inset_m

    @property
    def body_link_m(self) -> float:
        """Distance between the two handles of every other bench."""
        return self.body_length_m - 2 * self.hole_inset_m

    @cached_property
    def link_lengths_m(self) -> Floats:
        """Handle spacing of each bench, shape (benches,)."""
        return read_only(np.array([self.head_link_m] + [self.body_link_m] * (self.benches - 1)))

    @cached_property
    def bench_lengths_m(self) -> Floats:
        """Full length of each bench, shape (benches,)."""
        return read_only(np.array([self.head_length_m] + [self.body_length_m] * (self.benches - 1)))


def is_even(lengths_m: Floats) -> bool:
    """Return whether all behind the first are equal, as for the classic dragon (link or bench lengths, (N,))."""
    return bool(np.all(lengths_m[1:] == lengths_m[-1]))
