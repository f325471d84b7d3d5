"""``docs/answers.json`` contains the right answers within their uncertainties, in the form of its schema."""
import json
from pathlib import Path

import numpy as np
import pytest

from dragon_contest.answers import right_answers
from dragon_contest.grade.team import answers_of, truth_of
from dragon_contest.grade.truth import truth_at
from dragon_ros.__main__ import main

DOCS = Path(__file__).parents[2] / 'docs'
PUBLISHED = json.loads((DOCS / 'answers.json').read_text(encoding='utf-8'))


def test_the_published_answers_are_those_that_the_command_writes(tmp_path):
    out = tmp_path / 'answers.json'
    assert main(['grade', '--right-answers', '--output', str(out)]) == 0
    made = json.loads(out.read_text(encoding='utf-8'))

    def alike(one, other):
        if isinstance(one, dict):
            return one.keys() == other.keys() and all(alike(one[key], other[key]) for key in one)
        if isinstance(one, list):
            return len(one) == len(other) and all(map(alike, one, other))
        return abs(one - other) < 1e-9 if isinstance(one, float) else one == other
    assert alike(made, PUBLISHED)


def test_the_published_answers_have_the_form_of_their_schema():
    jsonschema = pytest.importorskip('jsonschema')
    jsonschema.validate(PUBLISHED, json.loads((DOCS / PUBLISHED['$schema']).read_text(encoding='utf-8')))


def test_every_published_answer_is_right_within_its_uncertainty():
    assert PUBLISHED['answers'].keys() == {'t_s', 'pitch_m', 'turn_m', 'speed_m_s'}
    for question, one in PUBLISHED['answers'].items():
        assert abs(one['value'] - truth_of(question)) <= one['uncertainty'] < 2e-9
        assert answers_of(DOCS / 'answers.json')[question] == one['value']


@pytest.mark.parametrize(('result', 'count'), [('result1', 42), ('result2', 7), ('result4', 35)])
def test_every_published_state_is_right_within_its_uncertainty(result, count):
    one = PUBLISHED['states'][result]
    assert len(one['rows']) == count
    for row in one['rows']:
        p, v = truth_at(result, np.array([row['t_s']]))
        assert np.abs(p[0, row['handle']] - (row['x_m'], row['y_m'])).max() <= one['uncertainty_m']
        assert abs(v[0, row['handle']] - row['speed_m_s']) <= one['uncertainty_m_s']


def test_answers_in_the_published_form_are_graded_for_programs(tmp_path, capsys):
    given = right_answers()
    given['answers']['turn_m']['value'] = 14.1372
    (tmp_path / 'answers.json').write_text(json.dumps(given), encoding='utf-8')
    assert main(['grade', '--answers', str(tmp_path / 'answers.json'), '--format', 'json']) == 0
    found = json.loads(capsys.readouterr().out)['teams'][0]['answers']
    assert {one['question']: (one['verdict'], [cause['key'] for cause in one['findings']]) for one in found} == {
        't_s': ('right', []), 'pitch_m': ('right', []), 'turn_m': ('wrong', ['half_turns']), 'speed_m_s': ('right', [])}


@pytest.mark.parametrize('text', ['{"t_s": 412.473838, "turn_m": 13.6212}', '{"red": {"t_s": 412.473838}}',
                                  '{"t_s": {"value": 412.473838}}'])
def test_plain_json_is_accepted(tmp_path, capsys, text):
    (tmp_path / 'a.json').write_text(text, encoding='utf-8')
    assert main(['grade', '--answers', str(tmp_path / 'a.json')]) == 0
    assert 'right' in capsys.readouterr().out


def test_the_right_answers_take_no_other_options(capsys):
    assert main(['grade', '--right-answers', '--t', '412']) == 2
    assert 'does not accept it' in capsys.readouterr().err
