"""What the checker answers where it does not accept a certificate: one line that names the place in it."""


class Refused(Exception):
    """A certificate that does not hold, that is none, or that could not be proved within the budget."""
