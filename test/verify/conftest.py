"""Helpers beside this file (``runs``) are imported by the tests of this room."""
