"""Make the helpers beside this file (such as ``runs``) importable for the tests in this folder."""
