"""Measures the costs of the page and of other pages, and takes its pictures: `python -m tests.viz.live.costs`."""

import argparse
import json
import os
import socket
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from datetime import date
from functools import partial
from importlib.metadata import version
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import gymnasium
import mujoco
import numpy as np
import websockets.asyncio.connection
from PIL import Image

from spidar_gym import __version__
from spidar_gym.cli.view import WebOptions, policies
from spidar_gym.console import run_cli
from spidar_gym.control.flight.controller import CONTROL_RATE
from spidar_gym.envs.registry import HOVER
from spidar_gym.errors import SpidarError
from spidar_gym.files import output_folder
from spidar_gym.sim.disturbances import Disturbances
from spidar_gym.sim.scene import scene
from spidar_gym.text import format_table
from spidar_gym.viz.live.serve import keep_time, served
from spidar_gym.viz.live.session import Session
from tests.support.chromium import Chromium

COMMAND = "python -m tests.viz.live.costs --out docs/results/web.json --pictures docs/pictures"
HEADING = [
    "page",
    "window [px]",
    "painted [1/s]",
    "without shadow",
    "× real time",
    "processor",
    "sent [kB/s]",
    "click to state [ms]",
    "load",
]
SIZES = ((1280, 800), (390, 844))
"""A desk's window and a telephone's."""
WARM, SECONDS, CLICKS = 12.0, 8.0, 10
"""Time to warm up [s], duration of each measurement [s], number of timed clicks."""
TRIES, KEEPS_UP = 2, 0.95
"""Largest number of measurements of a page, and least speed of its robot in multiples of real time."""
NONE = "–"
COLORS = 256
"""Number of colours of a picture."""
PAINTED = """new Promise(done => { let n = 0; const begin = performance.now();
  const step = () => { n++; const passed = performance.now() - begin;
    passed > 5000 ? done(1000 * n / passed) : requestAnimationFrame(step); };
  requestAnimationFrame(step); })"""
"""JavaScript that returns the pictures per second that the browser paints, over five seconds."""


@dataclass(frozen=True)
class Shown:
    """A page that shows a hover in real time."""

    address: str
    ready: str
    """JavaScript expression that is true once the page is loaded."""
    ticks: Callable[[], int]
    """Control periods that have passed."""
    session: Session | None = None
    """Session of the page; None for other packages' pages."""
    cast: Callable[[bool], object] | None = None
    """Turns shadows on or off."""


@contextmanager
def running(loop: Callable[[Callable[[], bool]], object]) -> Iterator[None]:
    """Run a loop on a separate thread until the context ends."""
    ended = threading.Event()
    thread = threading.Thread(target=loop, args=(ended.is_set,))
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()


@contextmanager
def ours() -> Iterator[Shown]:
    """Serve `spidar view --web`, in wind."""
    session = Session(options={"preset": "tuned", "joint_speed": 0.6}, disturbances=Disturbances(wind=4.0))
    with ExitStack() as stack:
        stack.callback(session.close)
        page, address = stack.enter_context(served(session, dict(policies(HOVER, WebOptions())), port=0))
        stack.enter_context(running(partial(keep_time, page)))
        yield Shown(
            address, "!!document.body?.innerText.includes('of its weight')", lambda: session.passed, session,
            lambda is_cast: page.scenery.hide("shadow", is_hidden=not is_cast),
        )  # fmt: skip


@contextmanager
def hovering(model: Any, data: Any, show: Callable[[], object], address: str) -> Iterator[Shown]:
    """Run a hover of the same preset, shown by another package."""
    env = gymnasium.make(HOVER, forms="form1", preset="tuned", max_episode_steps=10**6)
    env.reset(seed=0)
    ticks = [0]

    def loop(is_over: Callable[[], bool]) -> None:
        due = time.perf_counter()
        while not is_over():
            env.step(np.zeros(6))
            data.qpos[:] = env.unwrapped.plant.data.qpos
            mujoco.mj_forward(model, data)
            show()
            ticks[0] += 1
            due = max(due + 1.0 / CONTROL_RATE, time.perf_counter() - 0.1)
            time.sleep(max(0.0, due - time.perf_counter()))

    with running(loop):
        yield Shown(address, "!!document.querySelector('canvas')", lambda: ticks[0])


@contextmanager
def mjviser() -> Iterator[Shown]:
    """Serve mjviser's scene."""
    import viser
    from mjviser import ViserMujocoScene

    model = scene(visual=True, film=True)
    data, server = mujoco.MjData(model), viser.ViserServer(host="127.0.0.1", port=free_port(), verbose=False)
    shown = ViserMujocoScene(server, model, 1)
    address = f"http://127.0.0.1:{server.get_port()}"
    with hovering(model, data, lambda: shown.update_from_mjdata(data), address) as page:
        yield page


@contextmanager
def studio() -> Iterator[Shown]:
    """Serve MuJoCo's studio."""
    from mujoco.studio import app, launch_web, viewer_protocol

    model, port = scene(visual=True, film=True), free_port()
    data = mujoco.MjData(model)
    config = viewer_protocol.ViewerConfig(gfx="web", http_port=port)
    viewer = launch_web.launch(config, plugins=[app.App()])
    viewer.set_model(model, data=data)
    with hovering(model, data, lambda: viewer.sync(model, data), f"http://127.0.0.1:{port}") as page:
        yield page


PAGES = {"spidar view": (ours, "viser"), "mjviser": (mjviser, "mjviser"), "MuJoCo's studio": (studio, "mujoco")}
"""Name → function that serves the page, and the package whose version is reported."""


def free_port() -> int:
    """Return a port that is free now."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def sent() -> list[int]:
    """Count the bytes that this process sends on web sockets from now on; the list's entry is updated."""
    count, send = [0], websockets.asyncio.connection.Connection.send

    async def counted(self: Any, message: Any, *args: Any, **options: Any) -> None:
        count[0] += len(message) if isinstance(message, (str, bytes, bytearray, memoryview)) else 0
        await send(self, message, *args, **options)

    websockets.asyncio.connection.Connection.send = counted
    return count


def until(is_so: Callable[[], bool]) -> None:
    """Wait until a condition holds, for at most a minute."""
    begin = time.monotonic()
    while not is_so():
        if time.monotonic() - begin > 60.0:
            raise SpidarError("nothing has happened for a minute")
        time.sleep(0.002)


def show_off(browser: Chromium, session: Session) -> None:
    """Change forms and push the robot, for the pictures."""

    def wait(seconds: float) -> None:
        end = session.passed + seconds * CONTROL_RATE
        until(lambda: session.passed >= end)

    browser.click("①")
    wait(8.0)
    for button, seconds in (("②", 7.0), ("once", 5.0), ("③", 2.0)):
        browser.click(button)
        wait(seconds)
    browser.js("[...document.querySelectorAll('*')].forEach(each => { if (each.scrollTop) each.scrollTop = 0; })")
    time.sleep(1.0)


def draw(browser: Chromium, path: Path) -> None:
    """Save a picture small enough for a page, without viser's notice about the browser's OpenGL."""
    browser.js("document.querySelectorAll('.mantine-Notification-closeButton').forEach(each => each.click())")
    browser.until("!document.querySelector('.mantine-Notification-closeButton')")
    browser.picture(path)
    with Image.open(path) as image:
        whole = image.convert("RGB")
    whole.quantize(COLORS, kmeans=3, dither=Image.Dither.NONE).save(path, optimize=True)


def timed_clicks(browser: Chromium, session: Session) -> list[float]:
    """Measure the seconds from a click on a form to its arrival in the task; check that the state follows."""
    arrived, delays = list[float](), list[float]()
    take = session.take_named_form

    def timed(name: str) -> None:
        take(name)
        arrived.append(time.perf_counter())

    session.take_named_form = timed
    for mark in ("①", "③") * (CLICKS // 2):
        before = len(arrived)
        begin = browser.click(mark)
        until(lambda before=before: len(arrived) > before)
        delays.append(arrived[-1] - begin)
        time.sleep(0.4)
    until(lambda: session.env.state.joint_position[3] > 1.5)
    return delays


def measure(name: str, size: tuple[int, int], pictures: Path | None) -> list[str]:
    """Measure a page in a window; return its line of the table."""
    width, height = size
    count = sent()
    with ExitStack() as stack:
        page = stack.enter_context(PAGES[name][0]())
        browser = Chromium(page.address, width, height)
        stack.callback(browser.close)
        browser.until(page.ready)
        time.sleep(WARM)
        begin, work, ticks, data = time.perf_counter(), time.process_time(), page.ticks(), count[0]
        time.sleep(SECONDS)
        passed = time.perf_counter() - begin
        pace = (page.ticks() - ticks) / passed / CONTROL_RATE
        line = [name, f"{width} × {height}", f"{browser.js(PAINTED):.1f}", NONE, f"{pace:.2f}"]
        line += [
            f"{(time.process_time() - work) / (time.perf_counter() - begin):.0%}",
            f"{(count[0] - data) / passed / 1e3:.0f}",
            NONE,
        ]
        if page.session and page.cast:
            page.cast(False)
            time.sleep(2.0)
            line[3] = f"{browser.js(PAINTED):.1f}"
            page.cast(True)
            low, middle, high = 1e3 * np.quantile(timed_clicks(browser, page.session), (0.0, 0.5, 1.0))
            line[-1] = f"{middle:.0f}, {low:.0f} … {high:.0f}"
            if pictures:
                browser.call("Page.navigate", url=f"{page.address}?fixedDpr=1")  # else viser renders coarsely
                browser.until(page.ready)
                show_off(browser, page.session)
                draw(browser, pictures / f"web-{width}.png")
            if page.session.over:
                raise SpidarError(f"the flight is over: {page.session.over}")
        return line


def main(arguments: Sequence[str] | None = None) -> None:
    """Entry point."""
    parser = argparse.ArgumentParser(prog="python -m tests.viz.live.costs", description=__doc__)
    parser.add_argument("--pages", nargs="+", choices=PAGES, default=PAGES, help="which, all if not given")
    parser.add_argument("--pictures", type=Path, help="folder for web-1280.png and web-390.png, pictures of our page")
    parser.add_argument("--out", type=Path, help="file for the result, read by the table in the guide")
    args = parser.parse_args(arguments)
    pictures = output_folder(args.pictures) if args.pictures else None
    lines = list[list[str]]()
    for size in SIZES:
        for name in args.pages:
            # Each page runs in a separate process, which ends with all its threads, so that costs are not mixed.
            # If the robot was slower than real time, the other figures are invalid too: measure again.
            for _ in range(TRIES):
                with get_context("spawn").Pool(1) as pool:
                    line = [*pool.apply(measure, (name, size, pictures)), f"{os.getloadavg()[0]:.1f}"]
                if float(line[HEADING.index("× real time")]) > KEEPS_UP:
                    break
            lines.append(line)
            print(" | ".join(lines[-1]), flush=True)
    print(f"\n{format_table([HEADING, *lines])}")
    if args.out:
        versions = ", ".join(f"{package} {version(package)}" for _, package in (PAGES[name] for name in args.pages))
        result = {
            "command": COMMAND, "version": __version__, "date": date.today().isoformat(), "lines": [HEADING, *lines],
            "notes": [
                f"Headless Chromium draws with the processor (SwiftShader) and shares {os.cpu_count()} cores with the "
                f"robot and with other work: load. A graphics card paints faster. "
                f"{versions}. Processor: of one core, with the flight in it. Sent: before web sockets compress it. "
                f"Clicks: median, least … most of {CLICKS}, from the mouse button's release to the form in the task."
            ],
        }  # fmt: skip
        args.out.write_text(json.dumps(result, indent=2, ensure_ascii=False) + "\n", encoding="utf-8")


if __name__ == "__main__":
    run_cli("tests.viz.live.costs", main)
