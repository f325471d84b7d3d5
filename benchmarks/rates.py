"""The machine's rates on one thread, measured in the same run as a page, and the limits that follow from these rates.

For a page that shows ratios to the machine's limit, each piece of work has amounts to process: multiplications and
additions, and bytes to copy, compress or write. The limit is the longest of the times needed to process these amounts.
"""
from collections.abc import Mapping
from functools import partial
from pathlib import Path

import numpy as np

from dragon_ros.bags.write.mcap import compressor
from dragon_ros.core.numerics.chebyshev import columns_of
from dragon_ros.cost.measure import timed

NUMBER = 8                          # bytes per number
CACHED, LARGE = 2**15, 2**27        # bytes: a size that fits into a core's cache, and one that exceeds all caches
_BLOCK = 2**24                      # bytes per write to a file
_CHUNK = 2**20                      # bytes per compression
Amounts = dict[str, float]          # amounts, or rates per second, by the name of the rate


def product_rate(budget_s: float) -> float:
    """Return the multiplications and additions per second in a matrix product that stays in the cache."""
    a, b = np.ones((64, 64)), np.ones((64, columns_of(64 * 64)))
    return 2 * a.size * b.shape[1] / timed(lambda: a @ b, budget_s).median_s


def stage_copy_rate(size: float, budget_s: float) -> float:
    """Return the bytes per second that a stage of ``size`` bytes can copy, using that much memory in all.

    Half of them are the source and half the target, so that copying leaves a cache only where the stage would.
    """
    return copy_rate(0.5 * size, budget_s)


def copy_rate(size: float, budget_s: float) -> float:
    """Return the bytes per second when copying blocks of ``size`` bytes, or of 32 KiB if that is more.

    For a smaller block, the call would take longer than the copying.
    """
    source, target = np.ones((2, max(CACHED, int(size)) // NUMBER))
    return source.nbytes / timed(partial(np.copyto, target, source), budget_s).median_s


def compression_rate(name: str, data: bytes, budget_s: float) -> float:
    """Return the bytes per second that compression alone can read."""
    chunk = data[:_CHUNK]
    return len(chunk) / timed(partial(compressor(name), memoryview(chunk)), budget_s).median_s


def file_rate(folder: Path, budget_s: float) -> float:
    """Return the bytes per second that can be written to a file, before the system writes them to the disk."""
    block = bytes(_BLOCK)
    return len(block) / timed(partial((folder / 'block').write_bytes, block), budget_s).median_s


def tick_rates(budget_s: float, size: float = CACHED) -> Amounts:
    """Return the rates that limit the stages of a tick, measured for copies of ``size`` bytes."""
    return {'product': product_rate(budget_s), 'cache': copy_rate(size, budget_s)}


def limit(needs: Mapping[str, float], rates: Mapping[str, float]) -> tuple[float, str]:
    """Return the shortest possible time in seconds, and the rate that determines it; 0 s if nothing is needed."""
    return max(((amount / rates[rate], rate) for rate, amount in needs.items()), default=(0.0, ''))


def times(value: float, least: float) -> str:
    """Return the ratio of a value to its limit, to three digits, or '-' if there is no limit."""
    if not least > 0:
        return '-'
    ratio = value / least
    return f'{ratio:,.0f}' if ratio >= 99.95 else f'{ratio:.3g}' if ratio >= 9.995 else f'{ratio:.2f}'
