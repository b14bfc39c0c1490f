"""Pins the border of the page: pages of others cannot steer, a network needs the token, messages are checked."""

import contextlib
import time

import numpy as np
import pytest
from support.pages import needs_viser
from support.served import asked, browser, flying, inputs, joined, place, waited

from spidar_gym.viz.live.border import Border

pytestmark = needs_viser
msgspec = pytest.importorskip("msgspec")


MINE = "localhost:{port}", "127.0.0.1:{port}", "[::1]:{port}", "localhost:9999", "LOCALHOST:{port}", "127.3.2.1"
FOREIGN_HOSTS = (
    "evil.example", "evil.example:{port}", "localhost.evil.example", "localhost:{port}@evil.example", "10.0.0.1:{port}",
    "", "localhost:{port}:1", "localhost:99999", "[::2]:{port}", "0x7f.1", "localhost, evil.example", "2130706433",
)  # fmt: skip
FOREIGN_ORIGINS = (
    "http://evil.example", "null", "", "https://evil.example", "http://localhost", "http://localhost:1",
    "http://localhost:{port}.evil.example", "file://", "http://evil.example@localhost:{port}", "localhost:{port}",
    "http://127.0.0.1:{port}", "ftp://localhost:{port}", "http://localhost:{port}/",
)  # fmt: skip


@pytest.fixture(scope="module")
def address():
    with flying() as (_, address):
        yield address


@pytest.mark.parametrize("host", MINE)
def test_a_name_of_this_machine_at_any_port_has_the_page(address, host):
    host = host.format(port=place(address)[1])
    assert asked(address, [("Host", host)])[0] == 200
    assert asked(address, [("Host", host), ("Origin", f"http://{host}")])[0] == 200


def test_the_page_itself_has_the_socket_and_so_has_a_program_without_an_origin(address):
    _, port, _ = place(address)
    assert joined(address, [])
    assert joined(address, [("Host", f"localhost:{port}"), ("Origin", f"http://localhost:{port}")])


@pytest.mark.parametrize("host", FOREIGN_HOSTS)
def test_another_host_has_nothing(address, host):
    assert asked(address, [("Host", host.format(port=place(address)[1]))])[0] in (400, 403)


@pytest.mark.parametrize("origin", FOREIGN_ORIGINS)
def test_a_page_of_another_origin_has_neither_the_page_nor_the_socket(address, origin):
    port = place(address)[1]
    headers = [("Host", f"localhost:{port}"), ("Origin", origin.format(port=port))]
    assert asked(address, headers)[0] == 403
    if origin:
        assert not joined(address, headers)


def test_two_hosts_and_two_origins_are_none(address):
    port = place(address)[1]
    own = ("Host", f"localhost:{port}"), ("Origin", f"http://localhost:{port}")
    assert asked(address, [own[0], own[0]])[0] in (400, 403)
    assert asked(address, [*own, own[1]])[0] == 403
    assert asked(address, [*own, ("Origin", "http://evil.example")])[0] == 403
    assert asked(address, [])[0] in (400, 403)


def test_open_to_a_network_the_token_is_asked_for_by_the_page_and_by_the_socket():
    with flying(host="0.0.0.0") as (_, address):
        name, port, token = place(address)
        local, here = f"http://{name}:{port}", ("Host", f"robot.example:{port}")
        assert len(token) > 20
        assert asked(local, [here])[0] == 403
        assert asked(local, [here], "/?token=wrong")[0] == 403
        status, cookie = asked(local, [here], f"/?token={token}")
        assert status == 200
        assert "HttpOnly" in cookie
        assert "SameSite=Strict" in cookie
        known = [("Cookie", cookie.partition(";")[0])]
        assert asked(local, [here, *known], "/index.html")[0] == 200
        origin = ("Origin", f"http://robot.example:{port}")
        assert joined(local, [here, origin, *known])
        assert not joined(local, [here, origin])
        assert not joined(local, [here, ("Origin", "http://evil.example"), *known])
        assert asked(local, [here, ("Origin", "http://evil.example")], f"/?token={token}")[0] == 403


def said(connection, kind, seconds=5.0):
    """Whether the server says something of a kind, within a time."""
    until = time.monotonic() + seconds
    while time.monotonic() < until:
        with contextlib.suppress(TimeoutError):
            raw = connection.recv(timeout=0.5)
            import zstandard

            size = int.from_bytes(raw[8:16], "little")
            words = zstandard.ZstdDecompressor().decompress(raw[16 : 16 + size])
            if kind.encode() in words:
                return True
    return False


def test_what_no_input_has_is_answered_and_changes_nothing_and_what_one_has_is_done():
    with flying() as (page, address), browser(address) as connection:
        before = page.session.disturbances, page.session.form.copy(), page.session.towards

        def send(message):
            connection.send(msgspec.msgpack.encode(message))

        assert waited(lambda: page._server.get_clients())
        for uuid, handle in inputs(page).items():
            for value in (float("nan"), float("inf"), -1e300, "nothing", None, [1, 2], {"a": 1}, 10**9, "９"):
                send({"type": "GuiUpdateMessage", "uuid": uuid, "updates": {"value": value}})
            for name_of in ("options", "label", "min", "max", "visible", "disabled"):
                send({"type": "GuiUpdateMessage", "uuid": uuid, "updates": {name_of: handle.label}})
        for raw in (b"", b"\xc1", b"\x93", b"\xff" * 1000, msgspec.msgpack.encode({"type": "Zzz"})):
            connection.send(raw)
        connection.send("text")
        assert said(connection, "refused")
        after = page.session.disturbances, page.session.form, page.session.towards
        assert after[0] == before[0]
        assert np.array_equal(after[1], before[1])
        assert after[2] == before[2]
        wind = next(u for u, h in inputs(page).items() if h.label == "wind [m/s]")
        send({"type": "GuiUpdateMessage", "uuid": wind, "updates": {"value": 3}})
        assert waited(lambda: page.session.disturbances.wind == 3.0)


def test_every_input_of_the_page_takes_its_own_values():
    with flying() as (page, _):
        border = Border("127.0.0.1")
        border.find = page.find_input
        for uuid, handle in inputs(page).items():
            values = getattr(handle, "options", None) or (
                [handle.min, handle.max] if hasattr(handle, "min") else [True, False]
            )
            for value in values:
                message = {"type": "GuiUpdateMessage", "uuid": uuid, "updates": {"value": value}}
                assert border.refused(msgspec.msgpack.encode(message)) == "", handle.label
