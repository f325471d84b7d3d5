"""Open the scene or the bag that a command shows."""
from argparse import Namespace
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from dragon_ros.cli import command_line
from dragon_ros.cli.pool import ALONE, Pool
from dragon_ros.core.errors import InputError
from dragon_ros.pictures.sources import SceneSource, Source, dragon_in


@contextmanager
def opened(arguments: Namespace, pool: Pool = ALONE) -> Iterator[Source]:
    """Open the source that the options of ``command_line.add_source_options`` select, for the duration of a block."""
    if arguments.bag is None:
        if arguments.namespace is not None:
            raise InputError('--namespace: it requires --bag; omit --namespace for a scene')
        yield SceneSource(Path(arguments.scene).stem, command_line.scene_from(arguments), pool)
        return
    if command_line.gives_scene(arguments):
        raise InputError('--bag: a bag replaces the scene; omit --scene, --set and --accuracy')
    from dragon_ros.bags.read.reader import BagReader  # imported lazily, because a scene needs no bag
    with BagReader(arguments.bag) as bag:
        yield dragon_in(bag, arguments.namespace, pool)
