"""A log of problems with bounded memory use."""
from dataclasses import dataclass, field

_MOST = 100


@dataclass
class CappedLog:
    """The first lines of a log and the total number of lines."""

    lines: list[str] = field(default_factory=list)
    count: int = 0

    def note(self, what: object) -> None:
        """Count a problem; keep its line unless the log is full."""
        self.count += 1
        if len(self.lines) < _MOST:
            self.lines.append(str(what))
