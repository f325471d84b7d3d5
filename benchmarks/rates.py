"""The machine's rates on one thread, measured in the run of a page, and the shortest time for amounts at these rates.

A page that shows the ratio to the machine's limit states the amounts that a piece of work must process: multiplications
and additions, bytes to copy, to compress or to write. Its limit is the longest of the times that these amounts take.
"""
from collections.abc import Mapping
from functools import partial
from pathlib import Path

import numpy as np

from dragon_ros.bags.write.mcap import compressor
from dragon_ros.core.numerics.chebyshev import columns_of
from dragon_ros.cost.measure import timed

NUMBER = 8                          # bytes
CACHED, LARGE = 2**15, 2**27        # size in bytes that fits into a core's cache, and size that exceeds all caches
_BLOCK = 2**24                      # bytes written to a file at once
_CHUNK = 2**20                      # bytes compressed at once
Amounts = dict[str, float]          # amounts, or rates per second, by the name of the rate


def product_rate(budget_s: float) -> float:
    """Return the multiplications and additions per second of a product whose matrices stay in the cache."""
    a, b = np.ones((64, 64)), np.ones((64, columns_of(64 * 64)))
    return 2 * a.size * b.shape[1] / timed(lambda: a @ b, budget_s).median_s


def copy_rate(size: float, budget_s: float) -> float:
    """Return the bytes copied per second in blocks of ``size`` bytes, or of 32 kB if that is more.

    In a smaller block, the call would take longer than the copying.
    """
    source, target = np.ones((2, max(CACHED, int(size)) // NUMBER))
    return source.nbytes / timed(partial(np.copyto, target, source), budget_s).median_s


def compression_rate(name: str, data: bytes, budget_s: float) -> float:
    """Return the bytes per second that a compression reads alone."""
    chunk = data[:_CHUNK]
    return len(chunk) / timed(partial(compressor(name), memoryview(chunk)), budget_s).median_s


def file_rate(folder: Path, budget_s: float) -> float:
    """Return the bytes per second that are written to a file, which the system writes to disk later."""
    block = bytes(_BLOCK)
    return len(block) / timed(partial((folder / 'block').write_bytes, block), budget_s).median_s


def tick_rates(budget_s: float, size: float = CACHED) -> Amounts:
    """Return the rates that bound the stages of a tick, with copying in blocks of ``size`` bytes."""
    return {'product': product_rate(budget_s), 'cache': copy_rate(size, budget_s)}


def limit(needs: Mapping[str, float], rates: Mapping[str, float]) -> tuple[float, str]:
    """Return the shortest possible time in seconds, and the rate that bounds it; 0 s if nothing is needed."""
    return max(((amount / rates[rate], rate) for rate, amount in needs.items()), default=(0.0, ''))


def times(value: float, least: float) -> str:
    """Return how many times its limit a value is, to three digits; '-' if there is no limit."""
    if not least > 0:
        return '-'
    ratio = value / least
    return f'{ratio:,.0f}' if ratio >= 99.95 else f'{ratio:.3g}' if ratio >= 9.995 else f'{ratio:.2f}'
