"""The onboard core behind the controllers' own interface: `control="core"` flies what is compiled for the robot."""

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
from spidar_gym.native.codegen.committed import shared_headers
from spidar_gym.native.constants import MAX_OBSERVATION, PROGRAMS
from spidar_gym.native.core_structs import core_layouts
from spidar_gym.native.recipe import LIBRARY, NATIVE, SEAL, library_digest
from spidar_gym.native.robot import robot
from spidar_gym.robot import N_LEGS, N_ROTORS, ROBOT, RobotSpec
from spidar_gym.state import NO_RESIDUAL, Command, Residual, RobotState

BUILD = "spidar assets"
"""Command that brings the generated C and the compiled library up to date."""
STATUS = tuple(AllocationStatus)
"""How a tick was answered, in the order of the core's own words."""


def core_path() -> Path:
    """Where the compiled library lies: `SPIDAR_CORE`, or in the package, where installing puts it."""
    given = os.environ.get("SPIDAR_CORE")
    return Path(given) if given else NATIVE / LIBRARY


@cache
def expected_digest() -> str:
    """Digest that a library has to answer with: of this package's structs, constants and C sources."""
    headers = {name: text.encode() for name, text in shared_headers().items()}
    return library_digest(headers)


def version() -> str:
    """What has to be the same where bytes of the library's structs are to go on."""
    return f"{expected_digest()[:16]}, MuJoCo {mujoco.__version__}"


def require_version(what: str, found: object) -> None:
    """Raise `SpidarError` for bytes of the library's structs that another version wrote."""
    if found != version():
        raise SpidarError(f"the {what} are of another version: {found}; valid here: {version()}")


def write(array: np.ndarray, content: bytes) -> None:
    """Let an array be what its `tobytes` gave: where it lies for the library, it stays."""
    array[...] = np.frombuffer(content, array.dtype).reshape(array.shape)


def load_core() -> ctypes.CDLL:
    """The compiled library, one for the whole process: nothing in it is written.

    Raises:
        MissingDependencyError: When it is not compiled.
        StaleAssetError: When it is damaged, or was compiled of other sources.
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
    """Load a file after a look at its content; what the system has loaded under a name stays until the process ends."""
    data = path.read_bytes()
    if hashlib.sha256(data[:-SEAL]).digest() != data[-SEAL:]:  # half a library is a bus error
        raise StaleAssetError(path, BUILD, "is damaged")
    try:
        library = ctypes.CDLL(str(path))
    except OSError as error:  # of another processor, or where programs may not lie
        raise SpidarError(f"{error}; valid: the file that `{BUILD}` writes, a folder without noexec") from error
    library.sp_interface.restype = ctypes.c_char_p
    return library


class Closed:
    """What is left of the library where a controller is closed."""

    def __getattr__(self, name: str) -> Any:  # noqa: ANN401 - never
        """None of its functions."""
        raise closed()


def pointer(array: np.ndarray) -> ctypes.c_void_p:
    """Where an array's numbers lie; the array has to outlive it."""
    return ctypes.c_void_p(array.__array_interface__["data"][0])  # a third of the time of `array.ctypes`


_SCALES = ("joint_speed_scale", "raise_scale", "stride_scale", "lift_scale")
_FORCES = ("forces_l", "leg_forces_b")


class Struct:
    """One of the core's structs, and a view of each of its members."""

    def __init__(self, name: str, record: np.ndarray | None = None) -> None:
        """Make one, or look at one inside another."""
        self.record = np.zeros((), core_layouts()[name]) if record is None else record
        self.pointer = pointer(self.record)
        self.views: dict[str, np.ndarray] = {n: self.record[n] for n in self.record.dtype.names or ()}

    def __getitem__(self, name: str) -> np.ndarray:
        """View of a member."""
        return self.views[name]

    def inner(self, member: str, name: str) -> "Struct":
        """A struct inside this one."""
        return Struct(name, self.views[member])

    def load(self, value: object) -> None:
        """Write a dataclass of numbers and arrays with the same names into it."""
        for name, view in self.views.items():
            given = getattr(value, name)
            view[...] = given.reshape(view.shape) if isinstance(given, np.ndarray) else given


class Room:
    """What a thread works in: the robot's numbers, solvers of its own, room for linear algebra."""

    def __init__(self, library: ctypes.CDLL, spec: RobotSpec = ROBOT) -> None:
        """Make one for a robot."""
        size, programs = library.sp_solvers_size(), (len(PROGRAMS),)
        self._solvers = np.zeros(size // 64 + 1, "V64")
        self._robot = robot(spec)
        members = [("robot", "u8"), ("hard", "u8", programs), ("soft", "u8", programs)]
        self.record = np.zeros((), np.dtype([*members, ("workspace", core_layouts()["workspace"])], align=True))
        self.robot, self.pointer = pointer(self._robot), pointer(self.record)
        library.sp_make_room(self.robot, pointer(self._solvers), self.pointer)


class LastCommand:
    """What the core remembers of the last command: arrays that show what is there now."""

    def __init__(self, memory: Struct) -> None:
        """Look at it in a struct of the core's memory."""
        self.vectoring = memory["vectoring"].reshape(N_ROTORS, 2)
        self.forces_l = memory["forces_l"].reshape(N_ROTORS, 3)
        self.joint_position = memory["joint_position"]


M = TypeVar("M", bound=LastCommand)


class Core(Generic[M]):
    """What flight and crawl share: the library, a room, the structs that cross the border."""

    config: Any
    """What was chosen about the controller."""
    memory: M
    """What the core remembers: views of it."""
    whole: Struct
    """All that it remembers, and what was chosen."""

    def __init__(self, model: Model | None, room: Room | None = None) -> None:
        """Make a room of its own, or work in somebody else's, which is of the same robot."""
        self.model = model or Model()
        self.library: Any = load_core()
        self.room = Room(self.library, self.model.robot) if room is None else room
        self._state, self._residual, self._command = Struct("robot_state"), Struct("residual"), Struct("command")
        self._observation = np.zeros(MAX_OBSERVATION, np.float32)
        self._seen: RobotState | None = None
        self._solve_time = 0.0
        self._last_step: Any = None

    def forget(self) -> None:
        """The engine goes on with what this looks at: what was read of the last tick is past, and nobody timed it."""
        self._last_step, self._solve_time = None, float("nan")

    def close(self) -> None:
        """Nothing can be asked of it any more."""
        self.library = Closed()

    def __getstate__(self) -> dict[str, Any]:
        """What a copy is made of, with a memory of its own (`SpidarError` where it is closed)."""
        if isinstance(self.library, Closed):
            raise closed()
        return {"version": version(), "made": (self.config, self.model), "memory": self.remembered()}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Become a copy (`SpidarError` for one of another version)."""
        require_version("copied controller", state["version"])
        self.__init__(*state["made"])
        self.recall(state["memory"])

    def remembered(self) -> dict[str, Any]:
        """All that it remembers, by name."""
        return {"record": self.whole.record.tobytes()}

    def recall(self, memory: Mapping[str, Any]) -> None:
        """Remember what was `remembered` at another time."""
        write(self.whole.record, memory["record"])
        self._last_step = None

    def write_state(self, state: RobotState) -> None:
        """Give a state to the core; the one that it has already is not written again."""
        if state is not self._seen:
            self._state.load(state)
            self._seen = state

    def residual_pointer(self, residual: Residual) -> ctypes.c_void_p | None:
        """Where a residual lies for the core; nowhere if there is none."""
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
        """Remember a command that somebody else gave."""
        memory = self.memory
        memory.vectoring[:] = command.vectoring
        memory.forces_l[:] = vectoring_to_force(command.thrust, command.vectoring)
        memory.joint_position[:] = command.joint_position

    def _tick(self, function: Any, *arguments: ctypes.c_void_p | None) -> Command:  # noqa: ANN401 - of the library
        """Call the step; its command."""
        start, c = time.perf_counter(), self._command
        function(*arguments, c.pointer)
        self._solve_time, self._last_step = time.perf_counter() - start, None
        return Command(
            c["thrust"].copy(), c["vectoring"].reshape(N_ROTORS, 2).copy(), c["joint_position"].copy(),
            c["joint_torque_limit"].copy(),
        )  # fmt: skip


def read_allocation(struct: Struct, solve_time: float) -> Allocation:
    """The core's answer; its arrays are views."""
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
