"""A page that is served and flown, and what browsers and others send to it."""

import contextlib
import http.client
import importlib
import socket
import threading
import time

from spidar_gym.viz.live.session import Session


@contextlib.contextmanager
def flying(host="127.0.0.1", **options):
    """A page that is served and flown by a thread: session, server, host, port, token."""
    from spidar_gym.viz.live.serve import keep_time, served

    session, stop, ended = Session(**options), threading.Event(), []

    def fly():
        try:
            keep_time(page, stop.is_set)
        except BaseException as error:  # whatever ends the flight is what these tests look for
            ended.append(error)

    with served(session, {}, host=host, port=0) as (page, address):
        thread = threading.Thread(target=fly)
        thread.start()
        try:
            yield page, address
        finally:
            alive = thread.is_alive()
            stop.set()
            thread.join()
            session.close()
    assert alive
    assert not ended


def place(address):
    """Host, port and token of an address."""
    authority, _, token = address.removeprefix("http://").partition("/?token=")
    name, _, port = authority.rpartition(":")
    return name, int(port), token


def asked(address, headers, path="/"):
    """Status of a request with just these headers, a name may stand there twice."""
    name, port, _ = place(address)
    connection = http.client.HTTPConnection(name, port, timeout=10)
    with contextlib.closing(connection):
        return _answer(connection, headers, path)


def _answer(connection, headers, path):
    connection.putrequest("GET", path, skip_host=True, skip_accept_encoding=True)
    for key, value in headers:
        connection.putheader(key, value)
    connection.endheaders()
    with connection.getresponse() as answer:
        answer.read()
    return answer.status, answer.getheader("Set-Cookie")


def joined(address, headers):
    """Whether a socket is opened with these headers."""
    viser, client = importlib.import_module("viser"), importlib.import_module("websockets.sync.client")
    refused = importlib.import_module("websockets.exceptions").InvalidStatus
    name, port, _ = place(address)
    given = [(key, value) for key, value in headers if key != "Host"]
    host = dict(headers).get("Host")
    uri = f"ws://{host or f'{name}:{port}'}"
    try:
        with client.connect(
            uri, sock=socket.create_connection((name, port)), additional_headers=given,
            subprotocols=[f"viser-v{viser.__version__}"], compression=None, max_size=None,
        ) as connection:  # fmt: skip
            return bool(connection.recv(timeout=10))
    except refused as refusal:
        return refusal.response.status_code != 403


CAMERA = {
    "type": "ViewerCameraMessage", "wxyz": [1.0, 0.0, 0.0, 0.0], "position": [1.0, 1.0, 1.0], "fov": 1.0, "near": 0.1,
    "far": 100.0, "image_height": 480, "image_width": 640, "look_at": [0.0, 0.0, 0.0], "up_direction": [0.0, 0.0, 1.0],
}  # fmt: skip
"""What a browser says first; viser takes it for one from then on."""


def inputs(page):
    """viser's identifiers of the page's inputs, by label and first option."""
    return page._gui._gui_input_handle_from_uuid


@contextlib.contextmanager
def browser(address):
    """A socket that viser takes for a browser's."""
    viser, client = importlib.import_module("viser"), importlib.import_module("websockets.sync.client")
    encode = importlib.import_module("msgspec").msgpack.encode
    name, port, _ = place(address)
    with client.connect(
        f"ws://{name}:{port}", subprotocols=[f"viser-v{viser.__version__}"], compression=None, max_size=None
    ) as connection:
        connection.send(encode(CAMERA))
        yield connection


def waited(is_so, seconds=10.0):
    """Whether something comes to be so within a time."""
    until = time.monotonic() + seconds
    while not is_so() and time.monotonic() < until:
        time.sleep(0.02)
    return is_so()
