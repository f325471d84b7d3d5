"""Studies of small dragons, whose rows take between a millisecond and a few hundredths of a second."""
from pathlib import Path

import pytest
from slow_study import QUICK


@pytest.fixture(scope='session')
def study():
    """A function that reads a study from a string."""
    from dragon_ros.scenes.yaml import parse_document
    from dragon_studies.definition import study_of

    def read(text=QUICK):
        return study_of(parse_document('f.yaml', text), Path())
    return read


@pytest.fixture(scope='session')
def without_times():
    """A function that returns rows as plain values without their CPU time."""
    def values(table):
        rows = table if isinstance(table, list) else table.to_pylist()
        return [{key: value for key, value in row.items() if key != 'cpu_s'} for row in rows]
    return values
