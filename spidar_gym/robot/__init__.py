"""The robot: its parameters and the models generated from them."""

from spidar_gym.robot.spec import (
    CONTACT_SITES,
    FOOT_SITES,
    FORMS,
    GIMBAL_NAMES,
    GRAVITY,
    JOINT_NAMES,
    N_JOINTS,
    N_LEGS,
    N_LINKS,
    N_ROTORS,
    PEG_SITES,
    ROBOT,
    ROTOR_SITES,
    RobotSpec,
    field_docs,
    source_doc,
)

__all__ = [
    "CONTACT_SITES", "FOOT_SITES", "FORMS", "GIMBAL_NAMES", "GRAVITY", "JOINT_NAMES", "N_JOINTS", "N_LEGS",
    "N_LINKS", "N_ROTORS", "PEG_SITES", "ROBOT", "ROTOR_SITES", "RobotSpec", "field_docs", "source_doc",
]  # fmt: skip
