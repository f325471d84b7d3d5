"""``view``: a scene or a bag in the browser."""
