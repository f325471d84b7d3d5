"""How far a bag can be trusted: integrity, gaps, repair, and comparison with the model."""
