"""The gate of the page: accepts requests by their Host, their Origin and a token."""

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
"""Host and port of a header, in lower case, without user and path."""
PORTS = {"http": 80, "https": 443}
"""Default port of each scheme."""
HEADERS = {"Content-Security-Policy": "frame-ancestors 'self'", "Referrer-Policy": "no-referrer"}
"""Response headers: a foreign page cannot embed the page in a frame, and no other server receives the token."""
QUIET = 1.0
"""Least time between two notices about refused messages in a browser [s]."""


def split(authority: str, scheme: str = "http") -> tuple[str, int] | None:
    """Split an authority into host and port; return None where it is invalid."""
    found = AUTHORITY.fullmatch(authority.lower())
    if found is None:
        return None
    port = int(found[2]) if found[2] else PORTS[scheme]
    return (found[1], port) if 0 < port <= 65535 else None


def is_loopback_name(host: str) -> bool:
    """Return whether the host of an address is a name of the loopback: localhost, 127.0.0.0/8 or [::1]."""
    try:
        return host == "localhost" or ipaddress.ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return False


class Gate:
    """Accepts or refuses requests, and passes only valid messages of a browser on."""

    def __init__(self, host: str, *, is_open: bool) -> None:
        """Build the gate.

        Args:
            host: Address of the server.
            is_open: Whether other machines reach it: then any Host is accepted, but paths must begin with a token.
        """
        self._host, self._is_open = host.lower(), is_open
        self.path = f"/{secrets.token_urlsafe(24)}" if is_open else ""
        """Prefix of paths: empty, or the token."""
        self.server: Any = None
        """viser's server; requests are refused before it is set."""
        self._is_in_use = False

    def refusal(self, path: str, headers: Any) -> str:  # noqa: ANN401 - those of websockets
        """Return why a request is refused; empty where it is accepted."""
        hosts, origins = headers.get_all("Host"), headers.get_all("Origin")
        asked = split(hosts[0]) if len(hosts) == 1 else None
        if asked is None:
            return "the request has no Host, or several; valid: one Host"
        if not (self._is_open or is_loopback_name(asked[0]) or asked[0].strip("[]") == self._host):
            return "this Host is not the page's; valid: localhost, 127.0.0.1, [::1] and the name in --host"
        if origins:
            scheme, _, authority = origins[0].partition("://")
            is_own = len(origins) == 1 and scheme in PORTS
            if not is_own or split(authority, scheme) != split(hosts[0], scheme):
                return "this Origin is another page's; valid: the Origin of the page itself"
        own, given = self.path.encode(), path.encode(errors="surrogateescape")
        begin, rest = given[: len(own)], given[len(own) :]
        if own and not (secrets.compare_digest(begin, own) and rest[:1] in (b"", b"/", b"?")):
            return "the token is missing; valid: the whole address that spidar view has printed"
        return ""

    def asked(self, answer: Callable[[Any, Any], Any]) -> Callable[[Any, Any], Any]:
        """Wrap the handler of requests, for pages and sockets' handshakes, so that the gate checks them first."""

        def process(connection: Any, request: Any) -> Any:  # noqa: ANN401 - those of websockets
            refusal = self.refusal(request.path, request.headers)
            if refusal:
                return connection.respond(HTTPStatus.FORBIDDEN, f"{refusal}\n")
            if self.server is None:
                return connection.respond(HTTPStatus.SERVICE_UNAVAILABLE, "the page is not ready yet\n")
            rest = request.path.removeprefix(self.path)
            try:
                response = answer(connection, replace(request, path=rest if rest.startswith("/") else f"/{rest}"))
            except Exception:  # invalid headers or an invalid path
                return connection.respond(HTTPStatus.BAD_REQUEST, "this is not a valid request for a page\n")
            if response is not None:
                response.headers.update(HEADERS)
            return response

        return process

    def heard(self, handle: Callable[[Any], Awaitable[None]]) -> Callable[[Any], Awaitable[None]]:
        """Wrap the handler of a socket so that it receives valid messages only."""

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
        """Show a notice in the browser of a connection."""
        connections = self.server._websock_server._live_connections
        for number, client in self.server.get_clients().items():
            if connections.get(number) is connection:
                notify(client, words)

    def start(self, viser: Any, port: int) -> Any:  # noqa: ANN401 - the module, its server
        """Start viser's server behind the gate.

        Raises:
            SpidarError: For a version of viser that starts its server differently and would bypass the gate.
        """
        module: Any = importlib.import_module("websockets.asyncio.server")
        serve = module.serve

        def behind(handle: Any, *given: Any, process_request: Any, **options: Any) -> Any:  # noqa: ANN401
            self._is_in_use = True
            options["max_size"] = LARGEST
            return serve(self.heard(handle), *given, process_request=self.asked(process_request), **options)

        # viser has no option for this, but looks the function up when it starts. It is replaced until then.
        module.serve = behind
        try:
            server = viser.ViserServer(host=self._host, port=port, verbose=False)
        finally:
            module.serve = serve
        if not self._is_in_use:
            with contextlib.suppress(Exception):
                server.stop()
            raise SpidarError(f"viser {viser.__version__} cannot be protected from foreign pages; valid: 1.1.1")
        return server


def notify(client: Any, words: str) -> None:  # noqa: ANN401 - viser's
    """Show a notice about something refused in a browser for eight seconds."""
    client.add_notification("refused", words, color="red", auto_close_seconds=8.0)
