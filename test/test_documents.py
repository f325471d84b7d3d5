"""Tests of the documents: every command in them runs, every link resolves, and every table matches the code."""
import importlib.util
import re
import shlex
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest
from processes import Forked
from properties import thinned
from shapely import LineString

import dragon_ros as dr
from dragon_ros.__main__ import EXECUTABLES, NODES, main
from dragon_ros.cli.dds_domain import free_domain, local_environment
from dragon_ros.core.model import compile_scene

pytest.importorskip('dragon_contest', reason='the documents also describe the packages beside dragon_ros')
pytest.importorskip('dragon_studies', reason='the documents also describe the packages beside dragon_ros')
ROOT = Path(__file__).parents[1]
DOCUMENTS = [*(ROOT / name for name in ('README.md', 'README.zh.md', 'CONTRIBUTING.md')),
             *sorted((ROOT / 'docs').rglob('*.md'))]
# test_translations.py checks that the Chinese pages have the commands and programs of the English ones.
ENGLISH = [path for path in DOCUMENTS if path.parent.name != 'zh' and path.name != 'README.zh.md']
LONGEST_S = 50
CONTEST_ROWS = {0: 'head', 1: 'section 1', 51: 'section 51', 101: 'section 101', 151: 'section 151', 201: 'section 201',
                223: 'tail, rear'}

# Maps the first words of a documented command to the command that runs instead (None if nothing runs) and the reason.
# The longest match is used.
SUBSTITUTES = {
    './dragon demo': (None, 'takes ten seconds and four processes; test/nodes/test_graph.py runs it'),
    './dragon python test/bags/crash.py': (None, 'takes twenty minutes; test/bags/test_crash.py kills a few writers'),
    './dragon python test/soak/soak.py': (None, 'takes an hour'),
    './dragon python test/soak/moved_clock.py': (None, 'takes minutes and requires a C compiler'),
    './dragon python test/soak/backlog.py': (None, 'takes minutes and stops processes'),
    './dragon mutants': (None, 'takes hours'),
    './dragon test': (None, 'would run these tests again'),
    './dragon check': (None, 'would run these tests again'),
    './dragon lock': (None, 'queries the package index; test/test_locks.py checks the locks'),
    './dragon schemas': (None, 'writes to the checkout; test/scenes/test_scene_schema.py checks the schemas'),
    './dragon docs': (None, 'writes to the checkout; a test below checks the tables'),
    './dragon python docs/examples/common_mistakes.py': (None, 'a test below runs it and compares its tables'),
    './dragon python docs/examples/': (None, 'requires a sim; test/nodes/test_examples.py runs it with one'),
    './dragon grade result1.xlsx': ('grade --help', 'requires answer files; test/contest/test_grade.py grades some'),
    './dragon grade class': ('grade --help', "requires a class's files; test/contest/test_grade_files.py has some"),
    './dragon view': ('view --help', 'runs until Ctrl-C; test/commands/test_view.py tests the page'),
    './dragon record --output live.mcap': ('record --help', 'waits for a sim; test/nodes/test_record.py starts one'),
    './dragon sim --scene small.yaml': ('sim --scene small.yaml --set run.stop_s=5 --ros-args -p time_scale:=0.0 '
                                        '-p discovery_s:=0.0', 'a shorter run, which does not take real time'),
    './dragon sim --set': ('sim --set run.stop_s=0.1 --ros-args -p time_scale:=0.0 -p discovery_s:=0.0 -p '
                           'robot_description:=true', 'a shorter run; test/nodes/test_graph.py tests the topics'),
    './dragon sim --scene led': ('sim --scene led --set run.stop_s=0.2 --ros-args -p discovery_s:=0.0',
                                 'waits for commands for an hour; test/nodes/test_led.py sends some'),
    './dragon monitor': ('monitor --help', 'runs until Ctrl-C; test/nodes/test_examples.py publishes handles for it'),
    './dragon table --contest': (None, 'takes half a minute on a busy machine; '
                                'test/contest/test_contest_files.py writes the tables'),
    './dragon simulate --scene small.yaml': ('simulate --scene small.yaml --set run.stop_s=5 --output small.mcap',
                                             'a shorter run'),
    './dragon simulate --scene first_contact': (
        'simulate --scene first_contact --set run.start_s=404 --set run.stop_s=406 --output run.mcap', 'a shorter run'),
    './dragon contact --near-misses': ('contact --scene first_contact --near-misses 0.01 --certificate proof.json',
                                       'a shorter run, whose certificate takes less time to check'),
    './dragon study pitch_map --output': ('study --help', 'takes minutes; test/studies/test_study_command.py runs '
                                          'smaller ones'),
    './dragon study widths.yaml': ('study --help', 'starts workers; the program that follows runs this study'),
    './dragon study tolerances': ('study --help', 'takes hours; test/studies runs smaller ones'),
    'dask': (None, 'runs until Ctrl-C; test/studies/test_cluster.py starts both'),
    './dragon cost --scene': ('cost --scene turning --set dragon.benches=12 --set run.stop_s=2 --budget 0.01 --output '
                              'costs.png', 'a smaller dragon'),
    './dragon cost': ('cost --help', 'takes minutes; test/benchmarks runs a short form of each page'),
    './dragon plan --scene walled.yaml --output walled.pdf': (
        'plan --scene walled.yaml --set dragon.benches=5 --set run.stop_s=5 --output walled.pdf --title "The street"',
        'a smaller dragon and a shorter run'),
    './dragon plan --scene walled.yaml --output area.geojson': (
        'plan --scene walled.yaml --set dragon.benches=5 --set run.stop_s=5 --output area.geojson',
        'a smaller dragon and a shorter run'),
    './dragon plot dragon --scene street --times 60': (
        'plot dragon --scene street --times 60 --dpi 30 --output street.png', 'a smaller picture'),
    './dragon plot dragon --bag small.mcap': ('plot dragon --bag small.mcap --times 5 --dpi 30 --output small.png',
                                              'a smaller picture'),
    './dragon plot dragon --scene dance.yaml': (
        'plot dragon --scene dance.yaml --times 12 --dpi 30 --output dance.png', 'a smaller picture'),
    './dragon plot dragon --scene square --times': (
        'plot dragon --scene square --times 100 --dpi 30 --output square.png', 'a smaller picture'),
    './dragon plan --scene s': ('plan --help', 'like the plans above; test/commands/test_plan.py draws one of them'),
    './dragon plot animation --stop': ('plot animation --start 412 --stop 412.48 --pace 2 --fps 8 --dpi 30 '
                                       '--output run.gif', 'a shorter animation'),
    './dragon plot speeds': ('plot speeds --times 0,60 --dpi 30 --output speeds.png',
                             'a small picture outside docs/pictures'),
    './dragon plot dragon --times 60,240 --dpi': ('plot dragon --times 60 --dpi 30 --output dragon.png',
                                                  'a small picture outside docs/pictures'),
    './dragon plot dragon --scene street --times 67': (
        'plot dragon --scene street --times 67 --around head --dpi 30 --output around.png',
        'a small picture outside docs/pictures'),
    './dragon plot contact --dpi': ('plot contact --dpi 30 --output contact.png',
                                    'a small picture outside docs/pictures'),
    './dragon plot clearance --dpi': ('plot clearance --set run.start_s=400 --dpi 30 --output clearance.png',
                                      'a small picture outside docs/pictures'),
    'python3 test/browser.py': (None, 'requires Chromium; test/commands/test_view.py uses it'),
    'pdftoppm': (None, 'converts pages to pictures'),
    'pip install': (None, 'requires the network'),
    'jupyter lab': (None, 'runs until Ctrl-C; test/test_notebooks.py runs the notebooks'),
    'cd ~/ros2_ws': (None, 'requires ROS 2'),
    'rosdep': (None, 'requires ROS 2'),
    'colcon': (None, 'requires ROS 2; test/test_architecture.py builds with colcon if it is installed'),
    'ros2': (None, 'requires ROS 2; test/nodes/test_launch.py tests the launch files'),
    'export': (None, "sets up the reader's shell; each test has its own domain"),
}

# A shell block and the indented lines below it, or an indented block.
_BLOCK = re.compile(r'^```sh\n(.*?)^```\n(?:\n((?:    [^\n]*\n)+))?|((?:^    [^\n]*\n)+)', re.DOTALL | re.MULTILINE)


def blocks(path):
    """Yield (commands, lines shown below them) of each shell block and of each indented block of commands."""
    text = re.sub(r'^```(?!sh\n)\w+\n.*?^```\n', '', path.read_text(), flags=re.DOTALL | re.MULTILINE)
    for found in _BLOCK.finditer(text):
        fenced, shown, indented = found.groups()
        lines = [line.strip() for line in (fenced or indented).splitlines()]
        commands = [line for line in lines if line and (fenced or line.startswith(('./dragon', 'python3 ')))]
        if commands:
            yield commands, [line.strip() for line in (shown or '').splitlines()]


def planned(command):
    """Return the dragon_ros arguments that run a command, or None to skip it; raise KeyError if it is unknown."""
    bare = ' '.join(shlex.split(command, comments=True))
    for start in sorted(SUBSTITUTES, key=len, reverse=True):
        if bare.startswith(start):
            instead = SUBSTITUTES[start][0]
            return None if instead is None else shlex.split(instead)
    name, *arguments = shlex.split(command, comments=True)
    if name != './dragon':
        raise KeyError(f'{command}: unknown command; add it to SUBSTITUTES with the reason')
    return arguments


def environment_in(folder):
    return {**local_environment(free_domain()), 'ROS_LOG_DIR': str(folder / 'log')}


def run(arguments, folder, program=None):
    """Run an executable, or a program, in a separate process; return its exit code and what it printed."""
    process = Forked(arguments, environment_in(folder), folder, program=program)
    try:
        code = process.wait(LONGEST_S)      # the pipe holds more than these print
    finally:
        process.kill()
    with process.stdout as output:
        return code, output.read()


@pytest.fixture
def command(tmp_path, monkeypatch, capsys):
    """Run a command in the test's folder; only nodes run in their own process."""
    monkeypatch.chdir(tmp_path)

    def run_here(arguments):
        if arguments[0] in EXECUTABLES and EXECUTABLES[arguments[0]].module == NODES:
            return *run(arguments, tmp_path), ''
        try:
            code = main(arguments)
        except SystemExit as end:
            code = end.code
        return code, *capsys.readouterr()
    return run_here


def write_files(path, folder):
    """Write each block of YAML or SVG that begins with a file's name, as the page tells readers to do."""
    named = r'^```(?:yaml\n# |xml\n<!-- )(\w+\.(?:yaml|svg))(?: -->)?\n(.*?)^```'
    for name, text in re.findall(named, path.read_text(), re.DOTALL | re.MULTILINE):
        (folder / name).write_text(text)


# By default, the commands of all pages run, except for those whose commands other tests run in other forms.
ELSEWHERE = ('docs/cost/README.md', 'docs/pictures/README.md', 'docs/grading.md', 'docs/cumcm-2024-a.md',
             'docs/venue.md')


@pytest.mark.parametrize('path', thinned(ENGLISH, lambda path: not any(map(path.match, ELSEWHERE))),
                         ids=lambda path: path.name if path.parent == ROOT else str(path.relative_to(ROOT)))
def test_every_command_of_a_document_runs_and_says_what_is_shown(path, tmp_path, command):
    pytest.importorskip('rclpy')
    write_files(path, tmp_path)
    for commands, shown in blocks(path):
        output = ''
        for line in commands:
            arguments = planned(line)
            if arguments is None:
                continue
            code, out, err = command(arguments)
            output += out + err
            refused = path.name == 'faq.md' and shown
            assert code == (2 if refused else 0), f'{line}\n{output}'
            assert 'Traceback' not in output, output
            for figure in re.findall(r'\d+\.\d{6,}', line.partition('#')[2]):
                assert figure in out, f'{line}\n{output}'
        for line in shown if output else []:
            assert _steady(line) in _steady(output), f'{commands}: {line!r} is not in\n{output}'


def _steady(text):
    """Return a text with durations masked and with single spaces between words."""
    return re.sub(r'\s+', ' ', re.sub(r'in \d+\.\d+ s', 'in S', text))


@pytest.fixture(scope='module')
def venue_page(tmp_path_factory):
    """The folder in which the venue page's commands that create scenes from drawings have been run."""
    folder, page = tmp_path_factory.mktemp('venue'), ROOT / 'docs' / 'venue.md'
    write_files(page, folder)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        for line in (line for commands, _ in blocks(page) for line in commands if '.svg' in line):
            assert main(planned(line)) == 0, line
    return folder


MOVED_M = (100, 20)     # the page states that the street is shifted by this distance


def test_the_drawing_and_the_walls_of_the_venue_page_are_the_scene_street(venue_page):
    shipped, walled, way = map(dr.scene, ('street', venue_page / 'walled.yaml', venue_page / 'way.yaml'))
    times = [0.0, 20.0, 45.0, 70.0, 90.0]       # these times cover all pieces
    expected = dr.compile(shipped).states(times).handles_m
    for drawn in (walled, way):
        moved = dr.compile(drawn).states(times).handles_m - MOVED_M
        np.testing.assert_allclose(moved, expected, rtol=0, atol=1e-8)
        assert [type(piece) for piece in drawn.track.pieces] == [type(piece) for piece in shipped.track.pieces]
        assert drawn.track.pieces[-1].length_m == pytest.approx(shipped.track.pieces[-1].length_m, abs=1e-8)
    assert walled.venue.names == shipped.venue.names
    assert walled.venue.margin_m == shipped.venue.margin_m
    for here, there in zip(walled.venue.obstacles, shipped.venue.obstacles, strict=True):
        np.testing.assert_allclose(np.subtract(here.points_m, MOVED_M), there.points_m, rtol=0, atol=1e-9)


def test_the_drawing_of_the_square_becomes_its_track_within_the_tolerance(venue_page):
    shipped, arcs = (compile_scene(dr.scene(name)).track_line(1e-4) for name in ('square', venue_page / 'arcs.yaml'))
    for one, other in ((shipped, arcs), (arcs, shipped)):
        shared = one[one[:, 0] > 0]     # the drawing also contains the line on which the dragon starts
        assert LineString(other).buffer(0.02 * 1.01).contains(LineString(shared))


# The examples of python.md form one program, which test_api runs.
# The program of studies.md takes as long as all others; by default, test_study_command.py runs a study on a worker.
@pytest.mark.parametrize('path', thinned([path for path in ENGLISH if path.name != 'python.md'],
                                         lambda path: path.name != 'studies.md'), ids=lambda path: path.name)
def test_every_python_program_in_a_document_runs(path, tmp_path):
    write_files(path, tmp_path)
    program = tmp_path / 'program.py'
    for text in re.findall(r'^```python\n(.*?)^```', path.read_text(), re.DOTALL | re.MULTILINE):
        if 'rclpy' in text:
            pytest.importorskip('rclpy')
        program.write_text(text)
        code, output = run([], tmp_path, program)
        assert code == 0, output


def test_every_substitute_stands_for_a_command_of_a_document():
    commands = [' '.join(shlex.split(command, comments=True)) for path in DOCUMENTS
                for lines, _ in blocks(path) for command in lines]
    unused = [start for start in SUBSTITUTES if not any(command.startswith(start) for command in commands)]
    assert not unused
    assert len(commands) > 40


@pytest.mark.parametrize('path', DOCUMENTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_every_link_of_a_document_leads_to_a_file_and_a_heading(path):
    for target in re.findall(r'\]\(([^)\s]+)\)', path.read_text()):
        if '://' in target:
            continue
        name, _, heading = target.partition('#')
        file = path.parent / name if name else path
        assert file.exists(), f'{path.name}: {target}'
        assert not heading or heading in headings(file), f'{path.name}: {target}'


def headings(path):
    """Return the headings of a document in the form used in links."""
    lines = re.findall(r'^#+ (.*)$', path.read_text(), re.MULTILINE)
    return [re.sub(r'[^\w\- ]', '', line.lower()).replace(' ', '-') for line in lines]


def test_every_module_that_a_document_names_exists():
    """A name such as `geometry/near_pairs.py` may omit the folders above it."""
    folders = ('benchmarks', 'docs', 'dragon_contest', 'dragon_ros', 'dragon_studies', 'hard_cases', 'launch',
               'msg_configs', 'test')
    files = ['setup.py', *(path.relative_to(ROOT).as_posix() for folder in folders
                           for path in (ROOT / folder).rglob('*.py'))]
    ends = {name.split('/', n)[-1] for name in files for n in range(name.count('/') + 1)}
    named = [(path.name, name) for path in DOCUMENTS
             for name in re.findall(r'`([\w/]+\.py)\b[^`]*`', path.read_text())]
    assert len(named) > 50
    assert [one for one in named if one[1] not in ends] == []


def test_every_document_can_be_reached_from_the_readme():
    reached, ahead = set(), [ROOT / 'README.md']
    while ahead:
        path = ahead.pop()
        reached.add(path)
        names = re.findall(r'\]\(([^)#\s]+\.md)', path.read_text())
        ahead += [file for name in names if (file := (path.parent / name).resolve()) not in reached]
    assert set(DOCUMENTS) <= reached


def loaded(path):
    """Return a program from the documents as a module."""
    spec = importlib.util.spec_from_file_location(path.stem, path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope='module')
def tables():
    return loaded(ROOT / 'docs' / 'make_tables.py')


MISTAKES = loaded(ROOT / 'docs' / 'examples' / 'common_mistakes.py')


@pytest.mark.parametrize('question', thinned(MISTAKES.QUESTIONS, lambda question: question == '2'))
def test_common_mistakes_give_what_the_contest_page_says(question):
    page = (ROOT / 'docs' / 'cumcm-2024-a.md').read_text()
    found = re.search(rf'<!-- mistakes {question} -->\n(.*?)\n<!-- end -->', page, re.DOTALL)
    assert found
    assert found[1] == MISTAKES.table(MISTAKES.QUESTIONS[question]())


def test_the_contest_page_has_the_positions_of_the_table():
    page = (ROOT / 'docs' / 'cumcm-2024-a.md').read_text()
    motion = dr.compile(dr.scene('winding')).states([60.0 * n for n in range(6)])
    for handle, name in CONTEST_ROWS.items():
        cells = ' | '.join(f'{x + 0.0:.6f}, {y + 0.0:.6f}' for x, y in np.round(motion.handles_m[:, handle], 6))
        speeds = ' | '.join(f'{speed:.6f}' for speed in motion.speed_m_s[:, handle])
        assert f'| {name}: x, y (m) | {cells} |\n| speed (m/s) | {speeds} |' in page


def test_the_tables_of_the_documents_are_those_of_the_code(tables, capsys):
    assert tables.main(['--check']) == 0, capsys.readouterr().out


def test_every_table_stands_in_one_document(tables):
    assert sorted(name for path in tables.DOCUMENTS for name in tables.names_of(path)) == sorted(tables.TABLES)


def test_a_stale_table_is_found_and_renewed(tables, tmp_path, capsys):
    (tmp_path / 'docs').mkdir()
    for path in (*tables.DOCUMENTS, Path(tables.__file__)):
        shutil.copy(path, tmp_path / path.relative_to(ROOT))
    copied, page = loaded(tmp_path / 'docs' / 'make_tables.py'), tmp_path / 'docs' / 'reference.md'
    sys.path.remove(str(tmp_path))
    assert copied.main(['--check']) == 0
    text = page.read_text()
    page.write_text(text.replace('| `winding` |', '| `unwound` |'))
    assert copied.main(['--check']) == 1
    assert capsys.readouterr().out == 'docs/reference.md: stale; run ./dragon docs\n'
    assert copied.main([]) == 0
    assert page.read_text() == text
