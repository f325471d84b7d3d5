"""Compare the length of each message with the length that its type implies."""
import numpy as np

from dragon_ros.core.numerics.types import Array
from dragon_ros.messages.decode import Layout, MessageError, Reader, check_end, layout_of
from dragon_ros.messages.schemas import fields_of

_ALIGNED = 4        # bytes of a word that holds a length


class LengthCheck:
    """Checks the length of messages of one type; a message laid out like the previous message is not parsed."""

    def __init__(self, name: str) -> None:
        """Start with the name of a message type whose schema is in the package."""
        self._name, self._fields = name, fields_of(name)
        self._last: tuple[str, Layout, Array, Array] | None = None

    def fault(self, data: bytes) -> str | None:
        """Return why the bytes are not exactly one message, or None if they are."""
        try:
            layout = self._layout(Reader(data))
            check_end(layout.end, layout.spare, len(data))
        except MessageError as error:
            return f'{self._name}: {error}'
        return None

    def _layout(self, reader: Reader) -> Layout:
        """Return the layout of the message. Raises MessageError if the bytes end within it."""
        if self._last is not None:
            order, layout, places, words = self._last
            if order == reader.order and layout.end <= len(reader.data) and np.array_equal(
                    _words(reader)[places], words):
                return layout
        layout = layout_of(reader, self._fields)
        places = np.array(layout.lengths, np.intp) // _ALIGNED
        self._last = reader.order, layout, places, _words(reader)[places]
        return layout


def _words(reader: Reader) -> Array:
    words: Array = np.frombuffer(reader.data, f'{reader.order}u4', len(reader.data) // _ALIGNED)
    return words
