"""Every sentence of ``grade`` exists in both languages with the same parameters and is used."""
import re
from pathlib import Path
from string import Formatter

import dragon_contest as contest
from dragon_contest import grade
from dragon_contest.grade.words import WORDS, handle_name, sentence

FILES = [path for package in (grade, contest) for path in Path(package.__file__).parent.glob('*.py')
         if path.name != 'words.py']
SOURCES = '\n'.join(path.read_text() for path in (
    *FILES, Path(__file__).parents[2] / 'docs/examples/common_mistakes.py'))
MADE = ('turn_', 'short_')        # prefixes of keys that the code composes


def parameters(text):
    return {name for _, name, _, _ in Formatter().parse(text) if name}


def test_both_languages_have_a_sentence_with_the_same_parameters():
    for key, (english, chinese) in WORDS.items():
        assert english, key
        assert parameters(english) == parameters(chinese), key
        assert re.search(r'[\u4e00-\u9fff]', chinese) or (key == 'at_time' and chinese), key


def test_every_key_that_the_code_names_has_a_sentence():
    named = set(re.findall(r"(?:Finding|Answer|sentence|_said|_pill)\('(\w+)'", SOURCES))
    named |= set(re.findall(r"notes\.append\(\('(\w+)'", SOURCES))
    assert len(named) > 40
    assert named <= set(WORDS)


def test_no_sentence_is_dead():
    used = set(re.findall(r'\'(\w+)\'|"(\w+)"', SOURCES))
    used = {*(one or other for one, other in used), 'section', 'tail', 'rear', 'head'}
    assert {key for key in WORDS if not key.startswith(MADE)} <= used


def test_terms_are_the_contests():
    assert [handle_name(n, 'zh') for n in (0, 5, 222, 223)] == [
        '龙头前把手', '第5节龙身前把手', '龙尾前把手', '龙尾后把手']
    assert sentence('turn_diameter', {'diameter': 8.5}, 'zh') == '调头空间直径取 8.5 m，而不是 9 m'
    assert sentence('near_counts', {'near': 0.001}) == 'a gap below 1 mm counts as contact'
