"""Base class of the Python controllers: repeats the last command, or takes over from another controller."""

import math
from dataclasses import replace
from typing import Generic, TypeVar

import numpy as np

from spidar_gym.control.allocation.allocator import AllocationStatus
from spidar_gym.control.crawl.memory import CrawlMemory, CrawlRecord
from spidar_gym.control.flight.memory import FlightMemory, FlightRecord
from spidar_gym.model.dynamics import Model
from spidar_gym.model.rotor import vectoring_to_force
from spidar_gym.robot import N_JOINTS
from spidar_gym.state import Command

MemoryT = TypeVar("MemoryT", FlightMemory, CrawlMemory)
RecordT = TypeVar("RecordT", FlightRecord, CrawlRecord)


class ReadableController(Generic[MemoryT, RecordT]):
    """Base class of the Python controllers; owns the model and the memory."""

    memory: MemoryT
    """State kept from one tick to the next."""
    last_step: RecordT | None
    """Record of the last step; None before the first."""
    thrust_limit: float = math.inf
    """λ̄ at the present voltage of the battery where it is below the robot's [N]; an input of the next step."""

    def __init__(self, model: Model | None, *, rate_hz: float, joint_torque_limit: float) -> None:
        """Take the model, the control rate [Hz] and the torque that each joint servo may use [Nm]."""
        self.model = model or Model()
        self.dt = 1.0 / rate_hz
        self._torque_limit = np.full(N_JOINTS, joint_torque_limit)
        self.last_step = None

    def set_last_command(self, command: Command) -> None:
        """Store the command of another controller as the last command."""
        forces = vectoring_to_force(command.thrust, command.vectoring)
        self.memory = replace(
            self.memory, vectoring=command.vectoring, forces_l=forces, joint_position=command.joint_position
        )

    def close(self) -> None:
        """Do nothing: a Python controller holds no resources."""

    def _hold(self) -> Command:
        """Repeat the last command and set the status to `held`."""
        memory, last = self.memory, self.last_step
        if last is not None:
            self.last_step = replace(last, allocation=replace(last.allocation, status=AllocationStatus.HELD))
        thrust = np.linalg.norm(memory.forces_l, axis=1)
        return Command(thrust, memory.vectoring, memory.joint_position, self._torque_limit)
