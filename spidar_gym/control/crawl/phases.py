"""Data of the gait: phases, steps and memory [Zhao2025, Sec. Crawling Gait]."""

from dataclasses import dataclass, field

import numpy as np

from spidar_gym.arrays import FootForces, JointVector, Matrix3, Vector3
from spidar_gym.control.crawl.pose2 import Pose2
from spidar_gym.robot import N_JOINTS, N_LEGS

CYCLE = ("spool", "raise", "swing", "lower", "brace", "up", "forward", "down", "settle")
"""Phases of a gait cycle: legs, then torso."""
LIFT = ("spool", "raise", "hold", "lower", "settle")
"""Phases of lifting legs in place."""
STAND = ("brace", "up", "hold", "down", "settle")
"""Phases of standing up."""
PHASES = ("done", *CYCLE, "hold")
"""All phases."""


@dataclass(frozen=True, slots=True)
class Step:
    """One sequence of phases."""

    phases: tuple[str, ...]
    """Phases in order."""
    target: Pose2 | None = None
    """Pose of the torso at the end, world; None if the torso stays in place."""
    legs: tuple[int, ...] = (0, 1, 2, 3)
    """Indices of the lifted legs."""
    angle: float | None = None
    """Angle by which the legs are raised [rad]; that of the configuration if None."""
    height: float | None = None
    """Height to which the torso is lifted [m]; that of the configuration if None."""
    seconds: float = 0.0
    """Duration of `hold` [s]."""


@dataclass
class GaitMemory:
    """Complete state of the gait between ticks."""

    steps: list[Step]
    """Remaining steps, the present one first."""
    plan: JointVector
    """Planned joint setpoints [rad]."""
    position_w: Vector3
    """Filtered position of the torso [m]."""
    slow_w: Vector3
    """Position of the torso with a slower filter [m]."""
    R_wb: Matrix3
    """Attitude of the torso."""
    joints: JointVector
    """Filtered joint angles [rad]."""
    phase: str = "done"
    """One of `PHASES`."""
    index: int = 0
    """Index of the phase in the step."""
    time: float = 0.0
    """Time in the phase [s]."""
    still: float = 0.0
    """Time for which the condition for the end of the phase has held [s]."""
    target: JointVector = field(default_factory=lambda: np.zeros(N_JOINTS))
    """Target joint angles of this phase, or of the torso's displacement [rad]."""
    landing: JointVector = field(default_factory=lambda: np.zeros(N_JOINTS))
    """Joint angles at the end of the step [rad]."""
    highest: JointVector = field(default_factory=lambda: np.zeros(N_JOINTS))
    """Inner pitches of the raised legs [rad]."""
    start: JointVector = field(default_factory=lambda: np.zeros(N_JOINTS))
    """Joint angles at the start of the step [rad]."""
    floor_R: Matrix3 = field(default_factory=lambda: np.eye(3))
    """Axes of the floor, world: those of the torso when it last lay on the floor."""
    floor_w: Vector3 = field(default_factory=lambda: np.zeros(3))
    """Position of the torso when it last lay on the floor [m]."""
    feet_f: FootForces = field(default_factory=lambda: np.zeros((N_LEGS, 3)))
    """Positions of the standing feet from `floor_w`, floor axes [m]."""
    way: Pose2 = field(default_factory=Pose2)
    """Displacement of the torso from `floor_w` in this cycle, floor axes."""
    share: float = 0.0
    """Planned share of the displacement."""
    height: float = 0.0
    """Planned height of the torso above `floor_w` [m]."""
    lift: float = 0.0
    """Height above `floor_w` at which the torso moves [m]."""
    expected: Vector3 = field(default_factory=lambda: np.zeros(3))
    """Expected filtered pose of the torso relative to `floor_w`: x, y [m], yaw [rad]."""
    yaw: float = 0.0
    """Filtered yaw relative to `floor_R` [rad]."""
    trim: Vector3 = field(default_factory=lambda: np.zeros(3))
    """x, y [m] and yaw [rad] added to the target of the torso."""
    rested: bool = True
    """Whether the rotors were off before this phase."""
    timeouts: int = 0
    """Number of phases that ended by time-out."""
    corrected: int = 0
    """Number of cycles that were added to the present move."""
    planned: Pose2 = field(default_factory=Pose2)
    """Pose of the torso after the last queued command, world."""
