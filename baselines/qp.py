"""`qp`: the paper's controller, in the air and on the ground; what scores refer to."""

from spidar_gym.benchmark import CRAWL, HOVER, PresetPolicy


class QP(PresetPolicy):
    """The paper's controller: QP allocation with interference avoidance; its gait on the ground (`published`)."""

    presets = {HOVER: {"preset": "paper"}, CRAWL: {"preset": "published"}}  # noqa: RUF012
