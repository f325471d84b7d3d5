"""The tool that mutates a room: what it changes, and which tests it runs for a change."""
import pytest

pytest.importorskip('cosmic_ray')
import mutants

SOURCE = 'FACTOR = 2.0\n\n\ndef reach(a: int | None, b: float) -> float:\n    return min(a, b) * FACTOR - 1\n'


def changed(operator):
    known = mutants.operators()
    return {mutants.mutate_code(SOURCE, known[one.operator], one.occurrence)
            for one in mutants.mutants_of('reach.py', SOURCE, known) if one.operator == operator}


@pytest.mark.parametrize(('operator', 'old', 'new'), [
    ('dragon/Scaled', '2.0', '4.0'), ('dragon/Scaled', '2.0', '1.0'), ('dragon/Swapped', 'min(', 'max('),
    ('core/ReplaceBinaryOperator_Mul_Div', ' * ', ' / '), ('core/ReplaceBinaryOperator_Sub_Add', ' - ', ' + ')])
def test_a_dropped_factor_a_side_and_a_sign_are_among_the_mutants(operator, old, new):
    assert SOURCE.replace(old, new) in changed(operator)


def test_annotations_are_left_alone():
    assert all('a: int | None, b: float) -> float' in code for name in mutants.operators() for code in changed(name))


def test_each_mutant_is_one_change_of_the_line_that_it_names():
    known = mutants.operators()
    for one in mutants.mutants_of('reach.py', SOURCE, known):
        after = mutants.mutate_code(SOURCE, known[one.operator], one.occurrence).splitlines()
        assert [n for n, (a, b) in enumerate(zip(SOURCE.splitlines(), after, strict=True), 1) if a != b] == [one.line]


def test_the_quickest_tests_that_reach_the_line_run_first():
    lines = {'a.py': {3: ['t.py::slow', 't.py::quick', 't.py::far']}}
    times = {'slow': 5.0, 'quick': 0.1, 'far': 1e9}
    assert mutants.chosen(mutants.Mutant('a.py', 'x', 0, 3), lines, times) == (['t.py::quick', 't.py::slow'], 5.1)
    assert mutants.chosen(mutants.Mutant('b.py', 'x', 0, 3), lines, times) == ([], 0.0)


def test_a_constant_is_held_against_every_test_that_runs_its_file():
    lines = {'a.py': {3: ['t.py::one'], 9: ['t.py::two']}}
    tests, _ = mutants.chosen(mutants.Mutant('a.py', 'x', 0, 1), lines, {'one': 1, 'two': 2})
    assert tests == ['t.py::one', 't.py::two']


def test_every_room_has_files_and_tests():
    for sources, tests in mutants.ROOMS.values():
        assert all((mutants.ROOT / part).exists() for part in (*sources, *tests))
