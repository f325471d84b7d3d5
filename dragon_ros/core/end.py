"""Where a scene ends, and the error for a time after the end of the model."""
from dataclasses import dataclass

from dragon_ros.core.errors import ChainLockError, ModelEnd, TrackEndError


@dataclass(frozen=True)
class End:
    """Where a scene ends: time, why ('stop', 'lock' or 'track') and the link that locks."""

    t_s: float
    reason: str
    link: int | None = None


def beyond(t_s: float, limit: End, radius_m: float | None) -> ModelEnd:
    """Return the error for a time after ``limit``, when the head is at a radius; None where no head leads a spiral."""
    if radius_m is None:
        return TrackEndError(f't_s: {t_s:.9g} s is beyond the end of the scene: the track ends for a handle '
                             f'at {limit.t_s:.6f} s; ask for an earlier time', t_s=t_s, limit_s=limit.t_s)
    why = 'the head reaches the centre' if limit.reason == 'track' else f'the chain locks at link {limit.link}'
    kind = TrackEndError if limit.reason == 'track' else ChainLockError
    return kind(f't_s: {t_s:.9g} s is beyond the end of the scene: {why} at {limit.t_s:.6f} s, with the head at '
                f'radius {radius_m:.6f} m; ask for an earlier time', t_s=t_s, limit_s=limit.t_s, link=limit.link,
                radius_m=radius_m)
