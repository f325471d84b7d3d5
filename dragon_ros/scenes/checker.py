"""Run the independent checker of certificates in a process that shares nothing with the solver."""
import json
import subprocess
import sys
from contextlib import suppress
from threading import Timer
from typing import Any

from dragon_ros.core.errors import InputError

_EFFORT = 1000      # a multiple of the usual budget, so large that only the time limit can end the proof early


def command(certificate: str, effort: str | None = None) -> list[str]:
    """Return the command that checks a certificate file; ``-`` means standard input."""
    given = [] if effort is None else [f'--effort={effort}']
    return [sys.executable, '-m', 'dragon_ros.verify', certificate, *given]


def prove(values: Any, most_s: float) -> str:
    """Return the statement that a certificate proves. Raises InputError if the statement is not proved in time."""
    try:
        text = json.dumps(values)
    except (TypeError, ValueError):
        raise InputError('its certificate is refused: it is not a valid certificate') from None
    with subprocess.Popen(command('-', str(_EFFORT)), stdin=subprocess.PIPE, stdout=subprocess.PIPE,
                          stderr=subprocess.PIPE, text=True) as process:
        end = Timer(most_s, process.kill)
        end.start()
        try:
            why = _told(process, text)
            said = process.stdout.read() if process.stdout else ''
        finally:
            end.cancel()
            process.kill()
    if said:
        return said.removeprefix('-: ').rstrip('\n')
    raise InputError(f'its certificate is {why}' if why else f'its certificate was not proved within {most_s:g} s')


def _told(process: subprocess.Popen[str], text: str) -> str:
    """Send a certificate to the checker, show the progress on a terminal, and return the reason for a rejection."""
    assert process.stdin is not None
    assert process.stderr is not None
    with suppress(BrokenPipeError), process.stdin as file:
        file.write(text)
    why = ''
    for line in process.stderr:
        if line.startswith('-: '):
            why = line.removeprefix('-: ').rstrip('\n')
        elif sys.stderr.isatty():
            print(line.rstrip('\n'), end='\r', file=sys.stderr, flush=True)
    return why
