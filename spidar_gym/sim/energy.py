"""Numbers of the batteries and of what empties them; native/engine/energy.c has power, voltage and what they give."""

FULL_VOLTAGE, EMPTY_VOLTAGE = 25.2, 22.2
"""Voltage of a pack at rest, full and at the end of the usable charge [V]."""
CAPACITY_WH = 8 * EMPTY_VOLTAGE * 3.0
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
RESISTANCE = 0.08 / 8
"""Resistance of eight packs in parallel [Ω] [JSK]."""


def endurance_min(mean_power: float) -> float:
    """Minutes that the usable energy lasts at a mean power [W]."""
    return 60.0 * USABLE * CAPACITY_WH / mean_power
