"""The offline commands produce the documented output, exit codes, and one-line errors for bad input."""
import argparse
import csv
import io
import json
import os
import shlex
import signal
import subprocess
import sys

import pytest
from properties import thinned

import dragon_ros
from dragon_ros.__main__ import EXECUTABLES, main
from dragon_ros.cli import command_line
from dragon_ros.cli.ranges import handles_of, times_of
from dragon_ros.cli.signals import ending
from dragon_ros.commands import demo, plot


def run(capsys, *arguments):
    try:
        code = main(list(arguments))
    except SystemExit as end:
        code = end.code
    return code, *capsys.readouterr()


def test_table_prints_json_alone_with_the_true_figures(capsys):
    code, out, err = run(capsys, 'table', '--scene', 'winding', '--times', '0,60,300', '--handles', '0,1,51,223',
                         '--format', 'json')
    rows = json.loads(out)
    assert (code, err, len(rows)) == (0, '', 12)
    assert list(rows[0]) == ['t_s', 'handle', 'x_m', 'y_m', 'vx_m_s', 'vy_m_s', 'speed_m_s']
    by_key = {(row['t_s'], row['handle']): row for row in rows}
    assert by_key[0.0, 1]['x_m'] == pytest.approx(8.363823851, abs=1e-9)
    assert by_key[0.0, 1]['y_m'] == pytest.approx(2.826543891, abs=1e-9)
    assert by_key[0.0, 1]['speed_m_s'] == pytest.approx(0.999971038, abs=1e-9)
    assert (by_key[300.0, 223]['x_m'], by_key[300.0, 223]['y_m']) == pytest.approx((1.785033, 9.301164), abs=1e-6)
    assert (by_key[300.0, 0]['x_m'], by_key[300.0, 0]['y_m']) == pytest.approx((4.420274, 2.320429), abs=1e-6)


def test_table_is_not_limited_by_the_run_and_has_all_handles_by_default(capsys):
    code, out, _ = run(capsys, 'table', '--scene', 'first_contact', '--times', '0:2:0.5', '--format', 'csv')
    rows = list(csv.DictReader(io.StringIO(out)))
    assert code == 0
    assert [float(row['t_s']) for row in rows[::224]] == [0, 0.5, 1, 1.5, 2]
    assert len(rows) == 5 * 224


def test_table_as_text_has_a_line_for_each_row(capsys):
    code, out, _ = run(capsys, 'table', '--handles', '0,1')
    assert code == 0
    assert len(out.splitlines()) == 3


def test_contact_prints_json_alone_with_the_true_figures(capsys):
    code, out, err = run(capsys, 'contact', '--scene', 'winding', '--format', 'json')
    found = json.loads(out)
    assert (code, err) == (0, '')
    assert found['t_s'] == pytest.approx(412.4738377, abs=1e-6)
    assert found['benches'] == [0, 8]
    assert found['point_m'] == pytest.approx([1.474395, 2.110665], abs=1e-6)
    assert found['stats']['elapsed_s'] > 0


@pytest.mark.parametrize(('overrides', 'end', 't_end'), [
    (['dragon.benches=1'], 'lock', 432.917924), (['run.stop_s=100'], 'stop', 100.0),
    (['dragon.benches=2', 'track.pitch_m=5', 'track.start_turns=1'], 'track', 16.91522),
])
def test_contact_of_a_scene_without_one_says_how_it_ended(capsys, overrides, end, t_end):
    code, out, _ = run(capsys, 'contact', '--format', 'json', *[a for o in overrides for a in ('--set', o)])
    found = json.loads(out)
    assert (code, found['t_s'], found['end']) == (0, None, end)
    assert found['t_end_s'] == pytest.approx(t_end, abs=1e-4)


def test_near_misses_are_printed_whether_or_not_there_is_a_contact(capsys):
    before = ('--scene', 'first_contact', '--set', 'run.stop_s=412')
    for changes in (before, ('--scene', 'first_contact')):
        code, out, err = run(capsys, 'contact', *changes, '--near-misses', '0.001')
        assert (code, err) == (0, '')
        assert out.startswith('no contact; ' if changes is before else 'first contact at ')
        assert out.splitlines()[1:] == ['  near miss (sampled) of bench 0 and 11: 0.865235 mm at 409.83199 s']
    assert run(capsys, 'contact', *before, '--near-misses', '1e-6')[1].endswith('\n  no near misses (sampled)\n')
    assert 'near miss' not in run(capsys, 'contact', *before)[1]


@pytest.mark.parametrize('overrides', [[], ['head.lead=tail']])
def test_contact_says_that_it_is_proved(capsys, overrides):
    changes = [a for o in ['run.start_s=429', 'run.stop_s=429.5', *overrides] for a in ('--set', o)]
    assert json.loads(run(capsys, 'contact', *changes, '--format', 'json')[1])['certified'] is True
    assert 'without a certificate' not in run(capsys, 'contact', *changes)[1]
    code, out, err = run(capsys, 'contact', *changes, '--near-misses', '0.01', '--format', 'json')
    found = json.loads(out)
    assert (code, err) == (0, '')
    assert len(found['near_misses']) == found['near_misses_count']
    assert all(miss['bench'] == miss['benches'][1] and miss['gap_m'] < 0.01 for miss in found['near_misses'])


@pytest.mark.parametrize('form', ['text', 'csv', 'json'])
def test_output_goes_to_a_file_on_request(capsys, tmp_path, form):
    path = tmp_path / 'out'
    code, out, _ = run(capsys, 'contact', '--set', 'dragon.benches=20', '--format', form, '--output', str(path))
    assert (code, out) == (0, '')
    assert '412.47' in path.read_text()


@pytest.mark.parametrize(('arguments', 'says'), [
    (['table', '--times', '500'], '432.917923'),
    (['table', '--times', 'noon'], '--times'),
    (['table', '--times', '0:10:0'], '--times'),
    (['table', '--times', '-1'], 'times of a scene begin at 0 s'),
    (['table', '--times', 'nan'], 't_s'),
    (['table', '--handles', '224'], '0 to 223'),
    (['table', '--handles', 'head'], '--handles'),
    (['table', '--handles', '0-300'], '0 to 223'),
    (['table', '--handles', '5-1'], 'the stop must not be before the start'),
    (['table', '--times', '0:1e9:1e-3'], 'a larger step'),
    (['table', '--format', 'xlsx'], 'give --output'),
    (['table', '--format', 'csv', '--output', 'x.json'], 'csv conflicts'),
    (['contact', '--output', 'x.xlsx'], 'the formats are text, csv, json'),
    (['contact', '--output', ''], 'argument --output: the path is empty'),
    (['inspect', ''], 'argument BAG: the path is empty'),
    (['contact', '--set', 'dragon.benches', '5'], 'write --set dragon.benches=VALUE, without a space'),
    (['contact', '--set', 'dragon.benches="40"'], 'write 40 without quotes'),
    (['contact', '--scene', 'turning', '--set', 'track.diameter_m=4'], 'give more than 5.75238 m with track.ratio 1'),
    (['inspect'], 'BAG'),
    (['inspect', 'a.mcap', '--bag', 'b.mcap'], 'not allowed with'),
    (['design', 'fit', '--sqare', '3'], 'did you mean --square?; see '),
    (['table', '--accuracy', '1e-16'], 'accuracy'),
    (['table', '--accuracy', 'best'], 'accuracy'),
    (['table', '--output', 'no/such/folder/file'], 'no/such/folder'),
    (['table', '--format', 'xml'], '--format'),
    (['table', '--set', 'track.pitch_m=-0.5'], 'track.pitch_m'),
    (['contact', '--set', 'dragon.benches=0'], 'dragon.benches'),
    (['contact', '--set', 'track.pitch_m=0.01'], 'locked from the start'),
    (['contact', '--scene', 'windin'], 'the scenes are first_contact, led'),
    (['contact', '--set', 'head.speed_m_s=0'], 'run.stop_s'),
    (['contcat'], 'did you mean contact'),
    (['plot', 'dragn'], "'animation'); did you mean dragon?; see "),
    (['design', 'pitch'], 'did you mean min-pitch?'),
    (['table', '--format', 'jsn'], 'did you mean json?'),
    (['contact', '--set', 'track.pitch_m: 0.5'], 'is not KEY=VALUE; write --set track.pitch_m=0.5;'),
    (['contact', '--accuracy', '1mm'], "'1mm' has a unit; write metres alone: --accuracy 0.001;"),
    (['table', '--scene', 'turning', '--times', '-100,-50'], '-100: times of a scene begin at 0 s; the head enters the '
                                                             'turn at 100 s; add the difference'),
    ([], 'usage'),
])
def test_bad_input_exits_with_2_and_a_clear_line(capsys, arguments, says):
    code, out, err = run(capsys, *arguments)
    assert code == 2
    assert says in err + out
    assert 'Traceback' not in err


@pytest.mark.parametrize('program', ['./dragon', 'ros2 run dragon_ros'])
def test_usage_names_the_program_that_was_called(capsys, monkeypatch, program):
    monkeypatch.setenv('DRAGON_PROGRAM', program)
    assert run(capsys, 'contact', '--help')[1].startswith(f'usage: {program} contact [-h]')
    assert run(capsys, 'plot', 'dragon', '--help')[1].startswith(f'usage: {program} plot dragon [-h]')
    assert run(capsys, 'plot', 'dragon', '--dpi', 'x')[2].endswith(f'; see {program} plot dragon --help\n')


def test_a_value_may_begin_with_a_negative_number(capsys, tmp_path):
    assert run(capsys, 'plot', 'dragon', '--around', '-3,2', '--output', str(tmp_path / 'a.png'))[0] == 0


@pytest.mark.parametrize('name', [*EXECUTABLES, *(f'plot {kind}' for kind in plot._KINDS)])
def test_the_example_in_the_help_of_every_executable_is_understood(capsys, monkeypatch, name):
    """Do everything but the command's work, to show that the parsed command is accepted."""
    monkeypatch.setattr(command_line, 'guarded', lambda name, body: 0)
    if EXECUTABLES[name.split()[0]].module.startswith('dragon_ros.nodes'):
        pytest.importorskip('rclpy')
        from dragon_ros.nodes import shell
        monkeypatch.setattr(shell, 'run', lambda name, argv, body, json: 0)
    code, out, _ = run(capsys, *name.split(), '--help')
    assert code == 0
    program, example = shlex.split(out.split('example: ')[1]), shlex.split(command_line.program())
    assert program[:len(example)] == example
    example = program[len(example):]
    assert ' '.join(example).startswith(name)
    handlers = {number: signal.getsignal(number) for number in (signal.SIGTERM, signal.SIGHUP)}
    assert run(capsys, *example) == (0, '', '')
    for number, handler in handlers.items():
        signal.signal(number, handler)


@pytest.mark.parametrize(('suffix', 'begins'), [
    ('.csv', b't_s,handle'), ('.json', b'[{"t_s"'), ('.txt', b'         t_s'), ('.xlsx', b'PK'),
    ('', b'         t_s')])
def test_the_suffix_of_the_output_chooses_the_format_of_a_table(capsys, tmp_path, suffix, begins):
    path = tmp_path / f'out{suffix}'
    assert run(capsys, 'table', '--handles', '0', '--output', str(path))[0] == 0
    assert path.read_bytes().startswith(begins)


@pytest.mark.parametrize(('suffix', 'form', 'code'), [
    ('.pdf', None, 2), ('.table', None, 2), ('.pdf', 'csv', 2), ('.table', 'csv', 0)])
def test_a_suffix_of_no_format_is_refused_unless_the_format_is_given(capsys, tmp_path, suffix, form, code):
    path = tmp_path / f'out{suffix}'
    chosen = ['--format', form] if form else []
    given, _, err = run(capsys, 'table', '--handles', '0', *chosen, '--output', str(path))
    assert given == code
    assert path.exists() == (code == 0)
    assert code == 0 or f'{suffix[1:]} is not supported here; the formats are text, csv, json, xlsx' in err


def test_a_workbook_holds_the_rows_of_the_table(capsys, tmp_path):
    openpyxl = pytest.importorskip('openpyxl')
    path = tmp_path / 'table.xlsx'
    assert run(capsys, 'table', '--times', '0-2', '--handles', '0,222-223', '--output', str(path))[0] == 0
    rows = list(openpyxl.load_workbook(path).active.values)
    assert rows[0] == ('t_s', 'handle', 'x_m', 'y_m', 'vx_m_s', 'vy_m_s', 'speed_m_s')
    assert [row[:2] for row in rows[1:]] == [(t_s, handle) for t_s in (0, 1, 2) for handle in (0, 222, 223)]
    assert rows[1][2] == 8.8


@pytest.mark.parametrize(('text', 'values'), [
    ('3', [3]), ('0-3', [0, 1, 2, 3]), ('0:6:2', [0, 2, 4, 6]), ('0:2', [0, 1, 2]), ('7,0-1,0:4:4', [7, 0, 1, 0, 4])])
def test_times_and_handles_take_the_same_ranges(text, values):
    assert handles_of(text, 10) == times_of(text) == values


def test_a_small_number_with_an_exponent_is_no_range():
    assert times_of('1e-3,2.5') == [0.001, 2.5]


@pytest.mark.parametrize('words', [['help'], ['--help'], ['help', 'contact'], ['contact', '--help']])
def test_help_can_be_asked_for_as_a_command(capsys, words):
    code, out, err = run(capsys, *words)
    assert (code, err) == (0, '')
    assert 'usage' in out


@pytest.mark.parametrize('word', ['--version', '-V'])
def test_the_version_is_printed(capsys, word):
    assert run(capsys, word) == (0, f'dragon_ros {dragon_ros.__version__}\n', '')


@pytest.mark.parametrize(('argv0', 'checkout', 'program'), [
    ('/ws/install/dragon_ros/lib/dragon_ros/table', None, 'ros2 run dragon_ros'), ('/usr/bin/dragon', None, 'dragon'),
    ('/x/dragon_ros/__main__.py', None, 'python -m dragon_ros'), ('/x/__main__.py', './dragon', './dragon')])
def test_examples_begin_with_what_the_reader_has_typed(monkeypatch, argv0, checkout, program):
    monkeypatch.setattr(sys, 'argv', [argv0])
    monkeypatch.delenv('DRAGON_PROGRAM', raising=False)
    if checkout:
        monkeypatch.setenv('DRAGON_PROGRAM', checkout)
    assert command_line.program() == program


def test_help_of_any_executable_imports_the_standard_library_alone():
    asked = [['--help'], *([name, '--help'] for name in EXECUTABLES)]
    code = ('import contextlib, sys\nbefore = set(sys.modules)\nfrom dragon_ros.__main__ import main\n'
            f'from dragon_ros.guests import GUESTS\nfor arguments in {asked}:\n'
            '    with contextlib.suppress(SystemExit), contextlib.redirect_stdout(None): main(arguments)\n'
            '    new = {name.partition(".")[0] for name in set(sys.modules) - before} - sys.stdlib_module_names\n'
            '    heavy = {"dataclasses", "asyncio", "email"} & set(sys.modules)\n'
            '    own = {"dragon_ros", *(guest.module.partition(".")[0] for guest in GUESTS.values())}\n'
            '    if (new | heavy) - own: print(*arguments, "imports", *(new | heavy) - own)')
    done = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, check=True)
    assert done.stdout == ''


BAG = 'numpy yaml mcap zstandard lz4'
# The HEAVY modules and the rooms that the simplest use of each command may import, so that it starts quickly.
NEEDS = {
    'table --times 60 --handles 0': ('numpy yaml', ''),
    'contact --set run.stop_s=1': ('numpy yaml', 'core.enclosures core.search'),
    'design turn': ('numpy yaml', ''),
    'simulate --force --set run.stop_s=0.1 --output OUT.mcap': ('numpy yaml mcap zstandard subprocess', 'messages'),
    'table BAG': (BAG, 'messages'),
    'export BAG --output OUT.csv': (BAG, 'messages'),
    'inspect BAG': (BAG, 'messages core.enclosures core.search'),
    # This command imports shapely to mark overlaps.
    'plot dragon --set dragon.benches=3 --output OUT.png': ('numpy numpy.ma yaml shapely matplotlib subprocess', ''),
}
ROOMS = {'messages', 'core.enclosures', 'core.search', 'core.effects', 'nodes'}
HEAVY = {'numpy', 'numpy.ma', 'yaml', 'mcap', 'zstandard', 'lz4', 'shapely', 'matplotlib', 'scipy', 'pyarrow', 'dask',
         'tqdm', 'openpyxl', 'argcomplete', 'rclpy', 'flint', 'subprocess', 'asyncio', 'email', 'importlib.metadata'}


# The others, which run with --long, need what some of these need.
USUAL = 'contact', 'simulate', 'export', 'inspect', 'plot'


@pytest.mark.parametrize('line', thinned(NEEDS, lambda line: line.startswith(USUAL)),
                         ids=lambda line: ' '.join(line.split()[:2]))
def test_a_command_imports_what_it_needs_and_no_more(tmp_path, line):
    bag = tmp_path / 'run.mcap'
    if 'BAG' in line:
        assert main(['simulate', '--set', 'run.stop_s=0.1', '--output', str(bag)]) == 0
    words = line.replace('BAG', str(bag)).replace('OUT', str(tmp_path / 'out')).split()
    code = ('import contextlib, sys\nbefore = set(sys.modules)\nimport numpy\nprint(*set(sys.modules) - {"numpy"})\n'
            'from dragon_ros.__main__ import main\n'
            f'with contextlib.redirect_stdout(None): assert main({words}) == 0\nprint(*set(sys.modules) - before)')
    done = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, check=True)
    brought, new = (set(line.split()) for line in done.stdout.splitlines())     # numpy 1 itself imports numpy.ma
    parts = {name.removeprefix('dragon_ros.').rpartition('.')[0] for name in new if name.startswith('dragon_ros.')}
    libraries, rooms = NEEDS[line]
    assert new & HEAVY - brought == set(libraries.split()) - brought
    assert parts & ROOMS == set(rooms.split())


def parsers(name):
    """Return the parsers of an executable and its subcommands."""
    found = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(command_line.Parser, 'print_help', lambda parser: found.append(parser))
        with pytest.raises(SystemExit):
            main([name, '--help'])
    below = [child for action in found[0]._actions if isinstance(action, argparse._SubParsersAction)
             for child in action.choices.values()]
    return [*found, *below]


@pytest.mark.parametrize('name', EXECUTABLES)
def test_the_defaults_that_help_names_are_those_of_the_code(name):
    for parser in parsers(name):
        for action in parser._actions:
            said = action.help or ''
            if action.default not in (None, False, 0, argparse.SUPPRESS) and action.default != []:
                assert '(%(default)' in said, f'{parser.prog} {action.dest}: {said}'
            elif action.default != 0:       # the text in brackets at the end is not the parser's default
                assert '%(default)' not in said


@pytest.mark.parametrize(('question', 'scene'), [('turn', 'turning'), ('max-speed', 'turning'), ('fit', 'winding')])
def test_a_design_question_names_the_scene_that_it_takes(capsys, question, scene):
    assert f'name or file of the scene ({scene})' in ' '.join(run(capsys, 'design', question, '--help')[1].split())


def test_design_gives_the_length_of_the_turn_and_the_largest_speed(capsys):
    code, out, _ = run(capsys, 'design', 'turn')
    assert code == 0
    assert out.startswith('the turn is 13.6212449068 m long')
    code, out, _ = run(capsys, 'design', 'turn', '--contact', '--set', 'dragon.benches=12')
    assert 'no benches touch until the whole dragon has left the turn' in out
    code, out, _ = run(capsys, 'design', 'max-speed', '--format', 'json')
    values = json.loads(out)
    assert (code, values['handle']) == (0, 3)
    assert values['speed_m_s'] == pytest.approx(1.2462663582, abs=1e-10)



@pytest.mark.parametrize(('arguments', 'says'), [
    (['turn', '--scene', 'winding'], 'track has no S-turn'), (['max-speed', '--scene', 'winding'], 'run.stop_s'),
    (['max-speed', '--limit', '-1'], '--limit'), (['fast'], 'invalid choice'), ([], 'required')])
def test_a_design_question_without_an_answer_is_reported(capsys, arguments, says):
    code, out, err = run(capsys, 'design', *arguments)
    assert code == 2
    assert says in err + out


def test_a_closed_pipe_is_no_traceback():
    command = f'{sys.executable} -m dragon_ros table --times 0:100:1 | head -n 1'
    done = subprocess.run(command, shell=True, capture_output=True, text=True, check=True)
    assert done.stderr == ''


@pytest.mark.parametrize('name', ['sim', 'monitor'])
def test_help_comes_before_anything_slow_is_imported(name):
    code = ('import sys\nfrom dragon_ros.__main__ import main\n'
            f'try:\n    main([{name!r}, "--help"])\nexcept SystemExit as end:\n    print(end.code)\n'
            'print([slow for slow in ("rclpy", "numpy", "shapely", "matplotlib") if slow in sys.modules])')
    done = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-2:] == ['0', '[]']


def test_a_signal_that_ends_the_demo_waits_until_a_started_process_is_noted():
    noted = []
    before = {number: signal.getsignal(number) for number in ending()}

    def start():
        with demo._later():
            os.kill(os.getpid(), signal.SIGTERM)
            noted.append('a process')

    with pytest.raises(KeyboardInterrupt):
        start()
    assert noted
    assert {number: signal.getsignal(number) for number in ending()} == before


@pytest.mark.parametrize('name', thinned(['sim', 'monitor', 'record', 'replay'], lambda name: name == 'replay'))
def test_without_ros_a_node_says_so_in_one_line(name):
    program = (f"import sys; sys.modules['rclpy'] = None\nfrom dragon_ros.__main__ import main\n"
               f"sys.exit(main(['{name}', *(['a.mcap'] if '{name}' == 'replay' else [])]))")
    done = subprocess.run([sys.executable, '-c', program], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (2, '')
    assert done.stderr.startswith(f'{name}: rclpy is not installed, and nodes need ROS 2')
    assert done.stderr.count('\n') == 1
