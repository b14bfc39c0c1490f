"""Moments of an environment: copies that go on by themselves, and bytes from which another one goes on.

What is remembered is all that an environment, its controller and their parts have as attributes, but for what their
construction settles. So what a law or an environment of one's own keeps comes along, under whatever name.
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
"""Part of a saved state that says what it is of."""
PARTS = (Commander, ReadableController, Manager, Gait, Allocator, Pilot, Estimator, Core, Plant)
"""Objects that remember something, each in place."""
IN_BYTES = (Core, Plant)
"""Those of them that the library remembers for."""
SETTLED = (
    "view", "robot", "layout", "sight", "render_mode", "action_space", "observation_space", "spec", "fleet", "plant",
    "hold", "most_steps", "_arguments", "_is_bare", "_nominal", "_randomization", "_described", "_control", "_mode",
    "_bound", "_ruled", "_config", "_allocator", "_law", "_is_waypoint", "_made", "turn", "is_closed", "truncates",
    "metadata", "reward_terms", "failures", "_now",
)  # fmt: skip
"""Attributes of an environment that its construction settles."""
SETTLED_OF_PARTS = {
    ReadableController: ("preview",), Allocator: ("modes", "_workspaces"), Pilot: ("manager",),
    Commander: ("_fleet", "_plant", "_mode", "_bound", "_gait", "_is_waypoint", "_decide", "_is_described"),
}  # fmt: skip
"""The same of its parts."""
_ROOT = "env"
"""How the environment itself is called among its parts."""


class Restorable(ABC):
    """An environment that is copied, pickled, saved and restored."""

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
    """Task and robot as they were asked for."""
    _now: dict[str, Any]
    """What is known of this tick."""
    _commander: Commander | None
    """The controller in Python, where there is one."""

    @property
    @abstractmethod
    def horizon(self) -> int:
        """Steps after which the episode ends, unless it fails before."""

    @in_turn
    def __getstate__(self) -> dict[str, Any]:
        """What a copy is made of; who looks into the engine's memory looks into the copy's there."""
        state = vars(self).copy()
        if self._is_bare:
            return state
        self.plant.keep()
        state["_now"] = {}
        if self._commander is None:
            state.pop("controller")
        return state

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Become a copy."""
        vars(self).update(state)
        if self._is_bare:
            return
        if self._commander is None:
            self.controller = self._look_at_controller()
        self.fleet.commander = self._commander

    def __copy__(self) -> NoReturn:
        """Two environments that share one robot would both be wrong about it."""
        raise SpidarError("copy.copy would share one robot; valid: copy.deepcopy(env)")

    def _obey(self, fleet: Fleet) -> None:
        """Let the engine's rules be those of the task, which may have become another."""
        if self.task is not self._ruled:
            self._rule(fleet)
            self._ruled = self.task
        fleet.rules["rules"]["horizon"] = self.horizon

    @in_turn
    def save_state(self) -> bytes:
        """All that there is of this moment: the robot, the controller, the task, what is drawn next; nothing changes.

        Raises:
            SpidarError: When `reset` was never called, and where a law or a class of one's own keeps what no file
                holds, such as a function or a network.
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
        """Go on from a moment that was saved, bit for bit as that environment would have.

        Args:
            saved: What `save_state` gave, of any environment of the same id and options, here or in another process.

        Returns:
            Observation and info of that moment.

        Raises:
            SpidarError: For bytes that are not what fits here, and nothing has changed.
        """
        told, arrays = _opened(saved)
        own = self._description()
        _require_same(told, own)
        back = self._way_back()
        try:
            seen = self._become(arrays)
            _require_same(self._description(), own)  # what it says of itself is not always what it holds
        except Exception as error:  # of damaged values anything may come; whatever it is, nothing has changed
            back()
            if isinstance(error, SpidarError):
                raise
            raise SpidarError(f"the saved state is damaged: {shown(error)}; valid: what save_state() gave") from error
        if self.render_mode == "human":
            self.render()
        return seen

    def _become(self, arrays: dict[str, np.ndarray]) -> tuple[Any, dict[str, Any]]:
        """Go on from what was saved, observation and info of that; where this raises, some of it may be taken over."""
        self._take_over(arrays)
        if self._commander is not None:  # Python may raise anything at what means nothing: a step shows, and is undone
            self.fleet.step()
            self._take_over(arrays)
        return self._shown()

    def _take_over(self, arrays: dict[str, np.ndarray]) -> None:
        """Remember what was saved, all of it new."""
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
        """What lets everything be again as it is now."""
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
        """The environment itself, and what of it remembers something by itself, by the way that leads there."""
        yield _ROOT, self
        if self._commander is not None:
            yield from _parts_of(self, "", set())

    def _modules(self) -> set[str]:
        """Modules that what is remembered may have its classes from: those of the environment and its controller."""
        parts = [self.task, *(part for _, part in self._parts())]
        return {kind.__module__ for part in parts for kind in type(part).__mro__ if kind is not object}

    def _description(self) -> dict[str, Any]:
        """What has to be the same where an episode is to go on."""
        task, robot = self._made
        kinds = [_name(type(part)) for path, part in self._parts() if path.startswith("controller")]
        asked = {each.name: getattr(task, each.name) for each in fields(task) if each.name not in self.reset_options}
        ground = robot.ground  # where it is drawn, the episode's
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
        """A picture."""

    @abstractmethod
    def _look_at_controller(self) -> Any:  # noqa: ANN401 - a controller of the subclass
        """The core's controller in the engine's memory."""

    @abstractmethod
    def _rule(self, fleet: Fleet) -> None:
        """Write the task into the engine's rules."""

    @abstractmethod
    def _forget(self) -> None:
        """What was read of the last tick is past."""

    @abstractmethod
    def _shown(self) -> tuple[Any, dict[str, Any]]:
        """Observation and info of now."""


def _require_same(told: Mapping[str, Any], own: Mapping[str, Any]) -> None:
    """Refuse a moment of another environment than the one that is to go on from it."""
    for name, here in own.items():
        if told.get(name) != here:
            raise SpidarError(f"the saved state is of another {name}: {shown(told.get(name))}; valid here: {here}")


def _parts_of(owner: Any, path: str, seen: set[int]) -> Iterator[tuple[str, Any]]:  # noqa: ANN401 - an environment or a part of one
    """Parts of an owner and their parts, each once, by the way that leads there."""
    for name, value in vars(owner).items():
        if isinstance(value, PARTS) and name not in _settled(owner) and id(value) not in seen:
            seen.add(id(value))
            yield path + name, value
            if not isinstance(value, IN_BYTES):
                yield from _parts_of(value, f"{path}{name}.", seen)


def _settled(owner: Any) -> tuple[str, ...]:  # noqa: ANN401 - as above
    """Attributes that its construction settles."""
    if isinstance(owner, Restorable):
        return SETTLED
    return next((names for kind, names in SETTLED_OF_PARTS.items() if isinstance(owner, kind)), ())


def _names(part: Any) -> list[str]:  # noqa: ANN401 - as above
    """Attributes in which it remembers something by itself."""
    settled = _settled(part)
    return [name for name, value in vars(part).items() if not (name in settled or isinstance(value, (*PARTS, Model)))]


def _remembered(part: Any) -> dict[str, Any]:  # noqa: ANN401 - as above
    """What it remembers, by name."""
    if isinstance(part, Core):
        return part.remembered()
    if isinstance(part, Plant):
        return vars(part.save())
    return {name: getattr(part, name) for name in _names(part)}


def _recall(part: Any, known: dict[str, Any]) -> None:  # noqa: ANN401 - as above
    """Let it remember just that."""
    if isinstance(part, Core):
        part.recall(known)
    elif isinstance(part, Plant):
        part.restore(Saved(**known))
    else:
        for name in _names(part):
            delattr(part, name)
        vars(part).update(known)


def _require_parts(known: dict[str, Any], parts: dict[str, Any]) -> None:
    """Raise `SpidarError` for what the parts of this environment cannot remember."""
    valid = "valid: one of an environment with such a controller"
    if known.keys() != parts.keys() or not all(isinstance(told, dict) for told in known.values()):
        raise SpidarError(f"the saved state is of other parts; {valid}")
    for path, part in parts.items():
        told = known[path]
        if isinstance(part, IN_BYTES):
            fault = _fault_in_bytes(part, told)
        elif any(name in _settled(part) for name in told):
            fault = "attributes that are settled"
        else:
            fault = fault_of(part, _names(part), told, is_environment=path == _ROOT)
        if fault:
            raise SpidarError(f"the saved state has, of {path}, {fault}; {valid}")
    env, told = parts[_ROOT], known[_ROOT]
    if type(told.get("task")) is not type(env.task):
        raise SpidarError(f"the saved state is of another task; {valid}")


def _fault_in_bytes(part: Any, told: dict[str, Any]) -> str:  # noqa: ANN401 - as above
    """What of a part that the library remembers for cannot be, in words; else empty."""
    sizes = [
        {name: len(value) if isinstance(value, bytes) else 0 for name, value in each.items()}
        for each in (_remembered(part), told)
    ]
    if sizes[0] != sizes[1]:
        return "another size"
    return part.fault_of(Saved(**told) if isinstance(part, Plant) else told)


def _opened(saved: object) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """What a saved state says that it is of, and its arrays (`SpidarError` where it is none)."""
    valid = "valid: the bytes that save_state() gave, all of them"
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
    """A class in a word; of another package with its module."""
    own = kind.__module__.startswith("spidar_gym.")
    return kind.__qualname__ if own else f"{kind.__module__}.{kind.__qualname__}"
