"""Select the language of human-readable text, English or Chinese, from ``--lang`` or the locale."""
import os
from argparse import ArgumentParser
from collections.abc import Mapping

LANGUAGES = ('en', 'zh')
Words = Mapping[str, tuple[str, str]]       # key: (English, Chinese)


def add_lang_option(parser: ArgumentParser, what: str) -> None:
    """Add --lang, which sets the language of ``what``; its value must be passed to ``language_of``."""
    parser.add_argument('--lang', choices=LANGUAGES, help=f'language of {what} (from the locale)')


def language_of(given: str | None) -> str:
    """Return ``given`` or, if it is None, the language of the locale: ``zh`` for Chinese, otherwise ``en``."""
    if given is not None:
        return given
    locale = next((value for name in ('LC_ALL', 'LC_MESSAGES', 'LANG') if (value := os.environ.get(name))), '')
    return 'zh' if locale.lower().startswith('zh') else 'en'


def say(words: Words, key: str, lang: str, **parameters: object) -> str:
    """Return the sentence for a key in a language, with its parameters inserted."""
    return words[key][LANGUAGES.index(lang)].format_map(parameters)
