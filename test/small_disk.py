"""A simulated full disk, on which no file can grow any further."""
import resource
from contextlib import contextmanager


@contextmanager
def small_disk(size):
    """Within the block, no file can grow beyond ``size`` bytes."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
