"""Pins the committed files about the page: its pictures in both windows, and its costs beside other pages'."""

import json
import struct
from itertools import product

import pytest
from support.commands import ROOT

RESULT = json.loads((ROOT / "docs" / "results" / "web.json").read_text(encoding="utf-8"))
SOURCE = (ROOT / "tests" / "viz" / "live" / "costs.py").read_text(encoding="utf-8")
WINDOWS = (1280, 800), (390, 844)


@pytest.mark.parametrize(("width", "height"), WINDOWS)
def test_the_picture_of_a_window_is_as_large_as_the_window_and_small_enough_for_a_page(width, height):
    content = (ROOT / "docs" / "pictures" / f"web-{width}.png").read_bytes()
    assert struct.unpack(">II", content[16:24]) == (width, height)
    assert len(content) < 200_000


def test_the_table_is_of_all_pages_in_both_windows():
    _, *lines = RESULT["lines"]
    names = "spidar view", "mjviser", "MuJoCo's studio"
    windows = [f"{width} × {height}" for width, height in WINDOWS]
    assert [(window, name) for name, window, *_ in lines] == list(product(windows, names))
    assert f'"{RESULT["command"]}"' in SOURCE
    assert all(f'"{title}"' in SOURCE for title in RESULT["lines"][0])
