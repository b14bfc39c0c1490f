"""Validation of browsers' messages before they are applied: types, widgets and their values."""

import importlib
from collections.abc import Mapping
from typing import Any

from spidar_gym.errors import (
    InvalidValueError,
    UnknownNameError,
    is_finite,
    require_flag,
    require_name,
    require_within,
    shown,
)

LONGEST, LARGEST = 1 << 14, 1 << 20
"""Largest size of a message that is decoded, and of one that is received [bytes]; the page's own have some hundreds."""
CAMERA = {"wxyz": 4, "position": 3, "look_at": 3, "up_direction": 3, "fov": 0, "near": 0, "far": 0}
"""Fields of the camera: length of a vector, or 0 for a scalar."""
MOST_PIXELS = 1 << 16
"""Largest number of pixels along an edge of a picture."""
FARTHEST = 1e6
"""Largest absolute value of a camera's numbers."""


def require_message(gui: Any, raw: object) -> None:  # noqa: ANN401 - viser's panel
    """Refuse a message that the page of this panel does not send.

    Args:
        gui: viser's panel.
        raw: The message as received.

    Raises:
        SpidarError: For bytes that are not a message of the page, an unknown widget, or an invalid value.
    """
    message = _decoded(raw)
    kind = message.get("type")
    require_name("message", kind, _FIELDS)
    given = {name: value for name, value in message.items() if name != "type"}
    if given.keys() != _FIELDS[str(kind)]:
        raise InvalidValueError(f"fields of {kind}", sorted(map(shown, given)), ", ".join(sorted(_FIELDS[str(kind)])))
    _REQUIRE[str(kind)](gui, given)


def _decoded(raw: object) -> Mapping[str, Any]:
    expected = f"a message of the page, a dictionary of at most {LONGEST} bytes"
    if not isinstance(raw, bytes):
        raise InvalidValueError("message", raw, expected)
    if len(raw) > LONGEST:
        raise InvalidValueError("bytes of a message", len(raw), expected)
    try:
        message = importlib.import_module("msgspec.msgpack").decode(raw)
    except Exception as error:  # any error in the bytes
        raise InvalidValueError("message", raw, expected) from error
    if not isinstance(message, dict):
        raise InvalidValueError("message", message, expected)
    return message


def _require_update(gui: Any, given: Mapping[str, Any]) -> None:  # noqa: ANN401 - viser's panel
    handle = _found(gui._gui_input_handle_from_uuid, given["uuid"])
    updates = given["updates"]
    if not isinstance(updates, dict) or list(updates) != ["value"]:
        raise InvalidValueError("updates", updates, "only the value of a widget")
    require_value(handle, updates["value"])


def require_value(handle: Any, value: object) -> None:  # noqa: ANN401 - viser's
    """Refuse an invalid value of a widget.

    Raises:
        SpidarError: For a number outside a slider's range, a name that is not an option, and any value of a disabled
            widget.
    """
    kind, name = type(handle).__name__, str(getattr(handle, "label", "") or "button")
    if handle.disabled:
        raise InvalidValueError(name, value, "no value, because the widget is disabled now")
    if kind == "GuiSliderHandle":
        if isinstance(value, bool):
            raise InvalidValueError(name, value, "a number")
        require_within(handle.min, handle.max, "1", **{name: value})
    elif kind in ("GuiDropdownHandle", "GuiButtonGroupHandle"):
        require_name(name, value, handle.options)
    else:
        require_flag(**{name: value})


def _require_command(gui: Any, given: Mapping[str, Any]) -> None:  # noqa: ANN401 - viser's panel
    _found(gui._command_handle_from_uuid, given["uuid"])


def _found(handles: Mapping[str, Any], uuid: object) -> Any:  # noqa: ANN401 - viser's
    if not (isinstance(uuid, str) and uuid in handles):
        raise UnknownNameError("widget", uuid, ["one of the page; reload it"])
    return handles[uuid]


def _require_camera(_: Any, given: Mapping[str, Any]) -> None:  # noqa: ANN401 - viser's panel
    for name, count in CAMERA.items():
        value = given[name]
        numbers = value if isinstance(value, list) else [value]
        is_vector = isinstance(value, list) and len(value) == count
        if not (is_vector if count else numbers is not value) or not all(_is_number(number) for number in numbers):
            raise InvalidValueError(name, value, f"{count or 'one'} finite number{'s' if count else ''}")
    for name in ("image_height", "image_width"):
        if not (_is_number(given[name]) and 1 <= given[name] <= MOST_PIXELS):
            raise InvalidValueError(name, given[name], f"within [1, {MOST_PIXELS}]")


def _is_number(value: object) -> bool:
    return not isinstance(value, bool) and is_finite(value) and abs(value) <= FARTHEST


_FIELDS = {
    "GuiUpdateMessage": {"uuid", "updates"},
    "CommandTriggerMessage": {"uuid"},
    "ViewerCameraMessage": {*CAMERA, "image_height", "image_width"},
}
"""Types of the page's messages → their fields."""
_REQUIRE = {
    "GuiUpdateMessage": _require_update,
    "CommandTriggerMessage": _require_command,
    "ViewerCameraMessage": _require_camera,
}
