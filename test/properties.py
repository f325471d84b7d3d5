"""How many examples a property is tried with: fewer in the profile ``brief``, many more in ``thorough``."""
from hypothesis import settings

USUAL = 100         # examples of a property that says nothing


def examples(count: int) -> settings:
    """Return the settings of a property that is usually tried with so many examples, at least two in any profile."""
    return settings(max_examples=max(2, count * settings().max_examples // USUAL))
