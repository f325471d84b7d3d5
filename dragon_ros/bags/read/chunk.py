"""What is in a chunk of an MCAP file: bounded decompression, the CRC, and the records inside."""
import struct
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

import lz4.frame
import zstandard
from mcap.opcode import Opcode

from dragon_ros.bags.read.records import HEAD, BagFile, Place

MOST_CHUNK = 128 * 2**20        # bytes of a chunk, decompressed: what one message and its neighbours may take
_FIXED = struct.Struct('<QQQII')
_MESSAGE = struct.Struct('<HIQQ')
_LONGEST_NAME = 32              # of a compression


@dataclass(frozen=True)
class ChunkHead:
    """What a chunk says of itself: times of its messages in ns, size and CRC of its records, and where they are."""

    start_ns: int
    end_ns: int
    size: int
    crc: int
    compression: str
    offset: int
    length: int


class Row(NamedTuple):
    """One message in a chunk; its data are the bytes from ``start`` to ``end``."""

    t_ns: int
    start: int
    end: int
    channel: int
    sequence: int
    publish_ns: int


class Inner(NamedTuple):
    """A record that is no message: its opcode and where its content is."""

    opcode: int
    start: int
    end: int


def chunk_head(file: BagFile, place: Place) -> ChunkHead:
    """Return what a chunk says of itself. Raises BagError where that cannot be."""
    if place.length < _FIXED.size + 8:
        raise file.fault(place.offset, f'a chunk of {place.length} bytes')
    start_ns, end_ns, size, crc, name = _FIXED.unpack(file.read(place.content, _FIXED.size))
    fixed = _FIXED.size + name + 8
    if name > _LONGEST_NAME or fixed > place.length:
        raise file.fault(place.offset, f'a chunk whose compression has a name of {name} bytes')
    text = file.read(place.content + _FIXED.size, name + 8)
    length = int.from_bytes(text[name:], 'little')
    if length != place.length - fixed:
        raise file.fault(place.offset, f'a chunk claims {length} bytes of records, {place.length - fixed} follow')
    return ChunkHead(start_ns, end_ns, size, crc, text[:name].decode(errors='replace'), place.content + fixed, length)


def chunk_data(file: BagFile, place: Place) -> bytes:
    """Return a chunk's records, decompressed and held against size and CRC. Raises BagError."""
    head = chunk_head(file, place)
    if max(head.size, head.length) > MOST_CHUNK:
        raise file.fault(place.offset, f'a chunk of {max(head.size, head.length)} bytes; the largest that is read has '
                         f'{MOST_CHUNK}')
    unpack = _UNPACK.get(head.compression)
    if unpack is None:
        raise file.fault(place.offset, f'a chunk in compression {head.compression!r}; known are zstd, lz4 and none')
    try:
        data = unpack(file.read(head.offset, head.length), head.size)
    except (zstandard.ZstdError, RuntimeError, ValueError, EOFError) as error:
        raise file.fault(place.offset, f'a chunk does not decompress: {error}') from None
    if len(data) != head.size:
        raise file.fault(place.offset, f'a chunk claims {head.size} bytes and holds {len(data)}')
    if head.crc and zlib.crc32(data) != head.crc:
        raise file.fault(place.offset, f'the CRC of a chunk is {zlib.crc32(data):08x}; it should be {head.crc:08x}')
    return data


def message_time_ns(file: BagFile, place: Place) -> int:
    """Return the time of a message outside of chunks. Raises BagError."""
    if place.length < _MESSAGE.size:
        raise file.fault(place.offset, f'a message has {place.length} bytes')
    t_ns: int = _MESSAGE.unpack(file.read(place.content, _MESSAGE.size))[2]
    return t_ns


def records_in(data: bytes) -> Iterator[Row | Inner]:
    """Yield what stands in the records of a chunk. Raises ValueError with the offset where they end early."""
    at, size = 0, len(data)
    while at < size:
        if at + HEAD.size > size:
            raise ValueError(f'its records end inside one at {at}')
        opcode, length = HEAD.unpack_from(data, at)
        start, end = at + HEAD.size, at + HEAD.size + length
        if end > size:
            raise ValueError(f'its record at {at} claims {length} bytes, {size - start} are left')
        if opcode == 0:
            raise ValueError(f'a record of kind 0 at {at}; there is no such kind')
        if opcode != Opcode.MESSAGE:
            yield Inner(opcode, start, end)
        elif length < _MESSAGE.size:
            raise ValueError(f'its message at {at} has {length} bytes')
        else:
            yield row_of(data, start + _MESSAGE.size, end)
        at = end


def row_of(data: bytes, start: int, end: int) -> Row:
    """Return the message whose data are the bytes from ``start`` to ``end``."""
    channel, sequence, t_ns, publish_ns = _MESSAGE.unpack_from(data, start - _MESSAGE.size)
    return Row(t_ns, start, end, channel, sequence, publish_ns)


def first_bytes(data: bytes, compression: str) -> bytes:
    """Return what can be decompressed of a chunk that was cut off, at most MOST_CHUNK bytes."""
    if compression == 'zstd':
        return _first_of_zstd(data)
    if compression == 'lz4':
        return _first_of_lz4(data)
    return data[:MOST_CHUNK] if compression == '' else b''


def _first_of_zstd(data: bytes) -> bytes:
    # In small steps: what was decompressed before the damage stays.
    reader, out = zstandard.ZstdDecompressor(max_window_size=MOST_CHUNK).stream_reader(data), bytearray()
    try:
        while len(out) < MOST_CHUNK and (part := reader.read(2**17)):
            out += part
    except zstandard.ZstdError:
        pass
    return bytes(out)


def _first_of_lz4(data: bytes) -> bytes:
    out, reader = bytearray(), lz4.frame.LZ4FrameDecompressor()
    try:
        for start in range(0, len(data), 2**12):
            if len(out) >= MOST_CHUNK or reader.eof:
                break
            out += reader.decompress(data[start:start + 2**12], max_length=MOST_CHUNK - len(out))
    except (RuntimeError, EOFError):
        pass
    return bytes(out)


def _plain(data: bytes, size: int) -> bytes:
    return data


def _zstd(data: bytes, size: int) -> bytes:
    """Decompress; the frame's own claim must be the chunk's before anything is allocated for it."""
    claimed = zstandard.frame_content_size(data)
    if claimed not in (-1, size):
        raise ValueError(f'its zstd frame claims {claimed} bytes, the chunk {size}')
    return zstandard.ZstdDecompressor().decompress(data, max_output_size=size) if size else b''


def _lz4(data: bytes, size: int) -> bytes:
    out: bytes = lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=size + 1)
    return out


_UNPACK: dict[str, Callable[[bytes, int], bytes]] = {'': _plain, 'zstd': _zstd, 'lz4': _lz4}
