"""Certificates of first contact: written from the solver's, checked with none of its code.

The checker has its own chain (bisection on the law of cosines), its own rectangles (corners and edge normals) and its
own second derivatives (differences of its own positions). It shares only the scene's plain numbers with the solver.
"""
import json
from collections.abc import Callable
from itertools import pairwise
from math import asinh, atan2, cos, hypot, pi, sin, sqrt
from pathlib import Path
from typing import Any

import numpy as np

from dragon_ros.core.errors import InputError, MissingError
from dragon_ros.core.first_contact import Contact, NoContact
from dragon_ros.core.scene import Scene
from dragon_ros.core.types import Floats
from dragon_ros.wire.documents import Document
from dragon_ros.wire.scenes import scene_of, scene_values

_STEP_M = 1e-3          # for differences along the leading bench's way
_AGREE_M = 1e-5         # between a recorded bound and the checker's
_UNCOVERED_S = 1e-6     # that may be left before the contact
Place = tuple[float, float]


def as_values(scene: Scene, found: Contact | NoContact) -> dict[str, Any]:
    """Return a certificate as plain values. Raises InputError where there is none."""
    proof = found.certificate
    if not proof.complete:
        raise InputError('--certificate: this run has none: its body was followed pair by pair '
                         '(benches touch at the start, or the body touches before the head)')
    intervals = [{'lead': name, 'start_rad': s.start_rad, 'stop_rad': s.stop_rad, 'bound_m': s.bound_m}
                 for name, part in (('head', proof.head), ('body', proof.body)) for s in part]
    contact = {'t_s': found.t_s, 'benches': list(found.benches)} if isinstance(found, Contact) else {'t_s': None}
    return {'scene': scene_values(scene), 'contact': contact, 'intervals': intervals}


def check(path: Path, progress: Callable[[Any], Any] = lambda rows: rows) -> int:
    """Check a certificate file and return how many intervals it has. Raises InputError with the first fault."""
    try:
        values = json.loads(path.read_text(encoding='utf-8'))
        scene = scene_of(Document(str(path), values['scene']))
        rows = {lead: [row for row in values['intervals'] if row['lead'] == lead] for lead in ('head', 'body')}
        for row in values['intervals']:
            row.update({key: float(row[key]) for key in ('start_rad', 'stop_rad', 'bound_m')})
        t_s = values['contact']['t_s']
    except OSError as error:
        raise MissingError(f'--verify {path}: cannot be read: {error.strerror}') from None
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise InputError(f'--verify {path}: is no certificate: {error!r}') from None
    checker = Checker(scene)
    checker.check_cover(rows, scene.end.t_s if t_s is None else float(t_s), t_s is not None)
    for row in progress([*rows['head'], *rows['body']]):
        checker.check_bound(row)
    return len(values['intervals'])


class Checker:
    """Recomputes what a certificate claims for a scene."""

    def __init__(self, scene: Scene) -> None:
        """Take plain numbers from the scene."""
        d, self.scene = scene.dragon, scene
        self.b = scene.spiral.pitch_m / (2 * pi)
        self.links = [d.head_length_m - 2 * d.hole_inset_m] + [d.body_length_m - 2 * d.hole_inset_m] * (d.benches - 1)
        self.lengths = [d.head_length_m] + [d.body_length_m] * (d.benches - 1)
        self.half_width = 0.5 * d.width_m

    def check_cover(self, rows: dict[str, list[dict[str, Any]]], t_s: float, ends_in_contact: bool) -> None:
        """Refuse intervals that leave out a part of what has to be cleared."""
        for lead, part in rows.items():
            for before, after in pairwise(part):
                if before['stop_rad'] != after['start_rad']:
                    raise InputError(f'{lead}: the interval from {after["start_rad"]!r} does not start where the one '
                                     f'before it stops, at {before["stop_rad"]!r}')
        run, benches = self.scene.run, self.scene.dragon.benches
        first, last = (self.angle(at) for at in (run.start_s, t_s))
        slack = _UNCOVERED_S * abs(self.scene.steady_m_s) / (self.b * max(last, 1e-9)) + 1e-8
        if benches > 2:
            self._covers('head', rows['head'], first, last, slack)
        if benches > 3:
            ends = [self.chain(0, angle, benches) for angle in (first, last)]
            self._covers('body', rows['body'], max(end[-2] for end in ends), min(end[1] for end in ends), 1e-6)
        if ends_in_contact and self._smallest(last + 1e-6 * (1 if last < first else -1)) <= 0:
            raise InputError(f'contact: benches touch before {t_s!r} s already')

    @staticmethod
    def _covers(lead: str, part: list[dict[str, Any]], start: float, stop: float, slack: float) -> None:
        if not part or abs(part[0]['start_rad'] - start) > slack or (
                (part[-1]['stop_rad'] - stop) * (1 if stop < start else -1) > slack):
            raise InputError(f'{lead}: the intervals do not reach from {start!r} to {stop!r} rad')

    def check_bound(self, row: dict[str, Any]) -> None:
        """Refuse an interval whose bound is not what the checker finds, or not positive."""
        bound = self.bound(0 if row['lead'] == 'head' else 1, row['start_rad'], row['stop_rad'])
        if not 0 < row['bound_m'] <= bound + _AGREE_M:
            raise InputError(f'{row["lead"]}: from {row["start_rad"]!r} to {row["stop_rad"]!r} rad the bound is '
                             f'{bound:.9g} m, not {row["bound_m"]!r} m')

    def angle(self, t_s: float) -> float:
        """Return the head's polar angle by bisection on the arc length."""
        start = 2 * pi * self.scene.spiral.start_turns

        def arc(theta: float) -> float:
            return self.b / 2 * (theta * sqrt(1 + theta * theta) + asinh(theta))
        wanted = arc(start) - self.scene.steady_m_s * t_s
        low, high = 0.0, start + 2 * abs(self.scene.steady_m_s * t_s) / self.b + 1
        while low < (middle := 0.5 * (low + high)) < high:
            low, high = (middle, high) if arc(middle) < wanted else (low, middle)
        return high

    def chain(self, first: int, theta: float, benches: int) -> list[float]:
        """Return polar angles of the handles of some benches behind a front handle."""
        angles = [theta]
        for link in self.links[first:first + benches]:
            angles.append(self._next(angles[-1], link / self.b))
        return angles

    @staticmethod
    def _next(theta: float, chord: float) -> float:
        """Return the next handle's angle: secant steps on the law of cosines, kept in a bisection bracket."""
        def over(delta: float) -> float:
            return hypot(theta - (theta + delta) * cos(delta), (theta + delta) * sin(delta)) - chord
        low, high = 0.0, pi
        while over(high) < 0:
            high += 0.01
            if high > 1.5 * pi:
                raise InputError(f'the chain is locked with a front handle at {theta!r} rad')
        x, slope = min(high, chord / sqrt(1 + theta * theta)), sqrt(1 + theta * theta)
        for _ in range(100):
            value = over(x)
            low, high = (x, high) if value < 0 else (low, x)
            following = x - value / slope
            if not low < following < high:
                following = 0.5 * (low + high)
            if abs(following - x) < 1e-15 * x:
                break
            change = over(following) - value
            slope = change / (following - x) if change and following != x else slope
            x = following
        return theta + x

    def rectangles(self, first: int, theta: float, benches: int) -> Floats:
        """Return corners (benches, 4, 2): front left, rear left, rear right, front right."""
        angles = np.array(self.chain(first, theta, benches))
        p = self.b * angles[:, None] * np.stack((np.cos(angles), np.sin(angles)), axis=1)
        out = []
        for number, (front, rear) in enumerate(pairwise(p)):
            yaw = atan2(front[1] - rear[1], front[0] - rear[0])
            u, n = np.array([cos(yaw), sin(yaw)]), np.array([-sin(yaw), cos(yaw)])
            along, side = 0.5 * self.lengths[first + number] * u, self.half_width * n
            middle = 0.5 * (front + rear)
            out.append([middle + along + side, middle - along + side, middle - along - side, middle + along - side])
        return np.array(out)

    def bound(self, first: int, start: float, stop: float) -> float:
        """Return the lower bound of every gap of the leading bench on a stretch between two places."""
        benches = self._within_reach(first, max(start, stop), min(start, stop))
        length = self.b * abs(start - stop) * sqrt(1 + max(start, stop) ** 2)
        ends = [self._seen(first, angle, benches) for angle in (start, stop)]
        (corners_a, bend_a, radius_a), (corners_b, bend_b, radius_b) = ends
        sag = 2 * np.maximum(bend_a, bend_b) * length**2 / 8
        low = np.full(benches - 2, -np.inf)
        for frame, (half_length, half_width) in enumerate(self._halves(first, benches)):
            for axis, half in ((0, half_length), (1, half_width)):
                for side in (1, -1):
                    apart = [np.min(side * corners[frame][..., axis], axis=1) - half
                             for corners in (corners_a, corners_b)]
                    low = np.maximum(low, np.minimum(*apart) - sag[frame])
        circle = np.minimum(radius_a[1], radius_b[1]) - max(radius_a[0], radius_b[0])
        still = self._still(first, start, stop, benches)
        return float(np.min(np.maximum(np.maximum(low, circle), still), initial=np.inf))

    def _halves(self, first: int, benches: int) -> list[tuple[Any, Any]]:
        lengths = 0.5 * np.array(self.lengths[first:first + benches])
        return [(lengths[0], self.half_width), (lengths[2:], self.half_width)]

    def _within_reach(self, first: int, outer: float, inner: float) -> int:
        """Return how many benches can matter: all further ones lie outside the leading bench's circle."""
        most = len(self.links) - first
        benches = min(most, 8)
        while benches < most:
            lead = max(self._radii(first, angle, benches)[0] for angle in (outer, inner))
            if min(float(self._radii(first, angle, benches)[1][-1]) for angle in (outer, inner)) > lead:
                return benches
            benches = min(most, 2 * benches)
        return benches

    def _radii(self, first: int, theta: float, benches: int) -> tuple[float, Floats]:
        rectangles = self.rectangles(first, theta, benches)
        middles = 0.5 * (rectangles[:, 0] + rectangles[:, 2])
        normals = (rectangles[:, 0] - rectangles[:, 3]) / (2 * self.half_width)
        inner: Floats = np.abs(np.sum(middles * normals, axis=1)) - self.half_width
        return float(np.max(np.hypot(*rectangles[0].T))), inner[2:]

    def _seen(self, first: int, theta: float, benches: int) -> tuple[list[Floats], Floats, tuple[float, Floats]]:
        """Return corners of each bench in the leading one's frame and the other way round, their bends, and radii."""
        step = _STEP_M / (self.b * sqrt(1 + theta * theta))
        seen = [self._frames(self.rectangles(first, theta + k * step, benches)) for k in (-1, 0, 1)]
        bends = [np.max(np.hypot(*np.moveaxis(seen[0][f] - 2 * seen[1][f] + seen[2][f], -1, 0)), axis=1) / _STEP_M**2
                 for f in (0, 1)]
        return seen[1], np.array(bends), self._radii(first, theta, benches)

    @staticmethod
    def _frames(rectangles: Floats) -> list[Floats]:
        """Return corners (K, 4, 2) of the others in the frame of the first, and of the first in theirs."""
        def inside(owner: Floats, points: Floats) -> Floats:
            middle = 0.5 * (owner[..., 0, :] + owner[..., 2, :])
            u = owner[..., 0, :] - owner[..., 1, :]
            u = u / np.hypot(u[..., 0], u[..., 1])[..., None]
            d = points - middle[..., None, :]
            along = d[..., 0] * u[..., None, 0] + d[..., 1] * u[..., None, 1]
            aside = d[..., 1] * u[..., None, 0] - d[..., 0] * u[..., None, 1]
            return np.stack((along, aside), axis=-1)
        lead, others = rectangles[:1], rectangles[2:]
        lead = np.broadcast_to(lead, others.shape)
        return [inside(lead, others), inside(others, lead)]

    def _still(self, first: int, start: float, stop: float, benches: int) -> Floats:
        """Return bounds from how far the corners go at all between the two places."""
        ends = [self.rectangles(first, angle, benches) for angle in (start, stop)]
        arcs = [np.array([self.b / 2 * (q * sqrt(1 + q * q) + asinh(q)) for q in self.chain(first, angle, benches)])
                for angle in (start, stop)]
        gone = np.abs(arcs[0] - arcs[1])
        links = np.array(self.links[first:first + benches])
        overhang = 0.5 * (np.array(self.lengths[first:first + benches]) - links)
        lever = 1 + 2 * (overhang + self.half_width) / np.maximum(links, 1e-12)
        step = lever * np.maximum(gone[:-1], gone[1:])
        apart = np.maximum(*(self._apart(first, rectangles) for rectangles in ends))
        out: Floats = apart - step[0] - step[2:]
        return out

    def _apart(self, first: int, rectangles: Floats) -> Floats:
        """Return the largest separation of the first bench and each of the others along any edge normal."""
        frames, out = self._frames(rectangles), np.full(len(rectangles) - 2, -np.inf)
        for corners, halves in zip(frames, self._halves(first, len(rectangles)), strict=True):
            for axis, half in enumerate(halves):
                for side in (1, -1):
                    out = np.maximum(out, np.min(side * corners[..., axis], axis=1) - half)
        return out

    def _smallest(self, theta: float) -> float:
        """Return the smallest separation of the head from the benches within its reach."""
        benches = self._within_reach(0, theta, theta)
        return float(np.min(self._apart(0, self.rectangles(0, theta, benches)), initial=np.inf))
