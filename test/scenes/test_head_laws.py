"""Custom head laws are loaded from entry points, never from a bag, and rejected if they break their contract."""
import sys

import pytest

from dragon_ros.core.chain.head_law import Profile
from dragon_ros.core.errors import InputError
from dragon_ros.core.step import tick
from dragon_ros.scenes.load import load_scene, scene_of, scene_values, strangers_scene
from dragon_ros.scenes.provenance import scene_file
from dragon_ros.scenes.yaml import parse_document

LAWS = """
from dragon_ros.core.chain.head_law import Head, Profile
calls = []
def wave(top_m_s=1.0, period_s=4.0):
    return Profile(tuple((n * period_s / 2, top_m_s * (n % 2)) for n in range(9)), 'smooth')
def text():
    return 'fast'
def broken():
    raise RuntimeError('no such dance')
def restless():
    calls.append(1)
    return Head(float(len(calls)))
"""


@pytest.fixture(autouse=True)
def _installed(tmp_path, monkeypatch):
    """A distribution that contains head laws, as pip would install it."""
    (tmp_path / 'own_laws.py').write_text(LAWS)
    info = tmp_path / 'own_laws-1.0.dist-info'
    info.mkdir()
    (info / 'METADATA').write_text('Metadata-Version: 2.1\nName: own-laws\nVersion: 1.0\n')
    names = ('wave', 'text', 'broken', 'restless', 'gone')
    (info / 'entry_points.txt').write_text('[dragon_ros.head_laws]\n' + ''.join(
        f'{name} = own_laws:{name}\n' for name in names))
    monkeypatch.syspath_prepend(tmp_path)


def scene_with(tmp_path, head):
    (tmp_path / 's.yaml').write_text(f'dragon: {{benches: 9}}\nhead: {head}\nrun: {{stop_s: 10}}\n')
    return load_scene(str(tmp_path / 's.yaml'))


def test_a_law_of_ones_own_leads_the_dragon_and_its_scene_stands_without_it(tmp_path):
    scene = scene_with(tmp_path, '{kind: plugin, law: wave, settings: {top_m_s: 2}}')
    assert scene.head == Profile(tuple((2.0 * n, 2.0 * (n % 2)) for n in range(9)), 'smooth')
    assert scene_values(scene)['head']['kind'] == 'profile'
    again = strangers_scene('a bag', scene_file(scene))
    assert again == scene
    assert tick(again, 77).chain.p.tobytes() == tick(scene, 77).chain.p.tobytes()


@pytest.mark.parametrize(('head', 'says'), [
    ('{kind: plugin, law: text}', 'returned str; it must return a Head or a Profile'),
    ('{kind: plugin, law: broken}', 'RuntimeError: no such dance'),
    ('{kind: plugin, law: restless}', 'two different laws for the same settings'),
    ('{kind: plugin, law: gone}', 'AttributeError'),
    ('{kind: plugin, law: waves}', 'broken, gone, restless, text, wave'),
    ('{kind: plugin}', 'None is unknown'),
    ('{kind: plugin, law: wave, settings: {top: 2}}', 'TypeError'),
    ('{kind: plugin, law: wave, settings: [2]}', 'head.settings'),
    ('{kind: plugin, law: wave, speed: 2}', 'head.speed'),
    ('{kind: plugin, law: wave, settings: {period_s: -4}}', 'head.knots')])
def test_a_law_that_breaks_its_contract_is_refused_with_the_reason(tmp_path, head, says):
    with pytest.raises(InputError) as error:
        scene_with(tmp_path, head)
    assert says in str(error.value)
    assert 's.yaml' in str(error.value)


def test_no_law_is_loaded_because_a_bag_or_a_topic_names_it():
    sys.modules.pop('own_laws', None)
    text = 'head: {kind: plugin, law: wave}'
    for read in (lambda: scene_of(parse_document('bag', text)), lambda: strangers_scene('a bag', text, trust=True)):
        with pytest.raises(InputError, match='not from bags or topics'):
            read()
    assert 'own_laws' not in sys.modules
