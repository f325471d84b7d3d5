"""Print the results of common mistakes on the contest problem CUMCM 2024 A, as in the tables of docs/cumcm-2024-a.md.

Each row is a recipe with one mistake (``dragon_contest/mistakes.py``). ``common_mistakes.py 1 2`` prints
only the tables of questions 1 and 2.
"""
import sys
from collections.abc import Callable, Iterable, Iterator

import dragon_ros as dr
from dragon_contest import mistakes
from dragon_contest.grade.words import sentence
from dragon_contest.mistakes import MistakenAnswer, first_touch_s, front_gaps, gap_of

Rows = Iterator[tuple[str, ...]]


def rows(head: str, answers: Iterable[MistakenAnswer], form: Callable[[MistakenAnswer], str]) -> Rows:
    """Yield the header of a table, then a row for each mistake with its answer."""
    yield 'mistake', head
    for one in answers:
        yield sentence(one.key, one.parameters), form(one)


def truth(dragon: dict[str, float]) -> str:
    """Return a string that states the first contact that ``contact`` finds."""
    found = dr.compile(dr.scene('winding', dragon=dragon)).contact()
    return f'{found.t_s:.6f} s, benches {found.benches[0]} and {found.benches[1]}'


def elsewhere() -> Rows:
    """Yield checks that are right on the classic dragon only by luck, each with a dragon for which it is wrong."""
    yield 'check', 'dragon', 'gives', 'right'
    wide, short = {'width_m': 0.301}, {'head_length_m': 1.2}
    yield ("only the head's front corners", 'benches 0.301 m wide', f'{first_touch_s(gap_of(wide, front_gaps)):.6f} s',
           truth(wide))
    yield 'only the head', 'a head of 1.2 m', f'{first_touch_s(gap_of(short), 420.0, 432.0):.6f} s', truth(short)


QUESTIONS: dict[str, Callable[[], Rows]] = {
    '1': lambda: rows('largest error of a handle at 300 s', mistakes.errors_at_300_s(), lambda one: (
        f'{one.value:.3g} m')),
    '2': lambda: rows('first contact', mistakes.contact_times_s(), lambda one: f'{one.value:.6f} s'),
    '2, elsewhere': elsewhere,
    '3': lambda: rows('smallest pitch', mistakes.pitches_m(), lambda one: (
        f'{one.value:.6f} m' if one.key == 'on_circle' else f'{one.value:.5f} m')),
    '4': lambda: rows('length of the turn', mistakes.turn_lengths_m(), lambda one: f'{one.value:.6f} m'),
    '5': lambda: rows("head's largest speed", mistakes.head_speeds_m_s(), lambda one: f'{one.value:.6f} m/s')}


def table(lines: Rows) -> str:
    """Return rows as a Markdown table; the first row is the header."""
    out = [f'| {" | ".join(row)} |' for row in lines]
    return '\n'.join([out[0], '|---' * out[0].count(' | ') + '|---|', *out[1:]])


if __name__ == '__main__':
    for number in sys.argv[1:] or QUESTIONS:
        print(f'Question {number}\n\n{table(QUESTIONS[number]())}\n')
