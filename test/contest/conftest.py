"""A browser."""
from browser_fixtures import axe, chromium, page  # noqa: F401 - fixtures
