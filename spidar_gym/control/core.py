"""The onboard core behind the controllers' own interface: `control="core"` flies what is compiled for the robot."""

import ctypes
import os
import shutil
import tempfile
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from spidar_gym.control.allocator import Allocation, AllocationStatus
from spidar_gym.control.layout import CORE, layouts
from spidar_gym.control.structs import interface_hash, structs_header
from spidar_gym.errors import MissingDependencyError, StaleAssetError
from spidar_gym.model.dynamics import Model
from spidar_gym.model.rotor import vectoring_to_force
from spidar_gym.robot import N_LEGS, N_ROTORS
from spidar_gym.state import NO_RESIDUAL, Command, Residual, RobotState

BUILD = "spidar export --build"
"""Command that compiles the core."""
STATUS = tuple(AllocationStatus)
"""How a tick was answered, in the order of the core's own words."""


def core_path() -> Path:
    """Where the compiled core lies: `SPIDAR_CORE`, or the user's cache, in a folder named after its interface."""
    given = os.environ.get("SPIDAR_CORE")
    if given:
        return Path(given)
    cache_home = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return cache_home / "spidar_gym" / interface_hash() / "libspidar.so"


@cache
def core_layouts() -> dict[str, np.dtype]:
    """The core's structs as numpy types."""
    border = layouts(structs_header())
    return layouts((CORE / "spidar_core.h").read_text(encoding="utf-8"), border)


def load_core() -> ctypes.CDLL:
    """The compiled core, an instance of its own: OSQP's generated work spaces are globals of the library.

    Raises:
        MissingDependencyError: When it is not compiled.
        StaleAssetError: When it was compiled for another interface or robot.
    """
    path = core_path()
    if not path.is_file():
        raise MissingDependencyError("the compiled core", f"{BUILD} (it needs a C compiler)")
    # A loaded library's file must not change, and one file is loaded once: every instance has a copy.
    with tempfile.TemporaryDirectory() as folder:
        own = Path(folder) / "libspidar.so"
        shutil.copyfile(path, own)
        library = ctypes.CDLL(str(own))
    library.sp_interface.restype = ctypes.c_char_p
    if library.sp_interface().decode() != interface_hash():
        raise StaleAssetError(path, BUILD)
    return library


def pointer(array: np.ndarray) -> ctypes.c_void_p:
    """Where an array's numbers lie; the array has to outlive it."""
    return ctypes.c_void_p(array.__array_interface__["data"][0])  # a third of the time of `array.ctypes`


_SCALES = ("joint_speed_scale", "raise_scale", "stride_scale", "lift_scale")
_FORCES = ("forces_l", "leg_forces_b")


class Struct:
    """One of the core's structs, and a view of each of its members."""

    def __init__(self, name: str, record: Any = None) -> None:  # noqa: ANN401 - a numpy record
        """Make one, or look at one inside another."""
        self.record = np.zeros((), core_layouts()[name]) if record is None else record
        self.pointer = pointer(self.record)
        self.views: dict[str, Any] = {n: self.record[n] for n in self.record.dtype.names or ()}

    def __getitem__(self, name: str) -> Any:  # noqa: ANN401 - a view
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


class Core:
    """What flight and crawl share: the library, the structs that cross the border."""

    memory: Any
    """What the core remembers: views of it."""

    def __init__(self, model: Model | None) -> None:
        """Load a library of its own."""
        self.model = model or Model()
        self.library = load_core()
        self._state, self._residual, self._command = Struct("robot_state"), Struct("residual"), Struct("command")
        self._observation = np.zeros(512, np.float32)
        self._seen: RobotState | None = None

    def see(self, state: RobotState) -> None:
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

    def note(self, command: Command) -> None:
        """Remember a command that somebody else gave."""
        memory = self.memory
        memory.vectoring[:] = command.vectoring
        memory.forces_l[:] = vectoring_to_force(command.thrust, command.vectoring)
        memory.joint_position[:] = command.joint_position

    def _answer(self) -> Command:
        c = self._command
        return Command(
            c["thrust"].copy(), c["vectoring"].reshape(N_ROTORS, 2).copy(), c["joint_position"].copy(),
            c["joint_torque_limit"].copy(),
        )  # fmt: skip


def allocation_of(struct: Struct, solve_time: float) -> Allocation:
    """The core's answer; its arrays are views."""
    return Allocation(
        forces_l=struct["forces_l"].reshape(N_ROTORS, 3),
        foot_forces_f=struct["foot_forces_f"].reshape(N_LEGS, 3),
        thrust=struct["thrust"],
        joint_torques=struct["joint_torques"],
        wrench=struct["wrench"],
        unallocated_wrench=struct["unallocated_wrench"],
        saturated=struct["saturated"] != 0,
        status=STATUS[int(struct["status"])],
        iterations=int(struct["iterations"]),
        active=struct["active"][: int(struct["rows"])].astype(float),
        slack=float(struct["slack"]),
        solve_time=solve_time,
    )
