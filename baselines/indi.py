"""`indi`: incremental inversion of the centroidal dynamics on the measured acceleration [Smeur2016].

w = H w₀ + M (a − H ȧ): the wrench as the rotors gave it and the measured acceleration, both behind the same filter H,
and what the acceleration lacks. No integrals, for what lasts is in the increment. That is the momentum observer with a
share of 1 (a test holds one against the other), so it is a configuration and runs on the robot as it is. Changed: the
acceleration is the rate of the estimated momentum, as there is no other at 40 Hz; H has two equal poles in place of
Butterworth's; the legs' planned momentum and the lead of the vectoring are fed forward as `tuned` does.
"""

from dataclasses import replace

from spidar_gym.benchmark import HOVER, PresetPolicy
from spidar_gym.control.flight.controller import ControllerConfig
from spidar_gym.control.presets import TUNED
from spidar_gym.tune.flight import BOUNDS, axes, loops, pids
from spidar_gym.tune.parameter import Parameter
from spidar_gym.tune.search import Search, with_config

SLOWER = 0.7
"""Bandwidth at which the search begins, of that of `tuned`: a share of 1 takes margin from the loop."""
FORWARD = ("momentum_gain", "momentum_filter", "servo_bandwidth", "vectoring_lead")
"""Compensations that `tuned` has too."""
PARAMETERS = (
    *(
        Parameter(f"{axis}_{term}", value, value / 5.0, value * 5.0)
        for axis, (p, _, d) in axes(TUNED).items()
        for term, value in (("p", SLOWER**2 * p), ("d", SLOWER * d))
    ),
    *(Parameter(name, getattr(TUNED.compensation, name), *BOUNDS[name]) for name in FORWARD),
    Parameter("observer_time", 0.15, 0.02, 1.0),
    Parameter("observer_lag", 0.15, 0.01, 0.6),
)
"""Gains of the outer loops, what is fed forward, the filter H, and the model of the rotors."""


def configuration(values: dict[str, float]) -> ControllerConfig:
    """The controller with these parameters."""
    own = {name: values[name] for name in (*FORWARD, "observer_time", "observer_lag")}
    return ControllerConfig(
        centroidal=pids(*((values[f"{axis}_p"], 0.0, values[f"{axis}_d"]) for axis in axes(TUNED))),
        compensation=replace(TUNED.compensation, observer_gain=1.0, observer_order=2, **own),
    )


SEARCH = Search(
    "indi", "indi", "flight", "tuned", PARAMETERS, with_config(configuration),
    lambda values: loops(configuration(values)),
)  # fmt: skip
"""`spidar tune baselines.indi:SEARCH`."""
FOUND = {p.name: p.start for p in PARAMETERS}
"""What it flies with: where the search begins, as long as none is committed."""


class INDI(PresetPolicy):
    """Incremental nonlinear dynamic inversion of the centroidal motion, legs fed forward; flights only."""

    training = {"command": "spidar tune baselines.indi:SEARCH --generations 200", "seed": 0}  # noqa: RUF012
    presets = {HOVER: {"controller": configuration(FOUND)}}  # noqa: RUF012
