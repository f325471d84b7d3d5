"""The error that rejects a certificate, with a one-line message that names the field."""


class Refused(Exception):
    """The certificate does not hold, is malformed, or could not be proved within the budget."""
