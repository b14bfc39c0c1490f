"""`indi`: incremental inversion: to the last wrench comes what the measured acceleration lacks [Smeur2016].

Per axis of the centroidal motion w = w_f + M (ν − a_f): a_f is the momentum's rate behind a low-pass, w_f what the
rotors gave behind the same one, ν = P e + D ė. There is no integral: whatever wrench nobody knows of is in a_f. That is
the momentum observer cancelled whole (`observer_gain` 1), as a test shows; its time constant is that of the low-pass.
What `tuned` knows of the legs (their momentum, the servos' lag) it keeps: that is not what they differ in.
"""

from dataclasses import replace

from spidar_gym.benchmark import HOVER, PresetPolicy
from spidar_gym.control.presets import TUNED
from spidar_gym.tune.flight import pids
from spidar_gym.tune.search import flight_search

START = replace(
    TUNED,
    centroidal=pids((27.0, 0.0, 7.4), (28.0, 0.0, 6.1), (30.0, 0.0, 7.2), (30.0, 0.0, 6.9)),
    compensation=replace(
        TUNED.compensation, vectoring_lead=0.04, observer_gain=1.0, observer_time=0.33, observer_lag=0.22,
        torque_observer_gain=1.0, torque_observer_time=0.33, torque_observer_lag=0.22,
    ),
)  # fmt: skip
"""Where the search begins."""
FREE = (
    "momentum_gain", "vectoring_lead", "observer_time", "observer_lag", "torque_observer_time", "torque_observer_lag",
)  # fmt: skip
"""Compensations that are tuned: the low-pass of the force, and of the torque, each its own."""
SEARCH = flight_search("indi", START, names=FREE, by_pattern=True)
"""`spidar tune baselines.indi:SEARCH`."""
FOUND = {
    "xy_d": 7.193, "z_d": 7.328, "roll_pitch_d": 6.144, "yaw_d": 5.856, "momentum_gain": 1.419,
    "vectoring_lead": 0.04471, "observer_time": 0.2069, "observer_lag": 0.119, "torque_observer_time": 0.33,
    "torque_observer_lag": 0.2076, "xy_p": 30.21, "z_p": 29.34, "roll_pitch_p": 35.41, "yaw_p": 35.02,
}  # fmt: skip
"""What it flies with: where the search came to rest, `baselines/searches/indi.json`."""


class Indi(PresetPolicy):
    """Incremental nonlinear dynamic inversion of the centroidal dynamics on the paper's allocation; flights only."""

    presets = {HOVER: SEARCH.arguments(FOUND)}  # noqa: RUF012 - nobody writes it
