"""Pins the page in a browser, on a desk and on a telephone: it shows the robot, and clicks and keys reach it."""

import threading
import time

import numpy as np
import pytest
from support.needs import marks
from support.pages import needs_viser

from spidar_gym.viz.live.serve import HOST, keep_time, served
from spidar_gym.viz.live.session import Session

pytestmark = [pytest.mark.slow, *marks("browser"), needs_viser]
READY = "!!document.body?.innerText.includes('of its weight')"
DESK, TELEPHONE = (1280, 800), (390, 844)
RECTANGLES = """[...document.querySelectorAll('button, input')].map(b => [b, b.getBoundingClientRect()])
  .filter(([b, r]) => r.width > 4 && r.height > 4 && getComputedStyle(b).opacity !== '0')
  .map(([b, r]) => [b.innerText || b.tagName, r.left, r.top, r.right, r.bottom])"""


@pytest.fixture
def opened():
    """Open a browser on a session that flies in real time."""
    from support.chromium import Chromium

    undo = []

    def open_page(size, host=HOST, **options):
        session = Session(options={"joint_speed": 1.0, **options})
        entered = served(session, {}, host=host, port=0)
        page, address = entered.__enter__()
        ended = threading.Event()
        loop = threading.Thread(target=keep_time, args=(page, ended.is_set))
        loop.start()
        undo.extend([session.close, lambda: entered.__exit__(None, None, None), loop.join, ended.set])
        browser = Chromium(address, *size)
        undo.append(browser.close)
        browser.until(READY)
        return browser, session, address

    yield open_page
    while undo:
        undo.pop()()


def flown(session, is_so):
    """Wait until a condition holds, for at most ten simulated seconds."""
    begin = session.passed
    while not is_so():
        assert session.passed < begin + 400
        time.sleep(0.02)


def seen(browser, path):
    """Return the picture, (height, width, 3)."""
    image = pytest.importorskip("PIL.Image")
    browser.picture(path)
    return np.asarray(image.open(path).convert("RGB")).astype(int)


def orange(picture):
    """Return rows and columns of the pixels of the thrusts' arrows."""
    red, green, blue = np.moveaxis(picture, 2, 0)
    return np.argwhere((red > 150) & (green < 120) & (blue < 90))


@pytest.mark.parametrize("size", [DESK, TELEPHONE], ids=["desk", "telephone"])
def test_the_robot_is_in_the_picture_and_nothing_lies_on_anything(opened, size, tmp_path):
    browser, _, address = opened(size)
    width, height = size
    left, right = (304, 956) if size is DESK else (0, width)
    bottom = (0.9 if size is DESK else 0.42) * height  # on a telephone above the panel

    def arrows():
        found = orange(seen(browser, tmp_path / "page.png"))
        return found[(found[:, 1] > left + 2) & (found[:, 1] < right - 2)]

    # The picture is refined, and the camera moves back once the picture's width is known.
    for _ in range(60):
        inside = arrows()
        if len(inside) > 200 and inside[:, 0].max() < bottom:
            break
    assert len(inside) > 200
    assert inside[:, 1].min() > left + 5
    assert inside[:, 1].max() < right - 5
    assert inside[:, 0].max() < bottom
    boxes = browser.js(RECTANGLES)
    assert len(boxes) > 15
    for k, (name, x0, y0, x1, y1) in enumerate(boxes):
        assert x0 >= 0
        assert x1 <= width, name
        for other, a0, b0, a1, b1 in boxes[k + 1 :]:
            assert min(x1, a1) - max(x0, a0) < 1 or min(y1, b1) - max(y0, b0) < 1, f"{name} lies on {other}"
    assert browser.asked == {f"{address}/"}


def test_a_click_changes_the_form_in_flight(opened):
    browser, session, _ = opened(DESK)
    before = session.env
    browser.click("③")
    browser.until("[...document.querySelectorAll('input')].some(b => b.value === '90')")  # the slider follows
    assert session.form[3] == pytest.approx(np.pi / 2)
    assert session.env is before
    flown(session, lambda: session.env.state.joint_position[3] > 1.5)
    assert (session.over, session.seed) == ("", 0)


def test_a_page_that_is_open_to_a_network_comes_in_by_its_token(opened):
    browser, session, address = opened(DESK, host="0.0.0.0")
    assert len(address.rpartition("/")[2]) >= 32
    browser.click("③")
    flown(session, lambda: session.form[3] > 1.5)
    browser.call("Page.reload")
    browser.until(READY)
    assert not browser.js("document.body.innerText.includes('refused')")


def test_keys_fly_the_reference(opened):
    browser, session, _ = opened(DESK)
    for _ in range(4):
        browser.hit("R")
    flown(session, lambda: session.env.helm.place[2] > 0.15)
    assert session.env.helm.goal[2] == pytest.approx(0.2)


def test_the_picture_moves_with_the_robot(opened, tmp_path):
    browser, session, _ = opened(DESK)
    for _ in range(60):
        before = orange(seen(browser, tmp_path / "page.png"))
        if len(before) > 200:
            break
    for _ in range(30):
        browser.hit("R")
    flown(session, lambda: session.env.helm.place[2] > 0.3)
    higher = before
    for _ in range(60):
        higher = orange(seen(browser, tmp_path / "page.png"))
        if len(higher) and higher[:, 0].mean() < before[:, 0].mean() - 20:
            break
    assert higher[:, 0].mean() < before[:, 0].mean() - 20
