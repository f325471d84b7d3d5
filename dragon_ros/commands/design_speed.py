"""``design max-speed``: how fast the leader may go so that no handle ever exceeds a limit."""
from argparse import ArgumentParser, Namespace
from dataclasses import asdict
from typing import Any

from tqdm import tqdm

from dragon_ros.cli import command_line
from dragon_ros.core.checks import number
from dragon_ros.core.design.max_speed import max_speed


def options(parser: ArgumentParser) -> None:
    """Add the scene options and the limit; the scene is the turn's."""
    command_line.add_scene_options(parser)
    parser.set_defaults(scene='turning')
    parser.add_argument('--limit', type=float, default=2.0, metavar='M_S', help='of every handle, in m/s (2)')


def answer(arguments: Namespace) -> dict[str, Any]:
    """Return the leader's largest speed, and which handle reaches the limit, and where; a profile is scaled."""
    limit = number('--limit', arguments.limit, above=0.0, high=1e9)
    scene = command_line.scene_from(arguments)
    with tqdm(desc='max-speed', unit=' places', disable=None, leave=False, delay=1) as bar:
        found = max_speed(scene, bar.update)
    return {'speed_m_s': limit / found.ratio, 'uncertainty_m_s': limit / found.ratio - limit / found.bound,
            'limit_m_s': limit, **asdict(found)}


def text(values: dict[str, Any]) -> str:
    """Return the answer as text."""
    return (f'the leader may go {values["speed_m_s"]:.12g} m/s (to {values["uncertainty_m_s"]:.1g} m/s; of a profile, '
            f'its largest speed) and no handle exceeds {values["limit_m_s"]:.9g} m/s\n'
            f'handle {values["handle"]} is the fastest, {values["ratio"]:.12g} times the leader, when the leader is '
            f'{values["along_m"]:.7g} m along the track (on a turn: from its entry)\n'
            f'{values["looks"]} places were examined')
