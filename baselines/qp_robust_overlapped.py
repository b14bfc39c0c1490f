"""`qp_robust_overlapped`: the margins of `robust` with the fast schedule of `overlapped`; crawls only."""

from spidar_gym.benchmark import CRAWL, PresetPolicy


class QPRobustOverlapped(PresetPolicy):
    """Preset `robust_overlapped`: the careful crawler with phases that run into each other; crawls only."""

    name = "qp_robust_overlapped"
    presets = {CRAWL: {"preset": "robust_overlapped"}}  # noqa: RUF012
