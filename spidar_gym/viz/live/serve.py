"""Serves the page: one address of one machine, no other unless it is asked for, and a loop that keeps time."""

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
"""Where the page is: this machine alone can open it."""
INSTALL_WEB = "pip install 'spidar-gym[web]'"


def require_viser() -> tuple[Any, Any]:
    """The modules viser and trimesh (`MissingDependencyError` says what to install)."""
    try:
        return importlib.import_module("viser"), importlib.import_module("trimesh")
    except ImportError as error:
        raise MissingDependencyError("viser", INSTALL_WEB) from error


def require_address(host: str, port: int) -> None:
    """Refuse an address that is not this machine's, or a port that is taken: viser would look for others, or hang."""
    if not 0 <= port <= 65535:
        raise InvalidValueError("port", port, "a port number within 1 … 65535, or 0 for any that is free")
    try:
        found = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)
    except OSError as error:
        raise InvalidValueError("host", host, "an address of this machine, 127.0.0.1 for itself alone") from error
    family, kind, protocol, _, address = found[0]
    with socket.socket(family, kind, protocol) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind(address)
        except OSError as error:
            raise SpidarError(
                f"cannot listen on {host}, port {port}: {error.strerror}; valid: an address of this machine, and a "
                "port that nobody uses (--port 0 takes any)"
            ) from error


def is_loopback(host: str) -> bool:
    """Whether an address is reached from this machine alone."""
    found = socket.getaddrinfo(host, None)
    return all(ipaddress.ip_address(address[0]).is_loopback for *_, address in found)


@contextlib.contextmanager
def served(
    session: Session, policies: Mapping[str, str], *, host: str = HOST, port: int = PORT
) -> Iterator[tuple[Page, str]]:
    """The page of a session while it is served, and its address.

    Args:
        session: The robot.
        policies: What can be chosen to fly: name → module:Class or an artifact's path.
        host: Address that is listened on: by default nobody else's machine reaches it.
        port: … and port; 0 takes any that is free.

    Raises:
        MissingDependencyError: Without the extra `web`.
        SpidarError: For an address that cannot be listened on.
    """
    viser, trimesh = require_viser()
    require_address(host, port)
    gate = Gate(host, is_open=not is_loopback(host))
    with contextlib.redirect_stdout(io.StringIO()):  # it draws a box with words of its own
        server = gate.start(viser, port)
    # Otherwise a browser could have it open a tunnel to a server of others, for everybody.
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
    """Fly in the wall's time, do what people ask for, and show it, until `stop` says so.

    A moment that cannot be shown, or an order that cannot be done, is a line on the standard error and ends nothing:
    viser's own threads can come between.
    """
    clock, session, said = page.clock, page.session, set[str]()

    def tried(do: Callable[..., object], *given: object) -> None:
        try:
            do(*given)
        except Exception as error:
            words = " ".join(f"{type(error).__name__}: {error}".split())
            if words not in said:  # once each
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
        time.sleep(clock.wait + 1e-4)  # or, by rounding, it might not be due yet
