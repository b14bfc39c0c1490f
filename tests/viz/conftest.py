"""What tests of figures share."""

import pytest

from spidar_gym.viz import courses, figures, style


@pytest.fixture
def kept(monkeypatch):
    """The figures that are saved, left open."""
    found = []
    for module in (courses, figures):
        monkeypatch.setattr(module, "save", lambda figure, path: found.append(figure))
    yield found
    for figure in found:
        style.pyplot().close(figure)
