"""All parts of the package support links of almost zero length if these have a direction, and reject them otherwise."""
import json

import numpy as np
import pytest
from certificates import written
from properties import thinned

from dragon_ros.__main__ import main
from dragon_ros.core.chain.dragon import Dragon, Group, Mixed
from dragon_ros.core.errors import FieldError
from dragon_ros.core.geometry.rectangles import axes_of
from dragon_ros.core.scene import Scene
from dragon_ros.core.step import state
from dragon_ros.core.tracks.spec import Spiral
from dragon_ros.scenes.load import load_scene

KEPT = [0.0, 1e-9, 1e-8, 1e-7]
REFUSED = [10.0**power for power in range(-15, -9)]
INSET_M = 0.275


@pytest.fixture(scope='module')
def certificate_text():
    """The certificate of a dragon whose head has a link of zero length."""
    return json.dumps(written(load_scene('winding', ['dragon.benches=20', 'dragon.head_length_m=0.55',
                                                     'track.start_turns=4.5'])))


def scene_options(link_m):
    return ['--set', f'dragon.head_length_m={2 * INSET_M + link_m!r}', '--set', 'dragon.benches=20',
            '--set', 'track.start_turns=4.5']


def dragons(link_m):
    """Return two dragons with a link of almost zero length: one in its head, the other in its body."""
    short_m = 2 * INSET_M + link_m
    return Dragon(20, short_m), Mixed((Group(3.41), Group(2.2, 5), Group(short_m), Group(2.2, 13)))


@pytest.mark.parametrize('link_m', KEPT)
def test_positions_benches_and_velocities_with_a_short_link_are_those_with_none(link_m):
    for dragon, without in zip(dragons(link_m), dragons(0.0), strict=True):
        one, other = (state(Scene(dragon=each, track=Spiral(start_turns=6.0)), 3.0) for each in (dragon, without))
        assert np.max(np.hypot(*(one.p - other.p).T)) <= 2 * link_m
        assert np.max(np.abs(one.velocities(1.0) - other.velocities(1.0))) <= 1e-5
        assert np.max(np.abs(axes_of(one) - axes_of(other))) <= 1e-5


@pytest.mark.parametrize('link_m', thinned(KEPT, lambda link_m: link_m == 1e-7))
def test_a_contact_with_a_short_link_is_found_and_proved(link_m, tmp_path, capsys):
    certificate = tmp_path / 'c.json'
    options = [*scene_options(link_m), '--set', 'dragon.benches=12', '--set', 'run.start_s=15']     # 0.9 s earlier
    assert main(['contact', *options, '--format', 'json', '--certificate', str(certificate)]) == 0
    found = json.loads(capsys.readouterr().out)
    assert (found['benches'], found['grazing_m']) == ([1, 8], None)
    assert main(['contact', '--verify', str(certificate)]) == 0


@pytest.mark.parametrize('link_m', [0.0, 1e-9])
def test_a_bag_with_a_short_link_holds_its_promise(link_m, tmp_path, capsys):
    bag = tmp_path / 'a.mcap'
    assert main(['simulate', *scene_options(link_m), '--set', 'run.stop_s=1', '--output', str(bag)]) == 0
    assert main(['inspect', str(bag), '--check']) == 0


@pytest.mark.parametrize('link_m', thinned([1e-16, *REFUSED], (1e-16, max(REFUSED)).__contains__))
def test_a_link_without_a_direction_is_refused_with_its_cure(link_m, tmp_path, capsys, certificate_text):
    length_m = 2 * INSET_M + max(link_m, 2e-16)
    for build in (lambda: Dragon(20, length_m), lambda: Mixed((Group(2.2), Group(length_m), Group(2.2, 9)))):
        with pytest.raises(FieldError, match=r'too short to have an accurate direction; give 0.55 m for a link of '
                                             r'zero length'):
            build()
    certificate = tmp_path / 'c.json'
    values = json.loads(certificate_text)
    values['scene']['dragon']['head_length_m'] = length_m
    certificate.write_text(json.dumps(values))
    assert main(['contact', '--verify', str(certificate)]) == 2
    for command in (['contact'], ['table'], ['simulate', '--output', str(tmp_path / 'a.mcap')]):
        assert main([*command, '--set', f'dragon.head_length_m={length_m!r}']) == 2
    assert 'Traceback' not in capsys.readouterr().err


def test_what_counts_is_the_length_beside_the_longest_bench():
    for scale in (1e-6, 1.0, 1e6):
        Dragon(20, 0.5 * scale + 1e-9 * scale, 2.2 * scale, 0.3 * scale, 0.25 * scale)
        with pytest.raises(FieldError):
            Dragon(20, 0.5 * scale + 1e-10 * scale, 2.2 * scale, 0.3 * scale, 0.25 * scale)
