"""Messages of several frames that are encoded together have the same bytes as those of single frames."""
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from properties import examples

from dragon_ros.core.chain.dragon import Dragon
from dragon_ros.core.flags import Effect
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.step import tick
from dragon_ros.messages.encode import encoders
from dragon_ros.messages.fixed_size import FixedSize, Together, each

SCENE = Scene(dragon=Dragon(24), run=Run(400, 413, 20), effects=~Effect.NONE)
FRAMES = [tick(SCENE, k) for k in range(7)]
CHANGING = {'model/clearance', 'model/contacts', 'model/markers', 'forces', 'trail', 'model/diagnostics', 'leader'}


@pytest.mark.parametrize('markers', ['cubes', 'triangles'])
@examples(50, long=100)
@given(st.lists(st.sampled_from(FRAMES), min_size=1, max_size=12), st.lists(st.sampled_from(FRAMES), min_size=1))
def test_frames_encoded_together_in_any_number_and_order_have_the_bytes_of_single_ones(markers, some, others):
    encode = encoders(replace(SCENE, markers=markers))
    for frames in (some, others):
        together = Together(frames)
        for name, one in encode.items():
            assert each(one, together) == [encode[name](frame) for frame in frames], name


def test_templates_serve_every_topic_but_those_whose_size_or_content_is_free():
    assert {name for name, one in encoders(SCENE).items() if not isinstance(one, FixedSize)} == CHANGING


def test_messages_encoded_together_do_not_change_when_the_next_ones_are():
    encode = encoders(SCENE)['benches']
    held = each(encode, Together(FRAMES[:3]))
    each(encode, Together(FRAMES[3:]))
    assert held == [encode(frame) for frame in FRAMES[:3]]


def test_arrays_are_stacked_once_for_all_topics(monkeypatch):
    stacked, stack = [], np.stack
    monkeypatch.setattr(np, 'stack', lambda arrays: stacked.append(arrays[0]) or stack(arrays))
    together = Together(FRAMES)
    for name in ('handles', 'benches', 'velocities', 'cloud'):
        each(encoders(SCENE)[name], together)
    frame = FRAMES[0]
    wanted = (frame.chain.p, frame.axis, frame.benches.centre, frame.velocity_m_s)
    assert {id(one) for one in stacked} == {id(one) for one in wanted}
    assert len(stacked) == 4
