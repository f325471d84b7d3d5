"""Texts are in the language of ``--lang`` or the locale; both languages have every text, with the same parameters."""
import re
import urllib.request
from pathlib import Path
from string import Formatter
from threading import Thread

import pytest
from matplotlib import font_manager

from dragon_ros.__main__ import main
from dragon_ros.cli.language import language_of, say
from dragon_ros.commands import plan, plan_contents, plan_pages, plan_together, plan_words, view
from dragon_ros.commands.view import variants
from dragon_ros.commands.view.data import ViewData
from dragon_ros.commands.view.server import ViewServer
from dragon_ros.pictures.sources import SceneSource
from dragon_ros.scenes.load import load_scene

WEB = Path(view.__file__).with_name('web')
TABLES = {'plan': (plan_words.WORDS, ''.join(Path(one.__file__).read_text() for one in (
    plan, plan_contents, plan_pages, plan_together)))}
PAGE = dict(re.findall(r'(\w+): \[((?:"[^"]*"|\'[^\']*\'), (?:"[^"]*"|\'[^\']*\'))\]', (WEB / 'words.js').read_text()))


def run(capsys, *arguments):
    try:
        code = main([*map(str, arguments)])
    except SystemExit as stop:
        code = stop.code
    return code, *capsys.readouterr()


@pytest.mark.parametrize(('given', 'environment', 'language'), [
    ('en', {'LANG': 'zh_CN.UTF-8'}, 'en'), ('zh', {'LANG': 'en_GB.UTF-8'}, 'zh'), (None, {'LANG': 'zh_CN.UTF-8'}, 'zh'),
    (None, {'LC_ALL': 'zh_TW', 'LANG': 'en_US'}, 'zh'), (None, {'LC_ALL': 'C', 'LANG': 'zh_CN'}, 'en'),
    (None, {}, 'en'), (None, {'LC_ALL': '', 'LC_MESSAGES': 'zh_CN', 'LANG': 'de_DE'}, 'zh')])
def test_the_option_comes_first_then_the_locale(monkeypatch, given, environment, language):
    for name in ('LC_ALL', 'LC_MESSAGES', 'LANG'):
        monkeypatch.delenv(name, raising=False)
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    assert language_of(given) == language


@pytest.mark.parametrize('name', TABLES)
def test_both_languages_have_every_text_with_the_same_parameters_and_none_is_dead(name):
    words, source = TABLES[name]
    for key, pair in words.items():
        fields = [{field for _, field, _, _ in Formatter().parse(text) if field} for text in pair]
        assert fields[0] == fields[1], key
        assert re.search('[\u4e00-\u9fff]', pair[1]) or key in ('gap', 'exact_gap', 'quantity'), key
        assert f"'{key}'" in source or f'"{key}"' in source or re.match(r'table\d', key), key


def test_the_page_has_every_text_that_it_names_in_both_languages():
    named = set(re.findall(r'data-(?:say|label|title)="(\w+)"', (WEB / 'index.html').read_text()))
    for script in ('view.js', 'try.js'):
        named |= set(re.findall(r"say\('(\w+)'", (WEB / script).read_text()))
    source = Path(variants.__file__).read_text()
    named |= {'meet', 'graze', 'meet_obstacle', 'graze_obstacle', 'proved', 'sampled'}
    named |= set(re.findall(r"Answer\('(\w+)'", source))
    assert len(named) > 45
    assert named <= set(PAGE)
    for key, pair in PAGE.items():
        english, chinese = re.findall(r'"([^"]*)"|\'([^\']*)\'', pair)
        assert set(re.findall(r'{(\w+)}', ''.join(english))) == set(re.findall(r'{(\w+)}', ''.join(chinese))), key
        assert re.search('[\u4e00-\u9fff]', ''.join(chinese)), key


def test_a_plan_is_in_chinese_or_says_which_font_is_missing(capsys, tmp_path, monkeypatch):
    small = ('plan', '--set', 'dragon.benches=4', '--lang', 'zh', '--output', tmp_path / 'a.pdf')
    if any('cjk' in path.lower() for path in font_manager.findSystemFonts()):
        code, out, err = run(capsys, *small)
        assert (code, err) == (0, '')
        assert say(plan_words.WORDS, 'exact_gap', 'zh', name='left wall', gap=1.5).partition('1.5')[0] in out
        assert (tmp_path / 'a.pdf').stat().st_size > 10_000
    monkeypatch.setattr(font_manager, 'findSystemFonts', list)
    code, out, err = run(capsys, *small)
    assert (code, out) == (2, '')
    assert err.count('\n') == 1
    assert 'fonts-noto-cjk' in err


@pytest.mark.parametrize(('lang', 'tag'), [(None, '<html lang="en">'), ('zh', '<html lang="en" data-lang="zh">')])
def test_the_page_is_served_in_the_language_that_is_asked_for(lang, tag):
    data = ViewData(SceneSource('x', load_scene('winding', ['dragon.benches=3', 'run.stop_s=1'])), lambda rows: rows)
    with ViewServer(data, lang=lang) as server:
        serving = Thread(target=server.serve_forever, args=(0.01,))
        serving.start()
        try:
            with urllib.request.urlopen(server.url, timeout=20) as answer:
                assert tag in answer.read().decode()
        finally:
            server.shutdown()
            serving.join()
