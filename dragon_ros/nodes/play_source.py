"""What a player plays."""
from typing import Protocol


class PlaySource(Protocol):
    """A source of frames in order of simulation time, with a current position."""

    def next_ns(self) -> int | None:
        """Return the time of the next frame, or None at the end."""

    def last_ns(self) -> int:
        """Return the time of the last frame."""

    def show(self) -> None:
        """Publish the next frame and advance."""

    def flush(self) -> bool:
        """Publish messages held back by slow readers; return whether none remain."""

    def rewind(self) -> None:
        """Move to the first frame."""

    def seek(self, t_ns: int | None) -> None:
        """Move to the last frame at or before ``t_ns`` (None: the first). Raises DragonError if there is no frame."""

    def stamp_ns(self, t_s: float) -> int:
        """Return the simulation time of a frame, given its time in seconds as users give and read it."""

    def seconds(self, t_ns: int) -> float:
        """Return the time in seconds that ``stamp_ns`` accepts."""

    def place(self) -> str:
        """Describe the position of the last frame shown."""

    def ending(self) -> str:
        """Return why there is no next frame."""
