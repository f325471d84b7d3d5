"""Phrases that messages in all rooms share."""
from math import ceil

_ROUNDING = 1e-6        # of a length that a float cannot state exactly, in units of the last digit shown
_PLURALS = {'is': 'are', 'was': 'were', 'has': 'have', 'overlaps': 'overlap', 'matches': 'match'}
COLUMNS = ('t_s', 'handle', 'x_m', 'y_m', 'vx_m_s', 'vy_m_s', 'speed_m_s')     # of a table of handles at many times


def counted(count: int, noun: str, verb: str = '', *, form: str = 'd') -> str:
    """Return a count, its noun and a verb, all singular for 1; the noun and the verb may be empty.

    ``form`` is the format of the count, such as ',' for a separator of thousands.
    """
    if count != 1:
        noun += 'es' if noun.endswith('ch') else 's' if noun else ''
        verb = _PLURALS.get(verb, verb)
    return ' '.join(filter(None, (f'{count:{form}}', noun, verb)))


def length(metres: float) -> str:
    """Return a length as a tape measure shows it, rounded up: in millimetres up to a metre, then in metres."""
    if metres > 0.999:
        return f'{ceil(100 * metres - _ROUNDING) / 100:.2f} m'
    if metres > 0.01:
        return f'{ceil(1000 * metres - _ROUNDING)} mm'
    return f'{ceil(10_000 * metres - _ROUNDING) / 10:g} mm'
