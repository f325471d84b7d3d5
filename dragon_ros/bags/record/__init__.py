"""The parts of a recorder besides the bag: a writer thread, simulation times and loss accounting."""
