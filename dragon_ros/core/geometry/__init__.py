"""The geometry of one instant: where benches lie, how far apart they are, and which pairs to test."""
