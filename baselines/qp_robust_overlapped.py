"""`qp_robust_overlapped`: our best classical crawler, and `qp_robust_overlapped_v1`, its first version.

The preset `robust_overlapped` is what `spidar tune crawl` found: `baselines/searches/crawl.json` is its log, which the
command replays. `robust_overlapped_v1` has the margins of `robust` and the phases of `overlapped`, tried by hand.
"""

from spidar_gym.benchmark import CRAWL, PresetPolicy


class QPRobustOverlapped(PresetPolicy):
    """Preset `robust_overlapped` (`spidar tune crawl`): the careful crawler that hurries; crawls only."""

    name = "qp_robust_overlapped"
    training = {"command": "spidar tune crawl --scenarios 5 --generations 26", "seed": 0}  # noqa: RUF012
    presets = {CRAWL: {"preset": "robust_overlapped"}}  # noqa: RUF012


class QPRobustOverlappedV1(PresetPolicy):
    """Preset `robust_overlapped_v1`: the first version of `robust_overlapped`; crawls only."""

    name = "qp_robust_overlapped_v1"
    presets = {CRAWL: {"preset": "robust_overlapped_v1"}}  # noqa: RUF012
