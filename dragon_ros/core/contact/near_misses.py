"""Near misses of the head: places where its gap to a bench is smallest, below a threshold, and no contact."""
from dataclasses import dataclass

import numpy as np

from dragon_ros.core.chain.rectangles import axes_of, benches_of
from dragon_ros.core.contact.certificate import Contact, NoContact
from dragon_ros.core.contact.interval_clearing import Stretch
from dragon_ros.core.contact.signed_distance import gaps
from dragon_ros.core.errors import FieldError
from dragon_ros.core.numerics.types import Floats, Ints
from dragon_ros.core.scene import Scene
from dragon_ros.core.step import state

_SPACING_S = 0.02
_GOLDEN = 0.5 * (5**0.5 - 1)


@dataclass(frozen=True)
class NearMiss:
    """Where the gap of the head and a bench is smallest: bench, time in s and gap in m."""

    bench: int
    t_s: float
    gap_m: float


def near_misses(scene: Scene, found: Contact | NoContact, below_m: float) -> list[NearMiss]:
    """Return the head's near misses before the contact (or end), the nearest first, with gaps below ``below_m``.

    Only stretches whose certified bound is below the threshold are looked at; times are right to about 1e-5 s. Raises
    FieldError but for a head that goes along one spiral at constant speed.
    """
    if scene.head.lead != 'head':
        raise FieldError('head.lead', scene.head.lead, 'near misses are told of a head that leads', 'leave them out')
    speed, spiral = abs(scene.steady_m_s), scene.spiral
    out: dict[tuple[int, float], NearMiss] = {}
    for start_rad, stop_rad in _spans([s for s in found.certificate.head if s.bound_m < below_m]):
        first, last = sorted(spiral.distance_to(angle) / scene.steady_m_s for angle in (start_rad, stop_rad))
        count = 3 + int((last - first) * max(speed, 1e-9) / (_SPACING_S * max(speed, 1e-9)))
        times = np.linspace(max(0.0, first - _SPACING_S), last, count)
        for bench, left, right in _dips(scene, times, below_m):
            miss = _lowest(scene, bench, left, right)
            if miss.gap_m < below_m and not _is_contact(miss, found):
                out[bench, round(miss.t_s, 4)] = miss
    return sorted(out.values(), key=lambda miss: miss.gap_m)


def _spans(stretches: list[Stretch]) -> list[tuple[float, float]]:
    """Return adjoining stretches as one."""
    spans: list[tuple[float, float]] = []
    for stretch in stretches:
        if spans and spans[-1][1] == stretch.start_rad:
            spans[-1] = spans[-1][0], stretch.stop_rad
        else:
            spans.append((stretch.start_rad, stretch.stop_rad))
    return spans


def _dips(scene: Scene, times: Floats, below_m: float) -> list[tuple[int, float, float]]:
    """Return (bench, time before, time after) of every sampled local minimum not far above the threshold."""
    later = np.arange(2, scene.dragon.benches)
    gap = np.array([_gaps(scene, t_s, later) for t_s in times.tolist()])
    low = (gap[1:-1] <= gap[:-2]) & (gap[1:-1] <= gap[2:]) & (gap[1:-1] < 2 * below_m)
    return [(int(later[column]), float(times[row]), float(times[row + 2])) for row, column in np.argwhere(low)]


def _gaps(scene: Scene, t_s: float, later: Ints) -> Floats:
    chain = state(scene, t_s)
    benches = benches_of(chain, scene.dragon, axes_of(chain))
    return gaps(benches, np.zeros_like(later), later)


def _lowest(scene: Scene, bench: int, left: float, right: float) -> NearMiss:
    """Return the smallest gap in an interval by golden-section search."""
    one = np.array([bench])
    for _ in range(40):
        a, b = right - _GOLDEN * (right - left), left + _GOLDEN * (right - left)
        if _gaps(scene, a, one)[0] < _gaps(scene, b, one)[0]:
            right = b
        else:
            left = a
    middle = 0.5 * (left + right)
    return NearMiss(bench, middle, float(_gaps(scene, middle, one)[0]))


def _is_contact(miss: NearMiss, found: Contact | NoContact) -> bool:
    return isinstance(found, Contact) and miss.bench == found.benches[1] and abs(miss.t_s - found.t_s) < 2 * _SPACING_S
