"""Pins strips of pictures: pictures side by side with captions, and the error without Pillow."""

import sys

import numpy as np
import pytest

from spidar_gym.errors import MissingDependencyError
from spidar_gym.viz.stills import write_strip

GREY = np.full((40, 60, 3), 128, np.uint8)


def test_pictures_are_side_by_side_and_missing_ones_of_a_row_are_white(tmp_path):
    image = pytest.importorskip("PIL.Image", reason="the extra `viz` is not installed")
    write_strip(tmp_path / "strip.png", [GREY] * 4, ["a", "b", "c", "d"])
    drawn = np.asarray(image.open(tmp_path / "strip.png"))
    assert drawn.shape == (80, 180, 3)
    assert (drawn[40:, 60:] == 255).all()
    assert (drawn[:40] == 128).any(axis=(0, 2)).all()


def test_without_pillow_the_error_states_the_extra_and_nothing_is_written(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "PIL", None)
    with pytest.raises(MissingDependencyError, match=r"Pillow is not available; .*pip install 'spidar-gym\[viz\]'"):
        write_strip(tmp_path / "strip.png", [GREY], ["a"])
    assert list(tmp_path.iterdir()) == []
