"""The parts of a recorder other than the bag: a writer thread, simulation times and loss accounting."""
