"""The version of this software; bags, certificates and cost pages name it."""

__version__ = '0.3.0'
