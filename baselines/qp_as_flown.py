"""`qp_as_flown`: the allocation that the robot's computer ran [JSK]."""

from spidar_gym.benchmark import HOVER, PresetPolicy


class QPAsFlown(PresetPolicy):
    """The allocation that the real robot flew with, on the paper's gains; flights only."""

    name = "qp_as_flown"
    presets = {HOVER: {"preset": "as_flown"}}  # noqa: RUF012
