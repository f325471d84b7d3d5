"""The tool that mutates a room makes the right mutants, and runs the right tests for each of them."""
import gc

import pytest

pytest.importorskip('cosmic_ray')
import mutants

SOURCE = 'FACTOR = 2.0\n\n\ndef reach(a: int | None, b: float) -> float:\n    return min(a, b) * FACTOR - 1\n'


def mutated(source):
    """Return the name of the operator and the code of each mutant."""
    known = mutants.operators()
    return [(one.operator, mutants.mutate_code(source, known[one.operator], one.occurrence))
            for one in mutants.mutants_of('a.py', source, known)]


@pytest.mark.parametrize(('operator', 'old', 'new'), [
    ('dragon/Scaled', '2.0', '4.0'), ('dragon/Scaled', '2.0', '1.0'), ('dragon/Swapped', 'min(', 'max('),
    ('core/ReplaceBinaryOperator_Mul_Div', ' * ', ' / '), ('core/ReplaceBinaryOperator_Sub_Add', ' - ', ' + ')])
def test_a_dropped_factor_a_side_and_a_sign_are_among_the_mutants(operator, old, new):
    assert (operator, SOURCE.replace(old, new)) in mutated(SOURCE)


def test_annotations_are_left_alone():
    codes = [code for _, code in mutated(SOURCE)]
    assert codes
    assert all('a: int | None, b: float) -> float' in code for code in codes)


@pytest.mark.parametrize(('source', 'left_alone', 'changed'), [
    ('a: list[int | None] = [3]\n', 'int | None', '[6]'),
    ('@cache(7)\ndef f():\n    return 3\n', '@cache(7)', 'return 4'),
    ('if 3:\n    raise ValueError(f"{1e3 * a} is above {MOST - 1}")\n', 'f"{1e3 * a} is above {MOST - 1}"', 'if 4:'),
    ('f(zip(a, 3, strict=True))\n', 'strict=True', '4')])
def test_what_computes_nothing_is_left_alone_and_what_stands_beside_it_is_not(source, left_alone, changed):
    codes = [code for _, code in mutated(source)]
    assert all(left_alone in code for code in codes)
    assert any(changed in code for code in codes)


def test_each_mutant_is_one_change_of_the_line_that_it_names():
    known = mutants.operators()
    for one in mutants.mutants_of('reach.py', SOURCE, known):
        after = mutants.mutate_code(SOURCE, known[one.operator], one.occurrence).splitlines()
        assert [n for n, (a, b) in enumerate(zip(SOURCE.splitlines(), after, strict=True), 1) if a != b] == [one.line]


def test_the_quickest_tests_that_reach_the_line_run_first():
    lines = {'a.py': {3: ['t.py::slow', 't.py::quick']}}
    times = {'t.py::slow': 5.0, 't.py::quick': 0.1, 'u.py::far': 0.1}
    tests = mutants.chosen(mutants.Mutant('a.py', 'x', 0, 3), lines, times, {}, 9.0)
    assert list(tests.items()) == [('t.py::quick', 0.1), ('t.py::slow', 5.0)]
    assert mutants.chosen(mutants.Mutant('b.py', 'x', 0, 3), lines, times, {}, 9.0) == {}


def test_tests_that_may_share_what_another_has_run_come_last():
    lines, times = {'a.py': {3: ['t.py::one']}}, {'t.py::one': 1.0, 't.py::shares': 0.1, 'u.py::far': 0.1}
    tests = mutants.chosen(mutants.Mutant('a.py', 'x', 0, 3), lines, times, {}, 9.0)
    assert list(tests) == ['t.py::one', 't.py::shares']


def test_tests_beyond_what_a_mutant_may_take_are_left_out():
    lines, times = {'a.py': {3: ['t.py::slow', 't.py::quick']}}, {'t.py::slow': 5.0, 't.py::quick': 0.1}
    assert mutants.chosen(mutants.Mutant('a.py', 'x', 0, 3), lines, times, {}, 5.0) == {'t.py::quick': 0.1}


def test_tests_that_found_mutants_of_the_file_before_run_first():
    lines = {'a.py': {3: ['t.py::slow', 't.py::quick']}}
    times = {'t.py::slow': 1.0, 't.py::quick': 0.5}
    tests = mutants.chosen(mutants.Mutant('a.py', 'x', 0, 3), lines, times, {'t.py::slow': 1}, 9.0)
    assert list(tests) == ['t.py::slow', 't.py::quick']


def test_a_constant_is_held_against_every_test_that_runs_its_file():
    lines = {'a.py': {3: ['t.py::one'], 9: ['t.py::two']}}
    tests = mutants.chosen(mutants.Mutant('a.py', 'x', 0, 1), lines, {'t.py::one': 1, 't.py::two': 2}, {}, 9.0)
    assert list(tests) == ['t.py::one', 't.py::two']


def outcome_of(folder, source, **limits):
    (folder / 'two.py').write_text(source)
    (folder / 'pyproject.toml').write_text('[tool.pytest.ini_options]\nmarkers = ["snapshot"]\n')
    (folder / 'conftest.py').write_text(
        'def pytest_addoption(parser):\n    parser.addoption("--long", action="store_true")\n')
    (folder / 'test_two.py').write_text('from two import two\n\n\ndef test_two():\n    assert two() == 2\n')
    known = mutants.operators()
    mutant, *_ = (one for one in mutants.mutants_of('two.py', source, known)
                  if one.operator.endswith(('Sub_Add', 'Add_Sub')))
    gc.freeze()     # pytest collects garbage in the fork, where it would visit all objects of the tests that ran before
    found = mutants.tried(folder, mutant, {'test_two.py::test_two': 0.01}, known, **limits)
    assert (folder / 'two.py').read_text() == source
    return found


@pytest.mark.parametrize(('source', 'outcome', 'by'), [
    ('def two():\n    return 1 + 1\n', 'caught', 'test_two.py::test_two'),
    pytest.param('def two():\n    return 2 or 1 + 1\n', 'survived', '', marks=pytest.mark.long),
    ('ONE = [1][1 - 1]\n\n\ndef two():\n    return 2\n', 'incompetent', '')])
def test_a_mutant_counts_as_caught_where_a_test_fails(tmp_path, source, outcome, by):
    assert outcome_of(tmp_path, source) == (outcome, by)


def test_a_mutant_that_does_not_end_counts_as_caught(tmp_path):
    source = 'import time\n\n\ndef two():\n    while 1 - 1:\n        time.sleep(1)\n    return 2\n'
    assert outcome_of(tmp_path, source, extra_s=0.5) == ('caught', 'no end')


def test_a_line_outside_of_functions_runs_at_import_wherever_that_is():
    source = 'ONE = 1\n\n\nclass A:\n    two: int = 2\n\n    def f(self, three=3):\n        return ONE\n'
    assert mutants.in_functions(source) == {8}


def test_every_room_has_files_and_tests():
    for sources, tests in mutants.ROOMS.values():
        assert all((mutants.ROOT / part).exists() for part in (*sources, *tests))
