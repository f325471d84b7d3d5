"""Helpers beside this file (``apart``) are imported by the tests of the rooms below."""
