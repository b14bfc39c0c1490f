"""The robot's health: its topics, their units and valid values, the runner's limits, and the structs that hold them."""

from collections.abc import Sequence
from dataclasses import dataclass

from spidar_gym.native.structs import CStruct, struct_of
from spidar_gym.robot import N_JOINTS, N_ROTORS

HEALTH_TOPICS = {
    "voltage": ("battery_voltage_status", 10.0), "servos": ("servo/states", 50.0), "motors": ("motor_pwms", 10.0),
}  # fmt: skip
"""Topics about the robot's health: name and usual rate [Hz]. A robot may lack them, and no rate is refused."""
N_SERVOS = N_JOINTS + 2 * N_ROTORS
"""Servos, for each link: joint yaw, joint pitch, φ and θ [JSK]."""
SERVO_FIELDS = ("index", "angle", "temp", "load", "error")
"""Fields of each servo in the message."""
SERVO_STALL = 220
"""`load` of a joint servo at its stall torque: 6.6 Nm [ROBOTIS] at 0.03 Nm a count [JSK]; of φ and θ a guess."""
SERVO_OVERLOAD = 0x20
"""Error bit that is no fault: the servos tolerate an overload while their current is limited [JSK]."""
MOTOR_FULL = 2000
"""`motor_value` at a duty of 1: the signal's length [µs] within a period of 2 ms [JSK]."""
VOLTAGES = (10.0, 30.0)
"""Least and largest valid voltage [V] [chosen]."""
HOTTEST = 120
"""Largest valid temperature of a servo [°C] [chosen]."""
MOST_LOAD = 3 * SERVO_STALL
"""Largest valid load of a servo [chosen]."""
VOLTAGE_TIME = 0.5
"""Time constant of the filter of the voltage [s] [chosen]."""
HOT_TIME = 1.0
"""Time for which a servo must be too hot [s] [chosen]."""
NUMBERS = (
    "SERVO_STALL",
    "SERVO_OVERLOAD",
    "MOTOR_FULL",
    "VOLTAGES",
    "HOTTEST",
    "MOST_LOAD",
    "VOLTAGE_TIME",
    "HOT_TIME",
)
"""Names of the numbers that the runner uses."""


@dataclass(frozen=True)
class HealthLimits:
    """Limits of the robot's health, beyond which the runner ends a mission or lands; the defaults are chosen."""

    voltage_low: float = 21.0
    """Filtered voltage of the battery under load below which the mission ends [V]."""
    voltage_critical: float = 20.0
    """Filtered voltage below which the landing is forced [V]."""
    temperature: float = 57.0
    """Temperature of a servo above which the mission ends [°C]; at 60 °C a servo switches itself off [JSK]."""
    load: float = 0.95
    """Load of a servo, as a share of that at its stall torque, that is allowed for `load_time` only."""
    load_time: float = 10.0
    """Time for which a servo may exceed `load` [s]."""
    output: float = 0.91
    """Duty of a motor that is allowed for `output_time` only; the board limits it to 0.92 [JSK]."""
    output_time: float = 2.0
    """Time for which a motor may reach `output` [s]."""
    age: float = 1.0
    """Longest time without a valid message of a topic that came before [s]."""


HEALTH_STRUCTS: Sequence[CStruct] = (
    struct_of(HealthLimits()),
    CStruct("health_input", "Last messages about the robot's health; times are 0 or less before the first.", (
        ("voltage_time servo_time motor_time", "f8", (), "of the messages [s]"),
        ("voltage", "f8", (), "of the battery [V]"),
        ("servo_count motor_count", "i4", (), "numbers of servos and motors in the last message"),
        ("servo_angle servo_temperature servo_load servo_error", "i4", (N_SERVOS,), "count; [°C]; count; bits"),
        ("motor_output", "i4", (N_ROTORS,), "of SP_MOTOR_FULL"),
    )),
    CStruct("health", "Memory of the checks of the robot's health.", (
        ("voltage", "f8", (), "filtered, 0 before the first [V]"),
        ("newest_time good_time", "f8", (len(HEALTH_TOPICS),), "of the last message; of the last valid one [s]"),
        ("hot", "f8", (), "time for which a servo has been too hot [s]"),
        ("loaded", "f8", (N_SERVOS,), "time above the limit of the load [s]"),
        ("at_limit", "f8", (N_ROTORS,), "time at the limit of the output [s]"),
        ("thrust_limit", "f8", (), "largest thrust of a module at this voltage, infinite before the first [N]"),
    )),
)  # fmt: skip
"""Structs of the robot's health."""
