"""No command overwrites the scene file or the bag that it reads."""
import shutil
from pathlib import Path

import pytest

from dragon_ros.__main__ import main

BAG = Path(__file__).parents[1] / 'data' / 'made_by_0_1_0.mcap'


@pytest.mark.parametrize('command', [
    'export IN --format csv --force --output IN', 'inspect IN --output IN', 'table --bag IN --times 404 --output IN',
    'plot dragon --bag IN.svg --output other.svg --output IN.svg', 'contact IN --output IN',
    'table --scene IN.yaml --format csv --output IN.yaml', 'simulate --scene IN.yaml --force --output IN.yaml',
    'table --scene IN.yaml --format csv --output link'])
def test_a_file_that_is_read_is_not_overwritten(monkeypatch, tmp_path, capsys, command):
    monkeypatch.chdir(tmp_path)
    output = command.split()[-1]
    name = 'IN.yaml' if output == 'link' else output
    if name == 'IN.yaml':
        Path(name).write_text('dragon: {benches: 3}')
    else:
        shutil.copyfile(BAG, name)
    Path('link').symlink_to(name)
    before = Path(name).read_bytes()
    with pytest.raises(SystemExit) as ended:
        main(command.split())
    assert (ended.value.code, Path(name).read_bytes() == before) == (2, True)
    assert f'--output {output}: this is the file that is read; give another file' in capsys.readouterr().err
