"""Check bags: integrity, gaps, repair, and comparison with the model."""
