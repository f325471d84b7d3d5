"""Contact: who is how near to whom at one instant, and the first contact of a run with what proves it."""
