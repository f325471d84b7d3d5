"""Random tracks and the number of examples (fewer in the profile ``brief``), shared by property tests."""
import pytest
from hypothesis import settings
from hypothesis import strategies as st

from dragon_ros.core.tracks.spec import Arc, Composite, Line, Spiral, SpiralArc, STurn

USUAL = 100         # default number of examples of a property; explicit numbers are relative to it
PIECES = st.lists(st.one_of(
    st.builds(Line, st.floats(0.1, 9)),
    st.builds(lambda radius, angle, left: Arc(radius, angle if left else -angle), st.floats(1.8, 9), st.floats(5, 300),
              st.booleans()),
    st.builds(SpiralArc, st.floats(0.3, 3), st.floats(3, 4), st.floats(1.5, 2.9), st.sampled_from(['left', 'right']))),
    min_size=1, max_size=6).map(lambda segments: Composite(tuple(segments)))
TRACKS = st.one_of(st.builds(Spiral, st.floats(0.3, 4), st.floats(0.5, 6)), PIECES,
                   st.builds(STurn, st.floats(1, 2), st.floats(9, 14), st.floats(0.5, 2), st.floats(-30, 30)))


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
