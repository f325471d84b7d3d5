"""``design``: questions about what to build, each a subcommand whose answer has bounds."""
import json
from argparse import ArgumentParser, Namespace
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

from dragon_ros.cli import command_line
from dragon_ros.commands import design_fit, design_min_pitch, design_speed, design_turn

Values = dict[str, Any]


class Question(NamedTuple):
    """A subcommand: what it answers, its options, and the functions that find and print the answer."""

    help: str
    example: str
    options: Callable[[ArgumentParser], None]
    answer: Callable[[Namespace], Values]
    text: Callable[[Values], str]


QUESTIONS = {
    'turn': Question('the length of the S-turn, and whether it can be shortened', 'turn --set track.ratio=3',
                     design_turn.options, design_turn.answer, design_turn.text),
    'max-speed': Question('the largest speed of the leader at which no handle ever exceeds a limit',
                          'max-speed --limit 2', design_speed.options, design_speed.answer, design_speed.text),
    'min-pitch': Question('the smallest pitch at which the head reaches a circle without any contact on the way in',
                          'min-pitch --diameter 9', design_min_pitch.options, design_min_pitch.answer,
                          design_min_pitch.text),
    'fit': Question('the smallest square that holds the whole dragon during a run, and whether it fits a given one',
                    'fit --square 24', design_fit.options, design_fit.answer, design_fit.text),
}


def main(argv: list[str]) -> int:
    """Answer a design question; return the exit code."""
    options = command_line.parser('design', 'Answer a question about what to build.',
                                  'python -m dragon_ros design turn')
    questions = options.add_subparsers(dest='question', required=True, metavar='QUESTION')
    for name, question in QUESTIONS.items():
        one = questions.add_parser(name, help=question.help, description=f'Find {question.help}.', allow_abbrev=False,
                                   epilog=f'example: python -m dragon_ros design {question.example}')
        question.options(one)
        command_line.add_output_options(one, ('text', 'json'))
    arguments = options.parse_args(argv)
    return command_line.guarded('design', partial(_run, QUESTIONS[arguments.question], arguments))


def _run(question: Question, arguments: Namespace) -> int:
    values = question.answer(arguments)
    text = json.dumps(values) if arguments.format == 'json' else question.text(values)
    command_line.write_output(arguments.output, text)
    return command_line.OK
