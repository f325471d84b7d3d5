"""Pictures and films of a dragon over time, from a scene or a bag."""
