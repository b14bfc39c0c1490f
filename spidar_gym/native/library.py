"""Loads the compiled library and wraps the onboard core's structs, for `control="core"`."""

import ctypes
import hashlib
import os
import time
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any, Generic, TypeVar

import mujoco
import numpy as np

from spidar_gym.control.allocation.allocator import Allocation, AllocationStatus
from spidar_gym.errors import MissingDependencyError, SpidarError, StaleAssetError, closed
from spidar_gym.model.dynamics import Model
from spidar_gym.model.rotor import vectoring_to_force
from spidar_gym.native import limits
from spidar_gym.native.codegen.committed import shared_headers
from spidar_gym.native.constants import MAX_OBSERVATION, PROGRAMS
from spidar_gym.native.core_structs import core_layouts
from spidar_gym.native.recipe import LIBRARY, NATIVE, SEAL, library_digest
from spidar_gym.native.robot import robot
from spidar_gym.robot import N_LEGS, N_ROTORS, ROBOT, RobotSpec
from spidar_gym.state import NO_RESIDUAL, Command, Residual, RobotState

BUILD = "spidar assets"
"""Command that updates the generated C and the compiled library."""
STATUS = tuple(AllocationStatus)
"""Outcomes of a tick's allocation, in the order of the core's enumeration."""


def core_path() -> Path:
    """Return the path of the compiled library: `SPIDAR_CORE`, or the installed one in the package."""
    given = os.environ.get("SPIDAR_CORE")
    return Path(given) if given else NATIVE / LIBRARY


@cache
def expected_digest() -> str:
    """Return the digest that a library must report: that of this package's structs, constants and C sources."""
    headers = {name: text.encode() for name, text in shared_headers().items()}
    return library_digest(headers)


def version() -> str:
    """Return the version on which bytes of the library's structs depend."""
    return f"{expected_digest()[:16]}, MuJoCo {mujoco.__version__}"


def require_version(what: str, found: object) -> None:
    """Raise `SpidarError` for bytes of the library's structs from another version."""
    if found != version():
        raise SpidarError(f"the {what} are of another version: {found}; valid here: {version()}")


def write(array: np.ndarray, content: bytes) -> None:
    """Overwrite an array in place with the bytes of its `tobytes`."""
    array[...] = np.frombuffer(content, array.dtype).reshape(array.shape)


def load_core() -> ctypes.CDLL:
    """Return the compiled library, one per process; it has no writable data.

    Raises:
        MissingDependencyError: When it is not compiled.
        StaleAssetError: When it is damaged, or was compiled from other sources.
        SpidarError: When it cannot be read or loaded here.
    """
    path = core_path()
    if not path.is_file():
        raise MissingDependencyError("the compiled core", f"{BUILD} (it needs a C compiler)")
    try:
        found = path.stat()
        library = _load(path, (found.st_ino, found.st_mtime_ns, found.st_size))
    except OSError as error:
        raise SpidarError(f"cannot read {path}: {error.strerror}; valid: the file that `{BUILD}` writes") from error
    if library.sp_interface().decode() != expected_digest():
        raise StaleAssetError(path, BUILD, "was compiled from other C, structs or numbers than are here")
    library.sp_solvers_size.restype = ctypes.c_size_t
    library.sp_find_mode.restype = ctypes.c_void_p
    return library


@cache
def _load(path: Path, version: tuple[int, ...]) -> ctypes.CDLL:
    """Check a file's seal and load it; the system keeps a loaded library until the process ends."""
    data = path.read_bytes()
    if hashlib.sha256(data[:-SEAL]).digest() != data[-SEAL:]:  # loading half a library ends in a bus error
        raise StaleAssetError(path, BUILD, "is damaged")
    try:
        library = ctypes.CDLL(str(path))
    except OSError as error:  # for another processor, or in a folder with noexec
        raise SpidarError(f"{error}; valid: the file that `{BUILD}` writes, a folder without noexec") from error
    library.sp_interface.restype = ctypes.c_char_p
    return library


class Closed:
    """Stands in for the library of a closed controller."""

    def __getattr__(self, name: str) -> Any:  # noqa: ANN401 - never
        """Raise the error of a closed object."""
        raise closed()


def pointer(array: np.ndarray) -> ctypes.c_void_p:
    """Return a pointer to an array's data; the array must outlive the pointer."""
    return ctypes.c_void_p(array.__array_interface__["data"][0])  # a third of the time of `array.ctypes`


_SCALES = ("joint_speed_scale", "raise_scale", "stride_scale", "lift_scale")
_FORCES = ("forces_l", "leg_forces_b")


class Struct:
    """One of the core's structs, and a view of each of its members."""

    def __init__(self, name: str, record: np.ndarray | None = None) -> None:
        """Make a struct, or view one inside another."""
        self.name, self.record = name, np.zeros((), core_layouts()[name]) if record is None else record
        self.pointer = pointer(self.record)
        self.views: dict[str, np.ndarray] = {n: self.record[n] for n in self.record.dtype.names or ()}

    def __getitem__(self, name: str) -> np.ndarray:
        """View of a member."""
        return self.views[name]

    def inner(self, member: str, name: str) -> "Struct":
        """Return a view of a struct inside this one."""
        return Struct(name, self.views[member])

    def load(self, value: object) -> None:
        """Copy a dataclass of numbers and arrays with the same names into the struct."""
        for name, view in self.views.items():
            given = getattr(value, name)
            view[...] = given.reshape(view.shape) if isinstance(given, np.ndarray) else given


class Room:
    """Workspace of a thread (`sp_room`): the robot's numbers, solvers, scratch memory for linear algebra."""

    def __init__(self, library: ctypes.CDLL, spec: RobotSpec = ROBOT) -> None:
        """Make a workspace for a robot."""
        size, programs = library.sp_solvers_size(), (len(PROGRAMS),)
        self._solvers = np.zeros(size // 64 + 1, "V64")
        self._robot = robot(spec)
        members = [("robot", "u8"), ("hard", "u8", programs), ("soft", "u8", programs)]
        self.record = np.zeros((), np.dtype([*members, ("workspace", core_layouts()["workspace"])], align=True))
        self.robot, self.pointer = pointer(self._robot), pointer(self.record)
        library.sp_make_room(self.robot, pointer(self._solvers), self.pointer)


class LastCommand:
    """The last command in the core's memory, as views."""

    def __init__(self, memory: Struct) -> None:
        """View the last command in a struct of the core's memory."""
        self.vectoring = memory["vectoring"].reshape(N_ROTORS, 2)
        self.forces_l = memory["forces_l"].reshape(N_ROTORS, 3)
        self.joint_position = memory["joint_position"]


M = TypeVar("M", bound=LastCommand)


class Core(Generic[M]):
    """Common part of flight and crawl: the library, a workspace, structs shared with the core."""

    config: Any
    """Configuration of the controller."""
    memory: M
    """Views of the controller's state in the core."""
    whole: Struct
    """The controller's struct: state and configuration."""

    def __init__(self, model: Model | None, room: Room | None = None) -> None:
        """Load the library; make a workspace, or use a given one for the same robot."""
        self.model = model or Model()
        self.library: Any = load_core()
        self.room = Room(self.library, self.model.robot) if room is None else room
        self._state, self._residual, self._command = Struct("robot_state"), Struct("residual"), Struct("command")
        self._observation = np.zeros(MAX_OBSERVATION, np.float32)
        self._seen: RobotState | None = None
        self._solve_time = 0.0
        self._last_step: Any = None

    @property
    def thrust_limit(self) -> float:
        """λ̄ at the present voltage [N]; as `ReadableController.thrust_limit`."""
        return float(self.whole["thrust_limit"])

    @thrust_limit.setter
    def thrust_limit(self, newtons: float) -> None:
        self.whole["thrust_limit"][...] = newtons

    def forget(self) -> None:
        """Discard what was read of the last tick, after the engine has advanced the viewed controller."""
        self._last_step, self._solve_time = None, float("nan")

    def close(self) -> None:
        """Release the library; later calls raise an error."""
        self.library = Closed()

    def __getstate__(self) -> dict[str, Any]:
        """Return the state of a copy, which has its own memory (`SpidarError` where this is closed)."""
        if isinstance(self.library, Closed):
            raise closed()
        return {"version": version(), "made": (self.config, self.model), "memory": self.remembered()}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Restore a copy (`SpidarError` for a state of another version)."""
        require_version("copied controller", state["version"])
        self.__init__(*state["made"])
        self.recall(state["memory"])

    def remembered(self) -> dict[str, Any]:
        """Return the controller's state by name."""
        return {"record": self.whole.record.tobytes()}

    def recall(self, memory: Mapping[str, Any]) -> None:
        """Restore a state that `remembered` returned."""
        write(self.whole.record, memory["record"])
        self._last_step = None

    def fault_of(self, memory: Mapping[str, Any]) -> str:
        """Describe what is invalid in a state that `remembered` returned; return "" if it is valid."""
        own, record = self.whole, np.frombuffer(memory["record"], self.whole.record.dtype)
        config = {"flight": "controller_config", "crawl": "crawler_config", "manager": "manager_config"}[own.name]
        return limits.fault_of(own.name, record) or limits.differs(config, record["config"], own["config"])

    def write_state(self, state: RobotState) -> None:
        """Write a state for the core, unless it is the last one written."""
        if state is not self._seen:
            self._state.load(state)
            self._seen = state

    def residual_pointer(self, residual: Residual) -> ctypes.c_void_p | None:
        """Write a residual for the core and return its pointer; None for `NO_RESIDUAL`."""
        if residual is NO_RESIDUAL:
            return None
        views = self._residual.views
        views["wrench"][:], views["joint_offset"][:] = residual.wrench, residual.joint_offset
        for name in _SCALES:
            views[name][...] = getattr(residual, name)
        for name in _FORCES:
            forces = getattr(residual, name)
            views[f"has_{name}"][...] = forces is not None
            if forces is not None:
                views[name][:] = forces.reshape(-1)
        return self._residual.pointer

    def set_last_command(self, command: Command) -> None:
        """Store a command from elsewhere as the last command."""
        memory = self.memory
        memory.vectoring[:] = command.vectoring
        memory.forces_l[:] = vectoring_to_force(command.thrust, command.vectoring)
        memory.joint_position[:] = command.joint_position

    def _tick(self, function: Any, *arguments: ctypes.c_void_p | None) -> Command:  # noqa: ANN401 - of the library
        """Call a step function of the core and return its command."""
        start, c = time.perf_counter(), self._command
        function(*arguments, c.pointer)
        self._solve_time, self._last_step = time.perf_counter() - start, None
        return Command(
            c["thrust"].copy(), c["vectoring"].reshape(N_ROTORS, 2).copy(), c["joint_position"].copy(),
            c["joint_torque_limit"].copy(),
        )  # fmt: skip


def read_allocation(struct: Struct, solve_time: float) -> Allocation:
    """Return the core's allocation; its arrays are views."""
    return Allocation(
        forces_l=struct["forces_l"].reshape(N_ROTORS, 3),
        foot_forces_f=struct["foot_forces_f"].reshape(N_LEGS, 3),
        thrust=struct["thrust"],
        joint_torques=struct["joint_torques"],
        wrench=struct["wrench"],
        unallocated_wrench=struct["unallocated_wrench"],
        status=STATUS[int(struct["status"])],
        iterations=int(struct["iterations"]),
        active=struct["active"][: int(struct["rows"])].astype(float),
        slack=float(struct["slack"]),
        solve_time=solve_time,
    )
