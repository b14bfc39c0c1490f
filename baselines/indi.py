"""`indi`: incremental inversion: to the last wrench comes what the measured acceleration lacks [Smeur2016].

Per axis of the centroidal motion w = w_f + M (ν − a_f): a_f is the momentum's rate behind a low-pass, w_f what the
rotors gave behind the same one, ν = P e + D ė. There is no integral: whatever wrench nobody knows of is in a_f. That is
the momentum observer cancelled whole (`observer_gain` 1), as a test shows; its time constant is that of the low-pass.
What `tuned` knows of the legs (their momentum, the servos' lag) it keeps: that is not what they differ in.
"""

from dataclasses import replace

from spidar_gym.benchmark import HOVER, PresetPolicy
from spidar_gym.control.presets import TUNED
from spidar_gym.tune.flight import BOUNDS, pids
from spidar_gym.tune.search import flight_search

START = replace(
    TUNED,
    centroidal=pids((27.0, 0.0, 7.4), (28.0, 0.0, 6.1), (30.0, 0.0, 7.2), (30.0, 0.0, 6.9)),
    compensation=replace(
        TUNED.compensation, vectoring_lead=0.04, observer_gain=1.0, observer_time=0.33, observer_lag=0.22
    ),
)
"""Where the search begins: what a shorter one came to, margins held."""
FREE = tuple(name for name in BOUNDS if name != "observer_gain")
"""Compensations that are tuned."""
SEARCH = flight_search("indi", START, names=FREE)
"""`spidar tune baselines.indi:SEARCH`."""


class Indi(PresetPolicy):
    """Incremental nonlinear dynamic inversion of the centroidal dynamics on the paper's allocation; flights only."""

    presets = {HOVER: {"controller": START}}  # noqa: RUF012 - nobody writes it
