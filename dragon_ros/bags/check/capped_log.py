"""A log of problems with bounded memory use."""
from dataclasses import dataclass, field

_MOST = 100


@dataclass
class CappedLog:
    """A log that keeps its first lines and counts all of them."""

    lines: list[str] = field(default_factory=list)
    count: int = 0

    def note(self, what: object) -> None:
        """Count a problem; keep its line unless the log is full."""
        self.count += 1
        if len(self.lines) < _MOST:
            self.lines.append(str(what))

    def note_first(self, what: object) -> None:
        """Count a problem, and put its line before all others, so that it is always kept."""
        self.count += 1
        self.lines.insert(0, str(what))
