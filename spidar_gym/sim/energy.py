"""Electrical power, energy and voltage: how long the batteries last, and what they still give."""

import numpy as np

from spidar_gym.arrays import JointVector, RotorVector

CAPACITY_WH = 8 * 22.2 * 3.0
"""Eight packs of 22.2 V and 3.0 Ah [Wh] [JSK]."""
USABLE = 0.85
"""Share of the capacity that is flown [estimate]."""
BASE_POWER = 60.0
"""Computer, flight controller, servos at rest [W] [estimate]."""
THRUST_POWER = 4.26
"""c in c λ^1.5 [W/N^1.5]: **calibrated**, so that the usable energy hovers the paper's 9 minutes [Zhao2025, Tab. 1]."""
SERVO_EFFICIENCY = 0.5
"""Efficiency of a joint servo that moves against its torque [estimate]."""
HOLDING_POWER = 0.75
"""Power of a joint servo over the square of the torque that it holds [W/Nm²] [estimate]: 0.5 … 1."""
FULL_VOLTAGE, EMPTY_VOLTAGE = 25.2, 22.2
"""Voltage of a pack at rest, full and at the end of the usable charge [V]."""
RESISTANCE = 0.08 / 8
"""Resistance of eight packs in parallel [Ω] [JSK]."""


def electrical_power(thrust: RotorVector, joint_torque: JointVector, joint_velocity: JointVector) -> float:
    """Electrical power [W]: P = P_b + Σ c λ^1.5 + Σ max(τ q̇, 0) / η + Σ k τ².

    Args:
        thrust: What the motors work for, in still air [N].
        joint_torque: Torque of the joint servos [Nm].
        joint_velocity: q̇ [rad/s].
    """
    lift = float((thrust * np.sqrt(np.maximum(thrust, 0.0))).sum())
    move = float(np.maximum(joint_torque * joint_velocity, 0.0).sum())
    return (
        BASE_POWER + THRUST_POWER * lift + move / SERVO_EFFICIENCY + HOLDING_POWER * float(joint_torque @ joint_torque)
    )


def endurance_min(mean_power: float) -> float:
    """Minutes that the usable energy lasts at a mean power [W]."""
    return 60.0 * USABLE * CAPACITY_WH / mean_power


def voltage(energy_wh: float, power: float) -> float:
    """Voltage of a pack [V] after `energy_wh` [Wh] at a load of `power` [W]: linear in the charge, minus the sag."""
    rest = FULL_VOLTAGE - (FULL_VOLTAGE - EMPTY_VOLTAGE) * energy_wh / (USABLE * CAPACITY_WH)
    return rest - RESISTANCE * power / max(rest, 1.0)


def max_thrust(volts: float) -> float:
    """Largest thrust of a module at a voltage [N]: 31.8 N at 22.2 V, 40.5 N at 25.2 V [JSK]."""
    return max(0.0, 2.0 * (15.9 + 1.45 * (volts - 22.2)))
