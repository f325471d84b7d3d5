"""What the command lines of the nodes share."""
import argparse
from typing import NoReturn

from dragon_ros.cli import command_line


def parser(name: str, text: str, example: str) -> argparse.ArgumentParser:
    """Return a parser that knows --json."""
    options = command_line.parser(name, text, example)
    options.add_argument('--json', action='store_true', help='log for machines: one JSON object a line')
    return options


def parse(options: argparse.ArgumentParser, argv: list[str]) -> argparse.Namespace:
    """Parse the arguments that are not for ROS (``--ros-args ...``); exit with code 2 where any is wrong."""
    if '--help' in argv or '-h' in argv:
        _help(options)
    from rclpy.utilities import remove_ros_args
    try:
        rest: list[str] = remove_ros_args([options.prog, *argv])[1:]
    except Exception as error:  # noqa: BLE001 - rcl raises its own types for bad --ros-args
        options.exit(command_line.BAD_INPUT, f'{options.prog}: {" ".join(str(error).split())}\n')
    return options.parse_args(rest)


def _help(options: argparse.ArgumentParser) -> NoReturn:
    options.print_help()
    options.exit(command_line.OK)
