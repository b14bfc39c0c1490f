"""`qp_tuned`: our best classical controllers, and `qp_overlapped`, the fastest gait.

The preset `tuned` is what `spidar tune --seed 0 --generations 30` found, on flights with seeds that no scenario has.
"""

from spidar_gym.benchmark import CRAWL, HOVER, PresetPolicy


class QPTuned(PresetPolicy):
    """Preset `tuned` (`spidar tune --seed 0 --generations 30`) in the air, `robust` on the ground."""

    name = "qp_tuned"
    training = {"command": "spidar tune --seed 0 --generations 30", "seed": 0}  # noqa: RUF012
    presets = {HOVER: {"preset": "tuned"}, CRAWL: {"preset": "robust"}}  # noqa: RUF012


class QPOverlapped(PresetPolicy):
    """Preset `overlapped`: the gait whose phases run into each other; crawls only."""

    name = "qp_overlapped"
    presets = {CRAWL: {"preset": "overlapped"}}  # noqa: RUF012
