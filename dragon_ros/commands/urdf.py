"""``urdf``: write the dragon of a scene as a robot for RViz, MoveIt, Gazebo and other programs."""
from argparse import SUPPRESS
from pathlib import Path

from dragon_ros.cli import command_line


def main(argv: list[str]) -> int:
    """Write the URDF; return the exit code."""
    options = command_line.parser('urdf', 'Write the dragon of a scene as a URDF robot: benches are links of real '
                                  'size, and handles are revolute joints.\nThe topic joint_states (effect joints) '
                                  'contains the angles of the joints.',
                                  'urdf winding --set dragon.benches=9 --output dragon.urdf')
    command_line.add_scene_options(options)
    options.add_argument('scene', nargs='?', default=SUPPRESS, metavar='SCENE', help='the same as --scene')
    options.add_argument('--output', type=Path, metavar='FILE', help='write to a file instead of standard '
                         'output')
    arguments = options.parse_args(argv)

    def work() -> int:
        from dragon_ros.messages.urdf import urdf_of
        command_line.write_output(arguments.output, urdf_of(command_line.scene_from(arguments)))
        return command_line.OK
    return command_line.guarded('urdf', work)
