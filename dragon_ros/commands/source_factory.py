"""The source that the options --scene or --bag name."""
from argparse import Namespace
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from dragon_ros.bags.read.reader import LogReader
from dragon_ros.cli import command_line
from dragon_ros.commands.bag_source import dragon_in
from dragon_ros.commands.sources import SceneSource, Source
from dragon_ros.core.errors import InputError


@contextmanager
def opened(arguments: Namespace) -> Iterator[Source]:
    """Open the source of the options of ``cli.add_source_options``, for the length of a ``with`` block."""
    if arguments.bag is None:
        if arguments.namespace is not None:
            raise InputError('--namespace: belongs to --bag; a scene has no topics')
        yield SceneSource(Path(arguments.scene).stem, command_line.scene_from(arguments))
        return
    if arguments.overrides or arguments.accuracy is not None or arguments.scene != command_line.DEFAULT_SCENE:
        raise InputError('--bag: shows what was recorded; leave out --scene, --set and --accuracy')
    with LogReader(arguments.bag) as bag:
        yield dragon_in(bag, arguments.namespace)
