"""The geometry of one instant: positions of benches, gaps between them, and the pairs to test."""
