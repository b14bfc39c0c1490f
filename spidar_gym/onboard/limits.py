"""Thresholds of the runner: the third part of its parameters beside robot and gains; a mission may change some."""

from dataclasses import dataclass, field

from spidar_gym.onboard.health import HealthLimits
from spidar_gym.robot.ranges import OTHERS


@dataclass(frozen=True)
class Limits:
    """Thresholds of the runner's checks, and how long it waits."""

    settle: float = 1.0
    """Time with good samples before the take-over [s]."""
    pose_age: float = 0.2
    """Largest age of a valid pose [s]."""
    imu_age: float = 0.1
    """Largest age of a valid sample of the inertial unit [s]."""
    joint_age: float = 0.15
    """Largest age of valid joint angles [s]."""
    state_age: float = 0.5
    """Largest age of a valid flight state [s]."""
    gap: float = 0.1
    """Longest time between two ticks [s]."""
    tilt: float = 0.6
    """Largest tilt of the torso [rad]."""
    deviation: float = 0.0
    """Largest difference of a joint from its command in a test of the robot [rad]; 0 for any."""
    torque: float = OTHERS.most
    """Limit of the joints' torque that is commanded [Nm]; that of the robot applies too."""
    fence_low: tuple[float, float, float] = (-3.0, -3.0, -0.2)
    """Lowest coordinates of the torso in the world [m]."""
    fence_high: tuple[float, float, float] = (3.0, 3.0, 3.0)
    """Highest coordinates of the torso in the world [m]."""
    hold_ticks: int = 4
    """Ticks of a fault before the landing is forced."""
    landing_ticks: int = 10
    """Ticks of the landing command before silence."""
    health: HealthLimits = field(default_factory=HealthLimits)
    """Battery, servos and motors."""
