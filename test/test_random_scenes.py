"""The generator draws every kind of random scene, a seed produces the same scene everywhere, and most scenes load."""
import ast
import hashlib
import json
import sys
from collections import Counter
from itertools import pairwise

import pytest
import random_scenes
from random_scenes import KINDS, kind_of, random_scene

from dragon_ros.core.errors import DragonError
from dragon_ros.scenes.load import scene_of
from dragon_ros.scenes.yaml import Document

SEEDS = range(400)
FOR_GOOD = 'cf9af92c0e89bb31f8579c0a7dd21257e48215e1bd77ce65faa5fab238cf840d'    # the digest of all scenes of SEEDS


@pytest.fixture(scope='module')
def scenes():
    return [random_scene(seed) for seed in SEEDS]


def test_a_seed_is_one_scene_for_good(scenes):
    assert hashlib.sha256(json.dumps(scenes).encode()).hexdigest() == FOR_GOOD
    assert random_scene(3) == scenes[3] != random_scene(4)


def test_the_generator_knows_nothing_of_the_package():
    with open(random_scenes.__file__, encoding='utf-8') as file:
        tree = ast.parse(file.read())
    names = {node.module if isinstance(node, ast.ImportFrom) else name.name
             for node in ast.walk(tree) if isinstance(node, (ast.Import, ast.ImportFrom)) for name in node.names}
    assert names <= sys.stdlib_module_names


def test_every_kind_of_track_comes_about_as_often_as_it_should():
    found = Counter(map(kind_of, SEEDS))
    assert found.keys() == KINDS.keys()
    assert all(0.5 * part < found[kind] / 4 < 2 * part for kind, part in KINDS.items())


def lengths_of(dragon):
    if 'groups' in dragon:
        return [group['length_m'] for group in dragon['groups']]
    return [dragon['head_length_m'], dragon['body_length_m']]


def speeds_of(head):
    return [speed for _, speed in head['knots']] if 'knots' in head else [head['speed_m_s']]


def times_of(head):
    return [t_s for t_s, _ in head.get('knots', [])]


def pieces_of(scene):
    return scene['track'].get('pieces', [])


FEATURES = {        # the minimum number of scenes that must have the feature
    'a tail that leads': (40, lambda scene: scene['head'].get('lead') == 'tail'),
    'a leader that moves backwards': (40, lambda scene: min(speeds_of(scene['head'])) < 0),
    'a profile': (60, lambda scene: 'knots' in scene['head']),
    'smooth ramps': (15, lambda scene: scene['head'].get('ramps') == 'smooth'),
    'a profile that turns back': (15, lambda scene: min(speeds_of(scene['head'])) < 0 < max(speeds_of(scene['head']))),
    'a jump': (15, lambda scene: any(before == after for before, after in pairwise(times_of(scene['head'])))),
    'a rest': (5, lambda scene: any(before == after == 0 for before, after in pairwise(speeds_of(scene['head'])))),
    'a leader that never moves': (3, lambda scene: set(speeds_of(scene['head'])) == {0}),
    'mixed benches': (60, lambda scene: 'groups' in scene['dragon']),
    'equal benches': (60, lambda scene: len(set(lengths_of(scene['dragon']))) == 1),
    'a longer head': (100, lambda scene: scene['dragon'].get('head_length_m', 0) > min(lengths_of(scene['dragon']))),
    'many benches': (15, lambda scene: scene['dragon'].get('benches', 0) > 100),
    'a few benches': (3, lambda scene: scene['dragon'].get('benches', 9) < 4),
    'no inset': (30, lambda scene: scene['dragon']['hole_inset_m'] == 0),
    'the smallest links': (1, lambda scene: min(lengths_of(scene['dragon']))
                           < 2 * scene['dragon']['hole_inset_m'] + 0.07),
    'wide benches': (3, lambda scene: scene['dragon']['width_m'] > 0.5 * min(lengths_of(scene['dragon']))),
    'small dragons': (10, lambda scene: max(lengths_of(scene['dragon'])) < 0.5),
    'large dragons': (5, lambda scene: max(lengths_of(scene['dragon'])) > 20),
    'places far out': (2, lambda scene: scene['track'].get('start_turns', 0) > 100),
    'a line': (60, lambda scene: any(piece['kind'] == 'line' for piece in pieces_of(scene))),
    'more than a circle': (40, lambda scene: any(abs(piece.get('angle_deg', 0)) > 360 for piece in pieces_of(scene))),
    'spirals in and out': (5, lambda scene: {piece['from_turns'] > piece['to_turns'] for piece in pieces_of(scene)
                                             if piece['kind'] == 'spiral'} == {True, False}),
    'no stop': (40, lambda scene: 'stop_s' not in scene['run']),
    'a late start': (30, lambda scene: scene['run'].get('start_s', 0) > 0),
    'noise': (20, lambda scene: 'noise' in scene.get('effects', []))}


@pytest.mark.parametrize('feature', FEATURES)
def test_many_scenes_have(scenes, feature):
    least, has = FEATURES[feature]
    assert sum(map(has, scenes)) >= least


def test_most_scenes_load_and_the_others_are_refused_with_a_reason(scenes, request):
    refused, some = 0, scenes if request.config.getoption('--long') else scenes[:120]
    for seed, values in enumerate(some):
        try:
            scene_of(Document(f'seed {seed}', values))
        except DragonError:
            refused += 1
    assert refused < 0.1 * len(some)
