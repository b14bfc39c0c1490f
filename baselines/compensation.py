"""`compensation`: interference is not avoided but estimated and cancelled: a momentum observer on a free allocation.

[Zhao2020], the lab's way on DRAGON: where one rotor blows on another link, the wrench that the wake takes shows in the
robot's momentum, and the observer's estimate of it is asked of the rotors on top. What they cannot give, they do not.
The law is that of `tuned`, and its search the same: what differs is that no interference row stands in the QP.
"""

from dataclasses import replace

from spidar_gym.benchmark import HOVER, PresetPolicy
from spidar_gym.control.presets import TUNED
from spidar_gym.tune.flight import pids
from spidar_gym.tune.search import flight_search

FREE = {"avoid_interference": False}
"""Of `gym.make`: the rotors may blow wherever they want."""
START = replace(
    TUNED,
    centroidal=pids((32.0, 0.06, 6.2), (22.0, 5.2, 6.2), (33.0, 0.21, 7.2), (25.0, 24.0, 6.8)),
    compensation=replace(
        TUNED.compensation, servo_bandwidth=31.0, observer_gain=0.64, observer_time=0.1, observer_lag=0.29
    ),
)
"""Where the search begins: what a shorter one came to, margins held."""
SEARCH = flight_search("compensation", START, **FREE)
"""`spidar tune baselines.compensation:SEARCH`."""


class Compensation(PresetPolicy):
    """A momentum observer cancels what interference takes, and nothing avoids it; flights only."""

    presets = {HOVER: {"controller": START, **FREE}}  # noqa: RUF012 - nobody writes it
