"""The geometry of one instant: where benches lie, how far they are apart, and which pairs to ask about."""
