"""`compensation`: what the jets take from each other is not avoided but observed and compensated [Zhao2020].

The lab's earlier robot, DRAGON, flew so: the allocation knows no interference, and a momentum observer adds what the
wake takes to the wrench that is asked for. Changed here: the observer may cancel all of it or a share, whichever the
search found better, and everything else is what `tuned` has, found anew without the interference rows.
"""

from dataclasses import replace

from spidar_gym.benchmark import HOVER, PresetPolicy
from spidar_gym.control.flight.controller import ControllerConfig
from spidar_gym.control.presets import TUNED
from spidar_gym.tune.flight import BOUNDS, axes, loops, pids
from spidar_gym.tune.parameter import Parameter
from spidar_gym.tune.search import Search

PARAMETERS = (
    *(
        Parameter(f"{axis}_{term}", value, value / 5.0, value * 5.0)
        for axis, row in axes(TUNED).items()
        for term, value in zip("pid", row, strict=True)
    ),
    *(
        Parameter(name, getattr(TUNED.compensation, name), *(0.1, 1.0) if name == "observer_gain" else bounds)
        for name, bounds in BOUNDS.items()
    ),
)
"""Gains and compensations: all that `tuned` has, from where it is."""


def configuration(values: dict[str, float]) -> ControllerConfig:
    """The controller with these parameters."""
    rows = ((values[f"{axis}_p"], values[f"{axis}_i"], values[f"{axis}_d"]) for axis in axes(TUNED))
    return ControllerConfig(
        centroidal=pids(*rows),
        compensation=replace(TUNED.compensation, **{name: values[name] for name in BOUNDS}),
    )


def arguments(values: dict[str, float]) -> dict[str, object]:
    """What `gym.make` is told of these parameters."""
    return {"controller": configuration(values), "avoid_interference": False}


SEARCH = Search(
    "compensation",
    "compensation",
    "flight",
    "tuned",
    PARAMETERS,
    arguments,
    lambda values: loops(configuration(values)),
)
"""`spidar tune baselines.compensation:SEARCH`."""
FOUND = {p.name: p.start for p in PARAMETERS}
"""What it flies with: where the search begins, as long as none is committed."""


class Compensation(PresetPolicy):
    """Interference compensated, not avoided: momentum observer on the unconstrained QP; flights only."""

    training = {"command": "spidar tune baselines.compensation:SEARCH --generations 200", "seed": 0}  # noqa: RUF012
    presets = {HOVER: arguments(FOUND)}  # noqa: RUF012
