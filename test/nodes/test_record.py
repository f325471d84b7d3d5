"""Recorders that are killed, or that lack disk space or messages, keep the recorded data and report losses."""
import re
import resource
import signal
import time
from random import Random

import pytest
import yaml
from mcap.exceptions import EndOfFile
from mcap.reader import make_reader
from mcap.records import Message
from mcap.stream_reader import StreamReader
from properties import thinned
from zstandard import ZstdError

from dragon_ros.__main__ import main
from dragon_ros.bags.check import contacts
from dragon_ros.bags.check.compare import compare_with_model
from dragon_ros.bags.read.reader import BagReader
from dragon_ros.core.scene import Run
from dragon_ros.messages.cdr import Writer, stamp_of
from dragon_ros.scenes.load import load_scene, strangers_scene

READERS = 'wait_subscribers:=[handles=1,benches=1,velocities=1,scene=1]'
LATCHED = '/dragon/scene', '/dragon/track'
SHORT = 'run.start_s=412.2', 'run.stop_s=412.7'


def sim(start, *pairs, speed=1.0, readers=1):
    given = [part for pair in pairs for part in ('--set', pair)]
    return start('sim', '--scene', 'first_contact', *given, '--ros-args', '-p',
                 READERS.replace('=1', f'={readers}'), '-p', f'time_scale:={speed}')


def streamed(path):
    """Return all messages (topic, log time, data) that the mcap library's stream reader finds in a truncated file."""
    found, names = [], {}
    try:
        with path.open('rb') as file:
            for record in StreamReader(file).records:
                if hasattr(record, 'topic'):
                    names[record.id] = record.topic
                if isinstance(record, Message):
                    found.append((names[record.channel_id], record.log_time, record.data))
    except (EndOfFile, ValueError, OSError, ZstdError):      # the last chunk may be incomplete
        pass
    return found


def received(path):
    with path.open('rb') as file:
        return {row.name: row.metadata for row in make_reader(file).iter_metadata()}


def poses(t_ns):
    writer = Writer()
    writer.put('I', *stamp_of(t_ns))
    writer.text('dragon')
    writer.put('I', 0)
    return bytes(writer.finish())


def test_recorders_killed_at_random_moments_lose_at_most_the_flush_interval_and_are_repaired(start, tmp_path, capsys,
                                                                                             request):
    moments = sorted(Random(7).uniform(0.2, 3.5) for _ in range(3))
    if not request.config.getoption('--long'):
        del moments[0]      # what was recorded until the first moment may still be lost
    records = [start('record', '--output', tmp_path / f'{n}.mcap', '--flush-s', '0.5') for n in range(len(moments))]
    publisher = sim(start, 'run.start_s=400', 'run.stop_s=405', readers=len(moments))
    publisher.wait_for('starting')
    began, heard_ns = time.monotonic(), {}
    for n, moment in enumerate(moments):
        time.sleep(max(0.0, began + moment - time.monotonic()))
        heard_ns[n] = 400 * 10**9 + round((time.monotonic() - began) * 1e9)
        records[n].signal(signal.SIGKILL)
    publisher.stop()
    scene = load_scene('first_contact', ['run.start_s=400', 'run.stop_s=405'])
    for n, record in enumerate(records):
        assert record.end() == -signal.SIGKILL, record.text
        # A busy machine may take twice the flush interval of half a second.
        check_killed(tmp_path / f'{n}.mcap', heard_ns[n] - 10**9)
        check_repaired(tmp_path / f'{n}.mcap', tmp_path / f'whole{n}.mcap', scene, capsys)


def check_killed(bag, heard_ns):
    """Check that the mcap library's stream reader can read every tick from the first to ``heard_ns``."""
    found = streamed(bag)
    for name in ('handles', 'benches', 'velocities'):
        times = [t_ns for topic, t_ns, _ in found if topic == f'/dragon/{name}']
        assert times == [400 * 10**9 + 20_000_000 * k for k in range(len(times))]
        assert heard_ns <= 400 * 10**9 or times[-1] >= heard_ns


def check_repaired(bag, whole, scene, capsys):
    """Check that the truncated bag is reported, can be repaired, and is bit-identical to the model up to its end."""
    assert main(['inspect', str(bag)]) == 1
    if not streamed(bag):
        return
    assert main(['inspect', str(bag), '--repair', str(whole)]) == 0
    assert main(['inspect', str(whole)]) == 0
    with BagReader(whole) as run:
        found = compare_with_model(run, scene)
    assert found.equal == sum(topic.messages for topic in run.topics if topic.name not in LATCHED)
    assert all('is missing' in fault for fault in found.faults)


def test_a_bag_alone_makes_its_run_again(start, tmp_path):
    record = start('record', '--output', tmp_path / 'run')
    publisher = sim(start, *SHORT, 'accuracy=1e-6', speed=0.0)
    assert publisher.end() == 0, publisher.text
    assert record.end() == 0, record.text
    assert 'the publisher of handles has left' in record.text
    last = record.lines[-1]
    assert f'run: {3 * 26 + 2} messages on 5 topics, nothing is missing; the queue was ' in last, record.text
    assert not re.search(r'/dragon/\w+ 0\b', record.text), record.text      # topics without messages are not listed
    bag = tmp_path / 'run' / 'run_0.mcap'
    told = received(bag)
    scene = strangers_scene('told', told['dragon_ros']['scene'])
    assert scene == load_scene('first_contact', [*SHORT, 'accuracy=1e-6'])
    assert (told['dragon_ros']['promise_m'], told['dragon_ros']['about.on_contact']) == ('2e-12', 'continue')
    assert told['dragon_ros.received']['complete'] == 'true'
    assert told['dragon_ros.received']['/dragon/handles ticks'] == '0-25'
    with bag.open('rb') as file:
        (attachment,) = make_reader(file).iter_attachments()
    assert (attachment.name, strangers_scene('attached', attachment.data.decode())) == ('scene.yaml', scene)
    with BagReader(bag) as run:
        assert compare_with_model(run, scene).faults == []
    info = yaml.safe_load((tmp_path / 'run' / 'metadata.yaml').read_text())['rosbag2_bagfile_information']
    assert info['message_count'] == 3 * 26 + 2      # plus one message each on track and scene


@pytest.mark.parametrize('on_contact', thinned(['stop', 'hold'], lambda what: what == 'hold'))
def test_a_bag_of_a_run_that_ends_in_its_contact_is_checked_to_its_last_frame(start, tmp_path, capsys, monkeypatch,
                                                                              on_contact):
    record = start('record', '--output', tmp_path / 'a.mcap')
    publisher = start('sim', '--scene', 'first_contact', '--set', 'run.start_s=412.3', '--set', 'dragon.benches=24',
                      '--ros-args', '-p', READERS, '-p', f'on_contact:={on_contact}', '-p', 'time_scale:=0.0')
    if on_contact == 'hold':
        publisher.wait_for('holding until a signal')
        assert publisher.stop() == 0, publisher.text
    assert publisher.end() == 0, publisher.text
    assert record.end() == 0, record.text
    assert main(['inspect', str(tmp_path / 'a.mcap'), '--check']) == 0
    assert f'{3 * 10} messages are bit-identical to the model, 0 are not' in capsys.readouterr().out
    monkeypatch.setattr(contacts, 'SEARCHED_BENCHES', 23)
    assert main(['inspect', str(tmp_path / 'a.mcap'), '--check']) == 0      # checked by the certificate in the bag
    assert 'the contact at 412.47383768211' in capsys.readouterr().out


@pytest.mark.parametrize('how', thinned(['full', 'limit', 'gone'], lambda how: how != 'limit'))
def test_a_disk_that_fails_stops_the_recording_and_nothing_else(start, tmp_path, how):
    (tmp_path / 'bags').mkdir()
    bag = tmp_path / 'bags' / 'run.mcap'
    record = start('record', '--output', bag, '--compression', 'none', '--flush-s', '0.1',
                   *(['--max-size-mb', '2'] if how == 'limit' else []))
    publisher = sim(start, 'run.start_s=400')
    publisher.wait_for('starting')
    while not streamed(bag):
        time.sleep(0.01)
    if how == 'full':
        resource.prlimit(record.pid, resource.RLIMIT_FSIZE, (2_000_000, 2_000_000))
    elif how == 'gone':
        (tmp_path / 'bags').rename(tmp_path / 'moved')
        bag = tmp_path / 'moved' / 'run.mcap'
    assert record.end() == 1, record.text
    says = {'full': 'File too large', 'limit': '--max-size-mb', 'gone': 'no longer exists'}[how]
    assert says in record.text
    assert 'Traceback' not in record.text
    with bag.open('rb') as file:
        messages = list(make_reader(file, validate_crcs=True).iter_messages())
    assert messages
    assert bag.stat().st_size <= 2_000_000 or how == 'gone'
    assert publisher.running, publisher.text
    assert publisher.stop() == 0
    assert 'not all readers acknowledged' not in publisher.text, publisher.text     # it knows that the recorder left


def test_lost_and_missing_ticks_are_reported_in_the_bag_on_the_terminal_and_by_the_exit_code(start, node, tmp_path):
    from geometry_msgs.msg import PoseArray
    from std_msgs.msg import String

    from dragon_ros.core.scene import Scene
    from dragon_ros.messages.cdr import string_message
    from dragon_ros.messages.channels import channels
    from dragon_ros.nodes import qos
    from dragon_ros.scenes.provenance import scene_file
    run = Run(0, 1, 30)
    scene = node.create_publisher(String, 'scene', qos.of_channel(channels()['scene']))
    handles = node.create_publisher(PoseArray, 'handles', 100)
    scene.publish(string_message(scene_file(Scene(run=run))))
    record = start('record', '--output', tmp_path / 'a.mcap', '--keep-going')
    node.until(lambda: handles.get_subscription_count() and scene.get_subscription_count())
    bag = tmp_path / 'a.mcap'
    node.until(lambda: b'scene.yaml' in bag.read_bytes())       # the recorder has the scene of the run
    for k in (3, 4, 7, 8, 12):
        handles.publish(poses(run.time_ns(k)))
    node.until(lambda: len([row for row in streamed(bag) if row[0] == '/dragon/handles']) == 5)
    assert record.stop() == 3, record.text
    assert '/dragon/handles: 5 ticks are missing: 5-6, 9-11' in record.text
    told = received(bag)['dragon_ros.received']
    assert told['complete'] == 'false'
    assert told['/dragon/handles missing ticks'] == '5-6, 9-11'
    assert told['/dragon/handles lost'] == '0'


@pytest.mark.parametrize('first', thinned(['record', 'sim'], lambda first: first == 'sim'))
def test_a_live_recording_is_complete_whoever_starts_first(start, node, tmp_path, first):
    """As in the tutorial, no subscribers are named, so the sim waits for those that discovery finds."""
    short = 'run.start_s=412.2', 'run.stop_s=412.7'
    changes = [part for pair in short for part in ('--set', pair)]
    record, names = None, node.get_node_names_and_namespaces
    if first == 'record':
        record = start('record', '--output', tmp_path / 'a.mcap')
        node.until(lambda: ('record', '/dragon') in names())
    run = start('sim', '--scene', 'first_contact', *changes)
    record = record or start('record', '--output', tmp_path / 'a.mcap')
    assert run.end() == 0, run.text
    assert record.end() == 0, record.text
    with BagReader(tmp_path / 'a.mcap') as bag:
        assert compare_with_model(bag, load_scene('first_contact', short)).faults == []


def test_a_recorder_that_missed_the_beginning_says_so_and_exits_3(start, tmp_path):
    run = start('sim', '--scene', 'first_contact', '--ros-args', '-p', 'discovery_s:=0.0')
    run.wait_for('starting')
    record = start('record', '--output', tmp_path / 'a.mcap')
    while not {'/dragon/scene', '/dragon/handles', '/dragon/benches', '/dragon/velocities'} <= {
            topic for topic, _, _ in streamed(tmp_path / 'a.mcap')}:
        assert record.running
        time.sleep(0.02)
    assert record.stop() == 3, record.text
    assert '/dragon/handles: the beginning is missing: ' in record.text
    told = received(tmp_path / 'a.mcap')['dragon_ros.received']
    assert told['complete'] == 'false'
    assert int(told['/dragon/handles missing at the beginning']) > 0
    assert told['/dragon/handles missing ticks'] == 'none'


def test_a_closed_terminal_ends_every_node_as_ctrl_c_does_and_bags_are_whole(start, tmp_path):
    publisher = sim(start, 'run.start_s=400', readers=2)
    record, kept = (start('record', '--output', tmp_path / f'{name}.mcap', '--flush-s', '0.1', under=under)
                    for name, under in (('a', []), ('b', ['nohup'])))
    monitor = start('monitor')
    for bag in tmp_path / 'a.mcap', tmp_path / 'b.mcap':
        while not bag.exists() or not [row for row in streamed(bag) if row[0] == '/dragon/benches']:
            assert publisher.running
            time.sleep(0.02)
    for process in record, kept:
        process.signal(signal.SIGHUP)
    assert record.end() == 0, record.text
    assert main(['inspect', str(tmp_path / 'a.mcap')]) == 0
    assert kept.running
    for process in kept, monitor, publisher:
        assert process.stop(signal.SIGHUP if process is not kept else signal.SIGINT) == 0, process.text


def test_of_a_topic_that_two_publish_nobody_says_what_is_missing_and_both_are_named(start, node, other_node, tmp_path):
    from diagnostic_msgs.msg import DiagnosticArray
    from geometry_msgs.msg import PoseArray
    heard = []
    node.create_subscription(DiagnosticArray, '/diagnostics', heard.append, 10)
    outs = [one.create_publisher(PoseArray, 'handles', 100) for one in (node, other_node)]
    record = start('record', '--output', tmp_path / 'a.mcap', '--keep-going', '--flush-s', '0.1')
    node.until(lambda: all(out.get_subscription_count() for out in outs))
    for k in range(5):
        for n, out in enumerate(outs):
            out.publish(poses((k + 30 * n) * 10**9))
    named = ('/dragon/handles', '/dragon/observer, /dragon/stranger')

    def warned():
        return [status for message in heard for status in message.status
                if named in [(pair.key, pair.value) for pair in status.values]]
    node.until(warned)
    assert (warned()[0].name, warned()[0].level) == ('dragon: record: publishers', b'\x01')
    record.stop()
    assert 'several publishers on one topic: /dragon/handles: /dragon/observer and /dragon/stranger' in record.text
    assert 'handles: there are several publishers, so missing messages cannot be counted' in record.text
    assert ', it is unknown whether anything is missing; the queue' in record.text
    told = received(tmp_path / 'a.mcap')['dragon_ros.received']
    assert (told['complete'], told['/dragon/handles lost']) == ('unknown', 'unknown: several publishers')


def test_numbers_of_several_publishers_of_diagnostics_are_no_losses(start, node, other_node, tmp_path):
    from diagnostic_msgs.msg import DiagnosticArray
    from rclpy.duration import Duration
    record = start('record', '--output', tmp_path / 'a.mcap')
    one, other = (each.create_publisher(DiagnosticArray, '/diagnostics', 10) for each in (node, other_node))
    for publisher, each, times in ((one, node, 3), (other, other_node, 1), (one, node, 1)):
        each.until(publisher.get_subscription_count)
        for _ in range(times):
            publisher.publish(DiagnosticArray())
        assert publisher.wait_for_all_acked(Duration(seconds=30))
    assert record.stop() == 0, record.text
    assert received(tmp_path / 'a.mcap')['dragon_ros.received']['/diagnostics lost'] == 'unknown: several publishers'


def test_no_scene_on_the_topic_ends_or_blinds_a_recorder(start, node, tmp_path):
    from geometry_msgs.msg import PoseArray
    from std_msgs.msg import String

    from dragon_ros.core.limits import RECORDED_SCENES
    from dragon_ros.core.scene import Scene
    from dragon_ros.messages.cdr import string_message
    from dragon_ros.messages.channels import channels
    from dragon_ros.nodes import qos
    from dragon_ros.scenes.provenance import scene_file
    hostile = ['dragon: {kind: [a]}', f'dragon: {{benches: {"9" * 400}}}', '[' * 60_000, '? ' * 30_000,
               'dragon: {benches: 900000}', 'run: {rate_hz: 1000000, stop_s: 2000000000}', f'a: "{"x" * 3_000_000}"',
               *(f'about: {{n: {n}}}' for n in range(RECORDED_SCENES))]
    run = Run(0, 1, 30)
    scene = node.create_publisher(String, 'scene', qos.of_channel(channels()['scene']))
    handles = node.create_publisher(PoseArray, 'handles', 100)
    bag = tmp_path / 'a.mcap'
    record = start('record', '--output', bag, '--keep-going', '--flush-s', '0.1')
    node.until(lambda: handles.get_subscription_count() and scene.get_subscription_count())
    handles.publish(poses(run.time_ns(0)))
    for n, text in enumerate((*hostile, scene_file(Scene(run=run)))):
        scene.publish(string_message(text))
        node.until(lambda n=n: len([row for row in streamed(bag) if row[0] == '/dragon/scene']) > n)
    for k in (1, 2, 4):
        handles.publish(poses(run.time_ns(k)))
    node.until(lambda: len([row for row in streamed(bag) if row[0] == '/dragon/handles']) == 4)
    assert record.stop() == 3, record.text
    assert 'Traceback' not in record.text
    assert '1 tick is missing: 3' in record.text      # only the last scene counts
    with bag.open('rb') as file:
        assert 1 <= len(list(make_reader(file).iter_attachments())) <= RECORDED_SCENES


@pytest.mark.parametrize(('options', 'says'), [
    (['--compression', 'zip'], '--compression'), (['--split-size-mb', '0'], 'split_size_mb'),
    (['--flush-s', '0'], '--flush-s'), (['--queue-mb', 'nan'], '--queue-mb'),
    (['--output', 'a.mcap', '--split-size-mb', '5'], 'give a directory')])
def test_record_options_that_make_no_sense_are_refused(start, tmp_path, options, says):
    process = start('record', *options)
    assert process.end() == 2
    assert says in process.text
    assert not [path for path in tmp_path.iterdir() if path.name != 'log']


def test_a_message_that_no_reader_takes_is_named_and_counted_and_the_bag_is_not_complete(tmp_path, domain, capfd,
                                                                                        monkeypatch):
    import rclpy

    from dragon_ros.bags.record.loss_accounting import RECEIVED
    from dragon_ros.bags.write import writer
    from dragon_ros.messages.channels import channels
    from dragon_ros.nodes.record import Recorder
    monkeypatch.setattr(writer, 'MESSAGE_BYTES', 1000)
    rclpy.init()
    try:
        node = Recorder(writer.BagWriter(tmp_path / 'a.mcap', threaded=False))
        take = node.recording.receiver(channels()['handles'])
        for n in range(1, 4):
            take(poses(n) + bytes(1000 * (n == 2)), {'source_timestamp': n, 'publication_sequence_number': n})
        assert not node.close()
        node.destroy_node()
    finally:
        rclpy.shutdown()
    said = capfd.readouterr().err
    assert '2 messages on 1 topic, NOT COMPLETE' in said
    assert '/dragon/handles: left out 1 message of more than' in said
    assert 'not in the bag: 1 received message' in said
    account = received(tmp_path / 'a.mcap')[RECEIVED]
    assert (account['complete'], account['/dragon/handles too large']) == ('false', '1')
