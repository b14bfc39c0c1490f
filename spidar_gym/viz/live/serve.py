"""Serves the page at one address, which only this machine reaches by default, and runs the loop in real time."""

import contextlib
import importlib
import io
import ipaddress
import socket
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from typing import Any

from spidar_gym.errors import InvalidValueError, MissingDependencyError, SpidarError
from spidar_gym.policies.source import PolicyError
from spidar_gym.viz.live.clock import Clock
from spidar_gym.viz.live.gate import Gate
from spidar_gym.viz.live.page import Page
from spidar_gym.viz.live.session import Session

HOST, PORT = "127.0.0.1", 8080
"""Default address of the page, which only this machine can open."""
INSTALL_WEB = "pip install 'spidar-gym[web]'"


def require_viser() -> tuple[Any, Any]:
    """Import the modules viser and trimesh (`MissingDependencyError` states what to install)."""
    try:
        return importlib.import_module("viser"), importlib.import_module("trimesh")
    except ImportError as error:
        raise MissingDependencyError("viser", INSTALL_WEB) from error


def require_address(host: str, port: int) -> None:
    """Refuse an address of another machine, or a port in use, for which viser would use another port or hang."""
    if not 0 <= port <= 65535:
        raise InvalidValueError("port", port, "a port number within 1 … 65535, or 0 for any free port")
    try:
        found = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)
    except OSError as error:
        raise InvalidValueError("host", host, "an address of this machine, such as 127.0.0.1") from error
    family, kind, protocol, _, address = found[0]
    with socket.socket(family, kind, protocol) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind(address)
        except OSError as error:
            raise SpidarError(
                f"cannot listen on {host}, port {port}: {error.strerror}; valid: an address of this machine and a "
                "free port (--port 0 for any)"
            ) from error


def is_loopback(host: str) -> bool:
    """Return whether an address can be reached from this machine only."""
    found = socket.getaddrinfo(host, None)
    return all(ipaddress.ip_address(address[0]).is_loopback for *_, address in found)


@contextlib.contextmanager
def served(
    session: Session, policies: Mapping[str, str], *, host: str = HOST, port: int = PORT
) -> Iterator[tuple[Page, str]]:
    """Serve the page of a session; yield the page and its address.

    Args:
        session: Session of the robot.
        policies: Available policies: name → module:Class or an artifact's path.
        host: Address of the server; by default other machines cannot reach it.
        port: Port of the server; 0 for any free port.

    Raises:
        MissingDependencyError: Without the extra `web`.
        SpidarError: For an address or port that is not available.
    """
    viser, trimesh = require_viser()
    require_address(host, port)
    gate = Gate(host, is_open=not is_loopback(host))
    with contextlib.redirect_stdout(io.StringIO()):  # viser prints a banner
        server = gate.start(viser, port)
    # Otherwise a browser could make viser open a public tunnel through an external server.
    server.request_share_url = lambda *_, **__: None
    try:
        page = Page(server, trimesh, session, Clock(time.perf_counter), policies)
        gate.server = server
        name = "localhost" if host in ("", "0.0.0.0", "::") else f"[{host}]" if ":" in host else host
        yield page, f"http://{name}:{server.get_port()}{gate.path}"
    finally:
        with contextlib.redirect_stdout(io.StringIO()):
            server.stop()


def keep_time(page: Page, stop: Callable[[], bool]) -> None:
    """Run the session in real time, apply inputs and update the page, until `stop` returns True.

    An error in an update or an input is printed as one line on the standard error and does not end the loop, because
    viser's own threads can cause such errors.
    """
    clock, session, said = page.clock, page.session, set[str]()

    def tried(do: Callable[..., object], *given: object) -> None:
        try:
            do(*given)
        except Exception as error:
            words = " ".join(f"{type(error).__name__}: {error}".split())
            if words not in said:  # each one once
                said.add(words)
                print(f"spidar: warning: the page: {words}; the flight goes on", file=sys.__stderr__)

    while not stop():
        tried(page.settle)
        for _ in range(clock.due()):
            try:
                session.tick()
            except PolicyError as error:
                tried(page.tell, str(error))
        tried(page.show, time.perf_counter())
        time.sleep(clock.wait + 1e-4)  # the margin covers rounding, so that the period is due afterwards
