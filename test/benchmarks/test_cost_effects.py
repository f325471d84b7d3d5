"""The page ``cost effects`` lists the costs of effects and of whole ticks, and writes its files."""
import numpy as np
import pytest

from benchmarks import command, effects, wholes
from benchmarks.stages import multiplications
from dragon_ros.core.flags import Effect
from dragon_ros.core.scene import Scene
from dragon_ros.core.step import state, tick
from dragon_ros.cost import effects as prices
from dragon_ros.cost.measure import Timing
from dragon_ros.messages.encode import encoders
from dragon_ros.scenes.load import load_scene

TIMING = Timing(1e-5, 0.9e-5, 1.1e-5, 20)


def test_the_bytes_of_an_effect_are_those_of_its_topics_alone():
    scene = load_scene('minimal', ['dragon.benches=9'])
    row = prices.price(Effect.BENCHES, scene, 0.0)
    full = load_scene('minimal', ['dragon.benches=9', 'effects=[benches]'])
    assert row.size == len(encoders(full)['benches'](tick(full, 0)))
    assert row.timing.calls >= 15


def test_an_effect_is_priced_with_what_it_needs_on_both_sides():
    row = prices.price(Effect.CLEARANCE, load_scene('minimal', ['dragon.benches=9']), 0.0)
    assert row.size == 12


def test_what_sim_does_not_compute_has_no_price_and_every_scene_has_accelerations():
    turning = load_scene('turning', ['dragon.benches=9'])
    assert prices.price(Effect.ACCELERATIONS, turning, 0.0).timing.calls >= 15
    assert prices.price(Effect.CLOCK, Scene(), 0.0).timing is None


def test_a_build_without_effects_makes_the_same_bytes_as_a_scene_with_none():
    scene = load_scene('minimal', ['dragon.benches=9'])
    with_effects, without = wholes.worker(scene), wholes.bare(scene)
    assert [with_effects() for _ in range(3)] == [without() for _ in range(3)]


def test_the_limit_of_a_whole_tick_is_to_place_its_handles_and_to_copy_its_messages():
    scene = load_scene('minimal')
    terms = multiplications(state(scene, 0.0)) / 448
    size = len(encoders(scene)['handles'](tick(scene, 0)))
    rates = {'product': 1e12, 'cache': 1e9}
    assert wholes.limit_of(scene, rates) == pytest.approx(1e-9 * (8 * 448 * terms + size))
    more = load_scene('minimal', ['effects=[benches]'])
    added = len(encoders(more)['benches'](tick(more, 0)))
    assert wholes.limit_of(more, rates) - wholes.limit_of(scene, rates) == pytest.approx(1e-9 * added)


def test_the_page_is_written_as_table_csv_and_pictures(tmp_path):
    rows = effects.Measured(
        {scene: [prices.Price('benches', 100, TIMING), prices.Price('clock', 0, None)]
         for scene in (effects.ALONE, 'first_contact')},
        [wholes.Whole('minimal', TIMING, 0.2, 'everything on', 4e-6)])
    with np.errstate(all='warn'):
        paths = command.write('effects', rows, tmp_path)
    assert [path.name for path in paths] == ['effects.md', 'effects.csv', 'effects.png', 'effects.svg']
    assert all(path.stat().st_size for path in paths)
    assert '| benches | 100 | 10 | 10 |' in effects.table(rows)
    assert '| clock | 0 | - | - |' in effects.table(rows)
    assert '| minimal | 10 | 9 to 11 | 0.200 | everything on | 4 | 2.50 |' in effects.table(rows)
