"""The onboard core behind the controllers' own interface: `control="core"` flies what is compiled for the robot."""

import _ctypes
import ctypes
import hashlib
import os
import time
import weakref
from functools import cache
from pathlib import Path
from typing import Any, Generic, TypeVar

import numpy as np

from spidar_gym.control.allocation.allocator import Allocation, AllocationStatus
from spidar_gym.errors import MissingDependencyError, SpidarError, StaleAssetError
from spidar_gym.files import scratch_folder
from spidar_gym.model.dynamics import Model
from spidar_gym.model.rotor import vectoring_to_force
from spidar_gym.native.codegen.committed import shared_headers
from spidar_gym.native.constants import MAX_OBSERVATION
from spidar_gym.native.core_structs import core_layouts
from spidar_gym.native.recipe import LIBRARY, NATIVE, SEAL, library_digest
from spidar_gym.robot import N_LEGS, N_ROTORS
from spidar_gym.robot.description import mjcf_path
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
    """Digest that a library has to answer with: of this package's structs, constants, robot and C sources."""
    headers = {name: text.encode() for name, text in shared_headers().items()}
    return library_digest(mjcf_path().read_bytes(), headers)


FUNCTION: Any = ctypes.CFUNCTYPE(ctypes.c_int)
"""A function of the core, until its result is declared; other threads run while it does."""


class Library:
    """A compiled core, loaded; unloaded when it is closed, or when nobody has it or one of its functions any more."""

    def __init__(self, path: Path) -> None:
        """Load a file that no other instance has loaded (`OSError` where the system refuses)."""
        library = ctypes.CDLL(str(path))
        weakref.finalize(library, _ctypes.dlclose, library._handle).atexit = False
        self._library: ctypes.CDLL | None = library

    def __getattr__(self, name: str) -> Any:  # noqa: ANN401 - a function of any result
        """One of its functions (`SpidarError` once it is closed)."""
        if name.startswith("_"):
            raise AttributeError(name)
        if self._library is None:
            raise SpidarError("the compiled core of this environment or controller is closed; valid: a new one")
        # Not one of ctypes' own making: those refer to themselves, and would keep the library until the next sweep.
        function = self.__dict__[name] = FUNCTION(_ctypes.dlsym(self._library._handle, name))
        function.library = self._library
        return function

    def close(self) -> None:
        """Let go of it; a second call does nothing."""
        self.__dict__.clear()
        self._library = None


def load_core() -> Library:
    """The compiled core, an instance of its own: OSQP's generated work spaces are globals of the library.

    Raises:
        MissingDependencyError: When it is not compiled.
        StaleAssetError: When it is damaged, or was compiled for another interface or robot.
        SpidarError: When it cannot be read or loaded here.
    """
    path = core_path()
    if not path.is_file():
        raise MissingDependencyError("the compiled core", f"{BUILD} (it needs a C compiler)")
    try:
        data = path.read_bytes()
    except OSError as error:
        raise SpidarError(f"cannot read {path}: {error.strerror}; valid: the file that `{BUILD}` writes") from error
    if hashlib.sha256(data[:-SEAL]).digest() != data[-SEAL:]:  # half a library is a bus error
        raise StaleAssetError(path, BUILD, "is damaged")
    # A loaded library's file must not change, and one file is loaded once: every instance has a copy.
    with scratch_folder() as folder:
        own = folder / "libspidar.so"
        own.write_bytes(data)
        try:
            library = Library(own)
        except OSError as error:  # of another processor, or where programs may not lie
            words = str(error).replace(str(own), path.name)
            raise SpidarError(f"{words}; valid: the file that `{BUILD}` writes, a TMPDIR without noexec") from error
    library.sp_interface.restype = ctypes.c_char_p
    if library.sp_interface().decode() != expected_digest():
        raise StaleAssetError(path, BUILD, "was compiled from other C, structs or numbers than are here")
    return library


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


class LastCommand:
    """What the core remembers of the last command: arrays that show what is there now."""

    def __init__(self, memory: Struct) -> None:
        """Look at it in a struct of the core's memory."""
        self.vectoring = memory["vectoring"].reshape(N_ROTORS, 2)
        self.forces_l = memory["forces_l"].reshape(N_ROTORS, 3)
        self.joint_position = memory["joint_position"]


M = TypeVar("M", bound=LastCommand)


class Core(Generic[M]):
    """What flight and crawl share: the library, the structs that cross the border."""

    memory: M
    """What the core remembers: views of it."""

    def __init__(self, model: Model | None) -> None:
        """Load a library of its own."""
        self.model = model or Model()
        self.library = load_core()
        self._state, self._residual, self._command = Struct("robot_state"), Struct("residual"), Struct("command")
        self._observation = np.zeros(MAX_OBSERVATION, np.float32)
        self._seen: RobotState | None = None
        self._solve_time = 0.0
        self._last_step: Any = None

    def close(self) -> None:
        """Unload the library: nothing can be asked of it any more."""
        self.library.close()

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
