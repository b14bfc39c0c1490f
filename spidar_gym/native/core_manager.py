"""The onboard core's manager of both gaits, with the interface of the Python manager."""

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from spidar_gym.control.allocation.allocator import AllocationStatus
from spidar_gym.control.crawl.memory import CrawlRecord
from spidar_gym.control.flight.memory import FlightRecord
from spidar_gym.control.grasp.phases import GRASP_PHASES, Seen
from spidar_gym.control.locomotion.commands import (
    OBJECTS,
    SITUATIONS,
    CarryTo,
    CrawlTo,
    FlyTo,
    Grasp,
    Land,
    LocomotionCommand,
    Place,
    Release,
    TakeOff,
)
from spidar_gym.control.locomotion.orders import PHASES, ManagerConfig, Orders
from spidar_gym.errors import InvalidValueError
from spidar_gym.model.dynamics import Model
from spidar_gym.native.constants import MAX_WAYPOINTS
from spidar_gym.native.core_crawler import CoreCrawler
from spidar_gym.native.core_flight import CoreFlightController
from spidar_gym.native.core_structs import core_layouts
from spidar_gym.native.library import STATUS, Core, LastCommand, Room, Struct
from spidar_gym.native.structs import fill
from spidar_gym.state import NO_RESIDUAL, Command, Residual, RobotState

ORDER = (CrawlTo, TakeOff, FlyTo, Land, Grasp, CarryTo, Place, Release)
"""Commands in the core's order."""


def waypoint(command: LocomotionCommand) -> np.ndarray:
    """Return a command as `sp_waypoint`."""
    record = np.zeros((), core_layouts()["waypoint"])
    record["kind"] = ORDER.index(type(command))
    if isinstance(command, CrawlTo):
        fill(record["pose"], command.pose)
    elif isinstance(command, TakeOff):
        record["height"] = command.height
    elif isinstance(command, FlyTo):
        record["position_w"], record["speed"], record["along"] = command.position_w, command.speed, command.along
        record["at_once"], record["has_form"] = command.at_once, command.form is not None
        record["form"] = 0.0 if command.form is None else command.form
    elif isinstance(command, Grasp):
        record["shape"], record["half_size"], record["height"] = (
            OBJECTS.index(command.shape),
            command.half_size,
            command.height,
        )
        record["most_force"], record["mass"] = command.most_force, command.mass
        record["force"], record["friction"] = command.force, command.friction
    elif isinstance(command, CarryTo):
        record["position_w"], record["speed"] = command.position_w, command.speed
        record["has_yaw"], record["yaw"] = command.yaw is not None, 0.0 if command.yaw is None else command.yaw
    elif isinstance(command, Land | Place):
        record["floor"] = command.floor
    return record


class CoreManager(Core[LastCommand], Orders):
    """The manager of both gaits that is compiled for the robot."""

    def __init__(
        self, config: ManagerConfig | None = None, model: Model | None = None, *,
        record: np.ndarray | None = None, room: Room | None = None,
    ) -> None:  # fmt: skip
        """Make a manager in the core, or view one of the engine.

        Args:
            config: Controllers of flight and crawl, and the transitions between them.
            model: Model of the described robot.
            record: `sp_manager` of a robot in the engine, which already has this configuration.
            room: Workspace; a new one if not given.

        Raises:
            MissingDependencyError: When the core is not compiled.
        """
        self.config = config or ManagerConfig()
        super().__init__(model or Model(self.config.crawl.gait.robot), room)
        self._manager, settings, self._object = Struct("manager", record), Struct("manager_config"), Struct("seen")
        self.whole = self._manager
        fill(settings.record, self.config)
        if record is None:
            self.library.sp_manager_init(self.room.robot, self._manager.pointer, settings.pointer)
        self._memory = self._manager.inner("memory", "manager_memory")
        self._last: LocomotionCommand | None = None
        flight, crawl = (self._manager[name] for name in ("flight", "crawl"))
        self.flight = CoreFlightController(self.config.flight, self.model, record=flight, room=self.room)
        """Flight controller."""
        self.crawler = CoreCrawler(self.config.crawl, self.model, record=crawl, room=self.room)
        """Crawl controller."""

    def remembered(self) -> dict[str, Any]:
        """Return the state; as `Core.remembered`."""
        return super().remembered() | {"last": self._last}

    def recall(self, memory: Mapping[str, Any]) -> None:
        """Restore a state; as `Core.recall`."""
        super().recall(memory)
        self._last = memory["last"]
        self.flight.forget()
        self.crawler.forget()

    @property
    def last_step(self) -> FlightRecord | CrawlRecord | None:
        """Record of the last tick of the active controller; None before its first."""
        return (self.crawler if self.on_ground else self.flight).last_step

    def forget(self) -> None:
        """Discard what was read of the last tick, after the engine has advanced the viewed manager."""
        super().forget()
        self.flight.forget()
        self.crawler.forget()

    def close(self) -> None:
        """Release the library; later calls raise an error."""
        super().close()
        self.flight.close()
        self.crawler.close()

    @property
    def phase(self) -> str:
        """One of `PHASES`."""
        return PHASES[int(self._memory["phase"])]

    @property
    def grasp_phase(self) -> str:
        """Phase of the grasp, one of `GRASP_PHASES`."""
        return GRASP_PHASES[int(self._manager["grasper"]["memory"]["phase"])]

    @property
    def situation(self) -> str:
        """Where the robot is before a command that interrupts, one of `SITUATIONS`."""
        return SITUATIONS[self.library.sp_manager_situation(self._manager.pointer)]

    @property
    def done(self) -> bool:
        """Whether every command is carried out."""
        return bool(self.library.sp_manager_done(self._manager.pointer))

    @property
    def last(self) -> LocomotionCommand | None:
        """The last of the pending commands; None without any."""
        return self._last if int(self._manager["count"]) else None

    @property
    def floor(self) -> float:
        """Height of the CoG where the robot lay last, or is expected to lie [m]."""
        return float(self._memory["floor"])

    @property
    def asked_w(self) -> np.ndarray:
        """Commanded CoG of the last tick in flight, shape (3,) [m]."""
        return self._manager["reference"]["position_w"].copy()

    @property
    def status(self) -> AllocationStatus:
        """Status of the allocation at the last tick."""
        gait = "crawl" if self.phase in ("lie", "crawl") else "flight"
        return STATUS[int(self._manager[gait]["allocation"]["status"])]

    def reset(self, state: RobotState, commands: Iterable[LocomotionCommand] = ()) -> None:
        """Reset the manager; as `Manager.reset`."""
        self.write_state(state)
        self.library.sp_manager_reset(self.room.robot, self._manager.pointer, self._state.pointer)
        self._last = None
        self.command(commands)

    def _append(self, commands: tuple[LocomotionCommand, ...]) -> None:
        self._require_few(commands, int(self._manager["count"]))
        for command in commands:
            record = Struct("waypoint", waypoint(command))
            self.library.sp_manager_command(self._manager.pointer, record.pointer)
            self._last = command

    def _replace(self, commands: tuple[LocomotionCommand, ...]) -> None:
        self._require_few(commands, 1)
        records = np.zeros(len(commands) or 1, core_layouts()["waypoint"])
        for k, command in enumerate(commands):
            records[k] = waypoint(command)
        rows = Struct("waypoint", records)
        self.library.sp_manager_interrupt(self._manager.pointer, rows.pointer, len(commands))
        self._last = commands[-1] if commands else Land()

    def end(self) -> None:
        """End the mission, as `Manager.end`."""
        self.library.sp_manager_end(self._manager.pointer)
        self._last = Land()

    @staticmethod
    def _require_few(commands: tuple[LocomotionCommand, ...], before: int) -> None:
        if before + len(commands) > MAX_WAYPOINTS:
            raise InvalidValueError("commands", before + len(commands), f"at most {MAX_WAYPOINTS} at once")

    def step(self, state: RobotState, residual: Residual = NO_RESIDUAL, seen: Seen | None = None) -> Command:
        """Compute the command of one control tick; as `Manager.step`."""
        if seen is not None:
            fill(self._object.record, seen)
        self.write_state(state)
        self.flight.forget()
        self.crawler.forget()
        return self._tick(
            self.library.sp_manager_step, self._manager.pointer, self._state.pointer, self.residual_pointer(residual),
            None if seen is None else self._object.pointer, self.room.pointer,
        )  # fmt: skip
