"""Commands of optional packages beside dragon_ros: the one place that names these packages.

Such a package uses ``import dragon_ros`` and ``dragon_ros.cli`` alone. The commands of a package that is not installed
do not exist.
"""
from importlib.util import find_spec
from typing import NamedTuple


class Guest(NamedTuple):
    """An optional command: its module, whose function ``main(argv)`` returns the exit code, and one line of help."""

    module: str
    help: str


# A name with an option is an option of that command; its module has a function ``run(arguments)`` instead.
GUESTS = {
    'study': Guest('dragon_studies.command', 'run a parameter study over thousands or millions of scenes'),
    'grade': Guest('dragon_contest.grade.command', 'grade contest results and diagnose common mistakes'),
    'table --paper': Guest('dragon_contest.table', "the paper's three tables: printed, reproduced and true values, and "
                           'errors (incompatible with scene options)'),
    'table --contest': Guest('dragon_contest.table', 'write the files of the contest: result1 and result2 of the given '
                             'scene, and result4 of the scene turning (incompatible with --times)'),
}


def installed() -> dict[str, Guest]:
    """Return the optional commands and options whose packages are installed."""
    return {name: guest for name, guest in GUESTS.items() if find_spec(guest.module.partition('.')[0])}
