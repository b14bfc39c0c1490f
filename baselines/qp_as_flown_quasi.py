"""`qp_as_flown_quasi`: allocation and estimate that the robot's computer probably ran [JSK]."""

from spidar_gym.benchmark import HOVER, PresetPolicy


class QPAsFlownQuasi(PresetPolicy):
    """`qp_as_flown` whose velocity lacks the joints' share, as in the lab's public estimator; flights only."""

    name = "qp_as_flown_quasi"
    presets = {HOVER: {"preset": "as_flown_quasi"}}  # noqa: RUF012
