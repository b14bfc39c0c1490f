"""`qp_steady`: the recommended controllers of flight and ground.

`spidar tune steady --scenarios 6` found the preset `steady` on calibrated robots, with all margins held: its log is
baselines/searches/steady.json. `steady_crawl` is `robust_retuned` with lower lifts and a correction at the end.
"""

from spidar_gym.benchmark import CRAWL, HOVER, PresetPolicy


class QPSteady(PresetPolicy):
    """Preset `steady` (`spidar tune steady`) in the air, `steady_crawl` on the ground."""

    name = "qp_steady"
    training = {"command": "spidar tune steady --scenarios 6 --generations 60", "seed": 0}  # noqa: RUF012 - constant
    presets = {HOVER: {"preset": "steady"}, CRAWL: {"preset": "steady_crawl"}}  # noqa: RUF012 - constant
