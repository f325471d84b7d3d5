"""Each Chinese page has the commands, figures, links and terms of its English page."""
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
ENGLISH = {ROOT / 'README.zh.md': ROOT / 'README.md',
           **{path: ROOT / 'docs' / path.name for path in sorted((ROOT / 'docs' / 'zh').glob('*.md'))}}
_CODE = re.compile(r'^```\w*\n.*?^```$|^(?:    [^\n]*\n)+', re.DOTALL | re.MULTILINE)
# Only the English page contains generated tables.
_MADE = re.compile(r'<!-- (?:cost|table) .*?<!-- end -->', re.DOTALL)
_FIGURE = re.compile(r'(?<![A-Za-z0-9_.])\d[\d,]*(?:\.\d+)?(?:e[+-]?\d+)?')


def code(text):
    """Return the lines of code and of shown output, without the comments, because these are translated."""
    lines = (line.partition('#')[0].rstrip() for block in _CODE.findall(_MADE.sub('', text)) for line in
             block.splitlines())
    return [line for line in lines if line.strip()]


def figures(text):
    """Return the numbers of two or more digits in prose and in tables, as written."""
    prose = re.sub(r'\]\([^)]*\)|`[^`]*`', '', _CODE.sub('', _MADE.sub('', text)))
    return {figure for found in _FIGURE.findall(prose) if len(figure := found.rstrip(',')) > 1}


def links(path, text):
    """Return the files to which a page links, with a Chinese page replaced by the English page that it translates."""
    targets = (target.partition('#')[0] for target in re.findall(r'\]\(([^)\s]+)\)', _MADE.sub('', text)))
    files = {(path.parent / target).resolve() for target in targets if target and '://' not in target}
    return {ENGLISH.get(file, file) for file in files}


def terms(text):
    """Return the first two columns of the glossary's tables: English and Chinese, in the order of the page."""
    rows = [[cell.strip() for cell in line.split('|')[1:-1]] for line in text.splitlines() if line.startswith('| ')]
    return [row[:2] for row in rows]


@pytest.fixture(params=ENGLISH, ids=lambda path: str(path.relative_to(ROOT)))
def pages(request):
    """A Chinese page and its English page, each with its text."""
    chinese, english = request.param, ENGLISH[request.param]
    return (chinese, chinese.read_text(encoding='utf-8')), (english, english.read_text(encoding='utf-8'))


def behind(pages, here, there):
    """Return a message that names the outdated page and the missing parts."""
    (chinese, _), (english, _) = pages
    return (f'{chinese.relative_to(ROOT)} is behind {english.relative_to(ROOT)}: lacks {sorted(there - here)}, '
            f'has alone {sorted(here - there)}')


def test_a_chinese_page_has_the_commands_of_the_english_one(pages):
    (_, chinese), (_, english) = pages
    assert code(chinese) == code(english)


def test_a_chinese_page_has_the_figures_of_the_english_one(pages):
    (_, chinese), (_, english) = pages
    assert figures(chinese) == figures(english), behind(pages, figures(chinese), figures(english))


def test_a_chinese_page_has_the_links_of_the_english_one(pages):
    here, there = (links(path, text) for path, text in pages)
    here, there = (set(map(str, one - {pages[1][0]})) for one in (here, there))
    assert here == there, behind(pages, here, there)


def test_a_chinese_page_leads_to_the_english_one_and_says_whether_a_native_reader_has_read_it(pages):
    (path, chinese), (english, _) = pages
    assert english in {(path.parent / target).resolve() for target in re.findall(r'\]\(([^)#\s]+)\)', chinese)}
    assert '母语读者审校' in chinese


def test_the_chinese_glossary_has_every_word_of_the_english_one():
    chinese, english = (terms((ROOT / 'docs' / folder / 'glossary.md').read_text(encoding='utf-8')) for folder in
                        ('zh', ''))
    assert [row[1] for row in chinese if row[1] != 'English'] == [row[0] for row in english if row[0] != 'word']


def test_a_changed_figure_or_command_is_seen():
    page = (ROOT / 'docs' / 'zh' / 'cumcm-2024-a.md').read_text(encoding='utf-8')
    assert figures(page) != figures(page.replace('0.450340', '0.450341'))
    assert code(page) != code(page.replace('--near-misses 0.01', '--near-misses 0.02'))
