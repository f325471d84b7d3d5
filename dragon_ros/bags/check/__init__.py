"""What a bag is worth: integrity, gaps, repair, comparison with the model."""
