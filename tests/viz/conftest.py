"""Fixtures that tests of figures share."""

import pytest

from spidar_gym.viz import courses, figures, style


@pytest.fixture
def kept(monkeypatch):
    """Collect the figures that are saved, without closing them."""
    found = []
    for module in (courses, figures):
        monkeypatch.setattr(module, "save", lambda figure, path: found.append(figure))
    yield found
    for figure in found:
        style.pyplot().close(figure)
