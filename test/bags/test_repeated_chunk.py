"""A chunk laid out once and filled again and again is the chunk that single messages would fill."""
import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from dragon_ros.bags.write.mcap import OpenChunk, Packer, RepeatedChunk

STAMPS = st.integers(0, 2**64 - 1)


@given(sizes=st.lists(st.integers(0, 40), min_size=1, max_size=4),
       refills=st.lists(st.tuples(st.lists(STAMPS, min_size=1, max_size=6), st.integers(0, 2**32 - 7)), min_size=1,
                        max_size=3))
def test_a_repeated_chunk_has_the_bytes_the_index_and_the_times_of_single_messages(sizes, refills):
    repeated = RepeatedChunk([(7 + n, bytes([n]) * size) for n, size in enumerate(sizes)], 6)
    for times_ns, sequence in refills:
        single = OpenChunk()
        for k, t_ns in enumerate(times_ns):
            for n, size in enumerate(sizes):
                single.add(7 + n, bytes([n + k]) * size, t_ns, sequence + k, t_ns)
        for n, (start, size) in enumerate(zip(repeated.begin(times_ns, sequence), sizes, strict=True)):
            for k in range(len(times_ns)):
                place = start + k * repeated.stride
                repeated.data[place:place + size] = bytes([n + k]) * size
        assert repeated.data == single.data
        assert (repeated.size, repeated.index, repeated.counts()) == (single.size, single.index, single.counts())
        assert repeated.times_ns() == single.times_ns()


def test_a_repeated_chunk_is_packed_as_single_messages_are():
    data = np.random.default_rng(5).bytes(3000)
    repeated, packer = RepeatedChunk([(1, data), (4, data[:70])], 3), Packer('zstd')
    repeated.begin([10, 20, 30], 1)
    single = packer.pack((channel, one, 10 * k, k) for k in (1, 2, 3) for channel, one in ((1, data), (4, data[:70])))
    assert [packer.packed(repeated)] == single
