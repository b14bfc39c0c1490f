"""The gate of the page: a request comes in by the address it asks for, the page it comes from, and a token."""

import asyncio
import contextlib
import importlib
import ipaddress
import re
import secrets
from collections.abc import Awaitable, Callable
from dataclasses import replace
from http import HTTPStatus
from typing import Any

from spidar_gym.errors import SpidarError
from spidar_gym.viz.live.messages import LARGEST, require_message

AUTHORITY = re.compile(r"(\[[0-9a-f:.]+\]|[a-z0-9_.-]+)(?::([0-9]{1,5}))?", re.ASCII)
"""Host and port of a header, in lower case; no user, no path."""
PORTS = {"http": 80, "https": 443}
"""What a port is that an address does not name."""
HEADERS = {"Content-Security-Policy": "frame-ancestors 'self'", "Referrer-Policy": "no-referrer"}
"""A foreign page cannot lay the page under its own buttons, nor is the token told to any other server."""
QUIET = 1.0
"""A browser is told of refused messages no more often [s]."""


def split(authority: str, scheme: str = "http") -> tuple[str, int] | None:
    """Host and port of an authority, or None where it is none."""
    found = AUTHORITY.fullmatch(authority.lower())
    if found is None:
        return None
    port = int(found[2]) if found[2] else PORTS[scheme]
    return (found[1], port) if 0 < port <= 65535 else None


def is_loopback_name(host: str) -> bool:
    """Whether the host of an address is a name of the loopback: localhost, 127.0.0.0/8 or [::1]."""
    try:
        return host == "localhost" or ipaddress.ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return False


class Gate:
    """Lets requests in, or not, and of what a browser sends then only what the page can take."""

    def __init__(self, host: str, *, is_open: bool) -> None:
        """Build it.

        Args:
            host: The address that is listened on.
            is_open: Whether other machines reach it: any host is asked for then, but by a token in the path.
        """
        self._host, self._is_open = host.lower(), is_open
        self.path = f"/{secrets.token_urlsafe(24)}" if is_open else ""
        """What paths begin with: nothing, or the token."""
        self.server: Any = None
        """viser's; nothing comes in before there is one."""
        self._is_in_use = False

    def refusal(self, path: str, headers: Any) -> str:  # noqa: ANN401 - those of websockets
        """Why a request is refused; empty where it may come in."""
        hosts, origins = headers.get_all("Host"), headers.get_all("Origin")
        asked = split(hosts[0]) if len(hosts) == 1 else None
        if asked is None:
            return "a request has one Host"
        if not (self._is_open or is_loopback_name(asked[0]) or asked[0].strip("[]") == self._host):
            return "this Host is not the page's: valid are localhost, 127.0.0.1, [::1] and what --host names"
        if origins:
            scheme, _, authority = origins[0].partition("://")
            is_own = len(origins) == 1 and scheme in PORTS
            if not is_own or split(authority, scheme) != split(hosts[0], scheme):
                return "another page's Origin: valid is that of the page itself"
        own, given = self.path.encode(), path.encode(errors="surrogateescape")
        begin, rest = given[: len(own)], given[len(own) :]
        if own and not (secrets.compare_digest(begin, own) and rest[:1] in (b"", b"/", b"?")):
            return "the token is missing: valid is the whole address that spidar view has printed"
        return ""

    def asked(self, answer: Callable[[Any, Any], Any]) -> Callable[[Any, Any], Any]:
        """How requests are answered, pages' and sockets' handshakes, behind the gate."""

        def process(connection: Any, request: Any) -> Any:  # noqa: ANN401 - those of websockets
            refusal = self.refusal(request.path, request.headers)
            if refusal:
                return connection.respond(HTTPStatus.FORBIDDEN, f"{refusal}\n")
            if self.server is None:
                return connection.respond(HTTPStatus.SERVICE_UNAVAILABLE, "not yet\n")
            rest = request.path.removeprefix(self.path)
            try:
                response = answer(connection, replace(request, path=rest if rest.startswith("/") else f"/{rest}"))
            except Exception:  # of headers or a path that are none
                return connection.respond(HTTPStatus.BAD_REQUEST, "this is no request for a page\n")
            if response is not None:
                response.headers.update(HEADERS)
            return response

        return process

    def heard(self, handle: Callable[[Any], Awaitable[None]]) -> Callable[[Any], Awaitable[None]]:
        """How a socket is handled, which hears nothing but messages that are valid."""

        async def handle_valid(connection: Any) -> None:  # noqa: ANN401 - that of websockets
            receive, told = connection.recv, -QUIET

            async def receive_valid() -> bytes:
                nonlocal told
                while True:
                    raw = await receive()
                    try:
                        require_message(self.server.gui, raw)
                    except SpidarError as error:
                        now = asyncio.get_running_loop().time()
                        if now - told >= QUIET:
                            told = now
                            self._tell(connection, str(error))
                    else:
                        return raw

            connection.recv = receive_valid
            await handle(connection)

        return handle_valid

    def _tell(self, connection: Any, words: str) -> None:  # noqa: ANN401 - that of websockets
        """Show words on the browser of a connection."""
        connections = self.server._websock_server._live_connections
        for number, client in self.server.get_clients().items():
            if connections.get(number) is connection:
                notify(client, words)

    def start(self, viser: Any, port: int) -> Any:  # noqa: ANN401 - the module, its server
        """Start viser's server behind the gate.

        Raises:
            SpidarError: For a viser that serves in another way, and could be reached without.
        """
        module: Any = importlib.import_module("websockets.asyncio.server")
        serve = module.serve

        def behind(handle: Any, *given: Any, process_request: Any, **options: Any) -> Any:  # noqa: ANN401
            self._is_in_use = True
            options["max_size"] = LARGEST
            return serve(self.heard(handle), *given, process_request=self.asked(process_request), **options)

        # viser has no place for this, and looks the function up when it starts: until then it is another one.
        module.serve = behind
        try:
            server = viser.ViserServer(host=self._host, port=port, verbose=False)
        finally:
            module.serve = serve
        if not self._is_in_use:
            with contextlib.suppress(Exception):
                server.stop()
            raise SpidarError(f"viser {viser.__version__} cannot be kept from foreign pages; valid: 1.1.1")
        return server


def notify(client: Any, words: str) -> None:  # noqa: ANN401 - viser's
    """Show on a browser for some seconds what was refused."""
    client.add_notification("refused", words, color="red", auto_close_seconds=8.0)
