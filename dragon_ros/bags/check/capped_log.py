"""Lines about what is wrong, in bounded memory."""
from dataclasses import dataclass, field

_MOST = 100


@dataclass
class CappedLog:
    """The first lines, and how many there were."""

    lines: list[str] = field(default_factory=list)
    count: int = 0

    def note(self, what: object) -> None:
        """Count one, and keep its line if there are not too many."""
        self.count += 1
        if len(self.lines) < _MOST:
            self.lines.append(str(what))
