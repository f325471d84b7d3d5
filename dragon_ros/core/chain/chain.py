"""The chain: the positions of all handles, computed by any solver, and their velocities.

Velocities follow from the rigid-link constraint v[i+1] cos(beta) = v[i] cos(alpha), where alpha and beta are the
angles between a link and the track's tangents at the two handles of the link. The constraint states that both handles
have the same velocity component along a rigid link.
"""
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple, Protocol

import numpy as np

from dragon_ros.core.chain.forward import Handles, blocks_of, forward, forward_many, in_order, together
from dragon_ros.core.chain.kinematics import RigidLinks
from dragon_ros.core.numerics.types import Floats, Ints, read_only
from dragon_ros.core.tracks.composite import Place, Places, Track
from dragon_ros.core.tracks.segments import BEHIND


class PlacedLinks(Protocol):
    """Consecutive ``links`` of a chain, placed by one solver; ``start`` is the handle nearest to the leader."""

    @property
    def start(self) -> int:
        """Index of the first handle, counted from the leader."""
        ...

    @property
    def links(self) -> int:
        """Number of links."""
        ...

    @property
    def solver(self) -> str:
        """The solver of these links: 'table', 'march' if no table covered them, or '' if no table was requested."""
        ...

    def velocities(self, chain: 'Chain', speed: Any, out: Floats) -> Any:
        """Fill in velocities, given the first handle's speed in the head's direction; return the last handle's speed.

        ``out`` has shape (S, N+1, 2); for one instant, it is a flat array of 2 N + 2 numbers.
        """
        ...

    def headings(self, chain: 'Chain', out: Floats) -> None:
        """Fill in unit tangents in the head's direction; ``out`` has the same shape as in ``velocities``."""
        ...

    def places(self) -> Places:
        """Return the positions (..., links + 1) of these handles, starting with the handle nearest to the leader."""
        ...


@dataclass(frozen=True, eq=False)
class Chain:
    """All handles of a chain at one instant, or at many instants in arrays with a leading axis.

    ``p`` holds the handle positions (m, shape (..., N+1, 2)), ``links_m`` holds the link lengths from head to tail (m,
    shape (N,)), and ``evaluations`` is the number of evaluated equations. If ``direction`` is BEHIND, the leader is the
    head and its followers are behind it; otherwise, the leader is the tail. The first of the ``parts`` contains the
    leader.
    """

    p: Floats
    links_m: Floats
    evaluations: int
    track: Track
    direction: int
    parts: tuple[PlacedLinks, ...]

    def __repr__(self) -> str:
        """Return the size and the solver, but not the long arrays."""
        return f'Chain({self.links_m.size + 1} handles, solver={self.solver!r})'

    def __reduce__(self) -> tuple[type, tuple[Any, ...]]:
        """Pickle the positions of the handles instead of the tables, which are a hundred times larger.

        Velocities computed from the copy agree with the original to within rounding, but not bit for bit.
        """
        parts = tuple(MarchedLinks(part.start, part.places(), part.solver) for part in self.parts)
        return Chain, (self.p, self.links_m, self.evaluations, self.track, self.direction, parts)

    @property
    def solver(self) -> str:
        """The solver: 'table', 'march', or 'table+march' if a table covered only part of the links."""
        seen = {part.solver for part in self.parts}
        if 'table' not in seen:
            return 'march'
        return 'table+march' if 'march' in seen else 'table'

    @cached_property
    def residuals_m(self) -> Floats:
        """Distances between consecutive handles minus the link lengths (m, shape (..., N))."""
        step = np.diff(self.p, axis=-2)
        out: Floats = np.hypot(step[..., 0], step[..., 1]) - self.links_m
        return out

    @cached_property
    def worst(self) -> tuple[float, int]:
        """Largest absolute residual (m), and the index of its link."""
        link = int(np.argmax(np.abs(self.residuals_m)) % self.links_m.size)
        return float(np.max(np.abs(self.residuals_m))), link

    @property
    def leader(self) -> int:
        """Index of the leading handle: 0 if the head leads, -1 if the tail leads."""
        return 0 if self.direction == BEHIND else -1

    @cached_property
    def headings(self) -> Floats:
        """Unit tangents of the track at the handles (shape (..., N+1, 2)), in the head's direction."""
        out = np.empty_like(self.p)
        for part in self.parts:
            part.headings(self, out.reshape(-1) if out.ndim == 2 else out)
        return read_only(out)

    @cached_property
    def places(self) -> Places:
        """Positions of the handles from head to tail: segments and coordinates, each of shape (..., N+1)."""
        shape = self.p.shape[:-1]
        segment, u = np.empty(shape, dtype=np.int64), np.empty(shape)
        for part in self.parts:
            some = self.slice_of(part)
            for out, values in zip((segment, u), part.places(), strict=True):
                out[..., some] = values[..., ::-self.direction]
        return segment, u

    @property
    def segment(self) -> Ints:
        """Indices of the segments of all handles."""
        return self.places[0]

    @property
    def u(self) -> Floats:
        """Coordinates of the handles on their segments."""
        return self.places[1]

    def slice_of(self, part: PlacedLinks) -> slice:
        """Return the slice of the chain's handles that belongs to a part."""
        start = part.start if self.direction == BEHIND else self.links_m.size - part.start - part.links
        return slice(start, start + part.links + 1)

    def velocities(self, leader_speed_m_s: Any, out: Floats | None = None) -> Floats:
        """Return the velocities (m/s, shape (..., N+1, 2)), and write them into ``out`` if it is given.

        ``leader_speed_m_s`` is a single value or one value per instant. It is positive in the leader's own direction:
        outwards if the tail leads.
        """
        speed = -self.direction * leader_speed_m_s
        out = np.empty(self.p.size) if out is None else out.reshape(-1)
        if self.p.ndim > 2:
            out, speed = out.reshape(self.p.shape), np.broadcast_to(np.asarray(speed, np.float64), self.p.shape[:1])
        for part in self.parts:
            speed = part.velocities(self, speed, out)
        return read_only(out.reshape(self.p.shape).view())


def conditioning(chain: Chain) -> float:
    """Return the ratio of the fastest handle's speed to the leader's speed; the ratio is at least 1.

    Close to a lock, the ratio grows without bound, and so does the effect of the last bit of the head's position on
    the handles. The promised error of positions (in metres) is proportional to this ratio.
    """
    v = chain.velocities(1.0)
    return max(1.0, float(np.max(np.hypot(v[..., 0], v[..., 1]))))


def lag(chain: Chain) -> float:
    """Return the largest difference of a handle's speed along the track from the leader's, relative to the latter."""
    v = -chain.direction * np.sum(chain.velocities(1.0) * chain.headings, axis=-1)
    return float(np.max(np.abs(1 - v)))


@dataclass(frozen=True, eq=False)
class MarchedLinks:
    """Links placed by forward placement; ``handles`` (..., links + 1) holds positions, in order from the leader."""

    start: int
    handles: Places
    solver: str = ''

    @property
    def links(self) -> int:
        """Number of links."""
        return int(self.handles[0].shape[-1]) - 1

    def places(self) -> Places:
        """Return the positions."""
        return self.handles

    def headings(self, chain: Chain, out: Floats) -> None:
        """Fill in unit tangents in the head's direction."""
        rows = out.reshape(chain.p.shape)
        rows[..., chain.slice_of(self), :] = chain.track.headings(*self.handles)[..., ::-chain.direction, :]

    def velocities(self, chain: Chain, speed: Any, out: Floats) -> Any:
        """Fill in velocities."""
        some, direction = chain.slice_of(self), chain.direction
        heading = chain.track.headings(*self.handles)[..., ::-direction, :]
        links = RigidLinks(chain.p[..., some, :], chain.links_m, heading, chain.leader)
        speeds = links.speeds(-direction * speed)
        out.reshape(chain.p.shape)[..., some, :] = speeds[..., None] * heading
        last = speeds[..., -1 if direction == BEHIND else 0]
        return last if chain.p.ndim > 2 else float(last)


class MarchedLink(NamedTuple):
    """``MarchedLinks`` for one link at one instant, in plain floats; ``near`` is the handle nearer to the leader."""

    start: int
    near: Place
    far: Place
    solver: str = ''

    @property
    def links(self) -> int:
        """Number of links, which is always 1."""
        return 1

    def places(self) -> Places:
        """Return the positions."""
        return np.array([self.near.segment, self.far.segment]), np.array([self.near.u, self.far.u])

    def fill(self, values: tuple[complex, complex], direction: int, out: Floats) -> None:
        """Write a value for each handle, the nearer one first, into a flat array for all handles."""
        at = 2 * self.start if direction == BEHIND else out.size - 2 - 2 * self.start
        near, far = values
        out[at], out[at + 1] = near.real, near.imag
        at -= 2 * direction
        out[at], out[at + 1] = far.real, far.imag

    def _headings(self, chain: Chain) -> tuple[complex, complex]:
        segments, near, far = chain.track.segments, self.near, self.far
        return segments[near.segment].heading(near.u), segments[far.segment].heading(far.u)

    def headings(self, chain: Chain, out: Floats) -> None:
        """Fill in unit tangents in the head's direction."""
        self.fill(self._headings(chain), chain.direction, out)

    def velocities(self, chain: Chain, speed: Any, out: Floats) -> Any:
        """Fill in velocities."""
        one, two = self._headings(chain)
        segments, near, far = chain.track.segments, self.near, self.far
        link = segments[near.segment].at(near.u) - segments[far.segment].at(far.u)
        after = speed * (link.real * one.real + link.imag * one.imag) / (link.real * two.real + link.imag * two.imag)
        self.fill((speed * one, after * two), chain.direction, out)
        return after


def marched(track: Track, links_m: Floats, leader: Place, direction: int) -> Chain:
    """Return the chain of a leader, found by forward placement; the leader is the head (``direction`` BEHIND) or tail.

    On a single spiral, all handles are solved simultaneously (``together``), which is faster for long chains. Raises
    the same errors as ``forward``.
    """
    one = np.array([leader.segment]), np.array([leader.u])
    if len(track.segments) == 1 and (found := together(track, links_m, one, direction)):
        (segment, u), spent = found
        return chain_of(track, links_m, direction, (segment[:, 0], u[:, 0]), spent)
    handles = forward(track, in_order(links_m, direction), leader, direction)
    return chain_of(track, links_m, direction, arrays_of(handles), handles.evaluations)


def marched_many(track: Track, links_m: Floats, leaders: Places, direction: int) -> Chain:
    """Return the chains of many leaders as one chain, which agrees with ``marched`` except in the last digits."""
    rows, spent = forward_many(track, blocks_of(links_m, direction), leaders, direction)
    return chain_of(track, links_m, direction, (rows[0].T, rows[1].T), spent)


def chain_of(track: Track, links_m: Floats, direction: int, handles: Places, evaluations: int) -> Chain:
    """Return the chain with the given handles (..., N+1), which are in order from the leader."""
    p = track.points(*handles)[..., ::-direction, :]
    return Chain(read_only(p), links_m, evaluations, track, direction, (MarchedLinks(0, handles),))


def arrays_of(handles: Handles) -> Places:
    """Return the handles as arrays."""
    return np.array(handles.segment), np.array(handles.u)


def stack(chains: Sequence[Chain], count: int | None = None) -> Chain:
    """Stack all or the first ``count`` chains of one dragon into one chain with a leading axis, which may be empty."""
    first = chains[0]
    segment, u = (np.stack(values)[:count, ..., ::-first.direction]
                  for values in zip(*(one.places for one in chains), strict=True))
    p = read_only(np.stack([one.p for one in chains])[:count])
    return type(first)(p, first.links_m, sum(one.evaluations for one in chains), first.track, first.direction,
                       (MarchedLinks(0, (segment, u)),))
