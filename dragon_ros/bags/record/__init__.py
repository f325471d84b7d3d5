"""What a recorder needs besides the bag: a writer thread, simulation times, loss accounting."""
