"""Shell completion with argcomplete, which sets ``_ARGCOMPLETE`` and runs the program to obtain the completions."""
import argparse
import os
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any


def chosen(names: Iterable[str]) -> str:
    """Return the executable whose arguments are to be completed; if its name is incomplete, complete it and exit."""
    from argcomplete.lexers import split_line
    words = split_line(os.environ['COMP_LINE'], int(os.environ['COMP_POINT']))[3]
    start = int(os.environ['_ARGCOMPLETE'])
    if len(words) > start:
        os.environ['_ARGCOMPLETE'] = str(start + 1)
        return str(words[start])
    parser = argparse.ArgumentParser()
    parser.add_argument('name', choices=sorted(names))
    answer(parser)
    raise SystemExit


def answer(parser: argparse.ArgumentParser) -> None:
    """Send the completions of a parser's options to the shell, and exit."""
    import argcomplete
    for action in _actions(parser):
        if not action.choices and action.nargs != 0:
            action.completer = _completer(action)  # type: ignore[attr-defined]
    argcomplete.autocomplete(parser, always_complete_options='long')


def _actions(parser: argparse.ArgumentParser) -> Iterator[argparse.Action]:
    for action in parser._actions:
        yield action
        if isinstance(action.choices, dict):        # subcommands
            for child in action.choices.values():
                yield from _actions(child)


def _completer(action: argparse.Action) -> Any:
    """Return the completer of an option's value, which suggests files, scenes, scene keys, accuracies or nothing."""
    from argcomplete.completers import FilesCompleter, SuppressCompleter
    if action.type is Path:
        return FilesCompleter()
    if action.dest == 'scene':
        from dragon_ros.configuration import scene_names
        return lambda prefix, **_: [*scene_names(), *FilesCompleter(('yaml', 'yml'))(prefix)]
    if action.dest == 'overrides':
        return lambda **_: _keys()
    return (lambda **_: _requests()) if action.dest == 'accuracy' else SuppressCompleter()


def _keys() -> list[str]:
    """Return the scene keys for --set. The function imports numpy, so it is called only to complete a key."""
    from dataclasses import fields

    from dragon_ros.scenes.load import SECTIONS, SINGLES
    keys = {f'{name}.{each.name}' for name, kinds in SECTIONS.items() for kind in kinds.values()
            for each in fields(kind)}
    return [f'{key}=' for key in (*sorted(keys), *SINGLES)]


def _requests() -> list[str]:
    from dragon_ros.core.promise import REQUESTS
    return sorted(REQUESTS)
