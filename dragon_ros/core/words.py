"""Phrases that messages in all rooms share."""

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
    """Return a length as a tape measure shows it: in millimetres up to a metre, then in metres."""
    if metres < 0.9995:
        return f'{1000 * metres:.3g} mm' if metres < 0.01 else f'{1000 * metres:.0f} mm'
    return f'{metres:.2f} m'
