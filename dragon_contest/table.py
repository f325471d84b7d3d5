"""``table --paper`` and ``table --contest``: the paper's tables, and the contest's result files."""
import sys
from argparse import Namespace

import dragon_ros as dr
from dragon_contest import paper_tables
from dragon_ros.cli import command_line
from dragon_ros.cli.language import language_of, say
from dragon_ros.cli.progress import Progress


def run(arguments: Namespace) -> int:
    """Print the paper's tables, or write the contest's files and print their paths; return the exit code."""
    return _paper(arguments) if arguments.paper else _contest(arguments)


def _paper(arguments: Namespace) -> int:
    cells = paper_tables.cells()
    content = (paper_tables.text(cells, language_of(arguments.lang)) if arguments.format == 'text' else
               paper_tables.FORMATS[arguments.format](cells))
    command_line.write_output(arguments.output, content)
    return command_line.OK


def _contest(arguments: Namespace) -> int:
    from dragon_contest import result_files
    scene = command_line.scene_from(arguments)
    with Progress('contest', 'steps', 11) as bar:
        paths = result_files.write(arguments.contest, scene, dr.scene('turning'), bar.update)
    command_line.write_output(None, '\n'.join(map(str, paths)))
    if not any(path.suffix == '.xlsx' for path in paths):
        print(say(paper_tables.WORDS, 'no_xlsx', language_of(arguments.lang)), file=sys.stderr)
    return command_line.OK
