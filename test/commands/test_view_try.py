"""``view --try`` shows fields for a scene, answers questions, and stops work when the page stops waiting."""
import contextlib
import http.client
import json
import re
import socket
import threading
import urllib.error
import urllib.parse
import urllib.request
from dataclasses import replace

import pytest
import yaml
from test_view import serving_of

from dragon_ros.__main__ import main
from dragon_ros.commands.view import server as server_module
from dragon_ros.commands.view import variants as variants_module
from dragon_ros.commands.view.data import ViewData
from dragon_ros.commands.view.variants import QUESTIONS, Variants, fields_of
from dragon_ros.core.errors import InputError
from dragon_ros.core.search.bounding_box import bounding_box
from dragon_ros.core.search.first_contact import first_contact
from dragon_ros.core.search.max_speed import max_speed
from dragon_ros.core.search.min_pitch import min_pitch
from dragon_ros.core.search.venue_fit import venue_fit
from dragon_ros.pictures.sources import SceneSource
from dragon_ros.scenes.load import load_scene

SMALL = ['dragon.benches=20', 'run.start_s=411', 'run.stop_s=413', 'run.rate_hz=20']


def serving(scene='winding', overrides=SMALL):
    return serving_of(Variants('small', scene, list(overrides)))


@pytest.fixture(scope='module')
def server():
    with serving() as running:
        yield running


def get(server, path, **changes):
    query = urllib.parse.urlencode(changes)
    with urllib.request.urlopen(f'{server.url}{path}?{query}', timeout=60) as answer:
        return answer.read()


def ask(server, path, **changes):
    return json.loads(get(server, path, **changes))


def test_every_number_of_a_scene_is_a_field_with_its_value_on_the_slider():
    fields = {one.key: one for one in fields_of(load_scene('street'))}
    assert {'dragon.benches', 'dragon.width_m', 'track.pieces.2.radius_m', 'track.start_m', 'head.speed_m_s',
            'run.stop_s', 'venue.margin_m'} <= fields.keys()
    assert fields['track.pieces.2.radius_m'].value == 6.0
    for one in fields.values():
        assert one.value is None or one.low <= one.value <= one.high
        assert one.step > 0


def test_a_route_offers_what_can_be_tried_and_not_its_pieces():
    pieces = [{'kind': 'line', 'length_m': 5.0, 'heading_deg': 12.3456}, *[
        {'kind': 'arc', 'radius_m': 8.0, 'angle_deg': (-1) ** n * 20.0} for n in range(12)]]
    route = load_scene('street', ['venue=null', 'dragon.benches=3', 'track.start_m=5',
                                  f'track.pieces={json.dumps(pieces)}'])
    keys = {one.key for one in fields_of(route)}
    assert not [key for key in keys if 'pieces' in key]
    assert {'dragon.benches', 'dragon.body_length_m', 'dragon.width_m', 'head.speed_m_s', 'track.start_m'} <= keys
    assert not [one.key for one in fields_of(load_scene('street')) if one.key.endswith(('heading_deg', 'length_m'))
                and 'pieces' in one.key]


def test_only_numbers_that_are_proved_are_called_so_and_none_is_minus_zero():
    wall = 'venue.obstacles=[{{kind: line, name: wall, points_m: [[9, {y}], [-9, {y}]]}}]'
    for y in (0.3, 0.15):
        overrides = [*FEW, wall.format(y=y)]
        said = Variants('street', 'street', overrides).answer('room', '', lambda: None)
        assert '-' not in said['values'].get('gap', '')
        if said['key'] == 'gap_to':
            worst = min(venue_fit(load_scene('street', overrides)).gaps, key=lambda gap: gap.low_m)
            assert (said['how'] == 'proved') == (float(said['values']['gap']) <= worst.low_m)


FEW = ['dragon.benches=5', 'run.stop_s=30']
STREET = {one.key: one.value for one in fields_of(load_scene('street', FEW)) if one.value is not None}


@pytest.mark.parametrize('key', STREET)
def test_a_field_takes_its_key_as_set_does(key):
    changed = STREET[key] + 1 if key == 'dragon.benches' else 0.999 * STREET[key] + 1e-3
    form = Variants('street', 'street', FEW).form(urllib.parse.urlencode({key: changed}))
    assert form['error'] is None
    assert {one['key']: one['value'] for one in form['fields']}[key] == changed


def test_the_answers_are_those_of_the_commands(server):
    scene = load_scene('winding', [*SMALL, 'dragon.width_m=0.301'])
    found = first_contact(scene)
    until = replace(scene, run=replace(scene.run, stop_s=found.t_s))
    said = {name: ask(server, f'answers/{name}', **{'dragon.width_m': 0.301}) for name in QUESTIONS}
    values = {name: one['values'] for name, one in said.items()}
    assert values['contact'] == {'t': f'{found.t_s:.9f}', 'first': str(found.benches[0]),
                                 'second': str(found.benches[1]), 'obstacle': ''}
    assert max_speed(until).ratio == 1
    assert (said['speed']['key'], values['speed']) == ('none_faster', {})
    assert 0 <= float(values['room']['free']) - bounding_box(until).free_m[1] < 1e-4
    assert 0 <= float(values['pitch']['pitch']) - min_pitch(scene.dragon, within_m=1e-9).high_m < 1e-9
    assert [said[name]['how'] for name in QUESTIONS] == ['proved', 'proved', 'proved', 'proved', 'sampled']
    assert [said[name]['until_contact'] for name in QUESTIONS] == [False, True, True, False, True]
    assert 0 <= float(values['clearance']['gap']) < 5


def test_a_run_without_contact_is_said_to_have_none(server):
    said = ask(server, 'answers/contact', **{'dragon.benches': 5})
    assert said == {'key': 'no_contact', 'values': {'end': '413'}, 'how': 'proved', 'until_contact': False}


@pytest.mark.parametrize(('change', 'key', 'words'), [
    ({'dragon.width_m': '-1'}, 'dragon.width_m', 'at least 0.001'),
    ({'dragon.benches': '2.5'}, 'dragon.benches', 'whole number'),
    ({'dragon.benches': '2001'}, 'dragon.benches', 'give fewer'),
    ({'dragon.width_m': 'wide'}, 'dragon.width_m', 'not a finite number'),
    ({'dragon.width_m': ''}, 'dragon.width_m', 'a number'),
    ({'dragon.width_m': 'nan'}, 'dragon.width_m', 'finite number'),
    ({'dragon.width_m': '1e999'}, 'dragon.width_m', 'finite number'),
    ({'track.start_turns': '0.1'}, '', ''),
    ({'solver': 'march'}, 'solver', 'not a value'),
    ({'dragon.groups.1.count': '3'}, 'dragon.groups.1.count', 'not a value')])
def test_a_value_that_is_not_possible_is_refused_beside_its_field(server, change, key, words):
    error = ask(server, 'form.json', **change)['error']
    assert error['key'] == key or not key
    assert words in error['text']
    assert '--set' not in error['text']
    with pytest.raises(urllib.error.HTTPError, match='400') as refused:
        get(server, 'run.json', **change)
    refused.value.close()


def test_the_scene_file_of_a_variant_makes_the_same_scene(server, tmp_path):
    path = tmp_path / 'scene.yaml'
    path.write_bytes(get(server, 'scene.yaml', **{'track.pitch_m': 0.6}))
    assert load_scene(str(path)) == load_scene('winding', [*SMALL, 'track.pitch_m=0.6'])
    assert yaml.safe_load(path.read_text())['track']['pitch_m'] == 0.6


@pytest.mark.parametrize(('scene', 'closed'), [('street', [True]), ('square', [True, True, True])])
def test_the_walls_of_a_venue_are_sent_whole(scene, closed):
    variant = Variants(scene, scene, ['dragon.benches=3', 'run.stop_s=1']).variant('')
    x, y = variant.data.run()['walls']
    ends = [n for n, one in enumerate(x) if one is None]
    pieces = [list(zip(x[first + 1:last], y[first + 1:last], strict=True))
              for first, last in zip([-1, *ends], ends, strict=False)]
    venue = variant.scene.venue
    parts = [*(one.points_m for one in venue.obstacles), venue.inside or ()]
    assert {one for piece in pieces for one in piece} == {tuple(map(float, one)) for part in parts for one in part}
    assert [True for piece in pieces if piece[0] == piece[-1]] == closed


def test_the_last_few_variants_are_kept_and_no_more():
    variants = Variants('small', 'winding', SMALL)
    kept = [variants.variant(f'dragon.benches={n}') for n in range(2, 12)]
    assert variants.variant('dragon.benches=11') is kept[-1]
    assert variants.variant('dragon.benches=2') is not kept[0]
    assert len(variants._made) == 8


def test_work_ends_when_the_page_that_asked_is_gone():
    with serving(overrides=['track.start_turns=32']) as server:
        begun, ended = threading.Event(), threading.Event()
        made = server.shown.variant('').data
        source = made._source.searched

        def searched(progress):
            begun.set()
            try:
                return source(lambda rows: progress(iter(int, 1)))     # endless steps
            finally:
                ended.set()
        object.__setattr__(made._source, 'searched', searched)
        with socket.create_connection(server.server_address) as page:
            page.sendall(b'GET /answers/contact HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n')
            assert begun.wait(30)
        assert ended.wait(30)


def test_an_answer_that_takes_too_long_says_what_to_ask(monkeypatch):
    monkeypatch.setattr(server_module, 'VIEW_ANSWER_S', 0.0)
    with serving() as server, contextlib.closing(http.client.HTTPConnection(*server.server_address)) as connection:
        connection.request('GET', '/answers/contact')
        answer = connection.getresponse()
        assert answer.status == 500
        assert answer.read() == b'/answers/contact: takes longer than 0 s; use the command line'


def test_a_path_that_waits_for_the_work_of_another_has_a_deadline_too(monkeypatch):
    monkeypatch.setattr(server_module, 'VIEW_ANSWER_S', 0.2)
    with serving() as server:
        data = server.shown.variant('').data
        with data._lock:        # another request is being answered
            for path in ('run.json', 'contact.json', 'clearance.json', 'frames/0', 'frames/contact', 'answers/speed'):
                with pytest.raises(urllib.error.HTTPError, match='500') as late:
                    get(server, path)
                assert b'takes longer than 0.2 s' in late.value.read()
                late.value.close()


@pytest.mark.parametrize(('scene', 'change'), [('street', 'dragon.benches=1000000'),
                                               ('mixed', 'dragon.groups.1.count=900000')])
def test_too_many_benches_are_refused_before_a_track_is_built_for_them(monkeypatch, scene, change):
    variants = Variants(scene, scene, [])
    monkeypatch.setattr(variants_module, 'load_scene', None)
    with pytest.raises(InputError, match='a page supports at most 2000 benches; give fewer'):
        variants.variant(change)


def test_a_scene_with_too_many_benches_is_refused_at_the_start(capsys):
    assert main(['view', '--try', '--set', 'dragon.benches=2001', '--no-browser']) == 2
    assert 'a page supports at most 2000 benches' in capsys.readouterr().err


def test_plain_view_has_none_of_it(server):
    with serving_of(ViewData(SceneSource('small', load_scene('winding', SMALL)), iter)) as plain:
        for path in ('form.json', 'answers/contact', 'scene.yaml', 'try.js'):
            with pytest.raises(urllib.error.HTTPError, match='404') as missing:
                get(plain, path)
            missing.value.close()
        assert b'try.js' not in get(plain, '')
    assert b'try.js' in get(server, '')


def test_a_bag_cannot_be_tried(capsys, bag):
    assert main(['view', '--try', '--no-browser', '--bag', str(bag)]) == 2
    assert '--try: it requires a scene' in capsys.readouterr().err


SET = """const field = document.getElementById(arguments[0]); field.value = arguments[1];
    field.dispatchEvent(new Event('input'));"""
ANSWERS = 'return [...document.querySelectorAll("#answers dd")].map((one) => one.textContent)'


# Return whether the title of the x axis lies within the picture of the dragon.
FITS = """const box = document.getElementById('scene').getBoundingClientRect();
  return document.querySelector('#scene .xtitle').getBoundingClientRect().bottom <= box.bottom + 1"""


def test_a_changed_value_moves_the_dragon_and_renews_the_answers(server, page):
    page.look(820, 1180)        # at this size, the legend takes three lines
    page.open_view(server.url)
    page.wait('return document.body.dataset.answered === "yes"')
    page.wait(FITS)
    before = page.run(ANSWERS)
    page.run(SET.replace('arguments[0]', '"value-dragon.benches"').replace('arguments[1]', '"12"'))
    page.wait('return document.getElementById("facts").textContent.startsWith("12 benches")')
    page.wait('return document.querySelectorAll("#answers progress").length === 0')
    assert page.run(ANSWERS)[0].startswith(before[0].split(',')[0])
    assert page.run('return location.search') == '?dragon.benches=12'
    assert page.run('return document.getElementById("scene-file").getAttribute("href")').endswith('benches=12')
    page.run(SET.replace('arguments[0]', '"value-dragon.width_m"').replace('arguments[1]', '"-2"'))
    page.wait('return document.querySelector(".wrong p")?.textContent.includes("at least 0.001")')
    assert page.run('return document.getElementById("facts").textContent').startswith('12 benches')
    page.click('reset')
    page.wait('return document.getElementById("facts").textContent.startsWith("20 benches")')
    page.wait('return document.querySelectorAll("#answers progress").length === 0')
    assert page.run(ANSWERS) == before
    page.open_view(f'{server.url}?dragon.width_m=-1')       # an address with an impossible value
    assert 'at least 0.001' in page.run('return document.querySelector(".wrong p").textContent')
    for width, height, dark in ((390, 844, False), (1400, 860, True)):
        page.look(width, height, dark)
        assert page.run('return document.scrollingElement.scrollWidth <= window.innerWidth')
    assert [line for line in page.log() if 'favicon' not in line[1]] == []


def test_values_are_changed_by_keys_alone_on_a_page_that_is_all_in_its_language(page):
    with serving_of(Variants('small', 'winding', SMALL), 'zh') as server:
        page.open_view(server.url)
        for _ in range(20):
            page.press('Tab')
            if page.run('return document.activeElement.id') == 'value-dragon.width_m':
                break
        page.press('ArrowUp')
        page.wait('return location.search === "?dragon.width_m=0.305"')
        page.wait('return document.querySelectorAll("#answers progress").length === 0')
        page.press('End')       # the field handles this key, so the time does not change
        assert page.run('return document.getElementById("time").textContent') == '411.00 s'
        said = page.wait('return document.querySelectorAll("#answers i").length === 5 && '
                         'document.getElementById("values").textContent')
        assert re.findall('[A-Za-z]{3,}', said) == ['scene', 'yaml']
        assert said.count('已证明') == 4
        assert '抽样' in said


@pytest.mark.parametrize('each', [False, pytest.param(True, marks=pytest.mark.long)])
def test_axe_finds_nothing_wrong_at_three_sizes_in_the_light_and_the_dark_in_both_languages(axe, page, each):
    plain = ViewData(SceneSource('small', load_scene('winding', SMALL)), iter)
    tried = Variants('small', 'winding', SMALL)
    pages = [(plain, 'en', ''), (tried, 'zh', '?dragon.width_m=-1'), (plain, 'zh', ''), (tried, 'en', '')]
    for n, (shown, lang, query) in enumerate(pages if each else pages[:2]):
        with serving_of(shown, lang) as server:
            page.open_view(server.url + query)
            for m, (width, height) in enumerate(((390, 844), (820, 1180), (1400, 860))):
                for dark in (False, True) if each else ((n + m) % 2 == 1,):
                    page.look(width, height, dark)
                    assert page.violations(axe) == [], (n, width, dark)
    page.run('document.getElementById("scrub").removeAttribute("aria-label")')
    assert [found.split(':')[0] for found in page.violations(axe)] == ['label']


def test_the_fastest_handle_of_a_turn_is_named():
    with serving('turning', ['dragon.benches=5', 'run.stop_s=120']) as server:
        said = ask(server, 'answers/speed')
        fastest = max_speed(server.shown.variant('').scene)
    assert (said['key'], said['values']) == ('fastest', {
        'handle': str(fastest.handle), 'ratio': f'{fastest.ratio:.9g}', 'along': f'{fastest.along_m:.6g}'})
