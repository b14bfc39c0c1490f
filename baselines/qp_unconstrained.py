"""`qp_unconstrained`: the paper's QP without the interference rows [Zhao2025, Eq. 31, 32], its own comparison."""

from spidar_gym.benchmark import HOVER, PresetPolicy


class QPUnconstrained(PresetPolicy):
    """The paper's controller without interference avoidance: rotors may blow on each other; flights only."""

    name = "qp_unconstrained"
    presets = {HOVER: {"preset": "paper", "avoid_interference": False}}  # noqa: RUF012
