"""All budgets for untrusted input are in one table, used and documented."""
from pathlib import Path

from dragon_ros.core import limits

PACKAGE = Path(limits.__file__).parents[1]
UNITS = ('KB', 'MB')


def test_every_budget_has_one_row_in_the_table():
    declared = [name for name in vars(limits) if name.isupper() and name not in (*UNITS, 'LIMITS')]
    assert sorted(one.name for one in limits.LIMITS) == sorted(declared)


def test_every_budget_is_kept_somewhere():
    sources = [path.read_text() for path in PACKAGE.rglob('*.py') if path.name != 'limits.py']
    for one in limits.LIMITS:
        assert any(f'{one.name}' in source.partition('import')[2] for source in sources), one.name
