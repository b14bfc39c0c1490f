"""What changes about the simulated robot besides MuJoCo's own state; with it a moment can be kept and continued."""

from dataclasses import dataclass, field

import numpy as np
from reference.air import AirForces
from reference.sensors import SensorMemory
from reference.weather import Weather

from spidar_gym.arrays import JointVector, RotorMask, RotorVector
from spidar_gym.robot import N_JOINTS, N_ROTORS, ROBOT
from spidar_gym.sim.disturbances import Disturbances


@dataclass
class PlantMemory:
    """What changes besides MuJoCo's state."""

    clock: int = 0
    """Physics steps since the reset."""
    pending: list[tuple[int, slice, np.ndarray]] = field(default_factory=list)
    """Commands on their way: when they arrive, to which actuators, and what they say."""
    torque_limit: JointVector = field(default_factory=lambda: np.full(N_JOINTS, ROBOT.max_joint_torque))
    """Torque that the joint servos may use [Nm]."""
    in_contact: bool = False
    """Whether any part touches the floor."""
    noise: RotorVector = field(default_factory=lambda: np.zeros(N_ROTORS))
    """Thrust noise [N]."""
    disturbances: Disturbances = field(default_factory=Disturbances)
    """What happens to the robot."""
    weather: Weather = field(default_factory=Weather)
    """Wind and pushes."""
    air: AirForces | None = None
    """What the air did when it was evaluated last; None where there is none."""
    falling: RotorMask = field(default_factory=lambda: np.zeros(N_ROTORS, bool))
    """Modules whose thrust falls."""
    loose: JointVector = field(default_factory=lambda: np.zeros(N_JOINTS))
    """Where each joint is within its play [rad]."""
    stuck: np.ndarray | None = None
    """Vectoring angles of a module whose servos have failed [rad]."""
    power: float = 0.0
    """Electrical power at the end of the last control period [W]."""
    energy_wh: float = 0.0
    """Energy drawn since the reset [Wh]."""
    sensors: SensorMemory | None = None
    """The sensors'."""
    rng: np.random.Generator | None = None
    """Source of noise, wind and pushes."""


@dataclass(frozen=True)
class Saved:
    """A moment of the simulation; `Plant.restore` continues from it bit for bit."""

    state: np.ndarray
    """MuJoCo's state and actuator forces."""
    memory: PlantMemory
    """The rest."""
