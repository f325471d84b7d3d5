"""The index of the cost pages states the figures of the pages, rounded."""
import csv
import re
from functools import cache
from pathlib import Path

import pytest

PAGES = Path(__file__).parents[2] / 'docs' / 'cost'
ROUNDED = 0.06      # the largest relative error of a figure that is rounded to two digits, as 9.5 to 9 or 10


@cache
def rows(page):
    with (PAGES / f'{page}.csv').open(encoding='utf-8', newline='') as file:
        return list(csv.DictReader(file))


def value(page, column='median_s', **where):
    found, = (row for row in rows(page) if all(row[key] == wanted for key, wanted in where.items()))
    return float(found[column])


def cell(page, column, first):
    """Return a figure of a page's table in Markdown, in the column whose heading contains some words."""
    lines = [[one.strip() for one in line.split('|')] for line in (PAGES / f'{page}.md').read_text().splitlines()
             if line.startswith('|')]
    at, = (n for n, one in enumerate(lines[0]) if column in one)
    found, = (line for line in lines if line[1] == first)
    return float(found[at].replace(',', ''))


def published(messages):
    solver = 'plain' if messages == 'objects' else 'table'
    return sum(value('tick', solver=solver, tier='exact', messages=messages, stage=stage)
               for stage in ('encode', 'publish'))


def times_real_time(compression):
    return 3.01 / value('bag', writer='dragon_ros', compression=compression)      # 301 ticks at 100 Hz


# Words around figures, each figure as #, and the figures.
STATED = [
    ('of the classic dragon takes # µs', lambda: [
        1e6 * value('accuracy', method='dragon_ros, table')]),
    ('forward placement takes # ms', lambda: [1e3 * value('accuracy', method='dragon_ros, march')]),
    ("scipy's `brentq` takes # ms", lambda: [1e3 * value('accuracy', method='scipy brentq')]),
    ('a tick with only handles takes # µs', lambda: [
        1e6 * value('effects', what='minimal', scene='over a build without effects')]),
    ('bench rectangles, takes # times as long, and a tick with all effects # times', lambda: [
        value('effects', 'ratio', what=what, scene='over minimal') for what in ('winding', 'everything on')]),
    ('objects takes # times as long as publishing them as bytes', lambda: [published('objects') / published('bytes')]),
    ('which takes # ms for the classic dragon, # ms on the turn between two spirals, and # s for', lambda: [
        value('first', scene=scene, tick='first') * factor
        for scene, factor in (('winding', 1e3), ('turning', 1e3), ('long', 1))]),
    ('pay off after #, # and # ticks', lambda: [
        cell('first', 'pays off', one) for one in ('winding', 'turning', 'long')]),
    ('at # times real time, or at # times without compression', lambda: [*map(times_real_time, ('zstd', 'none'))]),
    ('grows by about # kB per minute, including # kB', lambda: [
        cell('memory', 'without steps (kB/min)', '10'), cell('memory', 'of the index', '10')]),
    ('(by # MB in the ten minutes measured', lambda: [cell('memory', 'in steps', '10')]),
    ('20,000 corners, `design fit` takes # s', lambda: [value('venue', corners='20000', answer='design fit')])]


@pytest.mark.parametrize(('words', 'figures'), STATED, ids=[words for words, _ in STATED])
def test_a_figure_of_the_index_is_the_one_of_its_page(words, figures):
    text = ' '.join((PAGES / 'README.md').read_text(encoding='utf-8').split())
    found, = re.findall(re.escape(words).replace(r'\#', r'([\d.]+)'), text)
    stated = [float(one) for one in ((found,) if isinstance(found, str) else found)]
    assert stated == pytest.approx(figures(), rel=ROUNDED)


def test_the_index_states_what_effects_that_are_off_cost():
    text = ' '.join((PAGES / 'README.md').read_text(encoding='utf-8').split())
    stated, = re.findall(r'without effects takes ([\d.]+) times as long', text)
    assert float(stated) == pytest.approx(
        value('effects', 'ratio', what='minimal', scene='over a build without effects'), abs=0.006)
