"""File names that are not UTF-8 and characters that the locale lacks are escaped; no command ends in a traceback."""
import os
import subprocess
import sys

import pytest
from properties import thinned

from dragon_ros.__main__ import main

NAME = os.fsdecode('舞龙'.encode('gbk'))         # as unpacked from a ZIP file that was made in Chinese Windows
ESCAPED = r'\udcce\udce8\udcc1\udcfa'


@pytest.fixture
def scene(tmp_path):
    path = tmp_path / f'{NAME}.yaml'
    path.write_text('dragon: {benches: 3}\nrun: {stop_s: 0.1}\n')
    return path


def run(*arguments, **environment):
    return subprocess.run([sys.executable, '-m', 'dragon_ros', *map(str, arguments)], capture_output=True, text=True,
                          check=False, env={**os.environ, **environment}, errors='surrogateescape')


@pytest.mark.parametrize('arguments', thinned([['plan'], ['plot', 'dragon', '--times', '0']],
                                              lambda arguments: arguments[0] == 'plot'))
def test_a_scene_may_have_any_name_in_a_picture(capsys, scene, arguments):
    sys.stdout.reconfigure(errors='backslashreplace')
    assert main([*arguments, '--output', f'{scene}.pdf', '--scene', str(scene)]) == 0
    assert f'{ESCAPED}.yaml.pdf' in capsys.readouterr().out
    assert os.path.getsize(f'{scene}.pdf') > 1000


@pytest.mark.parametrize(('arguments', 'shown'), [(['contact', '--verify', 'CERTIFICATE'], f'{ESCAPED}.json: ')])
def test_characters_that_the_locale_lacks_are_escaped(scene, arguments, shown):
    certificate = scene.with_suffix('.json')
    if 'CERTIFICATE' in arguments:
        sys.stdout.reconfigure(errors='backslashreplace')
        assert main(['contact', '--scene', str(scene), '--certificate', str(certificate)]) == 0
    given = [certificate if one == 'CERTIFICATE' else one for one in arguments]
    done = run(*given, PYTHONUTF8='0', PYTHONIOENCODING='ascii', LC_ALL='C')
    assert (done.returncode, shown in done.stdout) == (0, True), done.stdout + done.stderr
