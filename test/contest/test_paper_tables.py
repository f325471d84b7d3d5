"""Tables 1 to 3 of the paper, reproduced to the last printed digit; the print lost two minus signs in Table 3."""
import csv
import io
import json
from pathlib import Path

import pytest

from dragon_contest.paper_tables import cells
from dragon_ros.__main__ import main


@pytest.fixture(scope='module')
def all_cells():
    return cells()


@pytest.mark.parametrize('table', [1, 2, 3])
def test_the_recipe_reproduces_every_printed_cell(all_cells, table):
    ours = [cell for cell in all_cells if cell.table == table]
    assert ours
    lost = [(cell.handle, cell.quantity) for cell in ours if cell.reproduced == '-' + cell.printed]
    assert lost == ([(1, 'x'), (151, 'x')] if table == 3 else [])
    assert sum(cell.reproduced == cell.printed for cell in ours) == len(ours) - len(lost)


def test_every_printed_number_is_there(all_cells):
    printed = json.loads((Path(__file__).parents[1] / 'data' / 'paper_tables.json').read_text())
    assert len(all_cells) == 98 + 49
    raw = {(1, h, q, float(t)): v[q] for h, row in printed['table1'].items() for t, v in row.items() for q in 'xy'}
    raw |= {(2, h, 'v', float(t)): v for h, row in printed['table2'].items() for t, v in row.items()}
    raw |= {(3, h, q, 412.2): row[q] for h, row in printed['table3'].items() for q in 'xyv'}
    for cell in all_cells:
        assert cell.printed == raw.pop((cell.table, str(cell.handle), cell.quantity, cell.t_s))
    assert not raw


def test_the_print_is_up_to_2_cm_off_at_the_head_and_12_m_at_the_tail(all_cells):
    def off(handle, table):
        return max(abs(c.error) for c in all_cells if c.handle == handle and c.table == table and c.quantity in 'xy')
    assert 0.019 < off(0, 1) < 0.022
    assert 9 < off(223, 1) < 12
    assert 0.009 < max(abs(c.error) for c in all_cells if c.quantity == 'v') < 0.01


@pytest.mark.parametrize('form', ['text', 'csv', 'json'])
def test_table_paper_prints_all_of_it(capsys, form):
    assert main(['table', '--paper', '--format', form]) == 0
    out = capsys.readouterr().out
    if form == 'json':
        assert len(json.loads(out)) == 147
    elif form == 'csv':
        assert len(list(csv.DictReader(io.StringIO(out)))) == 147
    else:
        assert out.count('reproduced') == 14 + 7 + 7
        assert 'Table 3' in out


def test_the_paper_tier_refuses_times_between_its_steps(capsys):
    assert main(['table', '--accuracy', 'paper', '--times', '0.005']) == 2
    assert '0.01 s' in capsys.readouterr().err
