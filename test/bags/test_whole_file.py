"""A file is written completely or not at all, and an overwritten file is never half of a new one."""
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from dragon_ros.bags.write.whole_file import whole_or_none

AS_OWNER = ('setpriv', '--bounding-set=-dac_override', '--inh-caps=-dac_override')     # makes root obey permissions


def write(path, content=b'new'):
    with whole_or_none(path, overwrite=True) as file:
        file.write(content)


def write_half(path, error):
    with whole_or_none(path, overwrite=True) as file:
        file.write(b'half')
        file.flush()
        raise error


@pytest.mark.parametrize('error', [KeyboardInterrupt, OSError, ValueError])
@pytest.mark.parametrize('old', [b'old', None])
def test_a_file_stays_as_it_was_if_writing_fails(tmp_path, error, old):
    path = tmp_path / 'a'
    if old is not None:
        path.write_bytes(old)
    with pytest.raises(error):
        write_half(path, error)
    assert [one.read_bytes() for one in tmp_path.iterdir()] == [old] * (old is not None)


def test_a_replaced_file_keeps_its_permissions_and_a_symbolic_link_to_it_stays(tmp_path):
    folder = tmp_path / 'there'
    folder.mkdir()
    (folder / 'a').write_bytes(b'old and longer')
    (folder / 'a').chmod(0o751)
    link = tmp_path / 'link'
    link.symlink_to('there/a')
    write(link)
    assert (link.is_symlink(), (folder / 'a').read_bytes()) == (True, b'new')
    assert (folder / 'a').stat().st_mode & 0o777 == 0o751
    assert os.listdir(folder) == ['a']
    dangling = tmp_path / 'dangling'
    dangling.symlink_to('there/b')
    write(dangling)
    assert (dangling.is_symlink(), (folder / 'b').read_bytes()) == (True, b'new')


def test_a_new_file_has_the_usual_permissions(tmp_path):
    write(tmp_path / ('n' * 255))
    (tmp_path / 'b').touch()
    assert (tmp_path / ('n' * 255)).stat().st_mode == (tmp_path / 'b').stat().st_mode


def test_both_names_of_a_file_show_the_new_content(tmp_path):
    (tmp_path / 'a').write_bytes(b'old')
    (tmp_path / 'b').hardlink_to(tmp_path / 'a')
    write(tmp_path / 'a')
    assert (tmp_path / 'b').read_bytes() == b'new'


def test_devices_and_open_files_are_written_in_place(tmp_path):
    write(Path('/dev/null'))
    assert not Path('/dev/null').is_file()
    with (tmp_path / 'a').open('w+b') as file:
        write(Path(f'/dev/fd/{file.fileno()}'))
        assert file.read() == b'new'
    with pytest.raises(IsADirectoryError):
        write(tmp_path)


_WITHOUT_RIGHTS = """
from pathlib import Path
from test_whole_file import write
write(Path('read_only_folder/a'))
try:
    write(Path('read_only_file'))
except PermissionError:
    print('refused')
"""


def test_permissions_decide_whether_a_file_is_overwritten(tmp_path):
    if os.geteuid() == 0 and not shutil.which(AS_OWNER[0]):
        pytest.skip('root writes everywhere, and setpriv is not installed')
    folder, file = tmp_path / 'read_only_folder', tmp_path / 'read_only_file'
    folder.mkdir()
    for path, mode in ((folder / 'a', 0o644), (file, 0o444)):
        path.write_bytes(b'old')
        path.chmod(mode)
    folder.chmod(0o555)
    done = subprocess.run([*(AS_OWNER if os.geteuid() == 0 else ()), sys.executable, '-c', _WITHOUT_RIGHTS],
                          cwd=tmp_path, env={**os.environ, 'PYTHONPATH': os.pathsep.join(filter(None, sys.path))},
                          capture_output=True, text=True, check=False)
    folder.chmod(0o755)
    if done.returncode == 127:
        pytest.skip(f'permissions cannot be enforced for root here: {done.stderr}')
    assert (done.stdout, done.stderr) == ('refused\n', '')
    assert ((folder / 'a').read_bytes(), file.read_bytes()) == (b'new', b'old')
