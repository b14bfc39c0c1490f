"""Missions with an object: a robot on the floor, the object at a distance, and what both did."""

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import numpy as np

from spidar_gym.control.grasp.phases import Seen
from spidar_gym.control.locomotion.commands import CarryTo, FlyTo, Grasp, LocomotionCommand, Place, Release, TakeOff
from spidar_gym.control.locomotion.manager import Manager
from spidar_gym.control.locomotion.orders import ManagerConfig, Orders
from spidar_gym.control.presets import controller_config
from spidar_gym.native.core_manager import CoreManager
from spidar_gym.native.plant import Plant
from spidar_gym.robot import ROBOT
from spidar_gym.sim.config import PlantConfig
from spidar_gym.sim.object import ObjectConfig, ObjectState
from spidar_gym.so3 import quat_to_matrix
from spidar_gym.state import RobotState

BOX = ObjectConfig(shape="box")
NOISE = 1e-3
"""Standard deviation of the object's position as it is seen [m]."""
LEVEL = np.array([1.0, 0.0, 0.0, 0.0])


def whole(thing: ObjectConfig, to=(3.0, 0.8, 1.0), yaw: float | None = 0.8) -> list[LocomotionCommand]:
    """Return the commands of a mission from the floor until the robot has left the object."""
    grasp = Grasp(thing.shape, thing.half_size)
    return [TakeOff(1.5), FlyTo((1.2, 0.2, 1.7)), grasp, CarryTo(to, yaw), Place(0.0), Release()]


@dataclass
class Tick:
    """A moment of a mission."""

    phase: str
    grasp_phase: str
    state: RobotState
    thing: ObjectState
    thrust: float


class Mission:
    """A plant with an object, its manager, and a log."""

    def __init__(
        self, thing: ObjectConfig = BOX, kind: Callable[[ManagerConfig], Orders] = CoreManager, *,
        preset: str = "tuned", place=(1.5, 0.3), yaw: float = 0.4, seed: int = 0, plant: PlantConfig | None = None,
    ) -> None:  # fmt: skip
        self.thing, self.rng = thing, np.random.Generator(np.random.PCG64(seed))
        self.plant = Plant(replace(plant or PlantConfig(), object=thing))
        self.manager = kind(ManagerConfig(flight=controller_config(preset)))
        self.log: list[Tick] = []
        self.is_seen = True
        pose = np.array([*place, thing.scale[2], math.cos(yaw / 2), 0.0, 0.0, math.sin(yaw / 2)])
        self.state = self.plant.reset(
            np.array([0.0, 0.0, ROBOT.peg_depth]), LEVEL, self.manager.lying, object_pose=pose, rng=self.rng
        )
        self.manager.reset(self.state)

    def look(self) -> Seen | None:
        """Return the object as motion capture sees it."""
        if not self.is_seen:
            return None
        thing = self.plant.object()
        return Seen(thing.position_w + NOISE * self.rng.standard_normal(3), thing.quat_wo)

    def fly(
        self, commands: Iterable[LocomotionCommand] = (), seconds: float = 120.0,
        until: Callable[[], bool] = lambda: False,
    ) -> "Mission":  # fmt: skip
        """Execute commands until the manager is done, or `until`."""
        self.manager.command(commands)
        for _ in range(round(40 * seconds)):
            if self.manager.done or until() or self.plant.diverged:
                break
            command = self.manager.step(self.state, seen=self.look())
            self.state = self.plant.step(command)
            moment = Tick(
                self.manager.phase, self.manager.grasp_phase, self.state, self.plant.object(), command.thrust.sum()
            )
            self.log.append(moment)
        return self

    def reach(self, phase: str) -> "Mission":
        """Fly the whole mission until a phase of the grasp begins."""
        return self.fly(whole(self.thing), until=lambda: self.manager.grasp_phase == phase)

    def loosen(self) -> None:
        """Make the object slippery from now on."""
        self.plant.configure(replace(self.plant.config, object=replace(self.thing, friction=0.01)), goes_on=True)

    @property
    def phases(self) -> list[str]:
        """Phases of the grasp in order."""
        names = [tick.grasp_phase for tick in self.log]
        return [name for k, name in enumerate(names) if k == 0 or name != names[k - 1]]

    @property
    def tilt(self) -> float:
        """Largest tilt of the torso [rad]."""
        return max(math.acos(min(1.0, quat_to_matrix(tick.state.quat_wb)[2, 2])) for tick in self.log)

    @property
    def is_clean(self) -> bool:
        """Whether only feet have touched the object, and nothing but feet and pegs the floor."""
        return not self.plant.object().is_hit and not self.plant.violated & 6


__all__ = ["BOX", "Manager", "Mission", "Tick", "whole"]
