"""Support for recorders: a writer thread, simulation times and loss accounting."""
