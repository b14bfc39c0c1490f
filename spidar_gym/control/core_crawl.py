"""The crawler of the onboard core, with the interface of `Crawler`."""

import ctypes
import time
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from spidar_gym.arrays import RotorVector
from spidar_gym.control.allocator import Allocation
from spidar_gym.control.core import Core, Struct, allocation_of, pointer
from spidar_gym.control.crawler import CrawlerConfig
from spidar_gym.control.footsteps import GaitCommand, Lift, Move, plan_cycles
from spidar_gym.control.phases import PHASES
from spidar_gym.control.planar import Planar
from spidar_gym.control.structs import fill
from spidar_gym.errors import InvalidValueError
from spidar_gym.model.dynamics import Model
from spidar_gym.robot import N_LEGS, N_ROTORS
from spidar_gym.state import NO_RESIDUAL, Command, Residual, RobotState

MODES = ("paper", "as_flown", "projection", "rest", "leg", "legs", "stance")
"""Programs of the core in its order; on the ground they are the allocation modes' names."""


class _Planar(ctypes.Structure):
    """sp_planar, which is passed by value."""

    _fields_ = [("x", ctypes.c_double), ("y", ctypes.c_double), ("yaw", ctypes.c_double)]


class CoreGait:
    """What the core's gait is doing: what tasks and observations read of it."""

    def __init__(self, crawl: Struct, library: ctypes.CDLL) -> None:
        """Look at it."""
        self._crawl, self._library = crawl, library
        self._memory = crawl.inner("gait", "gait_memory")
        self.memory = self

    @property
    def done(self) -> bool:
        """Whether nothing is left to do."""
        return bool(self._library.sp_gait_done(self._crawl.pointer))

    @property
    def phase(self) -> str:
        """One of `PHASES`."""
        return PHASES[int(self._memory["phase"])]

    @property
    def timeouts(self) -> int:
        """Phases that ended by time-out."""
        return int(self._memory["timeouts"])


class CoreCrawlMemory:
    """What the core's crawler remembers; the arrays show what is there now."""

    def __init__(self, struct: Struct) -> None:
        """Look at it."""
        self._struct = struct
        self.vectoring = struct["vectoring"].reshape(N_ROTORS, 2)
        self.forces_l = struct["forces_l"].reshape(N_ROTORS, 3)
        self.joint_position = struct["joint_position"]

    @property
    def gap(self) -> float:
        """How much of the hand-over is left."""
        return float(self._struct["gap"])

    @property
    def mode(self) -> str:
        """Allocation mode of the last tick."""
        return MODES[int(self._struct["mode"])]


@dataclass(frozen=True, slots=True)
class CoreCrawlTick:
    """What one tick on the ground did; the arrays are overwritten by the next."""

    allocation: Allocation
    """What the allocation answered, before the hand-over."""
    mode: str
    """Allocation mode."""
    phase: str
    """Phase of the gait."""


class CoreCrawler(Core):
    """The crawler of the onboard core; the interface of `Crawler`."""

    def __init__(self, config: CrawlerConfig | None = None, model: Model | None = None) -> None:
        """Load the core and give it a configuration (`MissingDependencyError` when it is not compiled)."""
        super().__init__(model)
        self.config = config or CrawlerConfig()
        self._crawl, settings = Struct("crawl"), Struct("crawler_config")
        fill(settings.record, self.config)
        self.library.sp_crawl_init(self._crawl.pointer, settings.pointer)
        self.gait = CoreGait(self._crawl, self.library)
        self.memory = CoreCrawlMemory(self._crawl.inner("memory", "crawl_memory"))
        self._answered = self._crawl.inner("allocation", "allocation")
        self._solve_time, self._tick = 0.0, None

    @property
    def tick(self) -> CoreCrawlTick | None:
        """What the last tick did; None before the first."""
        if self._tick is None and self._crawl["ticked"]:
            allocation = allocation_of(self._answered, self._solve_time)
            self._tick = CoreCrawlTick(allocation, self.memory.mode, self.gait.phase)
        return self._tick

    def reset(self, state: RobotState, commands: Iterable[GaitCommand] = ()) -> None:
        """Forget everything; as `Crawler.reset`."""
        self.see(state)
        self._tick = None
        self.library.sp_crawl_reset(self._crawl.pointer, self._state.pointer)
        for command in commands:
            self.command(command)

    def command(self, command: GaitCommand) -> int:
        """Append a command; returns how many steps it takes (`InvalidValueError` for what is out of reach)."""
        crawl = self._crawl.pointer
        if isinstance(command, Move):
            way = _Planar(command.way.x, command.way.y, command.way.yaw)
            steps = self.library.sp_gait_move(crawl, way, plan_cycles(self.config.gait, command))
        elif isinstance(command, Lift):
            legs = np.array([leg in command.legs for leg in range(N_LEGS)], np.int32)
            seconds = ctypes.c_double(command.seconds)
            steps = self.library.sp_gait_lift(crawl, pointer(legs), ctypes.c_double(command.angle), seconds)
        else:
            height, seconds = ctypes.c_double(command.height), ctypes.c_double(command.seconds)
            steps = self.library.sp_gait_stand(crawl, height, seconds)
        if not steps:
            raise InvalidValueError("command", command, "one in reach, and no more than 256 steps in all")
        return int(steps)

    def step(self, state: RobotState, residual: Residual = NO_RESIDUAL) -> Command:
        """One control tick; as `Crawler.step`."""
        self.see(state)
        start = time.perf_counter()
        self.library.sp_crawl_step(
            self._crawl.pointer, self._state.pointer, self.residual_pointer(residual), self._command.pointer
        )
        self._solve_time = time.perf_counter() - start
        self._tick = None
        return self._answer()

    def observe(
        self, state: RobotState, goal: Planar, thrust: RotorVector, previous_action: np.ndarray, *, bound: np.ndarray
    ) -> np.ndarray:
        """The observation; as `control.crawl_observation.observe_crawl`."""
        self.see(state)
        pose = np.array([goal.x, goal.y, goal.yaw])
        size = self.library.sp_observe_crawl(
            self._crawl.pointer, self._state.pointer, pointer(pose), pointer(thrust), pointer(previous_action),
            len(previous_action), pointer(bound), pointer(self._observation),
        )  # fmt: skip
        return self._observation[:size].copy()
