"""`adrc`: active disturbance rejection by bandwidths [Gao2003]: nothing is known of legs, rotors and air.

Whatever accelerates the robot beyond what is asked for, moving legs included, is a disturbance, which an extended state
observer of the velocity estimates and the input cancels: k_p = ω_c², k_d = 2 ω_c for each axis, ω_o for the observer.
That is the momentum observer with two equal low-passes and a share of 1 (a test holds one against the other), so it is
a configuration. Changed: velocity and pose are measured here, so the observer is the reduced one, of order 2.
"""

from spidar_gym.benchmark import HOVER, PresetPolicy
from spidar_gym.control.flight.compensation import CompensationConfig
from spidar_gym.control.flight.controller import ControllerConfig
from spidar_gym.control.presets import TUNED
from spidar_gym.tune.flight import axes, loops, pids
from spidar_gym.tune.parameter import Parameter
from spidar_gym.tune.search import Search, with_config

PARAMETERS = (
    *(Parameter(f"{axis}_bandwidth", 4.0, 1.0, 12.0) for axis in axes(TUNED)),
    Parameter("observer_bandwidth", 3.3, 0.5, 30.0),
)
"""ω_c of every axis and ω_o of the observer [rad/s]."""


def configuration(values: dict[str, float]) -> ControllerConfig:
    """The controller with these parameters."""
    own = [values[f"{axis}_bandwidth"] for axis in axes(TUNED)]
    return ControllerConfig(
        centroidal=pids(*((w * w, 0.0, 2.0 * w) for w in own)),
        compensation=CompensationConfig(
            observer_gain=1.0, observer_time=1.0 / values["observer_bandwidth"], observer_order=2, observer_lag=0.0,
            joint_ramp=TUNED.compensation.joint_ramp, reference_gain=TUNED.compensation.reference_gain,
        ),
    )  # fmt: skip


SEARCH = Search(
    "adrc", "adrc", "flight", "tuned", PARAMETERS, with_config(configuration),
    lambda values: loops(configuration(values)),
)  # fmt: skip
"""`spidar tune baselines.adrc:SEARCH`."""
FOUND = {p.name: p.start for p in PARAMETERS}
"""What it flies with: where the search begins, as long as none is committed."""


class ADRC(PresetPolicy):
    """Active disturbance rejection, an extended state observer and two bandwidths; flights only."""

    training = {"command": "spidar tune baselines.adrc:SEARCH --generations 200", "seed": 0}  # noqa: RUF012
    presets = {HOVER: {"controller": configuration(FOUND)}}  # noqa: RUF012
