"""The figures on the page ``cost bag`` follow from the measurements, and the measured bags are complete."""
import csv
import io
from dataclasses import replace

import pytest

from benchmarks import bags, command
from dragon_ros.bags.read.reader import BagReader
from dragon_ros.cost.measure import Timing

RATES = {'memory': 1e8, 'file': 1e8, 'zstd': 2e7, 'lz4': 4e7}


def row(writer='dragon_ros', compression='zstd', seconds=0.5):
    return bags.Written(writer, compression, Timing(seconds, 0.4, 0.6, 5), 100, 300, 7_000_000, 1_400_000, RATES)


def test_throughput_and_size_follow_from_the_times():
    one = row()
    assert (one.mb_s, one.ticks_s, one.share) == (14, 200, 0.2)
    assert one.message_us == pytest.approx(1667, abs=1)


@pytest.mark.parametrize(('compression', 'rates', 'limit_s'), [
    ('zstd', {}, 0.35), ('lz4', {}, 0.175), ('none', {}, 0.07), ('none', {'memory': 1e7}, 0.7),
    ('zstd', {'file': 1e6}, 1.4), ('lz4', {'zstd': 1.0}, 0.175)])
def test_the_limit_of_a_bag_is_the_slowest_of_copying_compressing_and_writing(compression, rates, limit_s):
    assert replace(row(compression=compression), rates=RATES | rates).limit_s == pytest.approx(limit_s)


def test_every_rate_is_measured(tmp_path):
    assert set(bags._rates(bags._rows()[:30], tmp_path, 0.0)) == set(RATES)


def test_table_csv_and_picture_have_every_row(tmp_path):
    rows = [row(), row('mcap.writer', 'none', 0.25)]
    paths = command.write('bag', rows, tmp_path)
    assert {path.name for path in paths} == {'bag.md', 'bag.csv', 'bag.png', 'bag.svg'}
    assert '| dragon_ros | zstd | 14 | 20 | 1.43 |' in bags.table(rows)
    assert '| mcap.writer | none | 28 | 100 | 3.57 |' in bags.table(rows)
    read = list(csv.DictReader(io.StringIO((tmp_path / 'bag.csv').read_text())))
    assert [line['median_s'] for line in read] == ['0.5', '0.25']


@pytest.mark.parametrize('writer', list(bags._WRITERS))
def test_each_writer_of_the_page_writes_the_same_messages(tmp_path, writer):
    rows = bags._rows()[:30]
    bags._WRITERS[writer](tmp_path / 'a.mcap', 'lz4', rows)
    with BagReader(tmp_path / 'a.mcap') as bag:
        found = [(message.topic, message.data, message.t_ns, message.sequence) for message in bag.messages()]
    assert sorted(found) == sorted(rows)
