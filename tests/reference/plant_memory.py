"""State of the simulated robot outside MuJoCo; saving both makes a simulation resumable."""

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
    """State outside MuJoCo."""

    clock: int = 0
    """Physics steps since the reset."""
    pending: list[tuple[int, slice, np.ndarray]] = field(default_factory=list)
    """Pending commands: arrival step, actuators, values."""
    due: int = 0
    """Arrival step of the last command."""
    torque_limit: JointVector = field(default_factory=lambda: np.full(N_JOINTS, ROBOT.max_joint_torque))
    """Torque that the joint servos may use [Nm]."""
    in_contact: bool = False
    """Whether any part touches the floor."""
    noise: RotorVector = field(default_factory=lambda: np.zeros(N_ROTORS))
    """Thrust noise [N]."""
    disturbances: Disturbances = field(default_factory=Disturbances)
    """Disturbances of the episode."""
    weather: Weather = field(default_factory=Weather)
    """Wind and pushes."""
    eddy: np.ndarray = field(default_factory=lambda: np.zeros(6))
    """Recirculation: U, Ω less their means, over their standard deviations."""
    air: AirForces | None = None
    """Forces of the air at the last evaluation; None without air."""
    falling: RotorMask = field(default_factory=lambda: np.zeros(N_ROTORS, bool))
    """Modules with a falling thrust."""
    loose: JointVector = field(default_factory=lambda: np.zeros(N_JOINTS))
    """Position of each joint within its play [rad]."""
    sticks: np.ndarray = field(default_factory=lambda: np.zeros(2 * N_ROTORS))
    """Angle at which dry friction holds each vectoring axis [rad]."""
    stuck: np.ndarray | None = None
    """Vectoring angles of the module with failed servos [rad]; None without such a failure."""
    power: float = 0.0
    """Electrical power at the end of the last control period [W]."""
    energy_wh: float = 0.0
    """Energy drawn since the reset [Wh]."""
    spent_wh: float = 0.0
    """Energy that the battery lacks at the reset [Wh]."""
    sensors: SensorMemory | None = None
    """State of the sensors; None where they are off."""
    rng: np.random.Generator | None = None
    """Source of noise, wind, pushes, jitter and loss."""


@dataclass(frozen=True)
class Saved:
    """A saved state of the simulation; `Plant.restore` continues from it bit for bit."""

    state: np.ndarray
    """MuJoCo's state and actuator forces."""
    memory: PlantMemory
    """State outside MuJoCo."""
