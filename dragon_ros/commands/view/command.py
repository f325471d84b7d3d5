"""``view``: show a scene or a bag in the browser, served only on this host, without ROS."""
import argparse
import os
import signal
import sys
import threading
import webbrowser
from argparse import Namespace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from dragon_ros.cli import command_line
from dragon_ros.cli.language import LANGUAGES
from dragon_ros.cli.progress import Progress
from dragon_ros.cli.signals import ending
from dragon_ros.core.errors import FieldError, InputError

if TYPE_CHECKING:
    from dragon_ros.commands.view.data import ViewData
    from dragon_ros.commands.view.variants import Variants

_LOOKS_S = 0.1         # interval (s) at which the server checks whether to end


def main(argv: list[str]) -> int:
    """Serve until Ctrl-C; return the exit code."""
    return command_line.guarded('view', partial(_run, options().parse_args(argv)))


def options() -> argparse.ArgumentParser:
    """Return the parser."""
    parser = command_line.parser('view', 'Play a scene or a bag in the browser, with controls for play, pause, time, '
                                 'speed and zoom, and with the clearance and the speeds beside the dragon. The page is '
                                 'reachable only from this host. Ctrl-C ends the server.',
                                 'view --scene first_contact')
    command_line.add_source_options(parser)
    parser.add_argument('--try', action='store_true', dest='tries',
                        help='show sliders that change values of the scene')
    parser.add_argument('--lang', choices=LANGUAGES, help='language of the page (from the browser)')
    parser.add_argument('--port', type=int, default=0, help='port of the page (any free port)')
    parser.add_argument('--no-browser', action='store_true', help='print the address without opening a browser')
    return parser


def _run(arguments: Namespace) -> int:
    if not 0 <= arguments.port <= 65535:
        raise FieldError('--port', arguments.port, 'ports are 0 to 65535', 'omit it to use any free port')
    if arguments.tries:
        from dragon_ros.commands.view.variants import Variants
        if arguments.bag is not None:
            raise InputError('--try: it requires a scene; the run in a bag cannot be changed')
        name = Path(arguments.scene).stem
        return _serve(name, Variants(name, arguments.scene, command_line.overrides_from(arguments)), arguments)
    from dragon_ros.commands.opened import opened
    from dragon_ros.commands.view.data import ViewData
    with opened(arguments) as source:
        return _serve(source.name, ViewData(source, Progress('view', 'ticks')), arguments)


def _serve(name: str, shown: 'ViewData | Variants', arguments: Namespace) -> int:
    """Serve until a signal arrives."""
    from dragon_ros.commands.view.server import ViewServer
    stop = threading.Event()
    with ViewServer(shown, arguments.port, arguments.lang) as server:
        for number in ending():
            signal.signal(number, lambda *_: stop.set())
        serving = threading.Thread(target=server.serve_forever, args=(_LOOKS_S,))
        serving.start()
        command_line.write_output(None, f'{name} is at {server.url} (Ctrl-C ends)')
        if not arguments.no_browser and _has_screen():
            webbrowser.open(server.url)
        stop.wait()
        server.shutdown()
        serving.join()
    return command_line.OK


def _has_screen() -> bool:
    """Return whether a browser would open its own window; a text browser would take over this terminal."""
    return sys.platform != 'linux' or bool(os.environ.get('DISPLAY') or os.environ.get('WAYLAND_DISPLAY'))
