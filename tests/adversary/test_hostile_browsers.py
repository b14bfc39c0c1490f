"""Foreign pages and browsers that connect to `spidar view --web`, and messages that no page of it sends."""

import contextlib
import math
import threading
import time

import pytest
from support.pages import needs_viser

from spidar_gym.envs.registry import HOVER
from spidar_gym.errors import SpidarError
from spidar_gym.viz.live.gate import Gate
from spidar_gym.viz.live.messages import LONGEST, require_message
from spidar_gym.viz.live.serve import keep_time, served
from spidar_gym.viz.live.session import Session

pytestmark = needs_viser
MESSAGES = 2000
"""Number of hostile messages."""
CAMERA = {
    "type": "ViewerCameraMessage", "wxyz": [1.0, 0.0, 0.0, 0.0], "position": [3.0, 0.0, 1.0],
    "look_at": [0.0, 0.0, 0.0], "up_direction": [0.0, 0.0, 1.0], "fov": 0.7, "near": 0.1, "far": 1000.0,
    "image_height": 600, "image_width": 800,
}  # fmt: skip
FOREIGN = (
    {"Host": "evil.example"}, {"Host": "localhost.evil.example"}, {"Host": "127.0.0.1.evil.example"},
    {"Host": "localhost@evil.example"}, {"Host": "evil.example@localhost"}, {"Host": "[::1"}, {"Host": ""},
    {"Host": "localhost:99999"}, {"Host": "0.0.0.0"}, {"Host": "localhost/evil"},
    {"Origin": "http://evil.example"}, {"Origin": "null"}, {"Origin": ""}, {"Origin": "file://"},
    {"Origin": "http://localhost:1"}, {"Origin": "ws://{host}"}, {"Origin": "http://{host}@evil.example"},
    {"Origin": "http://evil.example@{host}"}, {"Origin": "http://{host}.evil.example"}, {"Origin": "http://{host}/x"},
)  # fmt: skip
VALUES = (
    math.nan, math.inf, -math.inf, -1.0, 1e308, 10**18, "", "9", "nonsense", "①\0", "x" * 5000, True, None, [], {},
    [1.0] * 900, b"\xff", {"a": [None]}, 0.5, 1,
)  # fmt: skip


@pytest.fixture
def flying():
    """A served page whose robot flies, its address without `http://`, and the thread of its simulation."""
    session = Session(HOVER)
    over = threading.Event()
    with served(session, {}, port=0) as (page, address):
        loop = threading.Thread(target=keep_time, args=(page, over.is_set))
        loop.start()
        try:
            yield page, address.removeprefix("http://"), loop
        finally:
            over.set()
            loop.join()
            session.close()


def socket(place, **headers):
    """A WebSocket as a browser opens it, with additional headers."""
    import viser
    from websockets.sync.client import connect
    from websockets.typing import Subprotocol

    return connect(
        f"ws://{place}", subprotocols=[Subprotocol(f"viser-v{viser.__version__}")], max_size=None,
        additional_headers=headers, open_timeout=30.0,
    )  # fmt: skip


def encoded(message):
    import msgspec

    return msgspec.msgpack.encode(message)


def answers(place, path="/", upgrade="", **headers):
    """Status code of a GET request with these headers."""
    import socket as sockets

    host, port = place.split("/")[0].split(":")
    given = {"Host": place.split("/")[0], **{k: v.replace("{host}", place.split("/")[0]) for k, v in headers.items()}}
    lines = "".join(f"{name}: {value}\r\n" for name, value in given.items())
    with sockets.create_connection((host, int(port)), 30.0) as peer:
        peer.sendall(f"GET {path} HTTP/1.1\r\n{lines}{upgrade}\r\n".encode())
        return int(peer.recv(64).split()[1])


UPGRADE = (
    "Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
    "Sec-WebSocket-Key: MDEyMzQ1Njc4OWFiY2RlZg==\r\n"
)


def test_foreign_pages_are_refused_and_the_own_one_is_not(flying):
    _, place, _ = flying
    port = place.split(":")[1]
    for own in ("localhost", "LocalHost", "127.0.0.1", "127.8.9.1", "[::1]"):
        for upgrade, status in (("", 200), (UPGRADE, 101)):
            host = f"{own}:{port}"
            assert answers(place, upgrade=upgrade, Host=host) == status
            assert answers(place, upgrade=upgrade, Host=host, Origin=f"http://{host.lower()}") == status
    assert answers(place, Host="localhost", Origin="http://localhost:80") == 200
    assert answers(place, Host="localhost:8888", Origin="http://localhost:8888") == 200  # forwarded
    for headers in FOREIGN:
        for upgrade in ("", UPGRADE):
            assert answers(place, upgrade=upgrade, **headers) == 403, headers
    for twice in ("Host: localhost\r\n", "Origin: http://evil.example\r\nOrigin: null\r\n"):
        assert answers(place, upgrade=twice + UPGRADE) == 403
    assert answers(place, path="/%00") in (400, 404)


def test_a_network_needs_the_token_and_asks_for_any_name():
    session = Session(HOVER)
    with served(session, {}, host="0.0.0.0", port=0) as (_, address):
        place, token = address.removeprefix("http://").rsplit("/", 1)
        for upgrade, status in (("", 200), (UPGRADE, 101)):
            for path in (f"/{token}", f"/{token}/", f"/{token}?websocket=x"):
                assert answers(place, path, upgrade, Host="robot.example:80") == status
                assert answers(place, path, upgrade, Origin="http://evil.example") == 403
            for path in ("/", "/?token", f"/{token[:-1]}", f"/{token}x", f"/{token.swapcase()}", f"//{token}"):
                assert answers(place, path, upgrade) == 403
    session.close()
    assert Gate("0.0.0.0", is_open=True).path != Gate("0.0.0.0", is_open=True).path


def hostile(rng, gui):
    """A message that no page sends: random bytes, or a message of the page with a wrong value."""
    handles, commands = gui._gui_input_handle_from_uuid, gui._command_handle_from_uuid
    value = VALUES[rng.integers(len(VALUES))]
    uuid = list(handles)[rng.integers(len(handles))]
    kind = rng.integers(8)
    if kind == 0:
        return rng.bytes(int(rng.integers(200)))
    if kind == 1:
        return encoded([VALUES[k] for k in rng.integers(len(VALUES), size=3)])
    if kind == 2:
        return encoded(
            {"type": ["GuiFormSubmitMessage", "ShareUrlRequest", "object", 7][rng.integers(4)], "uuid": uuid}
        )
    if kind == 3:
        key = [key for key in CAMERA if key != "type"][rng.integers(len(CAMERA) - 1)]
        return encoded({**CAMERA, key: value})
    if kind == 4:
        name = ["removed", "update_cb", "props", "uuid", "disabled", "value "][rng.integers(6)]
        return encoded({"type": "GuiUpdateMessage", "uuid": uuid, "updates": {name: value}})
    if kind == 5:
        return encoded({"type": "CommandTriggerMessage", "uuid": value, "more": next(iter(commands))})
    if kind == 6:
        return b"\x91" * int(rng.integers(1, 2 * LONGEST))
    return encoded({"type": "GuiUpdateMessage", "uuid": uuid, "updates": {"value": value}})


def refusal(gui, message):
    try:
        require_message(gui, message)
    except SpidarError as error:
        return str(error)
    return ""


def test_messages_that_no_page_sends_end_nothing_and_change_nothing(flying, rng, tries):
    page, place, loop = flying
    gui, session = page._server.gui, page.session
    handles = gui._gui_input_handle_from_uuid
    with socket(place) as peer:
        reader = threading.Thread(target=lambda: [None for _ in peer], daemon=True)
        reader.start()
        peer.send(encoded(CAMERA))
        for _ in range(tries(MESSAGES)):
            message = hostile(rng, gui)
            refused = refusal(gui, message)
            if not refused:
                continue  # a valid message
            assert "\n" not in refused
            before = [handle.value for handle in handles.values()]
            with contextlib.suppress(TimeoutError):
                peer.send(message)
            assert [handle.value for handle in handles.values()] == before
        for name in FOREIGN:
            assert answers(place, upgrade=UPGRADE, **name) == 403
        passed = session.passed
        end = time.monotonic() + 20.0
        while session.passed < passed + 20 and time.monotonic() < end:
            time.sleep(0.01)
        assert session.passed >= passed + 20
        assert loop.is_alive()
        assert (session.over, session.form[3], session.disturbances.lost_rotor) == ("", 0.0, 0)
        assert not session.env.plant.diverged


def test_a_refused_value_is_reported_to_the_browser_that_sent_it_and_a_valid_one_takes_effect(flying, monkeypatch):
    page, place, _ = flying
    told = []
    monkeypatch.setattr("spidar_gym.viz.live.gate.notify", lambda client, words: told.append((client.client_id, words)))
    wind, form = (
        next(uuid for uuid, h in page._server.gui._gui_input_handle_from_uuid.items() if h.label == label)
        for label in ("wind to [°]", "form")
    )
    with socket(place) as peer:
        threading.Thread(target=lambda: [None for _ in peer], daemon=True).start()
        peer.send(encoded(CAMERA))
        wait(lambda: page._server.get_clients())
        peer.send(encoded({"type": "GuiUpdateMessage", "uuid": wind, "updates": {"value": math.nan}}))
        peer.send(encoded({"type": "GuiUpdateMessage", "uuid": form, "updates": {"value": "③"}}))
        wait(lambda: page.session.form[3] > 1.5)
    assert [words.split(";")[0] for _, words in told] == ["wind to [°] = nan is not valid"]


def wait(is_so):
    end = time.monotonic() + 30.0
    while not is_so():
        assert time.monotonic() < end
        time.sleep(0.01)
