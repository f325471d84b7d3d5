"""A simulated full disk, on which no file can grow any further."""
import os
import resource
import sys
from contextlib import contextmanager
from unittest.mock import patch


@contextmanager
def small_disk(size):
    """Within the block, no file can grow beyond ``size`` bytes.

    Python does not write bytecode within the block, because it would leave truncated files in its cache.
    """
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        with patch.object(sys, 'dont_write_bytecode', True), patch.dict(os.environ, PYTHONDONTWRITEBYTECODE='1'):
            yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
