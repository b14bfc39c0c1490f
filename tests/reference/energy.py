"""NumPy reference of native/engine/energy.c: electrical power and voltage."""

import numpy as np

from spidar_gym.arrays import JointVector, RotorVector
from spidar_gym.sim.energy import (
    BASE_POWER,
    CAPACITY_WH,
    EMPTY_VOLTAGE,
    FULL_VOLTAGE,
    HOLDING_POWER,
    RESISTANCE,
    SERVO_EFFICIENCY,
    THRUST_POWER,
    USABLE,
)


def electrical_power(thrust: RotorVector, joint_torque: JointVector, joint_velocity: JointVector) -> float:
    """Electrical power [W]: P = P_b + Σ c λ^1.5 + Σ max(τ q̇, 0) / η + Σ k τ².

    Args:
        thrust: Thrust of the modules in still air [N].
        joint_torque: Torque of the joint servos [Nm].
        joint_velocity: q̇ [rad/s].
    """
    lift = float((thrust * np.sqrt(np.maximum(thrust, 0.0))).sum())
    move = float(np.maximum(joint_torque * joint_velocity, 0.0).sum())
    return (
        BASE_POWER + THRUST_POWER * lift + move / SERVO_EFFICIENCY + HOLDING_POWER * float(joint_torque @ joint_torque)
    )


def voltage(energy_wh: float, power: float) -> float:
    """Voltage of a pack [V] after `energy_wh` [Wh] at a load of `power` [W]: linear in the charge, minus the sag."""
    rest = FULL_VOLTAGE - (FULL_VOLTAGE - EMPTY_VOLTAGE) * energy_wh / (USABLE * CAPACITY_WH)
    return rest - RESISTANCE * power / max(rest, 1.0)


def max_thrust(volts: float) -> float:
    """Largest thrust of a module at a voltage [N]: 31.8 N at 22.2 V, 40.5 N at 25.2 V [JSK]."""
    return max(0.0, 2.0 * (15.9 + 1.45 * (volts - 22.2)))
