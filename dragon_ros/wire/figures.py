"""Figures as files."""
from pathlib import Path
from typing import Any

from dragon_ros.core.errors import MissingError


def save(figure: Any, stem: Path) -> list[Path]:
    """Write a matplotlib figure as PNG and SVG beside each other and return both paths."""
    paths = [stem.with_suffix(suffix) for suffix in ('.png', '.svg')]
    for path in paths:
        try:
            figure.savefig(path, dpi=130)
        except OSError as error:
            raise MissingError(f'{path}: cannot be written: {error.strerror}') from None
    return paths
