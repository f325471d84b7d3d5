"""The geometry of one instant: the positions of benches, their gaps, and the pairs to test."""
