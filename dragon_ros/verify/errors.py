"""The error that rejects a certificate; its message is one line that names the field."""


class Refused(Exception):
    """The certificate does not hold, is malformed, or could not be proved within the budget."""
