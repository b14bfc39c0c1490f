"""A stand-in for viser, and functions that use a session's page on the stand-in or on viser."""

import importlib.util
from contextlib import nullcontext
from types import SimpleNamespace
from typing import Any

import pytest

needs_viser = pytest.mark.skipif(
    importlib.util.find_spec("viser") is None, reason="viser missing: pip install -e '.[web]'"
)
CLIENT = SimpleNamespace(camera=SimpleNamespace(aspect=1.6, on_update=lambda _: None), told=[])
CLIENT.add_notification = lambda title, words, **_: CLIENT.told.append(words)


class Handle:
    """An element of the page: its arguments, and the callbacks called when the user changes it."""

    def __init__(self, kind: str, name: str, made: dict[str, Any]) -> None:
        self.kind, self.name, self.callbacks = kind, name, []
        self.value, self.options, self.visible, self.disabled = made.pop("initial_value", None), (), True, False
        self.position = (0.0, 0.0, 0.0)
        self.__dict__.update(made)
        if kind in ("button", "button_group"):
            self.on_click = self.callbacks.append
        elif kind == "command":
            self.on_trigger = self.callbacks.append
        elif kind in ("slider", "dropdown", "checkbox"):
            self.on_update = self.callbacks.append

    def __enter__(self):
        return self

    def __exit__(self, *_):
        pass

    def __getattr__(self, name: str):
        if name.startswith("on_"):
            raise AttributeError(name)
        return lambda *_, **__: Handle(name, "", {})


class Api:
    """`gui` or `scene` of a server: records what was added."""

    def __init__(self) -> None:
        self.added: list[Handle] = []
        self.main_panel, self.world_axes = Handle("panel", "", {}), Handle("axes", "", {})

    def __getattr__(self, name: str):
        def add(label: str = "", *values: Any, **made: Any) -> Handle:
            if values and "options" not in made:
                made["options"] = values[0]
            self.added.append(Handle(name.removeprefix("add_"), label, made))
            return self.added[-1]

        return add


class Server:
    """A stand-in for `viser.ViserServer`."""

    def __init__(self, **given: Any) -> None:
        self.given, self.gui, self.scene, self.is_stopped = given, Api(), Api(), False
        self.initial_camera, self.clients = SimpleNamespace(), {}

    def get_clients(self):
        return self.clients

    def on_client_connect(self, call):
        self.greet = call

    def atomic(self):
        return nullcontext()

    def get_port(self):
        return self.given["port"]

    def stop(self):
        self.is_stopped = True

    def request_share_url(self):
        raise AssertionError("a tunnel to an external server was requested")


def trimesh() -> Any:
    """A stand-in for the module."""
    look = SimpleNamespace(vertex_attributes={})
    visual = SimpleNamespace(TextureVisuals=lambda **_: look, material=SimpleNamespace(PBRMaterial=lambda **_: None))
    return SimpleNamespace(visual=visual, Trimesh=lambda vertices, faces, **_: SimpleNamespace(vertices=vertices))


def modules() -> tuple[Any, Any]:
    """Stand-ins for viser and trimesh."""
    return SimpleNamespace(ViserServer=Server), trimesh()


def start(gate: Any, viser: Any, port: int) -> Any:
    """A stand-in for `Gate.start`: no socket is opened."""
    return viser.ViserServer(host=gate._host, port=port)


def find(server: Any, label: str, option: str | None = None) -> Any:
    """The input with a label; among several, the input that has `option`."""
    if isinstance(server, Server):
        handles = [handle for handle in server.gui.added if handle.name == label]
    else:
        inputs = server.gui._gui_input_handle_from_uuid.values()
        handles = [handle for handle in inputs if getattr(handle, "label", None) == label]
    (found,) = [handle for handle in handles if option is None or option in handle.options]
    return found


def use(server: Any, label: str, value: Any = None) -> None:
    """Act as a user: set an input to a value, or press the button of that name."""
    handle = find(server, label, value if isinstance(value, str) else None)
    if isinstance(server, Server):
        handle.value, callbacks = value, handle.callbacks
    else:
        handle._impl.value, callbacks = value, handle._impl.update_cb
    for call in callbacks:
        call(SimpleNamespace(client=CLIENT, target=handle))


def hit(server: Any, key: str) -> None:
    """Press a key."""
    if isinstance(server, Server):
        calls = [h.callbacks for h in server.gui.added if h.kind == "command" and h.hotkey == key]
    else:
        commands = server.gui._command_handle_from_uuid.values()
        calls = [handle._impl.trigger_cb for handle in commands if handle.hotkey == key]
    ((call,),) = calls
    call(SimpleNamespace(client=CLIENT))
