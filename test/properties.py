"""Random tracks and the number of examples (fewer in the profile ``brief``), shared by property tests."""
from dataclasses import fields, replace
from math import exp, log

import pytest
from hypothesis import settings
from hypothesis import strategies as st

from dragon_ros.core.chain.dragon import Dragon, Group, Mixed
from dragon_ros.core.chain.head_law import Head
from dragon_ros.core.tracks.spec import Arc, Composite, Line, Spiral, SpiralArc, STurn

# Factors with which ``magnified`` lengths reach the largest of the world; the strategies draw the smallest links.
FACTORS = st.floats(0.0, log(16.0)).map(exp)
USUAL = 100         # default number of examples of a property; explicit numbers are relative to it
PIECES = st.lists(st.one_of(
    st.builds(Line, st.floats(0.1, 9)),
    st.builds(lambda radius, angle, left: Arc(radius, angle if left else -angle), st.floats(1.8, 9), st.floats(5, 300),
              st.booleans()),
    st.builds(SpiralArc, st.floats(0.3, 3), st.floats(3, 4), st.floats(1.5, 2.9), st.sampled_from(['left', 'right']))),
    min_size=1, max_size=6).map(lambda segments: Composite(tuple(segments)))
TRACKS = st.one_of(st.builds(Spiral, st.floats(0.3, 4), st.floats(0.5, 6)), PIECES,
                   st.builds(STurn, st.floats(1, 2), st.floats(9, 14), st.floats(0.5, 2), st.floats(-30, 30)))


def magnified(scene, factor):
    """Return a scene whose lengths and speeds are multiplied by a factor."""
    dragon, track, head = scene.dragon, scene.track, scene.head
    sizes = {'width_m': factor * dragon.width_m, 'hole_inset_m': factor * dragon.hole_inset_m}
    if isinstance(dragon, Mixed):
        dragon = Mixed(tuple(Group(factor * group.length_m, group.count) for group in dragon.groups), **sizes)
    else:
        dragon = Dragon(dragon.benches, factor * dragon.head_length_m, factor * dragon.body_length_m, **sizes)
    if isinstance(track, Composite):
        track = Composite(tuple(_larger(piece, factor) for piece in track.pieces), factor * track.start_m)
    else:
        track = _larger(track, factor)
    if isinstance(head, Head):
        head = replace(head, speed_m_s=factor * head.speed_m_s)
    else:
        head = replace(head, knots=tuple((t_s, factor * speed_m_s) for t_s, speed_m_s in head.knots))
    return replace(scene, dragon=dragon, track=track, head=head)


def _larger(piece, factor):
    return replace(piece, **{field.name: factor * getattr(piece, field.name) for field in fields(piece)
                             if field.name in ('length_m', 'radius_m', 'pitch_m', 'diameter_m', 'before_m')})


def thinned(cases, kept):
    """Return the parameters of a test; those for which ``kept`` is false run only with ``--long``."""
    out = [case if kept(case) else pytest.param(*(case if isinstance(case, tuple) else (case,)), marks=pytest.mark.long)
           for case in cases]
    assert any(kept(case) for case in cases)
    return out


def examples(count: int, long: int | None = None) -> settings:
    """Return the settings of a property with ``count`` examples, scaled by the profile to two or more.

    With ``long``, a property has this count in all profiles except the one by default.
    """
    if long is not None and settings().max_examples != settings.get_profile('usual').max_examples:
        count = long
    return settings(max_examples=max(2, count * settings().max_examples // USUAL))
