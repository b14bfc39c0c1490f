"""`qp_tuned`: our best classical controllers, `qp_tuned_v1`, its first version, and `qp_overlapped`, the fastest gait.

The preset `tuned` is what `spidar tune flight` found: `baselines/searches/flight.json` is its log, which the command
replays. `tuned_v1` came of 30 generations of an older search, on the simulator of its day.
"""

from spidar_gym.benchmark import CRAWL, HOVER, PresetPolicy


class QPTuned(PresetPolicy):
    """Preset `tuned` (`spidar tune flight`) in the air, `robust` on the ground."""

    name = "qp_tuned"
    training = {"command": "spidar tune flight --generations 200", "seed": 0}  # noqa: RUF012
    presets = {HOVER: {"preset": "tuned"}, CRAWL: {"preset": "robust"}}  # noqa: RUF012


class QPTunedV1(PresetPolicy):
    """Preset `tuned_v1`: the first version of `tuned`; flights only."""

    name = "qp_tuned_v1"
    training = {"command": "spidar tune --seed 0 --generations 30", "seed": 0}  # noqa: RUF012
    presets = {HOVER: {"preset": "tuned_v1"}}  # noqa: RUF012


class QPOverlapped(PresetPolicy):
    """Preset `overlapped`: the gait whose phases run into each other; crawls only."""

    name = "qp_overlapped"
    presets = {CRAWL: {"preset": "overlapped"}}  # noqa: RUF012
