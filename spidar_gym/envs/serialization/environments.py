"""Snapshots of an environment: independent copies, and saved states from which another environment resumes.

A snapshot contains all attributes of an environment, its controller and their parts, except those that the constructor
determines. It therefore includes additional attributes of custom laws and environments.
"""

import hashlib
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping
from dataclasses import fields
from typing import Any, NoReturn

import numpy as np

from spidar_gym.border import BorderError, pack, unpack
from spidar_gym.control.allocation.allocator import Allocator
from spidar_gym.control.course.pilot import Pilot
from spidar_gym.control.crawl.gait import Gait
from spidar_gym.control.estimator import Estimator
from spidar_gym.control.grasp.phases import Grasper
from spidar_gym.control.locomotion.manager import Manager
from spidar_gym.control.readable import ReadableController
from spidar_gym.envs.actions import ActionMode
from spidar_gym.envs.commander import Commander
from spidar_gym.envs.fleet import Fleet
from spidar_gym.envs.locking import in_turn
from spidar_gym.envs.serialization.checks import fault_of
from spidar_gym.envs.serialization.fleets import restore, save
from spidar_gym.envs.serialization.values import pack_values, unpack_values
from spidar_gym.errors import SpidarError, shown
from spidar_gym.model.dynamics import Model
from spidar_gym.native.library import Core, version
from spidar_gym.native.plant import Plant, Saved
from spidar_gym.sim.config import PlantConfig

TITLE = "state.json"
"""Part of a saved state that describes its environment."""
PARTS = (Commander, ReadableController, Manager, Grasper, Gait, Allocator, Pilot, Estimator, Core, Plant)
"""Classes of parts with state, which is restored in place."""
IN_BYTES = (Core, Plant)
"""Classes of parts whose state is in the native library."""
SETTLED = (
    "view", "robot", "layout", "sight", "render_mode", "action_space", "observation_space", "spec", "fleet", "plant",
    "hold", "most_steps", "_arguments", "_is_bare", "_nominal", "_randomization", "_described", "_control", "_mode",
    "_bound", "_gain", "_ruled", "_config", "_allocator", "_law", "_is_waypoint", "_is_order", "_grip",
    "_made", "turn", "is_closed", "truncates", "metadata", "reward_terms", "failures", "_now",
)  # fmt: skip
"""Attributes of an environment that its constructor determines."""
SETTLED_OF_PARTS = {
    ReadableController: ("preview",), Allocator: ("modes", "_workspaces"), Pilot: ("manager",),
    Grasper: ("config", "robot", "_joint_speed"),
    Commander: (
        "_fleet", "_plant", "_mode", "_bound", "_gait", "_is_waypoint", "_decide", "_is_described", "_is_order",
        "_grip",
    ),
}  # fmt: skip
"""Attributes of parts that their constructors determine."""
_ROOT = "env"
"""Path of the environment itself among its parts."""


class Restorable(ABC):
    """Copying, pickling, saving and restoring of an environment."""

    task: Any
    fleet: Fleet
    plant: Plant
    controller: Any
    render_mode: str | None
    reset_options: tuple[str, ...]
    _is_bare: bool
    _began: bool
    _mode: ActionMode
    _control: str
    _ruled: Any
    _made: tuple[Any, PlantConfig]
    """Task and nominal robot from the constructor."""
    _now: dict[str, Any]
    """Values cached in the current tick."""
    _commander: Commander | None
    """Python controller, or None."""

    @property
    @abstractmethod
    def horizon(self) -> int:
        """Steps after which the episode is truncated."""

    @in_turn
    def __getstate__(self) -> dict[str, Any]:
        """Return the state for a copy, without the controller that is a view of the engine's memory."""
        state = vars(self).copy()
        if self._is_bare:
            return state
        self.plant.keep()
        state["_now"] = {}
        if self._commander is None:
            state.pop("controller")
        return state

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Restore a copy, with a controller that is a view of its own engine."""
        vars(self).update(state)
        if self._is_bare:
            return
        if self._commander is None:
            self.controller = self._look_at_controller()
        self.fleet.commander = self._commander

    def __copy__(self) -> NoReturn:
        """Refuse a shallow copy: two environments would step the same robot."""
        raise SpidarError("copy.copy would share one robot; valid: copy.deepcopy(env)")

    def _obey(self, fleet: Fleet) -> None:
        """Update the engine's rules if the task has changed."""
        if self.task is not self._ruled:
            self._rule(fleet)
            self._ruled = self.task
        fleet.rules["rules"]["horizon"] = self.horizon

    @in_turn
    def save_state(self) -> bytes:
        """Return a snapshot as bytes: robot, controller, task and random generators. The environment is unchanged.

        Raises:
            SpidarError: When `reset` was never called, or if a custom law or class has an attribute that cannot be
                saved, such as a function or a network.
        """
        if not self._began:
            raise SpidarError("there is no episode before reset(); valid: call reset() first")
        known = {path: _remembered(part) for path, part in self._parts()}
        words, numbers = pack_values(known, self._modules())
        self.plant.keep()
        arrays = {
            "words": words, "numbers": numbers, "robot": np.frombuffer(save(self.fleet, [0]), np.uint8)
        }  # fmt: skip
        return pack(TITLE, self._description(), arrays, sealed=True)

    @in_turn
    def restore_state(self, saved: bytes) -> tuple[Any, dict[str, Any]]:
        """Resume from a saved state, bit for bit as the saved environment would have continued.

        Args:
            saved: Bytes from `save_state` of any environment of the same id and options, in this or another process.

        Returns:
            Observation and info of the saved state.

        Raises:
            SpidarError: For bytes that do not match this environment, which is then unchanged.
        """
        told, arrays = _opened(saved)
        own = self._description()
        _require_same(told, own)
        back = self._way_back()
        try:
            seen = self._become(arrays)
            _require_same(self._description(), own)  # the description in the file may not match its content
        except Exception as error:  # damaged values may raise anything; undo all changes
            back()
            if isinstance(error, SpidarError):
                raise
            raise SpidarError(f"the saved state is damaged: {shown(error)}; valid: bytes from save_state()") from error
        if self.render_mode == "human":
            self.render()
        return seen

    def _become(self, arrays: dict[str, np.ndarray]) -> tuple[Any, dict[str, Any]]:
        """Apply a saved state and return its observation and info; an exception may leave it partly applied."""
        self._take_over(arrays)
        if self._commander is not None:  # values without meaning may raise in a Python controller: try a step, undo it
            self.fleet.step()
            self._take_over(arrays)
        return self._shown()

    def _take_over(self, arrays: dict[str, np.ndarray]) -> None:
        """Replace the state of all parts by newly made saved values."""
        known = unpack_values(arrays["words"], arrays["numbers"], self._modules())
        parts, fleet = dict(self._parts()), self.fleet
        _require_parts(known, parts)
        for path, part in parts.items():
            _recall(part, known[path])
        self._obey(fleet)
        restore(fleet, arrays["robot"].tobytes() if "robot" in arrays else b"", [0])
        self.plant.refresh()
        self._forget()

    def _way_back(self) -> Callable[[], None]:
        """Return a function that restores the current state."""
        parts, fleet = dict(self._parts()), self.fleet
        if self._began:
            self.plant.keep()
        robots, known = fleet.way_back(), self._now
        now = {path: _remembered(p) if isinstance(p, IN_BYTES) else vars(p).copy() for path, p in parts.items()}

        def back() -> None:
            for path, part in parts.items():
                if isinstance(part, IN_BYTES):
                    _recall(part, now[path])
                else:
                    vars(part).clear()
                    vars(part).update(now[path])
            robots()
            self._now = known
            if self._began:
                self.plant.refresh()

        return back

    def _parts(self) -> Iterator[tuple[str, Any]]:
        """Yield the environment and its parts with state, each with its attribute path."""
        yield _ROOT, self
        if self._commander is not None:
            yield from _parts_of(self, "", set())

    def _modules(self) -> set[str]:
        """Return the modules whose classes saved values may have: those of the environment and its controller."""
        parts = [self.task, *(part for _, part in self._parts())]
        return {kind.__module__ for part in parts for kind in type(part).__mro__ if kind is not object}

    def _description(self) -> dict[str, Any]:
        """Return what must be equal in the environment that resumes an episode."""
        task, robot = self._made
        kinds = [_name(type(part)) for path, part in self._parts() if path.startswith("controller")]
        asked = {each.name: getattr(task, each.name) for each in fields(task) if each.name not in self.reset_options}
        ground = robot.ground  # with sampled floors, the episode's
        floor = ground.uneven, ground.boxed, ground.slope, ground.heading
        mode = [(channel.name, channel.size) for channel in self._mode.channels], self._mode.residual is None
        options = asked | {f"plant.{f.name}": getattr(robot, f.name) for f in fields(robot) if f.name != "ground"}
        options |= {name: getattr(self, name, None) for name in ("_config", "_randomization", "hold", "_is_waypoint")}
        parts = robot, getattr(self, "_config", None)
        modules = {type(value).__module__ for value in parts} | {kind.__module__ for kind in type(task).__mro__}
        content = pack_values({**options, "floor": floor, "mode": mode}, modules, shared=False)
        return {
            "environment": _name(type(self)),
            "task": _name(type(task)),
            "version": version(),
            "controller": ", ".join([self._control, *kinds]),
            "set of options": hashlib.sha256(b"".join(part.tobytes() for part in content)).hexdigest()[:16],
            "length of an episode": self.horizon,
        }

    @abstractmethod
    def render(self) -> Any:  # noqa: ANN401 - as Gymnasium has it
        """Return a picture."""

    @abstractmethod
    def _look_at_controller(self) -> Any:  # noqa: ANN401 - a controller of the subclass
        """Return a view of the core's controller in the engine's memory."""

    @abstractmethod
    def _rule(self, fleet: Fleet) -> None:
        """Write the task into the engine's rules."""

    @abstractmethod
    def _forget(self) -> None:
        """Clear the values cached in the last tick."""

    @abstractmethod
    def _shown(self) -> tuple[Any, dict[str, Any]]:
        """Return the current observation and info."""


def _require_same(told: Mapping[str, Any], own: Mapping[str, Any]) -> None:
    """Require a saved state to be of an equal environment (`SpidarError`)."""
    for name, here in own.items():
        if told.get(name) != here:
            raise SpidarError(f"the saved state is of another {name}: {shown(told.get(name))}; valid here: {here}")


def _parts_of(owner: Any, path: str, seen: set[int]) -> Iterator[tuple[str, Any]]:  # noqa: ANN401 - an environment or a part of one
    """Yield the parts of an owner and their parts, each once, with their attribute paths."""
    for name, value in vars(owner).items():
        if isinstance(value, PARTS) and name not in _settled(owner) and id(value) not in seen:
            seen.add(id(value))
            yield path + name, value
            if not isinstance(value, IN_BYTES):
                yield from _parts_of(value, f"{path}{name}.", seen)


def _settled(owner: Any) -> tuple[str, ...]:  # noqa: ANN401 - as above
    """Return the attributes that its constructor determines."""
    if isinstance(owner, Restorable):
        return SETTLED
    return next((names for kind, names in SETTLED_OF_PARTS.items() if isinstance(owner, kind)), ())


def _names(part: Any) -> list[str]:  # noqa: ANN401 - as above
    """Return the attributes that hold its own state."""
    settled = _settled(part)
    return [name for name, value in vars(part).items() if not (name in settled or isinstance(value, (*PARTS, Model)))]


def _remembered(part: Any) -> dict[str, Any]:  # noqa: ANN401 - as above
    """Return its state by name."""
    if isinstance(part, Core):
        return part.remembered()
    if isinstance(part, Plant):
        return vars(part.save())
    return {name: getattr(part, name) for name in _names(part)}


def _recall(part: Any, known: dict[str, Any]) -> None:  # noqa: ANN401 - as above
    """Set its state."""
    if isinstance(part, Core):
        part.recall(known)
    elif isinstance(part, Plant):
        part.restore(Saved(**known))
    else:
        for name in _names(part):
            delattr(part, name)
        vars(part).update(known)


def _require_parts(known: dict[str, Any], parts: dict[str, Any]) -> None:
    """Require saved values to fit the parts of this environment (`SpidarError`)."""
    valid = "valid: one of an environment with such a controller"
    if known.keys() != parts.keys() or not all(isinstance(told, dict) for told in known.values()):
        raise SpidarError(f"the saved state is of other parts; {valid}")
    for path, part in parts.items():
        told = known[path]
        if isinstance(part, IN_BYTES):
            fault = _fault_in_bytes(part, told)
        elif any(name in _settled(part) for name in told):
            fault = "attributes that the constructor determines"
        else:
            fault = fault_of(part, _names(part), told, is_environment=path == _ROOT)
        if fault:
            raise SpidarError(f"the saved state has, of {path}, {fault}; {valid}")
    env, told = parts[_ROOT], known[_ROOT]
    if type(told.get("task")) is not type(env.task):
        raise SpidarError(f"the saved state is of another task; {valid}")


def _fault_in_bytes(part: Any, told: dict[str, Any]) -> str:  # noqa: ANN401 - as above
    """Return why values do not fit a part whose state is in the library, in words; else empty."""
    sizes = [
        {name: len(value) if isinstance(value, bytes) else 0 for name, value in each.items()}
        for each in (_remembered(part), told)
    ]
    if sizes[0] != sizes[1]:
        return "another size"
    return part.fault_of(Saved(**told) if isinstance(part, Plant) else told)


def _opened(saved: object) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Return the description and the arrays of a saved state (`SpidarError` for other bytes)."""
    valid = "valid: the bytes that save_state() returned, all of them"
    if not isinstance(saved, bytes):
        raise SpidarError(f"a {type(saved).__name__} is no saved state; {valid}")
    try:
        told, arrays = unpack(TITLE, saved, sealed=True)
    except BorderError as error:
        raise SpidarError(f"this is no saved state, or a damaged one: {error}; {valid}") from error
    if not (isinstance(told, dict) and {"words", "numbers"} <= arrays.keys()):
        raise SpidarError(f"this is no saved state of an environment; {valid}")
    return told, arrays


def _name(kind: type) -> str:
    """Return the name of a class; with its module if it is of another package."""
    own = kind.__module__.startswith("spidar_gym.")
    return kind.__qualname__ if own else f"{kind.__module__}.{kind.__qualname__}"
