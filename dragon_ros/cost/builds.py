"""What the shift table itself costs: rows, terms, time to build and memory, against the number of benches."""
from dataclasses import dataclass, replace
from time import perf_counter

from dragon_ros.core.scene import Scene


@dataclass(frozen=True)
class Build:
    """The table of one dragon: rows, terms of its series, seconds to build it, bytes."""

    benches: int
    rows: int
    terms: int
    seconds: float
    memory_bytes: int


def build(scene: Scene) -> Build | None:
    """Return what the table of a scene costs, the faster of two builds; None where it has none."""
    spent = []
    for _ in range(2):
        fresh = replace(scene)      # a scene keeps its table
        start = perf_counter()
        table = fresh.table
        spent.append(perf_counter() - start)
    if table is None:
        return None
    return Build(scene.dragon.benches, table.rows, table.nodes, min(spent), table.memory_bytes)


def markdown(rows: list[Build]) -> str:
    """Return the rows as a Markdown table."""
    lines = ['| shift table of N benches | rows | terms | built in (ms) | memory (MB) |', '|---:|---:|---:|---:|---:|']
    lines += [f'| {row.benches:,} | {row.rows:,} | {row.terms} | {row.seconds * 1e3:.3g} '
              f'| {row.memory_bytes / 1e6:.3g} |'
              for row in rows]
    return '\n'.join(lines)
