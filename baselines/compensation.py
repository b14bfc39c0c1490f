"""`compensation`: interference is not avoided but estimated and cancelled: a momentum observer on a free allocation.

[Zhao2020], the lab's way on DRAGON: where one rotor blows on another link, the wrench that the wake takes shows in the
robot's momentum, and the observer's estimate of it is asked of the rotors on top. What they cannot give, they do not.
The law is that of `retuned`, and its search the same: what differs is that no interference row stands in the QP.
"""

from dataclasses import replace
from typing import Any

from spidar_gym.benchmark import HOVER, PresetPolicy
from spidar_gym.control.presets import TUNED
from spidar_gym.tune.flight import RETUNED_NAMES, pids
from spidar_gym.tune.search import flight_search

FREE: dict[str, Any] = {"avoid_interference": False}
"""Of `gym.make`: the rotors may blow wherever they want."""
START = replace(
    TUNED,
    centroidal=pids((32.0, 0.06, 6.2), (22.0, 5.2, 6.2), (33.0, 0.21, 7.2), (25.0, 24.0, 6.8)),
    compensation=replace(
        TUNED.compensation, servo_bandwidth=31.0, observer_gain=0.64, observer_time=0.1, observer_lag=0.29,
        torque_observer_gain=0.64, torque_observer_time=0.1, torque_observer_lag=0.29, lead_gain=0.05, lead_time=0.08,
    ),
)  # fmt: skip
"""Where the search begins."""
SEARCH = flight_search("compensation", START, names=RETUNED_NAMES, by_pattern=True, **FREE)
"""`spidar tune baselines.compensation:SEARCH`."""
FOUND = {
    "xy_i": 0.06, "xy_d": 7.565, "z_i": 23.16, "z_d": 7.228, "roll_pitch_i": 0.9352, "roll_pitch_d": 6.601,
    "yaw_i": 5.389, "yaw_d": 7.144, "momentum_gain": 1.552, "vectoring_lead": 0.04377, "observer_gain": 0.6752,
    "observer_time": 0.1, "observer_lag": 0.29, "torque_observer_gain": 0.6451, "torque_observer_time": 0.0942,
    "torque_observer_lag": 0.5712, "lead_gain": 0.03243, "lead_time": 0.03489, "xy_p": 51.84, "z_p": 56.69,
    "roll_pitch_p": 64.48, "yaw_p": 61.21,
}  # fmt: skip
"""What it flies with: what the search ended with, `baselines/searches/compensation.json`."""


class Compensation(PresetPolicy):
    """A momentum observer cancels what interference takes, and nothing avoids it; flights only."""

    presets = {HOVER: SEARCH.arguments(FOUND)}  # noqa: RUF012 - nobody writes it
