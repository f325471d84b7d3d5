"""Monitors and recorders that cannot keep up skip whole ticks and report them, unless the publisher waits for them."""
import threading

import pytest

pytest.importorskip('rclpy')

from dragon_ros.bags.read.reader import BagReader
from dragon_ros.bags.record.loss_accounting import RECEIVED
from dragon_ros.bags.write.writer import BagOptions, BagWriter
from dragon_ros.core.step import tick
from dragon_ros.messages.cdr import Writer
from dragon_ros.messages.channels import channels
from dragon_ros.messages.encode import encoders
from dragon_ros.messages.observation import read_benches
from dragon_ros.nodes import inbox, qos, shell
from dragon_ros.nodes.contact_messages import Pace
from dragon_ros.scenes.load import load_scene

T_STAR_S = 412.473837682
RUN = 'run.start_s=412.2', 'run.stop_s=412.7', 'run.rate_hz=1000'


@pytest.fixture(scope='module')
def messages():
    """The messages of a run that passes its contact, in order of publication, as (topic, bytes, stamp, number)."""
    scene = load_scene('first_contact', [*RUN, 'effects=[benches]'])
    encode = encoders(scene)
    frames = [tick(scene, k) for k in range(501)]
    return [(name, bytes(encode[name](frame)), frame.t_ns, k + 1) for k, frame in enumerate(frames)
            for name in ('handles', 'benches')]


@pytest.fixture
def ros(domain):
    import rclpy
    rclpy.init()
    yield
    rclpy.shutdown()


@pytest.fixture
def monitor(ros):
    from dragon_ros.nodes.monitor import Monitor
    node = Monitor()
    yield node
    node.destroy_node()


def info(number):
    return {'source_timestamp': number, 'received_timestamp': number, 'publication_sequence_number': number}


def values(status):
    return {pair.key: pair.value for pair in status.values}


def heard(node, name):
    row, got = channels()[name], []
    node.create_subscription(shell.message_type(row.type), name, got.append, qos.of_channel(row))
    node.until(lambda: node.count_publishers(name))
    return got


def test_handles_whose_benches_do_not_come_in_time_are_counted_and_logged(monitor, messages, monkeypatch, capfd):
    monkeypatch.setattr('dragon_ros.nodes.tick_reader._PARTNER_S', 0.0)
    (name, data, _, number), *_ = messages
    monitor._ticks._inbox.put(name, channels()[name].type, data, info(number))
    while monitor._ticks._inbox._waiting:
        monitor._ticks._inbox.work()
    assert monitor.dropped == 0
    monitor._on_timer()
    assert monitor.dropped == 1
    assert 'handles at 412.200000000 s: no benches arrived with that stamp' in capfd.readouterr().err


@pytest.mark.parametrize(('x_m', 'count', 'why'), [
    (1e5, 3, 'expected finite numbers below 10000'),
    (0.0, 20_002, 'the number of poses is 20002; a dragon has 2 to 20001 handles')])
def test_a_monitor_drops_handles_outside_the_world(monitor, capfd, x_m, count, why):
    writer = Writer()
    writer.header('dragon', 0)
    writer.put('I', count)
    writer.put('d', x_m, *[0.0] * (7 * count - 1))
    monitor._ticks._inbox.put('handles', channels()['handles'].type, bytes(writer.finish()), info(1))
    while monitor._ticks._inbox._waiting:
        monitor._ticks._inbox.work()
    assert monitor.dropped == 1
    assert why in capfd.readouterr().err


def test_a_monitor_that_cannot_follow_skips_whole_ticks_and_says_so_and_what_it_may_miss(monitor, node, messages,
                                                                                       monkeypatch):
    monkeypatch.setattr(inbox, 'INBOX_MESSAGES', 40)
    health, contacts = heard(node, '/diagnostics'), heard(node, 'collision')
    node.until(lambda: all(one.get_subscription_count() for name, one in monitor.topic_publishers.items()
                           if name in ('/diagnostics', 'collision')))
    for n, (name, data, _, number) in enumerate(messages):
        monitor._ticks._inbox.put(name, channels()[name].type, data, info(number))
        if monitor._ticks._inbox.skipped == 1 and name == 'handles':     # reported immediately, before anything is read
            node.until(lambda: any('pace' in row.name for message in health for row in message.status))
        if n % 6 == 0 and n > 60:
            # Meanwhile the monitor reads a sixth of the messages.
            monitor._ticks._inbox._read(*monitor._ticks._inbox._waiting.popleft())
    while monitor._ticks._inbox._waiting:
        monitor._ticks._inbox.work()
    assert (monitor.dropped, monitor.seen + monitor._ticks._inbox.skipped) == (0, 501)
    assert 50 < monitor._ticks._inbox.skipped < 480
    monitor._publish_health(always=True)
    node.until(lambda: contacts and any('longest_step_s' in values(row) and values(row)['unseen'] != '0'
                                        for message in health for row in message.status))
    pace = [row for message in health for row in message.status if 'pace' in row.name][-1]
    begin = values(contacts[0].status[0])
    before_s, after_s = float(begin['t_before_s']), float(begin['t_after_s'])
    assert before_s < T_STAR_S <= after_s
    assert 0.001 < after_s - before_s <= float(values(pace)['longest_step_s']) < 0.1
    assert pace.level == pace.WARN
    assert 'contacts shorter than' in monitor.pace.text()


def test_a_monitor_examines_waiting_ticks_together_and_drops_an_invalid_one_alone(monitor, node, messages):
    stamped = heard(node, 'clearance/stamped')
    node.until(lambda: monitor.topic_publishers['clearance/stamped'].get_subscription_count())
    sizes, expect = [], monitor._ticks._expect
    monitor._ticks._expect = lambda observations: (sizes.append(len(observations)), expect(observations))
    for name, data, _, number in messages[:60]:
        if (name, number) == ('benches', 8):
            data = bytearray(data)
            read_benches(data).markers.poses[2, 0] = float('nan')
        monitor._ticks._inbox.put(name, channels()[name].type, bytes(data), info(number))
    while monitor._ticks._inbox._waiting:
        monitor._ticks._inbox.work()
    assert (monitor.seen, monitor.dropped, monitor._ticks._inbox.waiting, monitor._ticks._unexamined) == (29, 1, 0, 0)
    assert sizes[0] == 1        # until a dragon has been chosen
    assert max(sizes) > 4
    node.until(lambda: len(stamped) == 29)
    assert [one.header.stamp.sec * 10**9 + one.header.stamp.nanosec for one in stamped] == [
        t_ns for name, _, t_ns, number in messages[:60] if name == 'handles' and number != 8]


def test_a_monitor_reads_first_where_the_publisher_waits_for_it(monitor, node, messages, monkeypatch):
    monkeypatch.setattr(inbox, 'INBOX_MESSAGES', 40)
    row = channels()['handles']
    node.create_publisher(shell.message_type(row.type), 'handles', qos.waiting(qos.of_channel(row)))
    node.until(lambda: monitor.count_publishers('handles'))
    for name, data, _, number in messages:
        earlier = 0 if name == 'handles' else 900       # earlier benches without handles do not count as ticks
        monitor._ticks._inbox.put(name, channels()[name].type, data, info(number + earlier))
    while monitor._ticks._inbox._waiting:
        monitor._ticks._inbox.work()
    assert (monitor.seen, monitor.dropped, monitor._ticks._inbox.skipped, monitor.pace.text()) == (501, 0, 0, '')
    assert (monitor.pace.before, monitor._ticks._numbers) == (0, {})


def test_benches_that_arrive_long_after_their_handles_do_not_exceed_the_budget_of_a_monitor(monitor, messages,
                                                                                           monkeypatch):
    early = [row for row in messages[:120] if row[0] == 'handles']
    late = [row for row in messages[:120] if row[0] == 'benches']
    budget = 2.2 * sum(len(data) for _, data, _, _ in early)        # the handles alone fill less than half of it
    assert sum(len(data) for _, data, _, _ in early + late) > 1.2 * budget
    monkeypatch.setattr(inbox, 'INBOX_BYTES', budget)
    for name, data, _, number in early + late:
        monitor._ticks._inbox.put(name, channels()[name].type, data, info(number))
        assert monitor._ticks._inbox.fill <= 1
    while monitor._ticks._inbox._waiting:
        monitor._ticks._inbox.work()
    assert (monitor.seen, monitor.dropped, monitor._ticks._inbox.skipped) == (60, 0, 0)


def test_no_tick_is_examined_before_an_awaited_map_even_if_a_lossless_run_fills_the_inbox(monitor, node, messages,
                                                                                         monkeypatch):
    from nav_msgs.msg import OccupancyGrid
    monkeypatch.setattr(inbox, 'INBOX_MESSAGES', 40)
    row, grid = channels()['handles'], OccupancyGrid(data=[100])
    grid.header.frame_id, grid.info.width, grid.info.height, grid.info.resolution = 'dragon', 1, 1, 1.0
    node.create_publisher(shell.message_type(row.type), 'handles', qos.waiting(qos.of_channel(row)))
    maps = node.create_publisher(OccupancyGrid, '/map', qos.profile('reliable', 'transient_local', 1))
    node.until(lambda: monitor.count_publishers('handles') and monitor.count_publishers('/map'))
    order, changed, add = [], monitor._obstacles._changed, monitor._tracker.add
    monitor._obstacles._changed = lambda around: (order.append(len(around.names)), changed(around))
    monitor._tracker.add = lambda observation: (order.append('a tick'), add(observation))[1]
    late = threading.Timer(0.3, maps.publish, [grid])
    late.start()
    for name, data, _, number in messages:
        monitor._ticks._inbox.put(name, channels()[name].type, data, info(number))
    late.join()
    assert order[:2] == [1, 'a tick']
    while monitor._ticks._inbox._waiting:
        monitor._ticks._inbox.work()
    assert (monitor.seen, monitor.dropped, monitor._ticks._inbox.skipped) == (501, 0, 0)


@pytest.mark.parametrize('read', [0, 100])
def test_a_monitor_reads_all_messages_of_a_publisher_that_waited_for_it_and_has_left(monitor, node, messages,
                                                                                    monkeypatch, read):
    monkeypatch.setattr(inbox, 'INBOX_MESSAGES', 40)
    rows = [channels()[name] for name in ('handles', 'benches')]
    publishers = [node.create_publisher(shell.message_type(row.type), row.name, qos.waiting(qos.of_channel(row)))
                  for row in rows]
    node.until(lambda: all(monitor.count_publishers(row.name) for row in rows))
    monitor._on_timer()
    for n, (name, data, _, number) in enumerate(messages):
        if n == read:
            for publisher in publishers:
                node.destroy_publisher(publisher)
            node.until(lambda: not any(monitor.count_publishers(row.name) for row in rows))
            monitor._on_timer()
        monitor._ticks._inbox.put(name, channels()[name].type, data, info(number))
    while monitor._ticks._inbox._waiting:
        monitor._ticks._inbox.work()
    assert (monitor.seen, monitor.dropped, monitor._ticks._inbox.skipped, monitor.pace.text()) == (501, 0, 0, '')


def test_a_monitor_remembers_numbers_of_handles_without_benches_within_its_budget(monitor, monkeypatch):
    from dragon_ros.nodes import tick_reader as module
    monkeypatch.setattr(module, 'INBOX_MESSAGES', 40)
    for number in range(1, 100):
        monitor._ticks._keep_number(10 * number, number)
    assert monitor._ticks._numbers == {10 * number: number for number in range(60, 100)}


def test_ticks_that_are_not_seen_are_known_by_the_numbers_of_their_handles():
    pace = Pace()
    assert not pace.see(10, 7, 0.0)
    assert pace.before == 6
    assert not pace.see(20, 8, 0.0)
    assert pace.text() == ''
    assert pace.see(50, 11, 0.0)        # reported immediately
    assert not pace.see(80, 14, 0.5)        # and reported every second afterwards
    assert pace.see(90, 16, 1.6)
    assert not pace.see(5, 17, 9.9)     # a restarted run
    assert not pace.see(9, 1, 9.9)      # another publisher
    assert (pace._unseen, pace._step_ns) == (2 + 2 + 1, 30)
    assert pace.warnings('red', 4.5)
    assert not pace.warnings('red', 4.7)
    assert pace.before == 6


def recorder_on(folder, hold, queue_mb):
    """Return a recorder whose disk accepts no data until an event is set."""
    from dragon_ros.nodes.record import Recorder
    bag = BagWriter(folder / 'run.mcap', options=BagOptions('none'), threaded=False)
    write = bag.write

    def slow(*row):
        hold.wait(60)
        write(*row)
    bag.write = slow
    return Recorder(bag, queue_mb=queue_mb)


def test_a_recorder_whose_disk_does_not_follow_leaves_out_whole_ticks_within_its_queue(ros, tmp_path, messages, capfd):
    go = threading.Event()
    recorder = recorder_on(tmp_path, go, queue_mb=2.0)
    takes = {name: recorder.recording.receiver(channels()[name]) for name in ('handles', 'benches')}
    for name, data, _, number in messages:
        takes[name](data, info(number))
        assert recorder.recording.writer.fill < 1.05
    recorder.poll(keep_going=True)
    go.set()
    assert not recorder.close()
    recorder.destroy_node()
    with BagReader(tmp_path / 'run.mcap') as bag:
        found = {name: [one.t_ns for one in bag.messages([f'/dragon/{name}'])] for name in takes}
        account = bag.metadata(RECEIVED)
    assert found['handles'] == found['benches']
    left_out = 501 - len(found['handles'])
    assert 400 < left_out < 501
    assert account['complete'] == 'false'
    assert [account[f'/dragon/{name} left out'] for name in takes] == [str(left_out)] * 2
    said = capfd.readouterr().err
    assert f'left out {left_out} ticks so far' in said
    assert f'/dragon/handles: {left_out} messages were left out because the disk was too slow' in said
    assert 'NOT COMPLETE' in said
