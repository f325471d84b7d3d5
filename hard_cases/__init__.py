"""The hard cases: series of named scenes that approach each singularity, shared by tests and benchmarks.

The module ``truth`` reads a 50-digit reference for each case from JSON files that scripts in this package write.
"""
from hard_cases.dances import dances
from hard_cases.problems import Problem, problems

__all__ = ['Problem', 'hard_cases']


def hard_cases() -> tuple[Problem, ...]:
    """Return every hard case: those on one spiral, then those with composite tracks, head laws or leading tails."""
    return (*problems(), *dances())
