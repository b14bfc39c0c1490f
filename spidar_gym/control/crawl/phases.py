"""What the gait runs through and remembers: phases, steps, memory [Zhao2025, Sec. Crawling Gait]."""

from dataclasses import dataclass, field

import numpy as np

from spidar_gym.arrays import FootForces, JointVector, Matrix3, Vector3
from spidar_gym.control.crawl.pose2 import Pose2
from spidar_gym.robot import N_JOINTS, N_LEGS

CYCLE = ("spool", "raise", "swing", "lower", "brace", "up", "forward", "down", "settle")
"""Phases of a gait cycle: legs, then torso."""
LIFT = ("spool", "raise", "hold", "lower", "settle")
"""Phases of lifting legs where they stand."""
STAND = ("brace", "up", "hold", "down", "settle")
"""Phases of standing up."""
PHASES = ("done", *CYCLE, "hold")
"""All phases."""


@dataclass(frozen=True, slots=True)
class Step:
    """One run through some phases."""

    phases: tuple[str, ...]
    """In order."""
    target: Pose2 | None = None
    """Where the torso lies at its end, world; None where it stays."""
    legs: tuple[int, ...] = (0, 1, 2, 3)
    """Which legs are lifted."""
    angle: float | None = None
    """How far they are raised, if not by the configuration [rad]."""
    height: float | None = None
    """How far the torso is lifted, if not by the configuration [m]."""
    seconds: float = 0.0
    """How long `hold` lasts [s]."""


@dataclass
class GaitMemory:
    """All that the gait remembers from one tick to the next."""

    steps: list[Step]
    """What is still to do, the present step first."""
    plan: JointVector
    """Planned joint setpoints [rad]."""
    position_w: Vector3
    """Filtered position of the torso [m]."""
    slow_w: Vector3
    """Position of the torso by a slower filter [m]."""
    R_wb: Matrix3
    """Attitude of the torso."""
    joints: JointVector
    """Filtered joint angles [rad]."""
    phase: str = "done"
    """One of `PHASES`."""
    index: int = 0
    """Which phase of the step."""
    time: float = 0.0
    """Time in the phase [s]."""
    still: float = 0.0
    """For how long everything has been still and where it should be [s]."""
    target: JointVector = field(default_factory=lambda: np.zeros(N_JOINTS))
    """Joint angles that the legs go to in this phase [rad]."""
    landing: JointVector = field(default_factory=lambda: np.zeros(N_JOINTS))
    """Joint angles at the end of the step [rad]."""
    highest: JointVector = field(default_factory=lambda: np.zeros(N_JOINTS))
    """Inner pitches of the raised legs [rad]."""
    start: JointVector = field(default_factory=lambda: np.zeros(N_JOINTS))
    """Joint angles at the start of the step [rad]."""
    floor_R: Matrix3 = field(default_factory=lambda: np.eye(3))
    """Axes of the floor, world: the torso's when it lay on it."""
    floor_w: Vector3 = field(default_factory=lambda: np.zeros(3))
    """Where the torso lay [m]."""
    feet_f: FootForces = field(default_factory=lambda: np.zeros((N_LEGS, 3)))
    """Where the feet stand, floor axes, from where the torso lay [m]."""
    way: Pose2 = field(default_factory=Pose2)
    """Way of the torso from there, floor axes."""
    share: float = 0.0
    """How much of the way is done."""
    height: float = 0.0
    """Planned height over where it lay [m]."""
    lift: float = 0.0
    """Height at which it moves [m]."""
    expected: Vector3 = field(default_factory=lambda: np.zeros(3))
    """Where the filtered pose should be by now, seen from where the torso lay: x, y [m], yaw [rad]."""
    yaw: float = 0.0
    """Filtered yaw from there [rad]."""
    trim: Vector3 = field(default_factory=lambda: np.zeros(3))
    """x, y [m] and yaw [rad] added to where the legs push the torso."""
    rested: bool = True
    """Whether the rotors were off before this phase."""
    timeouts: int = 0
    """Phases that ended by time-out."""
    planned: Pose2 = field(default_factory=Pose2)
    """Where the last command in the list ends, world."""
