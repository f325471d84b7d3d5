"""Shared parts of all command lines: options, errors, completion, figures, signals."""
