"""``inspect --check`` notices each message that is deleted, repeated, altered, lengthened or logged at another time."""
from dataclasses import replace

import pytest

from dragon_ros.bags.check.compare import compare_with_model
from dragon_ros.bags.read.frames import law_on
from dragon_ros.bags.read.reader import BagReader
from dragon_ros.bags.write.writer import BagOptions, BagWriter
from dragon_ros.core.flags import Effect
from dragon_ros.core.model import compile_scene
from dragon_ros.core.step import led_tick, tick
from dragon_ros.messages.cdr import string_message
from dragon_ros.messages.channels import channels
from dragon_ros.messages.encode import encoders
from dragon_ros.messages.latched import latched_messages
from dragon_ros.scenes.load import load_scene
from dragon_ros.scenes.provenance import RECORD, run_metadata, scene_file

TICKS = 4


def determined():
    scene = load_scene('first_contact', ['dragon.benches=4', 'run.start_s=400', 'run.stop_s=400.06'])
    venue = load_scene('street').venue
    scene = replace(scene, effects=~Effect.CLOCK, venue=venue)
    return scene, [tick(scene, k) for k in range(TICKS)]


def led():
    scene = load_scene('led', ['dragon.benches=4', 'run.stop_s=100'])
    law, frames = None, []
    for k in range(TICKS):
        law = law_on(scene, law, scene.run.time_ns(k), 0.01 * (k > 0))
        frames.append(led_tick(compile_scene(scene), law, k))
    return scene, frames


def messages_of(scene, frames):
    """Return the messages of a run as (topic, number on its topic, log time, bytes)."""
    text = scene_file(scene)
    start_ns, encode = scene.run.start_ns, encoders(scene)
    latched = {'scene': string_message(text), **latched_messages(scene, 'dragon')}
    return [*((name, 0, start_ns, data) for name, data in latched.items()),
            *((name, k, frame.t_ns, bytes(encode[name](frame))) for k, frame in enumerate(frames) for name in encode)]


RUNS = {'determined': determined(), 'led': led()}
MESSAGES = {run: messages_of(*made) for run, made in RUNS.items()}
LATCHED = {run: [name for name in dict.fromkeys(row[0] for row in rows) if name not in encoders(RUNS[run][0])]
           for run, rows in MESSAGES.items()}
CASES = [(run, name) for run, rows in MESSAGES.items() for name in dict.fromkeys(row[0] for row in rows)]


def write(path, run, rows, options=None):
    """Write these messages of a run."""
    scene, _ = RUNS[run]
    with BagWriter(path, overwrite=True, options=options) as bag:
        bag.describe(RECORD, run_metadata(scene_file(scene), scene, {}))
        for name, n, t_ns, data in rows:
            bag.add_channel(f'/dragon/{name}', channels()[name])
            bag.write(f'/dragon/{name}', data, t_ns, n + 1)
    return path


def checked(path, run):
    with BagReader(path) as bag:
        return compare_with_model(bag, RUNS[run][0])


def altered(data):
    """Yield the message with one bit of the byte changed at several places."""
    end = len(data)
    for place in sorted({4, 5, end // 3, end // 2, end - 9, end - 2} & set(range(4, end))):
        changed = bytearray(data)
        changed[place] ^= 1
        yield bytes(changed)


MUTATIONS = {
    'deleted': lambda t_ns, data: [[]],
    'repeated': lambda t_ns, data: [[(t_ns, data)] * 2],
    'lengthened': lambda t_ns, data: [[(t_ns, data + bytes(more))] for more in (1, 4, 8)],
    'shortened': lambda t_ns, data: [[(t_ns, data[:-less])] for less in (1, 4)],
    'altered': lambda t_ns, data: [[(t_ns, other)] for other in altered(data)],
    'at another time': lambda t_ns, data: [[(0, data)]] if t_ns else [],
    'a nanosecond late': lambda t_ns, data: [[(t_ns + 1, data)]]}


@pytest.mark.parametrize('kind', ['run.mcap', 'run'])
@pytest.mark.parametrize('run', RUNS)
def test_an_unchanged_run_passes_as_a_file_and_as_a_folder_with_parts(tmp_path, run, kind):
    options = None if kind.endswith('.mcap') else BagOptions(split_duration_s=0.03)
    found = checked(write(tmp_path / kind, run, MESSAGES[run], options), run)
    assert (found.passed, found.faults, found.notes) == (True, [], [])
    assert (found.equal, found.once) == (TICKS * len(encoders(RUNS[run][0])), len(LATCHED[run]))


@pytest.mark.parametrize('mutation', MUTATIONS)
@pytest.mark.parametrize(('run', 'name'), CASES)
def test_every_changed_message_is_noticed(tmp_path, run, name, mutation):
    """The messages are latched ones, or those of the first tick and of one in the middle of the run."""
    latched = name in LATCHED[run]
    if latched and mutation == 'a nanosecond late':
        return      # a latched message belongs to no tick
    for n in (0,) if latched else (0, 2):
        place = next(at for at, row in enumerate(MESSAGES[run]) if row[:2] == (name, n))
        for made in MUTATIONS[mutation](*MESSAGES[run][place][2:]):
            rows = [*MESSAGES[run][:place], *((name, n, *one) for one in made), *MESSAGES[run][place + 1:]]
            assert not checked(write(tmp_path / 'a.mcap', run, rows), run).passed, (n, made)


@pytest.mark.parametrize('run', RUNS)
def test_our_bags_are_logged_in_simulation_time(tmp_path, run):
    rows = [(name, n, t_ns + 1, data) for name, n, t_ns, data in MESSAGES[run]]
    assert not checked(write(tmp_path / 'a.mcap', run, rows), run).passed
