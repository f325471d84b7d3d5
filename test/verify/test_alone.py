"""The checker runs as a process without the solver."""
import json
import re
import subprocess
import sys

import pytest
from certificates import written
from properties import thinned

from dragon_ros.commands import contact
from dragon_ros.core.chain.dragon import Dragon
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.tracks.spec import Arc, Composite, Line
from dragon_ros.verify import command
from dragon_ros.verify.cover import Budget
from dragon_ros.verify.errors import Refused
from dragon_ros.verify.proof import _Proof
from dragon_ros.verify.reading import claims_of

SHORT = Scene(dragon=Dragon(12), run=Run(411.5, 413.0))
LOOP = Scene(dragon=Dragon(12), track=Composite((Line(5.0), Arc(3.0, 720.0))), run=Run(0, 20))


@pytest.fixture(scope='module')
def files(tmp_path_factory):
    """Write three certificate files: one for a contact, one for no contact, and a false one."""
    folder = tmp_path_factory.mktemp('certificates')
    values = {'contact': written(SHORT), 'none': written(LOOP)}
    values['false'] = {**values['contact'], 'contact': {'t_s': None}}
    for name, one in values.items():
        (folder / f'{name}.json').write_text(json.dumps(one))
    return folder


def run(*arguments, code=''):
    command = ['-c', code] if code else ['-m', 'dragon_ros.verify']
    return subprocess.run([sys.executable, *command, *map(str, arguments)], capture_output=True, text=True, check=False)


@pytest.mark.parametrize('name', thinned(['contact', 'none', 'false'], lambda name: name == 'contact'))
def test_the_process_imports_no_other_room_of_the_package_nor_the_solvers_libraries(files, name):
    done = run(files / f'{name}.json', code='import sys\nfrom dragon_ros.verify.command import main\n'
               'main(sys.argv[1:])\nprint(*sys.modules)')
    names = done.stdout.splitlines()[-1].split()
    ours = {name for name in names if name.split('.')[0] == 'dragon_ros'}
    assert {name for name in ours if not name.startswith('dragon_ros.verify')} == {'dragon_ros'}
    assert 'dragon_ros.verify.proof' in ours
    assert not {'numpy', 'scipy', 'shapely', 'yaml', 'rclpy', 'mpmath'} & set(names)


def test_it_prints_one_sentence_of_what_is_proved_or_one_line_of_why_not(files):
    done = run(files / 'contact.json')
    assert (done.returncode, done.stderr) == (0, '')
    assert 'no two benches touch from 411.5 s to the contact at 412.47383768211' in done.stdout
    assert 'less 1 nm of leader travel, and benches 0 and 8 overlap 1 nm after it' in done.stdout
    refused = run(files / 'false.json')
    assert (refused.returncode, refused.stdout) == (2, '')
    assert len(refused.stderr.splitlines()) == 1
    assert 'benches 0 and 8 overlap' in refused.stderr


def test_contact_verify_starts_it_and_passes_on_what_it_says(files, capfd):
    assert contact.main(['--verify', str(files / 'none.json')]) == 0
    passed_on = capfd.readouterr().out
    assert command.main([str(files / 'none.json')]) == 0
    assert capfd.readouterr().out == passed_on != ''
    assert contact.main(['--verify', str(files / 'false.json')]) == 2
    out, err = capfd.readouterr()
    assert (out, 'refused: benches 0 and 8 overlap' in err) == ('', True)
    assert contact.main(['--verify', str(files / 'none.json'), '--output', str(files / 'said')]) == 0
    assert 'no two benches touch' in (files / 'said').read_text()


def test_without_its_library_it_says_in_a_line_how_to_install_it(files):
    done = run(files / 'none.json', code='import sys\nsys.modules["flint"] = None\n'
               'from dragon_ros.verify.command import main\nsys.exit(main(sys.argv[1:]))')
    assert (done.returncode, done.stdout) == (2, '')
    assert len(done.stderr.splitlines()) == 1
    assert 'pip install python-flint' in done.stderr


def test_a_long_proof_tells_how_far_it_is(files):
    code = ('import sys\nfrom dragon_ros.verify import command\ncommand._FIRST_S = command._EVERY_S = 0.0\n'
            'sys.exit(command.main(sys.argv[1:]))')
    lines = run(files / 'none.json', code=code).stderr.splitlines()
    assert len(lines) > 1
    assert all('m of track cleared' in line for line in lines)
    assert 's left' in lines[-1]


def test_an_effort_that_is_too_small_ends_the_proof(files, capsys):
    assert command.main([str(files / 'none.json'), '--effort', '1e-4']) == 2
    assert 'give --effort' in capsys.readouterr().err


def test_a_proof_that_takes_more_than_its_budget_says_on_its_way_which_effort_is_enough():
    budget = Budget(1000, 2.0, spent=100, since=50, share=0.1)      # 550 steps at this rate
    assert budget.advice == ''
    budget.spend(100)       # 1,550 steps, and a safety factor of 2
    assert budget.advice == 'at this rate more than the budget: --effort 6.2 is enough'


def test_a_first_interval_that_is_a_float_long_tells_nothing_of_the_rest():
    budget = Budget(1000, 2.0, spent=100, since=50, share=5e-324)
    assert budget.advice == ''
    with pytest.raises(Refused, match=r'give --effort above 2$'):
        budget.spend(1000)


@pytest.mark.parametrize(('name', 'steps', 'intervals'), [('contact', 730, 24), ('none', 770, 29)])
def test_a_short_proof_takes_few_steps(files, name, steps, intervals):
    budget = Budget(10**6)
    _Proof(claims_of((files / f'{name}.json').read_bytes()), budget, lambda *row: None).sentence()
    assert budget.spent <= steps
    assert budget.intervals <= intervals


def test_the_effort_that_a_refusal_names_is_enough(files, capfd):
    small = ['--verify', str(files / 'none.json'), '--effort']
    assert contact.main([*small, '0.002']) == 2
    named = re.search(r'give --effort (\S+) \(at this rate the proof takes about \S+ s\)', capfd.readouterr().err)
    assert named
    assert contact.main([*small, named[1]]) == 0
    assert 'no two benches touch' in capfd.readouterr().out


@pytest.mark.parametrize('effort', ['0', '-1', 'nan', 'inf', 'much'])
def test_an_effort_is_a_positive_number(files, effort, capsys):
    with pytest.raises(SystemExit, match='2'):
        command.main([str(files / 'none.json'), f'--effort={effort}'])
    assert f'{effort}: give a positive number' in capsys.readouterr().err


def test_an_effort_without_a_certificate_is_refused(capsys):
    assert contact.main(['--effort', '2']) == 2
    assert '--effort: it requires --verify' in capsys.readouterr().err
