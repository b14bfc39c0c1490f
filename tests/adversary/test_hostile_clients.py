"""Hostile clients of `spidar sitl robot` (leave, stall, flood, lie): one line about each; the next is served."""

import contextlib
import math
import re
import socket
import struct
import threading
import time
from types import SimpleNamespace

import numpy as np
import pytest

from spidar_gym.errors import SpidarError
from spidar_gym.onboard.runner_structs import Action
from spidar_gym.sitl import link_socket, serve
from spidar_gym.sitl.link_socket import SocketLink
from spidar_gym.sitl.missions import crawl_mission
from spidar_gym.sitl.play import make_robot
from spidar_gym.sitl.serve import Served, serve_socket

CLIENTS = 200
"""Number of hostile clients."""


@pytest.fixture
def link():
    end = SocketLink()
    yield end
    end.close()


@pytest.fixture(autouse=True)
def hurry(monkeypatch):
    """No waiting for the next period of 5 ms, and a short timeout for clients."""
    monkeypatch.setattr(serve, "clock", SimpleNamespace(monotonic=time.monotonic, sleep=lambda seconds: None))
    monkeypatch.setattr(link_socket, "PATIENCE", 1.0)


def connect(link):
    host, port = link.place.split(":")
    return socket.create_connection((host, int(port)), 5.0)


def all_of(peer, size):
    data = b""
    while len(data) < size:
        part = peer.recv(size - len(data))
        if not part:
            raise ConnectionError
        data += part
    return data


def listen(peer, link):
    all_of(peer, link._hello.nbytes)


def answer(link, action=Action.SILENT, fill=0.0):
    record = np.zeros((), link.answer.dtype)
    record["action"] = action
    for name in record["command"].dtype.names:
        record["command"][name] = fill
    return record.tobytes()


def leave(peer, link, rng):
    pass


def reset(peer, link, rng):
    peer.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))


def leave_after_the_greeting(peer, link, rng):
    listen(peer, link)


def leave_in_the_middle(peer, link, rng):
    listen(peer, link)
    all_of(peer, link._input.nbytes)
    peer.sendall(answer(link)[: rng.integers(link.answer.nbytes)])


def say_nothing(peer, link, rng):
    while peer.recv(4096):
        pass


def stammer(peer, link, rng):
    """Send a byte at a time, each before the timeout."""
    listen(peer, link)
    while True:
        peer.send(b"\0")
        time.sleep(0.05)


def shout(peer, link, rng):
    """Send far more than expected, with a meaningless length."""
    peer.sendall(struct.pack("<q", 2**62) + rng.bytes(200_000))
    say_nothing(peer, link, rng)


def babble(peer, link, rng):
    listen(peer, link)
    while True:
        all_of(peer, link._input.nbytes)
        peer.sendall(rng.bytes(link.answer.nbytes))


def command_wildly(peer, link, rng):
    """Send complete answers with invalid commands, then leave."""
    listen(peer, link)
    for _ in range(rng.integers(1, 12)):
        all_of(peer, link._input.nbytes)
        peer.sendall(answer(link, Action.PUBLISH, rng.choice([math.nan, math.inf, -math.inf, 1e300, -1e300, 1e6])))


HOSTILE = (
    leave,
    reset,
    leave_after_the_greeting,
    leave_in_the_middle,
    say_nothing,
    stammer,
    shout,
    babble,
    command_wildly,
)


def gone(lines):
    return [line for line in lines if "has gone" in line]


def visit(link, kind, rng):
    """Act as a hostile client until the server disconnects it."""
    with connect(link) as peer, contextlib.suppress(ConnectionError, TimeoutError):
        kind(peer, link, rng)


def good(link, ticks):
    """Act as a runner that answers correctly."""
    with connect(link) as peer:
        listen(peer, link)
        for _ in range(ticks):
            all_of(peer, link._input.nbytes)
            peer.sendall(answer(link))


@pytest.fixture
def serving(link):
    """Start the server in a separate thread, with a robot on the ground which can be armed and driven."""
    threads, over = [], threading.Event()

    def start(seconds, *, operate=False):
        lines, made = [], []

        def make():
            made.append(make_robot(crawl_mission()))
            return Served(made[-1], operate=operate, tell=lines.append)

        def run():
            try:
                serve_socket(make, link, seconds, lines.append)
            except (OSError, ValueError):
                if not over.is_set():  # closing the listening socket at the end of the test raises here
                    raise

        threads.append(threading.Thread(target=run))
        threads[-1].start()
        return threads[-1], lines, made

    yield start
    over.set()
    link.close()
    for thread in threads:
        thread.join()


def wait_for(condition, seconds=20.0):
    end = time.monotonic() + seconds
    while not condition() and time.monotonic() < end:
        time.sleep(0.005)
    return condition()


@pytest.mark.parametrize("kind", HOSTILE, ids=lambda kind: kind.__name__)
def test_a_client_that_misbehaves_is_one_line_and_the_next_is_served(link, serving, rng, kind):
    thread, lines, made = serving(1e6, operate=kind is command_wildly)
    visit(link, kind, rng)
    good(link, 40)
    assert wait_for(lambda: len(gone(lines)) >= (1 if kind is reset else 2))
    assert thread.is_alive()
    assert len(gone(lines)) <= 2
    assert all(re.fullmatch(r" *\d+\.\d\d s  the runner has gone: .{4,}", line) for line in gone(lines))
    assert not any(robot.plant.diverged for robot in made)


def test_many_clients_that_misbehave_and_one_that_does_not(link, serving, rng, tries):
    thread, lines, _ = serving(1e6)
    count = tries(CLIENTS)
    for _ in range(count):
        visit(link, rng.choice(HOSTILE), rng)
    good(link, 20)
    assert thread.is_alive()
    assert len(gone(lines)) <= count + 1


def test_when_the_time_is_over_and_no_client_connects_it_ends(link, serving, rng):
    thread, lines, _ = serving(0.5)
    visit(link, leave, rng)
    thread.join(60.0)
    assert not thread.is_alive()
    assert len(gone(lines)) == 1


def test_a_runner_that_never_comes_is_still_an_error(link):
    with pytest.raises(SpidarError, match="no runner connected"):
        link.accept(patience=0.1)
