"""The source that the options --scene or --bag name."""
from argparse import Namespace
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from dragon_ros.core.errors import InputError
from dragon_ros.tools.bag_source import dragon_in
from dragon_ros.tools.sources import SceneSource, Source
from dragon_ros.wire import cli
from dragon_ros.wire.log_read import LogReader


@contextmanager
def opened(arguments: Namespace) -> Iterator[Source]:
    """Open the source of the options of ``cli.add_source_options``, for the length of a ``with`` block."""
    if arguments.bag is None:
        if arguments.namespace is not None:
            raise InputError('--namespace: belongs to --bag; a scene has no topics')
        yield SceneSource(Path(arguments.scene).stem, cli.scene_from(arguments))
        return
    if arguments.overrides or arguments.accuracy is not None or arguments.scene != cli.DEFAULT_SCENE:
        raise InputError('--bag: shows what was recorded; leave out --scene, --set and --accuracy')
    with LogReader(arguments.bag) as bag:
        yield dragon_in(bag, arguments.namespace)
