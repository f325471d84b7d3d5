"""Effects: what a scene asks to be simulated. What it does not ask for is not computed, published or recorded."""
from collections.abc import Iterable
from enum import Flag, auto

from dragon_ros.core.errors import FieldError


class Effect(Flag):
    """Switches; handles are always there."""

    NONE = 0
    VELOCITY = auto()
    BENCHES = auto()

    @property
    def names(self) -> list[str]:
        """Names as a scene file writes them."""
        return [name for name, effect in _known().items() if effect in self]


def effects_of(names: Iterable[object]) -> Effect:
    """Return the flags for names such as 'velocity'."""
    known = _known()
    effects = Effect.NONE
    for name in names:
        if not isinstance(name, str) or name not in known:
            raise FieldError('effects', name, f'the effects are {", ".join(known)}', 'name only these')
        effects |= known[name]
    return effects


def _known() -> dict[str, Effect]:
    """Return every effect by name (Python 3.10 iterates over the zero as well)."""
    return {str(effect.name).lower(): effect for effect in Effect if effect.value}
