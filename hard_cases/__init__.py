"""The hard cases: named scenes that approach each singularity and the corners of the world.

Tests and benchmarks share them. The module ``truth`` reads a 50-digit reference for each case from a JSON file that the
script ``make_reference`` writes.
"""
from hard_cases.cases import Problem, hard_cases

__all__ = ['Problem', 'hard_cases']
