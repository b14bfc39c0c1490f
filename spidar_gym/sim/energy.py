"""Parameters of the batteries and of the power consumption; native/engine/energy.c computes power and voltage."""

FULL_VOLTAGE, EMPTY_VOLTAGE = 25.2, 22.2
"""Voltage of a pack at rest, full and at the end of the usable charge [V]."""
CAPACITY_WH = 8 * EMPTY_VOLTAGE * 3.0
"""Eight packs of 22.2 V and 3.0 Ah [Wh] [JSK]."""
USABLE = 0.85
"""Usable share of the capacity [estimate]."""
BASE_POWER = 60.0
"""Computer, flight controller, servos at rest [W] [estimate]."""
THRUST_POWER = 4.26
"""c in c λ^1.5 [W/N^1.5], **calibrated** so that the usable energy lasts for the paper's 9 minutes of hover
[Zhao2025, Tab. 1]."""
SERVO_EFFICIENCY = 0.5
"""Efficiency of a joint servo in motion [estimate]."""
HOLDING_POWER = 0.75
"""Power of a joint servo over the square of the torque that it holds [W/Nm²] [estimate]: 0.5 … 1."""
RESISTANCE = 0.08 / 8
"""Resistance of eight packs in parallel [Ω] [JSK]."""


def endurance_min(mean_power: float) -> float:
    """Return the endurance of the usable energy at a mean power [W] in minutes."""
    return 60.0 * USABLE * CAPACITY_WH / mean_power
