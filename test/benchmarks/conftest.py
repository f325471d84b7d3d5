"""Every picture saved by a test of a cost page must be readable."""
import pictures
import pytest

from dragon_ros.cli import figures


@pytest.fixture(autouse=True)
def _pictures_are_readable(monkeypatch, request):
    monkeypatch.setattr(figures, 'save', pictures.readable(figures.save, request.config.getoption('--long')))
