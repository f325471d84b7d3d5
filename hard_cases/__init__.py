"""The hard cases: named scenes, in series that approach each singularity, shared by tests and benchmarks.

``truth`` has a reference for each case, to 50 digits, from JSON files that the scripts in this package compute.
"""
from hard_cases.dances import dances
from hard_cases.problems import Problem, problems

__all__ = ['Problem', 'hard_cases']


def hard_cases() -> tuple[Problem, ...]:
    """Return every hard case: those on one spiral, then those with composite tracks, head laws or leading tails."""
    return (*problems(), *dances())
