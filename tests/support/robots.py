"""Custom robots shared by tests."""

from spidar_gym.robot import RobotSpec
from spidar_gym.robot.payload import Payload

LONG = RobotSpec(pitch_to_foot=1.2 * RobotSpec.pitch_to_foot)
"""Outer links 20 % longer, and so heavier."""
LOADED = RobotSpec(
    payloads=(
        Payload("torso", 0.8, (0.02, -0.01, 0.09), (0.12, 0.10, 0.06)),
        Payload("link4", 0.2, (0.35, 0.0, 0.05), inertia=(4e-4, 3e-4, 2e-4, 1e-5, -2e-5, 3e-5)),
    )
)
"""A box on the torso and a payload on an outer link."""
OTHER = RobotSpec(
    described_mass=15.0, pitch_to_yaw=0.48, yaw_axis_xy=0.14, roll_axis_x=0.24, max_thrust=48.0, duct_offset_y=0.12,
    part_masses={"battery": 0.6},
    max_joint_torque=9.0, joint_speed=0.3, peg_length=0.12, foot_radius=0.035, joint_kp=200.0, torso_radius=0.18,
)  # fmt: skip
"""Nearly everything else changed."""
ROBOTS = {"long": LONG, "loaded": LOADED, "other": OTHER}
"""By name."""
