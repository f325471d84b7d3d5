"""Honest certificates for every kind of run are accepted, and the result states their claim."""
import json
from itertools import islice
from pathlib import Path

import pytest
from certificates import proved, refusal, written
from properties import thinned
from runs import certificates

from dragon_ros.core.chain.dragon import Dragon, Group, Mixed
from dragon_ros.core.chain.head_law import Head, Profile
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.search.certificate import NoContact
from dragon_ros.core.search.first_contact import first_contact
from dragon_ros.core.tracks.spec import Arc, Composite, Line, Spiral, SpiralArc, STurn
from dragon_ros.scenes.certificate import of_claim
from dragon_ros.scenes.load import load_scene, scene_of
from dragon_ros.scenes.yaml import Document

CROSSING = Dragon(14, 0.9, 2.9, 0.2)       # at 4.28 turns, the head is between two positions at which the body touches
LOOP = Composite((Line(5.0), Arc(3.0, 720.0)))
OUT_AND_IN = Profile(((0.0, 0.0), (5.0, -1.0), (15.0, -1.0), (25.0, 1.0), (60.0, 1.0)), 'smooth')
SCENES = {
    'the classic contact': (Scene(), 'contact at 412.4738376821'),
    'seven hundred turns out': (load_scene('winding', ['dragon.benches=200', 'track.start_turns=700', 'run.stop_s=20']),
                               'end of the run at 20 s (it stops)'),
    'the fastest head': (Scene(head=Head(100.0), dragon=Dragon(40), run=Run(4.0)), 'contact at 4.12473837682'),
    'a tail led backwards': (Scene(head=Head(-1.0, 'tail'), dragon=Dragon(40), run=Run(0, 20)),
                             'end of the run at 0 s (the head is back at the end of the track)'),
    'a lock': (Scene(dragon=Dragon(12, width_m=0.01), run=Run(425.0)),
               '432.917923228 s (the chain locks at link 0), less 1 nm of leader travel'),
    'a lock that is reached from far out': (Scene(dragon=Dragon(2), track=Spiral(start_turns=759.0)),
                                            'the chain locks at link 0'),
    'a lock of the second link': (Scene(dragon=Dragon(2, 1.65, 2.2, 0.01), run=Run(420.0)), 'locks at link 1'),
    'a lock of a mixed dragon': (Scene(dragon=Mixed((Group(1.2), Group(3.2), Group(1.2)), 0.01), run=Run(420)),
                                 'locks at link 1'),
    'the centre': (Scene(dragon=Dragon(3, width_m=0.01), track=Spiral(5.0, 1.0)), 'the head reaches the centre'),
    'the centre, near which a handle turns back': (
        Scene(Dragon(10, 0.3125, 0.53125, 0.125, 0.125), Spiral(0.37109375, 4.0)), 'the head reaches the centre'),
    'at the start': (Scene(run=Run(413.0)), 'starts with its contact at 413.0 s: benches 0 and 8 overlap'),
    'two benches': (Scene(dragon=Dragon(2)), 'the chain locks at link 0'),
    'out and in': (Scene(dragon=Dragon(60), track=Spiral(0.55, 5.0), head=OUT_AND_IN, run=Run(2, 200)), 'contact at'),
    'a body in': (Scene(dragon=CROSSING, track=Spiral(0.55, 4.28), run=Run(0, 5)), 'benches 1 and 7 overlap'),
    'a body out': (Scene(dragon=CROSSING, track=Spiral(0.55, 4.28), head=Head(-1.0), run=Run(0, 5)),
                   'benches 2 and 10 overlap'),
    'a tail': (Scene(dragon=CROSSING, track=Spiral(0.55, 4.28), head=Head(1.0, 'tail'), run=Run(0, 5)), 'contact at'),
    'unwinding': (load_scene('unwinding', ['run.stop_s=40', 'dragon.benches=40']), 'it stops'),
    'rest': (Scene(dragon=Dragon(30), head=Head(0.0), run=Run(0, 5)), 'it stops'),
    'a mixed dragon': (load_scene('mixed', ['run.start_s=395.6']), 'benches 40 and 71 overlap'),
    'two alternating lengths': (Scene(dragon=Mixed((Group(3.41), *(Group(length) for _ in range(12) for length in (
        2.2, 1.7)))), run=Run(405)), 'benches 0 and 9 overlap'),
    'an S-turn': (Scene(dragon=Dragon(60), track=STurn(before_m=100.0), run=Run(95, 115)), 'it stops'),
    'a tight S-turn': (Scene(dragon=Dragon(24), track=STurn(0.8, before_m=100.0), run=Run(95, 200)),
                       'benches 0 and 15 overlap'),
    'a loop': (Scene(dragon=Dragon(20), track=LOOP, run=Run(0, 30)), 'contact at 22.16017797'),
    'back and forth': (Scene(dragon=Dragon(20), track=LOOP, run=Run(3, 100), head=Profile(
        ((0.0, 0.0), (5.0, 1.0), (10.0, -1.0), (20.0, -1.0), (30.0, 1.0)))), 'contact at 59.66017797'),
    'a tail on a bent track': (Scene(dragon=Dragon(10), run=Run(0, 30), head=Head(1.0, 'tail'), track=Composite(
        (Line(50.0), Arc(3.0, -200.0), Line(1.0), SpiralArc(1.2, 2, 4.0)), start_m=70.0)), 'it stops'),
    'a track whose end rounds to a float beyond it': (
        Scene(dragon=Dragon(12), head=Head(1.0, 'tail'), run=Run(0, 20), track=Composite(
            (Line(5.0), SpiralArc(1.2, 500.2, 8.0)), start_m=942996.0497072366)), 'it stops'),
    'the end of the track': (Scene(dragon=Dragon(20), track=Composite((Line(5.0), Arc(6.0, 120.0)))),
                             'the head leaves the track'),
    'the beginning of the track': (Scene(dragon=Dragon(3), head=Head(-1.0), track=Composite((
        SpiralArc(3.0, 0.6, 3.0, 'left'), Line(9.0)), 12.0)), 'the tail leaves the track'),
    'a tail that leaves the track': (Scene(dragon=Dragon(3), head=Head(1.0, 'tail'), track=Composite((
        SpiralArc(3.0, 0.6, 3.0, 'left'), Line(9.0)), 12.0)), 'the tail leaves the track'),
    'arcs of the smallest allowed radius': (Scene(
        dragon=Dragon(11, 0.966718771980368, 1.1818753216942577, 0.02, 0.2), head=Head(-1.0), run=Run(0, 13.3),
        track=Composite((Arc(0.3952814126343191, 60.0), Arc(0.39838471924996127, 60.0), Arc(0.3952814126343191, -60.0),
                         Line(4.031361119055089)), 1.32155815303957)), 'starts with its contact'),
    'a coil of the smallest allowed radius': (Scene(
        dragon=Dragon(3, 1.4936533138512713, 1.4936533138512713, 0.02, 0.2), run=Run(0, 6.38),
        track=Composite((Line(4.142785360579651), Arc(0.5538751550657687, -90.0),
                         Arc(0.5523507108609016, 139.51910430136803), SpiralArc(
                             0.6873618061857618, 0.8183657181230056, 1.4822288808789037, 'left'), Line(1.0)),
                        2.4931853313160652)), 'it stops'),
    'decimetres': (Scene(dragon=Dragon(30, 0.341, 0.22, 0.03, 0.0275), track=Spiral(0.055, 16.0), head=Head(0.1),
                         run=Run(380, 413)), 'benches 0 and 8 overlap')}


SIMILAR = ('ten thousand turns out', 'a tail led backwards', 'a lock that is reached from far out', 'a body in',
           'unwinding', 'a loop', 'a tight S-turn', 'two alternating lengths', 'the centre',
           'a tail that leaves the track', 'millimetres', 'a third of the speed of light', 'a tail', 'a body out',
           'a lock', 'two benches', 'out and in',
           'a mixed dragon')        # to others of the scenes or of test_tampering.py


@pytest.mark.parametrize('name', thinned(SCENES, lambda name: name not in SIMILAR))
def test_an_honest_certificate_is_accepted(name):
    scene, said = SCENES[name]
    assert said in proved(written(scene))


MADE_BY_0_2_0 = Path(__file__).parents[1] / 'data' / 'made_by_0_2_0'
SAID_OF_0_2_0 = {
    'back_and_forth': 'from 3.0 s to the contact at 59.6601779',
    'contact': 'from 400.0 s to the contact at 412.4738376821',
    'contact_at_the_start': 'starts with its contact at 413.0 s: benches 0 and 8 overlap',
    'contact_of_mixed_benches': 'from 395.6 s to the contact at 395.6223649811',
    'contact_on_a_turn': 'from 0.0 s to the contact at 18.8575054155',
    'end_of_the_track': 'end of the run at 17.5663706144 s (the head leaves the track)',
    'lock': 'end of the run at 432.917923228 s (the chain locks at link 0)',
    'unwinding_tail': 'end of the run at 40 s (it stops)'}


@pytest.mark.parametrize('name', thinned(SAID_OF_0_2_0, lambda name: name not in (
    'contact', 'contact_on_a_turn', 'contact_of_mixed_benches')))
def test_what_a_certificate_of_0_2_0_says_is_found_and_proved_again(name):
    values = json.loads((MADE_BY_0_2_0 / f'{name}.json').read_text())
    scene = scene_of(Document(name, values['scene']))
    assert SAID_OF_0_2_0[name] in proved(written(scene))
    found, known = first_contact(scene), values['contact']
    if isinstance(found, NoContact):
        assert known == {'t_s': None}
    else:
        assert known['benches'] == list(found.benches)
        assert abs(known['t_s'] - found.t_s) <= 2 * found.uncertainty_s


@pytest.mark.parametrize('changes', [{'version': None}, {'version': 2}, {'version': 3}, {'family': 1}], ids=str)
def test_certificates_of_earlier_versions_are_refused_with_the_release_that_verifies_them(changes):
    values = json.loads((MADE_BY_0_2_0 / 'contact.json').read_text()) | {
        key: value for key, value in changes.items() if value}
    assert refusal(values) == 'it is a certificate of dragon_ros 0.1 to 0.3; dragon_ros 0.3.0 verifies it'


@pytest.mark.parametrize('seed', thinned(range(4), lambda seed: seed < 2))
def test_random_honest_certificates_are_accepted(seed):
    """More certificates can be checked by hand: ``python test/verify/runs.py SEED COUNT``."""
    for _, _, values in islice(certificates(f'suite {seed}'), 8):
        proved(values)


def test_benches_that_all_go_round_one_circle_are_cleared_at_once_however_near_they_are():
    circle = Scene(dragon=Dragon(4, 4.119728142305396, 4.119728142305396, 0.3, 1.059864071152698),
                   track=Composite((Arc(4.0, 360.0),), 1.0), run=Run(0, 10))
    assert 'it stops' in proved(of_claim(circle, {'t_s': None}), effort=1e-3)


def test_a_bench_between_two_lines_of_one_heading_is_cleared_in_bounded_time():
    hairpin = Composite((Line(40.0), Arc(1.5, 180.0), Line(40.0)), 70.0)
    scene = Scene(dragon=Dragon(20, width_m=0.3), track=hairpin, run=Run(0, 12))
    assert 'it stops' in proved(of_claim(scene, {'t_s': None}), effort=0.1)


@pytest.mark.parametrize('width', thinned([0.30097406, 0.3009740686, 0.30097406869751],
                                          lambda width: width > 0.30097406865))
def test_a_certain_contact_after_a_near_miss_of_nanometres_is_proved(width):
    scene = Scene(dragon=Dragon(20, width_m=width), run=Run(408))
    assert 'contact at 412.44300' in proved(written(scene))
