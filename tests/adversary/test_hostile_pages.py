"""Messages and requests that a hostile page sends to the page of a flight: none ends it, none changes it in silence."""

import numpy as np
import pytest
from support.pages import needs_viser
from support.served import CAMERA, asked, browser, flying, inputs, place, waited

msgspec = pytest.importorskip("msgspec")
WHOLE = 2000
VALUES = (
    float("nan"), float("inf"), float("-inf"), -1.0, 1e308, 2**62, -(2**63), True, None, "", "nothing", "①", "form9",
    "9", "x" * 10_000, b"\0" * 100, [], [1.0] * 1000, {}, {"value": 1}, [[[[[]]]]],
)  # fmt: skip
KINDS = (
    "GuiUpdateMessage", "CommandTriggerMessage", "ViewerCameraMessage", "GuiButtonHoldMessage",
    "FileTransferStartUpload",
    "FileTransferPart", "ScenePointerMessage", "SceneNodeClickMessage", "GuiFormSubmitMessage", "ShareUrlRequest",
    "SceneNodeUpdateMessage", "RunJavascriptMessage", "GetRenderResponseMessage", "", "Zzz",
)  # fmt: skip


def crafted(rng, uuids):
    """Bytes of a message: of a known kind with values that it has not, of another kind, cut, or changed in a bit."""
    kind = KINDS[min(int(rng.exponential(3.0)), len(KINDS) - 1)]
    message = {**CAMERA, "type": kind} if kind == "ViewerCameraMessage" else {"type": kind, "uuid": rng.choice(uuids)}
    value = VALUES[rng.integers(len(VALUES))]
    if kind == "GuiUpdateMessage":
        name = rng.choice(["value", "value", "value", "options", "label", "min", "visible", "update_cb", "__class__"])
        message["updates"] = {str(name): value} if rng.random() < 0.9 else value
    elif rng.random() < 0.8:
        message[str(rng.choice([*message, "zzz"]))] = value
    raw = bytearray(msgspec.msgpack.encode({k: str(v) if isinstance(v, np.str_) else v for k, v in message.items()}))
    if rng.random() < 0.2:
        raw[rng.integers(len(raw))] ^= 1 << rng.integers(8)
    elif rng.random() < 0.1:
        raw = raw[: rng.integers(len(raw))]
    return bytes(raw)


@needs_viser
@pytest.mark.parametrize("env_id", ["spidar_gym/Hover-v0", "spidar_gym/Crawl-v0"])
def test_no_message_ends_the_flight_or_takes_a_number_where_there_is_none(env_id, rng, tries):
    with flying(env_id=env_id) as (page, address):
        uuids = [*inputs(page), "", "0", "../etc"]
        for _ in range(max(1, tries(WHOLE) // 100)):
            with browser(address) as connection:
                for _ in range(50):
                    connection.send(crafted(rng, uuids))
        passed = page.session.passed
        assert waited(lambda: page.session.passed > passed + 10)
        chosen = page.session.disturbances
        assert np.isfinite([chosen.wind, chosen.push, page.session.towards, page.clock.speed]).all()
        assert np.isfinite(page.session.frame.qpos).all()


NAMES = ("localhost", "127.0.0.1", "[::1]", "evil.example", "localhost.evil.example", "evil.localhost.example", "0", "")
SCHEMES = ("http://", "https://", "ws://", "file://", "", "null", "//")


@needs_viser
def test_no_foreign_host_or_origin_is_let_in(rng, tries):
    with flying() as (_, address):
        port = place(address)[1]
        for _ in range(tries(WHOLE)):
            names = [str(name) for name in rng.choice(NAMES, 2)]
            ends = [f":{port}", "", ":1", "/", "@evil.example", " ", f":{port}:{port}", "#", "?"]
            host, origin = (name + ends[rng.integers(len(ends))] for name in names)
            origin = SCHEMES[rng.integers(len(SCHEMES))] + origin
            status = asked(address, [("Host", host), ("Origin", origin)])[0]
            if (
                "evil" in host + origin
                or "null" in origin
                or host.partition(":")[0] not in ("localhost", "127.0.0.1", "[")
            ):
                assert status in (400, 403), (host, origin)
