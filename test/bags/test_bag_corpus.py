"""Every reader handles every bag of the corpus in bounded memory."""
import runpy
import subprocess
import sys
from contextlib import suppress
from functools import cache, partial
from pathlib import Path

import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from properties import examples

from dragon_ros.bags.check.examine import examine
from dragon_ros.bags.check.repair import repair
from dragon_ros.bags.read.frames import frames
from dragon_ros.bags.read.reader import BagReader
from dragon_ros.core.errors import DragonError, InputError

FOLDER = Path(__file__).parents[1] / 'data' / 'corpus'
CORPUS = {path.stem: path for path in sorted(FOLDER.glob('*.mcap'))}
GOOD = [name for name in CORPUS if name.startswith('good')]
_LIMITED = """
import resource, sys
from pathlib import Path
from dragon_ros.core.errors import InputError
from dragon_ros.bags.check.examine import examine
from dragon_ros.bags.check.repair import repair
from dragon_ros.bags.read.reader import BagReader
used = int(Path('/proc/self/statm').read_text().split()[0]) * resource.getpagesize()
resource.setrlimit(resource.RLIMIT_AS, (used + 400 * 2**20,) * 2)
for name in sys.argv[2:]:
    for read in (lambda: [None for _ in BagReader(Path(name)).messages()], lambda: examine(Path(name)),
                 lambda: repair(Path(name), Path(sys.argv[1]) / Path(name).name)):
        try:
            read()
        except InputError:
            pass
"""


@cache
def expected():
    """Return the words of the error for each bag of the corpus, or None, from the script that makes the bags."""
    corpus = runpy.run_path(str(FOLDER / 'make_corpus.py'))['CORPUS']
    return {name: words for name, (_, words) in corpus.items()}


def read(path):
    with BagReader(path) as bag:
        return [(message.topic, message.t_ns, message.data) for message in bag.messages()]


def test_the_script_beside_the_corpus_lists_what_is_there():
    assert set(CORPUS) == set(expected())


@pytest.mark.parametrize('name', CORPUS)
def test_a_bag_of_the_corpus_is_read_or_refused_in_words_that_name_file_and_place(name):
    words = expected()[name]
    if words is None:
        assert read(CORPUS[name])
        return
    with pytest.raises(InputError) as caught:
        read(CORPUS[name])
    assert words in str(caught.value)
    assert f'{name}.mcap' in str(caught.value)


@pytest.mark.parametrize('name', CORPUS)
def test_a_bag_of_the_corpus_is_examined_and_repaired_or_refused(tmp_path, name):
    refused = name in ('empty', 'text')
    try:
        contents = examine(CORPUS[name])
        done = repair(CORPUS[name], tmp_path / 'out.mcap')
    except InputError:
        assert refused
        return
    assert not refused
    assert not contents.problems.count or not name.startswith(('good', 'foreign'))
    if done.messages and name != 'foreign_json':
        assert len(read(tmp_path / 'out.mcap')) == done.messages
    assert not examine(tmp_path / 'out.mcap').problems.count


@pytest.mark.parametrize('name', GOOD)
def test_all_ways_to_write_the_same_messages_are_read_as_the_same(name):
    assert read(CORPUS[name]) == read(CORPUS['good_none'])
    with BagReader(CORPUS[name]) as bag:
        seen = list(frames(bag))
        assert [topic.messages for topic in bag.topics] == [6, 6, 6]
    assert [len(frame.handles_m) for frame in seen] == [4] * 6
    assert all(frame.benches is not None and frame.velocity_m_s is not None for frame in seen)


def test_what_is_not_in_order_is_read_in_order():
    assert [t_ns for _, t_ns, _ in read(CORPUS['foreign_out_of_order'])] == [1, 2, 3]


@pytest.mark.skipif(not Path('/proc/self/statm').exists(), reason='/proc is not available')
def test_the_whole_corpus_is_read_in_little_memory(tmp_path):
    subprocess.run([sys.executable, '-c', _LIMITED, tmp_path, *CORPUS.values()], check=True)


def use(path, out):
    """Read a file with every reader; only the package's own errors may be raised."""
    for way in (read, examine, partial(repair, output=out)):
        with suppress(DragonError):
            way(path)
        out.unlink(missing_ok=True)
    with suppress(DragonError), BagReader(path) as bag:
        for frame in frames(bag):
            assert frame.clearance_m is None or frame.clearance_m == frame.clearance_m


@examples(100, long=150)
@given(st.sampled_from(GOOD), st.floats(0, 1))
def test_a_bag_cut_at_any_byte_is_refused_and_all_before_the_cut_is_saved(tmp_path_factory, name, share):
    folder, data = tmp_path_factory.mktemp('cut'), CORPUS[name].read_bytes()
    cut = int(share * (len(data) - 1))
    path = folder / 'cut.mcap'
    path.write_bytes(data[:cut])
    with pytest.raises(InputError, match=r'cut\.mcap'):
        read(path)
    use(path, folder / 'out.mcap')
    if cut < 8:
        return
    saved = repair(path, folder / 'out.mcap')
    if saved.messages:
        assert set(read(folder / 'out.mcap')) <= set(read(CORPUS[name]))
    if name in ('good_none', 'good_without_chunks') and b'/dragon/handles' in data[:cut]:
        whole = repair(CORPUS[name], folder / 'whole.mcap').messages
        messages_before = whole * min(1.0, (cut - 3000) / 8000)     # schemas and channels come first
        assert saved.messages >= int(messages_before) - 3


@examples(200)
@given(st.sampled_from(sorted(CORPUS)), st.lists(st.tuples(st.floats(0, 1), st.integers(0, 255)), max_size=4),
       st.floats(0, 1))
@example('good_zstd', [(0.0, 0)], 1.0)
def test_flipped_and_cut_bags_raise_nothing_but_clear_errors(tmp_path_factory, name, flips, keep):
    if name.startswith('bomb'):
        return      # these would only slow down garbage collection
    folder, data = tmp_path_factory.mktemp('flip'), bytearray(CORPUS[name].read_bytes())
    for share, value in flips:
        if data:
            data[int(share * (len(data) - 1))] = value
    path = folder / 'flipped.mcap'
    path.write_bytes(data[:int(keep * len(data))])
    use(path, folder / 'out.mcap')


@examples(100)
@given(st.sampled_from(GOOD), st.integers(0, 2**13), st.integers(0, 2**13), st.integers(0, 2**13))
def test_bags_with_parts_doubled_or_moved_raise_nothing_but_clear_errors(tmp_path_factory, name, start, length, to):
    folder, data = tmp_path_factory.mktemp('twice'), CORPUS[name].read_bytes()
    path = folder / 'doubled.mcap'
    path.write_bytes(data[:to] + data[start:start + length] + data[to:])
    use(path, folder / 'out.mcap')
