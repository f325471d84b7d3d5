"""Make the helpers beside this file (such as ``apart``) importable for the tests in the folders below."""
