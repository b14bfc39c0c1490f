"""`qp_retuned`: our best classical controllers of flight and ground, found by pattern from those before them.

`spidar tune retuned` found the preset `retuned`, `spidar tune recrawl` found `robust_retuned`: their logs are
`baselines/searches/retuned.json` and `recrawl.json`, which the commands replay.
"""

from spidar_gym.benchmark import CRAWL, HOVER, PresetPolicy


class QPRetuned(PresetPolicy):
    """Preset `retuned` (`spidar tune retuned`) in the air, `robust_retuned` (`spidar tune recrawl`) on the ground."""

    name = "qp_retuned"
    training = {"command": "spidar tune retuned; spidar tune recrawl", "seed": 0}  # noqa: RUF012 - nobody writes it
    presets = {HOVER: {"preset": "retuned"}, CRAWL: {"preset": "robust_retuned"}}  # noqa: RUF012 - nobody writes it
