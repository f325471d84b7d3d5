"""The hard cases: one list of named scenes with ladders towards each singularity, shared by tests and benchmarks.

``truth`` has the reference of each to 50 digits, from the JSON files that the scripts beside them compute.
"""
from hard_cases.dances import dances
from hard_cases.problems import Problem, problems

__all__ = ['Problem', 'hard_cases']


def hard_cases() -> tuple[Problem, ...]:
    """Return every hard case: of one spiral, then of composite tracks, head laws and leading tails."""
    return (*problems(), *dances())
