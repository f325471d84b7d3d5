"""The version of this software, which bags, certificates and cost pages state."""

__version__ = '0.4.0'
