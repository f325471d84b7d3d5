"""``python -m benchmarks PAGE ...``: measure a page of ``docs/cost`` in a process set up like that of a command."""
import sys

from benchmarks.command import main
from dragon_ros.__main__ import run

if __name__ == '__main__':
    run(sys.argv[1:], main)
