"""The border between browsers and the page: which of them may steer, and what their messages may say."""

import contextlib
import hmac
import http
import importlib
import ipaddress
import math
import re
import secrets
import socket
import time
from collections.abc import Awaitable, Callable, Iterator
from typing import Any
from urllib.parse import parse_qs, urlsplit

_AUTHORITY = re.compile(r"(?P<name>\[[0-9a-f:.]+\]|[^\s\[\]:/@?#\\,]+)(?::(?P<port>[0-9]{1,5}))?", re.IGNORECASE)
_DEFAULT_PORTS = {"http": 80, "https": 443}
_QUIET = 1.0
"""A browser is told of a refused message at most once in this time [s]."""
Handle = Any
"""viser's, of something on the page; or a part of websockets'."""


def is_loopback(host: str) -> bool:
    """Whether an address is reached from this machine alone."""
    found = socket.getaddrinfo(host, None)
    return all(ipaddress.ip_address(address[0]).is_loopback for *_, address in found)


def _names_loopback(name: str) -> bool:
    """Whether the name in a `Host` always means the machine of the browser, whatever a name server says."""
    if name == "localhost":
        return True
    with contextlib.suppress(ValueError):
        return ipaddress.ip_address(name.strip("[]")).is_loopback
    return False


def _authority(text: str, scheme: str) -> tuple[str, int] | None:
    """Name and port of `name:port`; None for any other text."""
    match = _AUTHORITY.fullmatch(text)
    if match is None:
        return None
    port = int(match["port"]) if match["port"] else _DEFAULT_PORTS[scheme]
    return (match["name"].lower(), port) if port <= 65535 else None


class Border:
    """What every request and every message has to pass before the server has it."""

    def __init__(self, host: str) -> None:
        """Make one for an address that is listened on; open to a network it has a token."""
        self._host = host.lower()
        self.token = "" if is_loopback(host) else secrets.token_urlsafe(16)
        """What the address has to hold, where other machines reach it; empty where none does."""
        self._cookie = f"spidar_{secrets.token_hex(4)}"
        self.find: Callable[[str], Handle | None] = lambda uuid: None
        """The input with an identifier."""
        self.tell: Callable[[Handle, str], object] = lambda connection, words: None
        """Tells the browser behind a connection why something is refused."""

    # ---- requests ----

    def refusal(self, headers: Handle, path: str) -> str:
        """Why a request, or the handshake of a socket, is refused; empty where it is not.

        Args:
            headers: Its headers, with `get_all`.
            path: Its path with the query.
        """
        hosts, origins = headers.get_all("Host"), headers.get_all("Origin")
        host = _authority(hosts[0], "http") if len(hosts) == 1 else None
        if host is None:
            return "one Host is needed"
        if not (self.token or _names_loopback(host[0]) or host[0].strip("[]") == self._host):
            return "this page is of another Host"
        if origins and not (len(origins) == 1 and self._is_same(origins[0], hosts[0])):
            return "another page cannot have this one"
        if self.token and not self._is_known(headers, path):
            return "the address lacks its token"
        return ""

    @staticmethod
    def _is_same(origin: str, host: str) -> bool:
        scheme, separator, rest = origin.partition("://")
        scheme = scheme.lower()
        if not separator or scheme not in _DEFAULT_PORTS:
            return False
        own = _authority(rest, scheme)
        return own is not None and own == _authority(host, scheme)

    def _is_known(self, headers: Handle, path: str) -> bool:
        """Whether the token is in the address, or in the cookie that the page was given with it."""
        given = parse_qs(urlsplit(path).query).get("token", [])
        for cookies in headers.get_all("Cookie"):
            pairs = (part.strip().partition("=") for part in cookies.split(";"))
            given += [value for name, _, value in pairs if name == self._cookie]
        return any(hmac.compare_digest(each.encode(), self.token.encode()) for each in given)

    # ---- messages ----

    def refused(self, raw: object) -> str:
        """Why a message is refused; empty where it is not.

        Args:
            raw: What came through the socket.
        """
        decode = importlib.import_module("msgspec").msgpack.decode
        try:
            message = decode(raw) if isinstance(raw, bytes) else None
        except Exception:  # of the decoder's own kinds, and RecursionError
            message = None
        if not isinstance(message, dict):
            return "a message that is none"
        kind, rest = message.get("type"), {name: value for name, value in message.items() if name != "type"}
        if kind == "GuiUpdateMessage" and rest.keys() == {"uuid", "updates"}:
            return self._refused_update(rest["uuid"], rest["updates"])
        if kind == "CommandTriggerMessage" and rest.keys() == {"uuid"} and isinstance(rest["uuid"], str):
            return ""
        if kind == "ViewerCameraMessage" and rest.keys() == _CAMERA.keys():
            fits = all(_are_numbers(rest[name], count) for name, count in _CAMERA.items())
            return "" if fits else "a camera that is nowhere"
        return "a message that this page does not have"

    def _refused_update(self, uuid: object, updates: object) -> str:
        handle = self.find(uuid) if isinstance(uuid, str) else None
        if handle is None or not isinstance(updates, dict) or updates.keys() != {"value"}:
            return "a change that this page does not have"
        value, label = updates["value"], getattr(handle, "label", "")
        return "" if _fits(handle, value) else f"{label or 'this input'} cannot be {str(value)[:40]!r}"


_CAMERA = {
    "wxyz": 4, "position": 3, "fov": 0, "near": 0, "far": 0, "image_height": 0, "image_width": 0, "look_at": 3,
    "up_direction": 3,
}  # fmt: skip
"""Numbers of a camera: how many in each, 0 for one that stands alone."""
_LARGEST = 1e6
"""Numbers of a camera are within ± this [m, px, rad]; its far plane is, too."""


def _is_number(value: object, low: float = -_LARGEST, high: float = _LARGEST) -> bool:
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    return is_number and math.isfinite(value) and low <= value <= high


def _are_numbers(value: Any, count: int) -> bool:  # noqa: ANN401 - whatever came
    if count == 0:
        return _is_number(value)
    return isinstance(value, list) and len(value) == count and all(map(_is_number, value))


def _fits(handle: Handle, value: object) -> bool:
    """Whether an input can have a value: one of its options, a number within its ends, a flag."""
    if hasattr(handle, "options"):
        return isinstance(value, str) and value in handle.options
    if hasattr(handle, "min"):
        return _is_number(value, handle.min, handle.max)
    return isinstance(value, bool)


@contextlib.contextmanager
def guarded(border: Border) -> Iterator[None]:
    """Have every server of websockets that is started meanwhile pass its requests and messages through a border."""
    module: Any = importlib.import_module("websockets.asyncio.server")
    response: Any = importlib.import_module("websockets.http11").Response
    headers: Any = importlib.import_module("websockets.datastructures").Headers
    original = module.serve

    def serve(
        handler: Callable[[Handle], Awaitable[None]],
        *arguments: object,
        process_request: Callable[[Handle, Handle], Handle],
        **named: object,
    ) -> Handle:
        def process(connection: Handle, request: Handle) -> Handle:
            refusal = border.refusal(request.headers, request.path)
            if refusal:
                body = f"403: {refusal}\n".encode()
                named = headers({"Content-Type": "text/plain; charset=utf-8", "Content-Length": str(len(body))})
                return response(http.HTTPStatus.FORBIDDEN, "Forbidden", named, body)
            answer = process_request(connection, request)
            if answer is not None and border.token:
                cookie = f"{border._cookie}={border.token}; HttpOnly; SameSite=Strict; Path=/"
                answer.headers["Set-Cookie"] = cookie
            return answer

        async def handle(connection: Handle) -> None:
            receive, said = connection.recv, -math.inf

            async def receive_checked(*given: object, **also: object) -> object:
                nonlocal said
                while True:
                    raw = await receive(*given, **also)
                    refusal = border.refused(raw)
                    if not refusal:
                        return raw
                    if time.monotonic() - said > _QUIET:
                        said = time.monotonic()
                        border.tell(connection, refusal)

            connection.recv = receive_checked
            await handler(connection)

        return original(handle, *arguments, process_request=process, **named)

    module.serve = serve
    try:
        yield
    finally:
        module.serve = original
