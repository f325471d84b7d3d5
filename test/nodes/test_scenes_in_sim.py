"""Every scene of the package runs in sim, and every effect is published and recorded as in the model."""
import pytest
from properties import thinned

from dragon_ros.bags.check.compare import compare_with_model
from dragon_ros.bags.read.reader import BagReader
from dragon_ros.configuration import scene_names
from dragon_ros.core.errors import InputError
from dragon_ros.core.flags import Effect, known
from dragon_ros.core.model import compile_scene
from dragon_ros.messages.channels import live
from dragon_ros.scenes.load import load_scene

TICKS = 3
CONTACT = 'run.start_s=412.4', 'run.stop_s=412.5', 'run.rate_hz=20'


def recorded(start, bag, scene, changes):
    """Run a scene in sim and record it; check that every message equals the model's, and return the bag's topics."""
    loaded = load_scene(scene, changes)
    topics = [row.name for row in live(loaded.effects)]
    record = start('record', '--output', bag)
    overrides = [part for change in changes for part in ('--set', change)]
    readers = ','.join(f'{name}=1' for name in topics)
    scale = 1.0 if loaded.is_led else 0.0       # commands arrive in real time
    sim = start('sim', '--scene', scene, *overrides, '--ros-args', '-p', f'time_scale:={scale}',
                '-p', f'wait_subscribers:=[{readers}]')
    assert sim.end() == 0, sim.text
    assert record.end() == 0, record.text
    with BagReader(bag) as run:
        result = compare_with_model(run, loaded)
        assert result.faults == []
        assert result.equal == len(topics) * (compile_scene(loaded).last_tick + 1)
        there = {topic.name.removeprefix('/dragon/') for topic in run.topics}
        latched = {'track', 'scene', *(['venue'] if loaded.venue is not None else [])}
        assert latched <= there
        return there - latched - {'path'}


# The scenes that differ most: a dragon that is led, mixed benches, obstacles, and a tail that leads. The others run
# with --long.
HARDEST = 'mixed', 'street', 'unwinding'      # test_led.py runs the scene led


@pytest.mark.parametrize('scene', thinned(scene_names(), HARDEST.__contains__))
def test_every_scene_runs_in_sim(start, tmp_path, scene):
    run = load_scene(scene).run
    changes = (f'run.stop_s={run.start_s + (TICKS - 1) / run.rate_hz}',)
    assert recorded(start, tmp_path / 'a.mcap', scene, changes) == {
        row.name for row in live(load_scene(scene).effects)}


def test_all_effects_at_once_are_recorded_to_the_last_bit_through_a_contact(start, tmp_path):
    names = ', '.join(known())
    topics = recorded(start, tmp_path / 'a.mcap', 'winding', (*CONTACT, f'effects=[{names}]'))
    assert topics == {row.name for row in live(~Effect.NONE)}


def test_the_clock_effect_brings_the_clock(start, node):
    from rosgraph_msgs.msg import Clock
    heard = []
    node.create_subscription(Clock, '/clock', heard.append, 10)
    sim = start('sim', '--scene', 'minimal', '--set', 'effects=[clock]', '--set', 'run.start_s=7', '--ros-args', '-p',
                'discovery_s:=0.0')
    node.until(lambda: heard)
    assert 7 <= heard[0].clock.sec < 60
    assert sim.stop() == 0, sim.text


def test_options_set_follow_the_parameter_set(start):
    sim = start('sim', '--scene', 'minimal', '--set', 'run.stop_s=1', '--ros-args', '-p',
                'set:=[run.stop_s=3, run.rate_hz=7]', '-p', 'time_scale:=0.0', '-p', 'discovery_s:=0.0')
    assert sim.end() == 0
    assert 'tick 0 of 8' in sim.text


@pytest.mark.parametrize('count', ['99999999999999999999', '1001', '-1', '9' * 5000, '\u0661', '', 'x'])
def test_nobody_waits_for_subscribers_that_cannot_come(count):
    from dragon_ros.nodes.publisher_queue import wanted_readers
    with pytest.raises(InputError, match='is not TOPIC=NUMBER with a number up to 1000'):
        wanted_readers([f'handles={count}'], {'handles': None})
