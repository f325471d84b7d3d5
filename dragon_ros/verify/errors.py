"""The error with which the checker rejects a certificate: one line that names the field in it."""


class Refused(Exception):
    """A certificate that does not hold, that is malformed, or that could not be proved within the budget."""
