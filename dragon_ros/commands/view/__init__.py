"""``view``: show a scene or a bag in the browser."""
