"""Pins how the page is served: by default only on this machine's own address, and in real time."""

import importlib
import os
import socket
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
from support import pages
from support.commands import ROOT
from support.pages import needs_viser

from spidar_gym.errors import InvalidValueError, MissingDependencyError, SpidarError
from spidar_gym.policies.source import PolicyError
from spidar_gym.viz.live import serve
from spidar_gym.viz.live.gate import Gate
from spidar_gym.viz.live.serve import HOST, is_loopback, keep_time, require_address, require_viser, served
from spidar_gym.viz.live.session import Session

LOOPBACK = "0100007F"
"""127.0.0.1 as in /proc/net/tcp."""


@pytest.fixture
def session():
    session = Session()
    yield session
    session.close()


@pytest.fixture
def standing_in(monkeypatch):
    """Replace viser and trimesh by stand-ins; return the list of servers that are created."""
    made = []

    def make(**given):
        made.append(pages.Server(**given))
        return made[-1]

    monkeypatch.setattr(Gate, "start", pages.start)
    monkeypatch.setattr(serve, "require_viser", lambda: (SimpleNamespace(ViserServer=make), pages.trimesh()))
    return made


def listened_on(port):
    """Return the addresses on which this process listens on a port, IPv4 and IPv6, as in /proc/net."""
    own = set()
    for entry in Path("/proc/self/fd").iterdir():
        try:
            own.add(os.readlink(entry))
        except OSError:
            continue
    found = []
    for table in ("tcp", "tcp6"):
        for line in Path(f"/proc/net/{table}").read_text().splitlines()[1:]:
            columns = line.split()
            address, number = columns[1].split(":")
            if columns[3] == "0A" and int(number, 16) == port and f"socket:[{columns[9]}]" in own:
                found.append(address)
    return found


@needs_viser
@pytest.mark.skipif(not Path("/proc/net/tcp").is_file(), reason="needs /proc/net of Linux")
def test_by_default_only_the_loopback_is_listened_on(session):
    with served(session, {}, port=0) as (_, address):
        port = int(address.rpartition(":")[2])
        assert address == f"http://127.0.0.1:{port}"
        assert listened_on(port) == [LOOPBACK]
    assert listened_on(port) == []


def test_the_server_receives_the_loopback_address_alone(session, standing_in):
    assert HOST == "127.0.0.1"
    assert is_loopback(HOST)
    assert not is_loopback("0.0.0.0")
    with served(session, {}, port=0):
        (server,) = standing_in
        assert server.given["host"] == "127.0.0.1"
        assert not server.is_stopped
    assert server.is_stopped


def test_no_browser_can_open_a_tunnel_to_others(session, standing_in):
    with served(session, {}, port=0):
        assert standing_in[0].request_share_url() is None


@needs_viser
def test_visers_own_request_for_a_tunnel_does_nothing(session, monkeypatch):
    viser = importlib.import_module("viser")
    monkeypatch.setattr(viser.ViserServer, "request_share_url", lambda *_: pytest.fail("a tunnel was requested"))
    with served(session, {}, port=0) as (page, _):
        assert page._server.request_share_url() is None


@needs_viser
def test_the_page_is_one_file_that_names_no_other_server(session):
    import urllib.request

    with served(session, {}, port=0) as (_, address):
        page = urllib.request.urlopen(address, timeout=30).read().decode()
    assert "<canvas" in page or "<script" in page
    assert 'src="http' not in page
    assert 'href="http' not in page


def test_without_viser_one_line_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "viser", None)
    with pytest.raises(MissingDependencyError) as refused:
        require_viser()
    assert str(refused.value) == "viser is not available; install it with: pip install 'spidar-gym[web]'"


def test_viser_is_imported_only_for_serving():
    code = "import spidar_gym.cli.main, sys; print([m for m in ('viser', 'trimesh', 'websockets') if m in sys.modules])"
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT)
    assert result.stdout.strip() == "[]"


def test_a_port_that_is_taken_is_refused_and_no_other_taken_instead(session, standing_in):
    with socket.socket() as taken:
        taken.bind((HOST, 0))
        taken.listen()
        port = taken.getsockname()[1]
        with pytest.raises(
            SpidarError, match=f"cannot listen on 127.0.0.1, port {port}: Address already in use; valid"
        ):
            served(session, {}, port=port).__enter__()
    assert standing_in == []


def test_an_address_of_another_machine_is_refused():
    with pytest.raises(SpidarError, match=r"cannot listen on 203\.0\.113\.7, port 8080: .* valid: an address of this"):
        require_address("203.0.113.7", 8080)
    with pytest.raises(InvalidValueError, match=r"host = 'no such\.host'"):
        require_address("no such.host", 8080)


@pytest.mark.parametrize("port", [-1, 65536, 10**9])
def test_a_port_that_does_not_exist_is_refused(port):
    with pytest.raises(InvalidValueError, match=f"port = {port} .* within 1 … 65535, or 0"):
        require_address(HOST, port)


def test_the_loop_flies_in_the_walls_time_and_shows_it(session, standing_in, monkeypatch):
    wall, shown = [0.0], []
    monkeypatch.setattr(serve.time, "perf_counter", lambda: wall[0])
    monkeypatch.setattr(serve.time, "sleep", lambda seconds: wall.__setitem__(0, wall[0] + seconds))
    with served(session, {}, port=0) as (page, _):
        monkeypatch.setattr(page, "show", shown.append)
        keep_time(page, lambda: wall[0] > 2.0)
    assert session.passed == pytest.approx(80, abs=1)
    assert len(shown) == pytest.approx(80, abs=2)
    assert page.clock.given_up == 0


def test_the_loop_tells_of_a_policy_that_fails_and_goes_on(session, standing_in, monkeypatch):
    wall, told, fails = [0.0], [], [True]
    monkeypatch.setattr(serve.time, "perf_counter", lambda: wall[0])
    monkeypatch.setattr(serve.time, "sleep", lambda seconds: wall.__setitem__(0, wall[0] + seconds))
    tick = session.tick

    def failing():
        if fails:
            fails.clear()
            raise PolicyError("it failed")
        tick()

    monkeypatch.setattr(session, "tick", failing)
    with served(session, {}, port=0) as (page, _):
        monkeypatch.setattr(page, "tell", told.append)
        keep_time(page, lambda: wall[0] > 1.0)
    assert told == ["it failed"]
    assert session.passed > 30


def test_a_moment_that_cannot_be_shown_is_one_line_and_the_flight_goes_on(session, standing_in, monkeypatch, capfd):
    wall = [0.0]
    monkeypatch.setattr(serve.time, "perf_counter", lambda: wall[0])
    monkeypatch.setattr(serve.time, "sleep", lambda seconds: wall.__setitem__(0, wall[0] + seconds))

    def interrupted(*_):
        raise RuntimeError("deque mutated during iteration")

    with served(session, {}, port=0) as (page, _):
        monkeypatch.setattr(page, "show", interrupted)
        page._orders.put(interrupted)
        keep_time(page, lambda: wall[0] > 1.0)
    assert session.passed > 30
    assert capfd.readouterr().err == (
        "spidar: warning: the page: RuntimeError: deque mutated during iteration; the flight goes on\n"
    )
