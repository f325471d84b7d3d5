"""``plot``: pictures of a scene or a bag."""
