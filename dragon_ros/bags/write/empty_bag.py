"""Files without messages that a recorder left behind; the next recorder may replace them."""
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING

from mcap.opcode import Opcode

from dragon_ros.core.errors import InputError

if TYPE_CHECKING:
    from dragon_ros.bags.read.mcap import Index

_HOLDING = (Opcode.MESSAGE, Opcode.CHUNK, Opcode.ATTACHMENT)
_CUT_BYTES = 4096       # a longer remainder is not considered a truncated record


def holds_no_message(path: Path) -> bool:
    """Return whether a file is an .mcap file, complete or truncated, without messages or attachments."""
    try:
        if not path.is_file():
            return False
        if path.stat().st_size == 0:
            return path.suffix == '.mcap'
        from dragon_ros.bags.read.mcap import McapFile, scanned_index  # imported lazily: it is rarely needed
        with closing(McapFile(path)) as file:
            index = scanned_index(file)
            return not (index.batches or index.attachments) and _ends_at_damage(index)
    except (InputError, OSError):
        return False


def _ends_at_damage(index: 'Index') -> bool:
    """Return whether a file is undamaged, or ends in a truncated record that is not a message, chunk or attachment."""
    if index.damage is None:
        return True
    file, at = index.file, index.damage.fields['offset']
    return file.size - at < _CUT_BYTES and (at >= file.size or file.read(at, 1)[0] not in _HOLDING)
