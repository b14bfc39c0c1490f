"""`adrc`: active disturbance rejection: an extended state observer estimates what disturbs, a PD does the rest.

[Gao2003]: per axis, the observer of the order of the momentum's rate has both poles at −1/T; its second state is the
wrench that nobody knows of, cancelled whole; there is no integral. That is the momentum observer with two low-passes
(`observer_order` 2, `observer_gain` 1), as a test shows. What `tuned` knows of the legs it keeps.
"""

from dataclasses import replace

from baselines.indi import FREE
from spidar_gym.benchmark import HOVER, PresetPolicy
from spidar_gym.control.presets import TUNED
from spidar_gym.tune.flight import pids
from spidar_gym.tune.search import flight_search

START = replace(
    TUNED,
    centroidal=pids((13.0, 0.0, 6.3), (18.0, 0.0, 5.6), (18.6, 0.0, 5.8), (16.7, 0.0, 4.9)),
    compensation=replace(
        TUNED.compensation, observer_gain=1.0, observer_order=2, observer_time=0.19, observer_lag=0.16,
        torque_observer_gain=1.0, torque_observer_time=0.19, torque_observer_lag=0.16,
    ),
)  # fmt: skip
"""Where the search begins."""
SEARCH = flight_search("adrc", START, names=FREE, by_pattern=True)
"""`spidar tune baselines.adrc:SEARCH`."""
FOUND = {
    "xy_d": 8.644, "z_d": 9.02, "roll_pitch_d": 7.616, "yaw_d": 6.253, "momentum_gain": 1.258,
    "vectoring_lead": 0.04995, "observer_time": 0.4352, "observer_lag": 0.04326, "torque_observer_time": 0.3033,
    "torque_observer_lag": 0.0856, "xy_p": 27.04, "z_p": 26.41, "roll_pitch_p": 25.19, "yaw_p": 23.18,
}  # fmt: skip
"""What it flies with: where the search came to rest, `baselines/searches/adrc.json`."""


class Adrc(PresetPolicy):
    """Active disturbance rejection with an extended state observer on the paper's allocation; flights only."""

    presets = {HOVER: SEARCH.arguments(FOUND)}  # noqa: RUF012 - nobody writes it
