"""Jobs for process pools, in a module that a new process can import quickly."""
import os
import signal
import time

from dragon_ros.core.errors import DragonError


def squares(job):
    return job * job + 1


def end_at_300(job):
    if job == 300:
        raise DragonError(f'job {job}: no')
    return job


class KilledElsewhere:
    """A function that kills every process that calls it, except the one that created it."""

    def __init__(self):
        self.parent = os.getpid()

    def __call__(self, job):
        if os.getpid() != self.parent:
            os.kill(os.getpid(), signal.SIGKILL)
        time.sleep(0.01)        # so that other processes also receive jobs
        return job


class FailsHere:
    """Fails in the process that created it once another process has begun a job, while that job still runs."""

    def __init__(self, folder):
        self.folder, self.process = folder, os.getpid()

    def __call__(self, job):
        begun, failed = self.folder / 'begun', self.folder / 'failed'
        if os.getpid() != self.process:
            begun.touch()
            until = time.monotonic() + 1.0      # the other may wait for this result first
            while not failed.exists() and time.monotonic() < until:
                time.sleep(0.001)
        elif begun.exists():
            failed.touch()
            raise DragonError(f'job {job}: no')
        return job


class InterruptedHere:
    """Is interrupted in the process that created it once another process has begun a job that takes half a minute."""

    def __init__(self, folder):
        self.folder, self.process = folder, os.getpid()

    def __call__(self, job):
        begun = self.folder / 'begun'
        if os.getpid() != self.process:
            begun.touch()
            time.sleep(30)
            (self.folder / 'done').touch()
            return job
        until = time.monotonic() + 0.5
        while not begun.exists() and time.monotonic() < until:
            time.sleep(0.001)
        if begun.exists():
            raise KeyboardInterrupt
        return job
