"""The crawler of the onboard core, a `CrawlControl`."""

import ctypes
from collections.abc import Iterable

import numpy as np

from spidar_gym.control.crawl.controller import CrawlerConfig, check_legs
from spidar_gym.control.crawl.footsteps import GaitCommand, Lift, Move, plan_cycles
from spidar_gym.control.crawl.memory import CrawlRecord
from spidar_gym.control.crawl.observation import CrawlObservables
from spidar_gym.control.crawl.phases import PHASES
from spidar_gym.errors import InvalidValueError
from spidar_gym.model.dynamics import Model
from spidar_gym.native.constants import MAX_STEPS, PROGRAMS
from spidar_gym.native.library import Core, LastCommand, Room, Struct, pointer, read_allocation
from spidar_gym.native.structs import fill
from spidar_gym.robot import N_LEGS
from spidar_gym.state import NO_RESIDUAL, Command, Residual, RobotState


class _Pose2(ctypes.Structure):
    """`sp_pose2`, which is passed by value."""

    _fields_ = [("x", ctypes.c_double), ("y", ctypes.c_double), ("yaw", ctypes.c_double)]


class CoreGait:
    """State of the core's gait, as far as tasks and observations read it."""

    def __init__(self, crawl: Struct, library: ctypes.CDLL) -> None:
        """View the gait in an `sp_crawl`."""
        self._crawl, self._library = crawl, library
        self._memory = crawl.inner("gait", "gait_memory")

    @property
    def done(self) -> bool:
        """Whether every command is carried out."""
        return bool(self._library.sp_gait_done(self._crawl.pointer))

    @property
    def phase(self) -> str:
        """One of `PHASES`."""
        return PHASES[int(self._memory["phase"])]

    @property
    def timeouts(self) -> int:
        """Number of phases that ended by time-out."""
        return int(self._memory["timeouts"])

    @property
    def swinging(self) -> np.ndarray:
        """Legs in swing, shape (4,): in a crawl all or none."""
        return np.full(N_LEGS, self.phase == "swing")


class CoreCrawlMemory(LastCommand):
    """State of the core's crawler; the arrays are views of it."""

    def __init__(self, struct: Struct) -> None:
        """View an `sp_crawl_memory`."""
        super().__init__(struct)
        self._struct = struct

    @property
    def gap(self) -> float:
        """Remaining share of the hand-over between modes, 1 … 0."""
        return float(self._struct["gap"])

    @property
    def mode(self) -> str:
        """Allocation mode of the last tick."""
        return PROGRAMS[int(self._struct["mode"])]


class CoreCrawler(Core[CoreCrawlMemory]):
    """The crawler of the onboard core, a `CrawlControl`."""

    def __init__(
        self,
        config: CrawlerConfig | None = None,
        model: Model | None = None,
        *,
        record: np.ndarray | None = None,
        room: Room | None = None,
    ) -> None:
        """Make a crawler in the core, or view one of the engine.

        Args:
            config: Gait, allocation, margins.
            model: Model of the described robot.
            record: `sp_crawl` of a robot in the engine, which already has this configuration.
            room: Workspace; a new one if not given.

        Raises:
            MissingDependencyError: When the core is not compiled.
            InvalidValueError: For a gait whose legs are not those of the model's robot.
        """
        self.config = config or CrawlerConfig()
        check_legs(self.config.gait, model)
        super().__init__(model or Model(self.config.gait.robot), room)
        self._crawl, settings = Struct("crawl", record), Struct("crawler_config")
        self.whole = self._crawl
        fill(settings.record, self.config)
        if record is None:
            self.library.sp_crawl_init(self.room.robot, self._crawl.pointer, settings.pointer)
        self.gait = CoreGait(self._crawl, self.library)
        self.memory = CoreCrawlMemory(self._crawl.inner("memory", "crawl_memory"))
        self._answered = self._crawl.inner("allocation", "allocation")

    @property
    def last_step(self) -> CrawlRecord | None:
        """Record of the last tick; None before the first."""
        if self._last_step is None and self._crawl["ticked"]:
            allocation = read_allocation(self._answered, self._solve_time)
            self._last_step = CrawlRecord(allocation, self.memory.forces_l, self.memory.mode, self.gait.phase)
        return self._last_step

    @property
    def done(self) -> bool:
        """Whether every command is carried out and the forces of the last mode have faded."""
        return self.gait.done and self.memory.gap == 0.0

    def reset(self, state: RobotState, commands: Iterable[GaitCommand] = ()) -> None:
        """Reset the controller; as `Crawler.reset`."""
        self.write_state(state)
        self._last_step = None
        self.library.sp_crawl_reset(self._crawl.pointer, self._state.pointer)
        for command in commands:
            self.command(command)

    def command(self, command: GaitCommand) -> int:
        """Append a command; return its number of steps (`InvalidValueError` if it is out of reach)."""
        crawl = self._crawl.pointer
        if isinstance(command, Move):
            way = _Pose2(command.way.x, command.way.y, command.way.yaw)
            steps = self.library.sp_gait_move(self.room.robot, crawl, way, plan_cycles(self.config.gait, command))
        elif isinstance(command, Lift):
            legs = np.array([leg in command.legs for leg in range(N_LEGS)], np.int32)
            seconds = ctypes.c_double(command.seconds)
            steps = self.library.sp_gait_lift(crawl, pointer(legs), ctypes.c_double(command.angle), seconds)
        else:
            height, seconds = ctypes.c_double(command.height), ctypes.c_double(command.seconds)
            steps = self.library.sp_gait_stand(self.room.robot, crawl, height, seconds)
        if not steps:
            raise InvalidValueError("command", command, f"one in reach, and no more than {MAX_STEPS} steps in all")
        return int(steps)

    def step(self, state: RobotState, residual: Residual = NO_RESIDUAL) -> Command:
        """Compute the command of one control tick; as `Crawler.step`."""
        self.write_state(state)
        return self._tick(
            self.library.sp_crawl_step, self._crawl.pointer, self._state.pointer, self.residual_pointer(residual),
            self.room.pointer,
        )  # fmt: skip

    def observe(self, observables: CrawlObservables, *, bound: np.ndarray) -> np.ndarray:
        """Compute the observation; as `control.crawl.observation.observe_crawl`."""
        goal, action = observables.goal, observables.previous_action
        self.write_state(observables.state)
        pose = np.array([goal.x, goal.y, goal.yaw])
        size = self.library.sp_observe_crawl(
            self._crawl.pointer, self._state.pointer, pointer(pose), pointer(observables.thrust_command),
            pointer(action), len(action), observables.ticks, pointer(bound), pointer(self._observation),
        )  # fmt: skip
        return self._observation[:size].copy()
