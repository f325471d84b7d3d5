"""Errors of the middleware at the start of a node, which settings such as names and remappings cause."""
import os
from collections.abc import Iterator
from contextlib import contextmanager

from dragon_ros.core.errors import InputError


@contextmanager
def in_one_line(what: str) -> Iterator[None]:
    """Raise InputError, which names the part of the node that cannot be created, instead of RuntimeError."""
    try:
        yield
    except RuntimeError as error:
        secured = 'ROS_SECURITY_ENABLE: ' if os.environ.get('ROS_SECURITY_ENABLE') == 'true' else ''
        raise InputError(f'{secured}{what} cannot be created: {" ".join(str(error).split())}; check the names, '
                         'parameters and remappings that the node was started with') from None
