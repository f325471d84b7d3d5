"""Architecture tests: a room imports only from rooms below it; executables, packaging, lint and types are checked."""
import ast
import os
import runpy
import shutil
import subprocess
import sys
import zipfile
from functools import cache
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from xml.etree import ElementTree

import pytest

import dragon_ros
from dragon_ros.__main__ import EXECUTABLES
from dragon_ros.guests import GUESTS as OPTIONAL

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / 'dragon_ros'
# Each room and the rooms that it may import besides itself; rooms that do not exist yet are skipped.
BELOW_NODES = ('core', 'version', 'configuration', 'guests', 'scenes', 'messages', 'bags', 'cli')
# Packages beside it, and their libraries.
GUESTS = {'dragon_contest': {'numpy', 'openpyxl', 'python_calamine', 'PIL'},
          'dragon_studies': {'numpy', 'scipy', 'yaml', 'pyarrow', 'matplotlib', 'distributed'}}
ROOMS = {**{room: BELOW_NODES[:rank] for rank, room in enumerate(BELOW_NODES)},
         'pictures': BELOW_NODES, 'api': (*BELOW_NODES, 'pictures'), 'commands': (*BELOW_NODES, 'pictures', 'api'),
         'nodes': BELOW_NODES, 'cost': BELOW_NODES, 'verify': ()}
# These commands are written on the public API and the parts of command lines, some of them with other rooms.
OF_PLAN = dict.fromkeys(('plan', 'plan_contents', 'plan_pages', 'plan_together'), ('commands', 'pictures', 'scenes'))
THIN = {'contact': (), 'demo': ('pictures',), 'design': (), 'export': (), 'inspect': (), 'plot': ('pictures',),
        'simulate': (), 'table': (), **OF_PLAN}
STARTS = {'commands': {'verify', 'nodes.read_path'}, 'scenes': {'verify'}}     # these modules are started as processes
# The rooms and single modules of the core, and the parts of the core that each may import besides itself.
VALUES = ('errors', 'checks', 'domain', 'flags', 'words')
CHAIN = ('errors', 'checks', 'domain', 'numerics', 'tracks', 'chain')
MODEL = (*VALUES, *CHAIN, 'venue', 'promise', 'scene', 'shift_map', 'paper', 'model')
CORE_ROOMS = {
    'errors': (), 'limits': (), 'numerics': (), 'words': (), 'checks': ('errors',),
    'domain': ('errors', 'checks'), 'flags': ('errors', 'checks', 'domain'),
    'venue': ('errors', 'checks', 'domain', 'limits', 'words'),
    'tracks': ('limits', *CHAIN[:4]), 'chain': CHAIN[:5], 'promise': ('errors',),
    'scene': (*VALUES, 'promise', 'tracks', 'chain', 'venue'),
    'paper': CHAIN, 'shift_map': CHAIN, 'model': MODEL[:-1], 'geometry': (*CHAIN, 'venue', 'limits'),
    'enclosures': (*CHAIN, 'geometry'), 'search': (*MODEL, 'geometry', 'enclosures'),
    'effects': (*MODEL, 'geometry'), 'step': (*MODEL, 'geometry', 'effects'),
    'batches': (*MODEL, 'geometry', 'effects', 'step')}
# A scene may import only value types from these rooms.
OF_SCENE = {'chain': {'commanded', 'dragon', 'head_law'}, 'tracks': {'spec'}}
LIBRARIES = {'core': {'numpy', 'shapely'}, 'version': set(), 'configuration': set(),
             'scenes': {'numpy', 'yaml', 'shapely', 'pyproj', 'svgelements'}, 'messages': {'numpy'},
             'bags': {'numpy', 'mcap', 'yaml', 'zstandard', 'lz4', 'pyarrow'},
             'cli': {'argcomplete', 'matplotlib', 'openpyxl', 'tqdm'},
             'pictures': {'numpy', 'matplotlib', 'PIL', 'shapely'}, 'api': {'numpy', 'matplotlib', 'pandas'},
             'commands': {'numpy', 'matplotlib', 'tqdm', 'shapely'},
             'verify': {'flint'}, 'cost': {'numpy', 'matplotlib', 'mpmath'}}
# Folders that exist only in a checkout, and the other folders that each of them may import.
BESIDE = {'hard_cases': {'hard_cases'}, 'benchmarks': {'benchmarks', 'hard_cases'}}


# The one file that may use private names of other packages, and public names of NamedTuple that look private.
INTERNALS = PACKAGE / 'nodes/rclpy_internals.py'
OF_TUPLES = {'_replace', '_fields', '_asdict', '_make', '_field_defaults'}


@cache
def read(path):
    """Return the modules that a file imports, and the names of the package in its imports and strings.

    Imports for types and inside functions count as well, and so do strings such as the argument of ``import_module``.
    The bare name of the package does not count, because it is also the name of a folder, a record and a logger.
    """
    imported, found = [], set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom):
            assert node.level == 0, f'{path}: relative import'
            imported.append(node.module)
            found |= {node.module, *(f'{node.module}.{name.name}' for name in node.names)}
        elif isinstance(node, ast.Import):
            imported += (name.name for name in node.names)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and '.' in node.value:
            found.add(node.value)
    return imported, {name for name in (*imported, *found) if name.startswith('dragon_ros.')}


def imports(path):
    return read(path)[0]


def named(path):
    return read(path)[1]


def libraries(path):
    """Return the top-level names of the modules that a file imports."""
    return {name.split('.')[0] for name in imports(path)}


def upward(room, path):
    """Return the modules to which a module of a room refers although their rooms are not below this room."""
    below = {room, *ROOMS[room], *STARTS.get(room, ())}
    return {name for name in named(path) if (part := name.split('.')[1]) in ROOMS and part not in below
            and name.removeprefix('dragon_ros.') not in below}


def upward_in_core(room, path):
    """Return the core modules to which a module of a core room refers although their rooms are not below this room."""
    found = set()
    for name in named(path):
        _, top, part, module = [*name.split('.'), '', ''][:4]
        if top != 'core' or part == room or part not in CORE_ROOMS:
            continue
        values = OF_SCENE.get(part) if room == 'scene' else None
        if part not in CORE_ROOMS[room] or (values and module not in {'', *values}):
            found.add(name)
    return found


def modules(folder, rooms):
    """Return (room, file) for every module of these rooms; a room is a folder or a single file."""
    return [(room, path) for room in rooms
            for path in (*sorted((folder / room).rglob('*.py')), *folder.glob(f'{room}.py'))]


MODULES = modules(PACKAGE, ROOMS)


@pytest.mark.parametrize('room', ROOMS)
def test_imports_point_down(room):
    for path in (path for owner, path in MODULES if owner == room):
        assert upward(room, path) == set(), path
        for name in imports(path):
            top, *rest = name.split('.')
            if top == 'dragon_ros' and rest:
                assert rest[0] in (room, *ROOMS[room]), f'{path} imports {name}'
            elif top != 'dragon_ros' and room in LIBRARIES:
                assert top in LIBRARIES[room] or top in sys.stdlib_module_names, f'{path} imports {name}'


def test_the_package_imports_nothing_that_an_install_lacks():
    lacking = {*BESIDE, 'test'}
    assert {path: used for path in PACKAGE.rglob('*.py') if (used := libraries(path) & lacking)} == {}


def test_the_package_names_the_packages_beside_it_in_one_list_alone():
    files = {path for path in PACKAGE.rglob('*.py') if any(name in path.read_text() for name in GUESTS)}
    assert files == {PACKAGE / 'guests.py'}


@pytest.mark.parametrize('guest', GUESTS)
def test_a_package_beside_it_uses_the_public_api_and_the_parts_of_command_lines_alone(guest):
    """It writes ``import dragon_ros``, so that it has public names only, and imports from ``dragon_ros.cli``."""
    for path in (ROOT / guest).rglob('*.py'):
        for name in imports(path):
            assert name == 'dragon_ros' or name.startswith((guest, 'dragon_ros.cli')) or (
                name.split('.')[0] in GUESTS[guest] | sys.stdlib_module_names), f'{path} imports {name}'
        used = {node.attr for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.Attribute)
                and isinstance(node.value, ast.Name) and node.value.id == 'dr'}
        assert used <= {*dragon_ros.__all__, '__version__'}, path


@pytest.mark.parametrize('command', THIN)
def test_a_command_is_written_on_the_public_api(command):
    """It imports ``dragon_ros`` for the public names, and the parts of command lines."""
    path = PACKAGE / 'commands' / f'{command}.py'
    rooms = ('cli', 'guests', *THIN[command])
    for name in imports(path):
        assert not name.startswith('dragon_ros.') or name.startswith(tuple(f'dragon_ros.{room}' for room in rooms)) or (
            name in ('dragon_ros.commands.opened', 'dragon_ros.commands.view.page')), f'{path} imports {name}'


WITHOUT_GUESTS = """
import importlib, pkgutil, sys
import dragon_ros
from dragon_ros.__main__ import EXECUTABLES, main
from dragon_ros.guests import GUESTS
assert not [name for name in GUESTS if name in EXECUTABLES], EXECUTABLES
assert main(['table', '--times', '0', '--handles', '0']) == 0
for name in GUESTS:
    try:
        code = main([*name.split(), 'a'])
    except SystemExit as end:
        code = end.code
    assert code == 2, name
"""


def test_without_the_packages_beside_it_their_commands_are_absent_and_the_others_work(tmp_path):
    shutil.copytree(PACKAGE, tmp_path / 'dragon_ros', ignore=shutil.ignore_patterns('__pycache__'))
    shutil.copytree(ROOT / 'msg_configs', tmp_path / 'msg_configs')
    done = subprocess.run([sys.executable, '-S', '-c', f'import sys; sys.path = ["."] + {alone()!r}\n{WITHOUT_GUESTS}'],
                          cwd=tmp_path, env=os.environ | NO_BYTECODE, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout.count('\n')) == (0, 2), done.stderr
    assert 'Traceback' not in done.stderr


def all_there():
    """Skip a test of the whole installation if a package beside dragon_ros is missing."""
    for guest in GUESTS:
        pytest.importorskip(guest)


def alone():
    """Return the path of modules without this checkout."""
    return [one for one in sys.path if one and ROOT not in (Path(one).resolve(), Path(one).resolve().parent)]


@pytest.mark.parametrize('folder', BESIDE)
def test_hard_cases_import_nothing_of_the_benchmarks_and_both_nothing_of_the_tests(folder):
    others = {*BESIDE, *(path.stem for path in (ROOT / 'test').rglob('*.py'))} - BESIDE[folder]
    assert {path: used for path in (ROOT / folder).glob('*.py') if (used := libraries(path) & others)} == {}


@pytest.mark.parametrize('room', CORE_ROOMS)
def test_imports_point_down_inside_the_core(room):
    for _, path in modules(PACKAGE / 'core', [room]):
        assert upward_in_core(room, path) == set(), path


def test_every_room_is_in_the_table():
    top = {path.parent.name for path in PACKAGE.glob('*/__init__.py')}
    assert top <= set(ROOMS)
    core = {path.stem if path.name != '__init__.py' else path.parent.name for path in (
        *(PACKAGE / 'core').glob('*.py'), *(PACKAGE / 'core').glob('*/__init__.py'))}
    assert core - {'core'} == set(CORE_ROOMS)


PLANTED = ['import {}', 'from {} import anything', 'def later():\n    import {}',
           'from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from {} import anything',
           'from importlib import import_module\nimport_module("{}")',
           'from importlib import import_module\nimport_module(f"{}.{{name}}")']


def not_found(folder, other, upward_of):
    """Plant every form of import of a module in a file, and return the forms that are not detected."""
    files = {folder / f'planted_{number}.py': how.format(f'dragon_ros.{other}') for number, how in enumerate(PLANTED)}
    for path, code in files.items():
        path.write_text(code)
    return [code for path, code in files.items() if not upward_of(path)]


@pytest.mark.parametrize(('room', 'other'), [
    ('flags', 'geometry.signed_distance'), ('tracks', 'chain.chain'), ('chain', 'shift_map.table'),
    ('shift_map', 'model'), ('scene', 'model'), ('scene', 'chain.chain'), ('scene', 'tracks.spiral'),
    ('geometry', 'step'), ('enclosures', 'model'), ('model', 'search.first_contact'),
    ('effects', 'step'), ('step', 'batches'), ('search', 'step'), ('errors', 'checks'), ('paper', 'shift_map.blocks'),
    ('promise', 'chain.chain'), ('limits', 'errors')])
def test_a_planted_upward_import_inside_the_core_is_found(tmp_path, room, other):
    assert not_found(tmp_path, f'core.{other}', lambda path: upward_in_core(room, path)) == []


@pytest.mark.parametrize(('room', 'other'), [
    ('core', 'scenes.load'), ('scenes', 'messages.cdr'), ('messages', 'bags.read.reader'), ('bags', 'cli.figures'),
    ('cli', 'commands.table'), ('commands', 'nodes.sim'), ('nodes', 'commands.table'),
    ('cost', 'nodes.sim'), ('verify', 'core.errors'), ('api', 'commands.table'), ('pictures', 'api.bag'),
    ('bags', 'api.bag')])
def test_a_planted_upward_import_is_found(tmp_path, room, other):
    assert not_found(tmp_path, other, lambda path: upward(room, path)) == []


def test_what_the_core_may_import_has_no_circle():
    rest = dict(CORE_ROOMS)
    while leaves := {room for room, below in rest.items() if not set(below) & set(rest)}:
        rest = {room: below for room, below in rest.items() if room not in leaves}
    assert rest == {}


def mentioned(path, known):
    """Return the known modules that a file names in imports or strings, anywhere in its code.

    A string that ends in a dot, such as a prefix for ``import_module``, names all modules with this prefix.
    """
    found = named(path)
    return {name for one in found if one.endswith('.') for name in known if name.startswith(one)} | found & known


def test_modules_are_seen_in_imports_for_types_in_functions_and_in_strings(tmp_path):
    path = tmp_path / 'module.py'
    path.write_text('from typing import TYPE_CHECKING\n'
                    'if TYPE_CHECKING:\n    from dragon_ros.core.scene import Scene\n'
                    'def load(name):\n    from dragon_ros.core import model\n'
                    '    import_module("dragon_ros.core.step")\n'
                    '    return import_module(f"dragon_ros.core.effects.{name}")\n')
    names = ('scene', 'model', 'step', 'effects.noise', 'effects.health', 'paper')
    core = {f'dragon_ros.core.{name}' for name in names}
    assert mentioned(path, core) == core - {'dragon_ros.core.paper'}


def test_there_is_no_import_cycle():
    paths = {'.'.join(path.relative_to(ROOT).with_suffix('').parts): path for path in PACKAGE.rglob('*.py')
             if path.name != '__init__.py'}
    paths['dragon_ros'] = PACKAGE / '__init__.py'
    rest = {name: mentioned(path, set(paths)) - {name} for name, path in paths.items()}
    while leaves := {name for name, wants in rest.items() if not wants & set(rest)}:
        rest = {name: wants for name, wants in rest.items() if name not in leaves}
    assert sorted(rest) == []


@pytest.mark.parametrize(('library', 'module'), [('argcomplete', 'completion.py'), ('matplotlib', 'figures.py')])
def test_only_one_module_below_the_commands_imports_a_library_of_the_screen(library, module):
    users = {path.name for room, path in MODULES if room in BELOW_NODES and library in libraries(path)}
    assert users == {module}


def test_the_core_runs_where_there_is_no_ros():
    code = ('import sys\nfor name in ("rclpy", "yaml", "mcap", "matplotlib"): sys.modules[name] = None\n'
            'from dragon_ros.core.scene import Scene\nfrom dragon_ros.core.step import tick\n'
            'from dragon_ros.core.search.first_contact import first_contact\n'
            'print(len(tick(Scene(), 0).chain.p), first_contact(Scene()).benches)')
    done = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ['224', '(0,', '8)']


def test_scripts_are_the_executables_and_all_the_same():
    scripts = {path.name: path.read_text() for path in (ROOT / 'scripts').iterdir()}
    assert set(scripts) - set(OPTIONAL) == set(EXECUTABLES) - set(OPTIONAL)
    assert set(EXECUTABLES) <= set(scripts)
    assert len(set(scripts.values())) == 1
    assert all(os.access(ROOT / 'scripts' / name, os.X_OK) for name in scripts)


def test_package_xml_setup_py_and_code_agree():
    tree = ElementTree.parse(ROOT / 'package.xml').getroot()
    assert tree.attrib['format'] == '3'
    assert tree.findtext('version') == dragon_ros.__version__
    assert f"version='{dragon_ros.__version__}'" in (ROOT / 'setup.py').read_text()
    assert f'## {dragon_ros.__version__}' in (ROOT / 'CHANGELOG.md').read_text()
    declared = {node.text for node in tree if node.tag.endswith('depend')}
    used = {name.split('.')[0] for path in PACKAGE.rglob('*.py') for name in imports(path)}
    ros = {name for name in used if name == 'rclpy' or name.endswith(('_msgs', '_srvs', '_interfaces'))}
    assert ros <= declared
    assert {f'python3-{name}' for name in used & {'numpy', 'shapely', 'matplotlib', 'tqdm', 'argcomplete'}} <= declared


def copy_source(target):
    """Copy the files of the package that a fresh checkout has, and return the copy."""
    target.mkdir(parents=True)
    for name in ('package.xml', 'setup.py', 'setup.cfg', 'pyproject.toml', 'README.md', 'LICENSE'):
        shutil.copy(ROOT / name, target)
    for name in ('dragon_ros', *GUESTS, 'benchmarks', 'hard_cases', 'launch', 'msg_configs', 'resource', 'scripts',
                 'test'):
        shutil.copytree(ROOT / name, target / name, symlinks=True, ignore=shutil.ignore_patterns('__pycache__'))
    return target


NO_BYTECODE = {'PYTHONDONTWRITEBYTECODE': '1'}      # the environment of a copy, which is used only once


def installed_names(prefix):
    return {path.name for path in (prefix / 'lib' / 'dragon_ros').iterdir()}


def test_a_wheel_puts_executables_in_lib_alone_and_carries_every_config(tmp_path):
    all_there()
    source = copy_source(tmp_path / 'source')
    # This is what pip runs, in one process instead of three.
    build = 'import sys; from setuptools import build_meta; build_meta.build_wheel(sys.argv[1])'
    subprocess.run([sys.executable, '-c', build, tmp_path], cwd=source, env=os.environ | NO_BYTECODE, check=True,
                   capture_output=True)
    (wheel,) = tmp_path.glob('*.whl')
    names = zipfile.ZipFile(wheel).namelist()
    assert not [name for name in names if '/scripts/' in name]
    (points,) = [zipfile.ZipFile(wheel).read(name).decode() for name in names if name.endswith('entry_points.txt')]
    assert points.split() == ['[console_scripts]', 'dragon', '=', 'dragon_ros.__main__:dragon']
    data = [name.split('.data/data/')[1] for name in names if '.data/data/' in name]
    assert {name.split('/')[-1] for name in data if name.startswith('lib/dragon_ros/')} == set(EXECUTABLES)
    configs = {path.relative_to(ROOT).as_posix() for path in (ROOT / 'msg_configs').rglob('*')
               if path.is_file() and path.suffix not in ('.py', '.pyc')}
    assert {name.removeprefix('share/dragon_ros/') for name in data if '/msg_configs/' in name} == configs
    assert 'share/ament_index/resource_index/packages/dragon_ros' in data
    assert 'share/dragon_ros/launch/dragon.launch.py' in data
    web = {path.relative_to(ROOT).as_posix() for path in (PACKAGE / 'commands' / 'view' / 'web').iterdir()}
    assert web <= set(names)
    assert {'dragon_contest/grade/report.css', 'dragon_contest/paper_tables.json'} <= set(names)
    packages = {path.parent.relative_to(ROOT).as_posix() for name in ('dragon_ros', *GUESTS)
                for path in (ROOT / name).rglob('*.py')}
    modules = [name for name in names if name.split('/')[0] in ('dragon_ros', *GUESTS) and name.endswith('.py')]
    assert packages == {name.rpartition('/')[0] for name in modules}
    assert not [name for name in names if name.startswith(tuple(BESIDE))]


@pytest.mark.skipif(not find_spec('colcon_core'), reason='colcon is not installed here')
@pytest.mark.long       # by default, the test above checks what setup.py installs, and where
@pytest.mark.parametrize('options', [[], ['--symlink-install']], ids=['install', 'symlink'])
def test_colcon_builds_a_package_whose_executables_run_from_lib(tmp_path, options):
    workspace = tmp_path / 'ws'
    copy_source(workspace / 'src' / 'dragon_ros')
    environment = {key: value for key, value in os.environ.items() if key != 'PYTHONPATH'} | NO_BYTECODE
    subprocess.run([sys.executable, '-m', 'colcon', 'build', *options], cwd=workspace, env=environment, check=True,
                   capture_output=True)
    prefix = workspace / 'install' / 'dragon_ros'
    assert installed_names(prefix) == {*EXECUTABLES, 'dragon'}
    assert not (prefix / 'bin').exists()
    assert (prefix / 'share/ament_index/resource_index/packages/dragon_ros').exists()
    script = '. "$1/install/setup.sh" && cd / && "$2/lib/dragon_ros/contact" --set dragon.benches=20 && python3 -c ' \
             '"from dragon_ros.commands.view.server import WEB; print(*(each.name for each in WEB.iterdir()))"'
    done = subprocess.run(['sh', '-c', script, 'sh', workspace, prefix], env=environment, capture_output=True,
                          text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert '412.4738' in done.stdout
    assert {path.name for path in (PACKAGE / 'commands' / 'view' / 'web').iterdir()} <= set(done.stdout.split())


def test_setup_lists_what_find_packages_must_not_forget():
    given = {}
    import setuptools
    original, setuptools.setup = setuptools.setup, given.update
    try:
        here = os.getcwd()
        os.chdir(ROOT)
        runpy.run_path('setup.py')
    finally:
        os.chdir(here)
        setuptools.setup = original
    assert 'dragon_ros.core' in given['packages']
    assert given['entry_points'] == {'console_scripts': ['dragon = dragon_ros.__main__:dragon']}


@pytest.mark.skipif(not find_spec('ruff'), reason='ruff is not installed here')
def test_ruff_finds_nothing():
    all_there()
    done = subprocess.run([sys.executable, '-m', 'ruff', 'check', '--no-cache', '.'], cwd=ROOT, capture_output=True,
                          text=True, check=False)
    assert done.returncode == 0, done.stdout


@pytest.mark.skipif(not find_spec('mypy'), reason='mypy is not installed here')
def test_types_hold_strictly():
    all_there()
    # From version 1.18 on, mypy can keep what it knows of unchanged modules in a format that it reads faster. It
    # has its own folder, because mypy starts again whenever the format of a folder changes.
    fast = ['--fixed-format-cache'] if tuple(map(int, version('mypy').split('.')[:2])) >= (1, 18) else []
    folder = 'mypy-fixed-format' if fast else 'mypy'
    cache = Path(os.environ['XDG_CACHE_HOME'], folder) if 'XDG_CACHE_HOME' in os.environ else os.devnull
    done = subprocess.run([sys.executable, '-m', 'mypy', *fast, '--cache-dir', cache], cwd=ROOT, capture_output=True,
                          text=True, check=False)
    assert done.returncode == 0, done.stdout


def own_private_names(paths):
    """Return every name with one leading underscore that these files define: as a variable, attribute or function."""
    own = set(OF_TUPLES)
    for path in paths:
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)):
                own.add(node.name)
            elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
                own.add(node.id)
            elif isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store):
                own.add(node.attr)
    return own


def private_names_of_others(source, own):
    """Return the private names of other packages in a source text: imported, or read as attributes."""
    def is_private(name):
        return name.startswith('_') and not name.startswith('__')
    found = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.ImportFrom) and not node.module.startswith('dragon_ros'):
            found |= {name for name in (*node.module.split('.'), *(one.name for one in node.names)) if is_private(name)}
        elif isinstance(node, ast.Import):
            found |= {part for one in node.names for part in one.name.split('.') if is_private(part)}
        elif isinstance(node, ast.Attribute) and is_private(node.attr) and node.attr not in own:
            found.add(node.attr)
        elif isinstance(node, ast.Call) and getattr(node.func, 'id', '') in ('getattr', 'hasattr', 'setattr'):
            name = node.args[1].value if isinstance(node.args[1], ast.Constant) else ''
            found |= {name} if is_private(name) and name not in own else set()
    return found


@pytest.mark.parametrize(('source', 'found'), [
    ('from rclpy._rclpy_pybind11 import RCLError', {'_rclpy_pybind11'}), ('from a import _b as c', {'_b'}),
    ('import a._b.c', {'_b'}), ('node._parameter_overrides', {'_parameter_overrides'}), ('self._own = 1', set()),
    ('getattr(node, "_cb_iter", None)', {'_cb_iter'}), ('row._replace(x=1)', set()), ('a.__class__', set()),
    ('from dragon_ros.core import _own', set())])
def test_private_names_of_others_are_found_in_a_source(source, found):
    assert private_names_of_others(source, {'_own', *OF_TUPLES}) == found


def test_one_file_alone_uses_private_names_of_other_packages():
    paths = sorted({*PACKAGE.rglob('*.py'), *(ROOT / 'launch').glob('*.py')} - {INTERNALS})
    own = own_private_names(paths) | {'_exit'}      # os._exit is documented
    found = {path.relative_to(ROOT).as_posix().removeprefix('dragon_ros/'): private_names_of_others(
        path.read_text(), own) for path in paths}
    assert {path: names for path, names in found.items() if names} == {}
    assert 'rclpy_implementation' in INTERNALS.read_text()


def test_setup_runs_through_a_link_in_another_folder_as_with_colcon_symlink_install(tmp_path):
    (tmp_path / 'setup.py').symlink_to(ROOT / 'setup.py')
    done = subprocess.run([sys.executable, 'setup.py', '--version', '--url'], cwd=tmp_path, capture_output=True,
                          text=True, check=True)
    assert done.stdout.split()[-2:] == [dragon_ros.__version__, ElementTree.parse(ROOT / 'package.xml').findtext('url')]
