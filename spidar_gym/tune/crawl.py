"""The crawl searches, `crawl` and `recrawl`: footsteps, phases, margins and thrust, at the paper's joint speed."""

from collections.abc import Mapping
from dataclasses import replace

from spidar_gym.control.crawl.controller import CrawlerConfig
from spidar_gym.control.presets import ROBUST_OVERLAPPED
from spidar_gym.control.presets import ROBUST_OVERLAPPED_V1 as FIRST
from spidar_gym.tune.parameter import Parameter

REFERENCE = "robust_overlapped_v1"
"""Preset that is evaluated beside every generation."""
# Three strides for the paper's displacement instead of four, a low lift, legs that swing while they rise and are
# lowered before they arrive, least electrical power: changes tried one after the other, all without a failure.
START = replace(
    FIRST,
    gait=replace(
        FIRST.gait,
        outer=1.3, max_distance=0.31, raise_angle=0.1, lift_height=0.025, start_time=0.12, leg_touch_time=0.08,
        torso_touch_time=0.06, lower_at=0.2, forward_at=0.1, trim_gain=6.0,
    ),
    torque_limit=5.0,
    foot_friction=0.2,
    power=True,
)  # fmt: skip
"""Start of the search: the reference after manual trials."""
UNSUCCESSFUL = 0.3
"""Added to the error of an unsuccessful crawl: half the error of a good crawl, so that dragging feet does not pay."""

_GAIT: dict[str, tuple[float, float]] = {
    "swing_at": (0.2, 1.0),
    "lower_at": (0.03, 0.4),
    "forward_at": (0.05, 1.0),
    "down_at": (0.7, 1.0),
    "lift_height": (0.02, 0.1),
    "raise_angle": (0.04, 0.25),
    "leg_touch_time": (0.05, 0.5),
    "torso_touch_time": (0.05, 0.5),
    "trim_gain": (1.0, 10.0),
    "max_distance": (0.1, 0.4),
}
"""Bounds of fields of `GaitConfig`, searched on a logarithmic scale."""
_GAIT_LINEAR: dict[str, tuple[float, float]] = {
    "inner": (-0.75, -0.35),
    "outer": (1.1, 1.5),
}
"""Bounds of fields of `GaitConfig` that may be 0 or negative, searched on a linear scale."""
_CRAWLER: dict[str, tuple[float, float]] = {
    "torque_limit": (3.0, 6.0),
    "foot_friction": (0.15, 0.5),
    "min_normal": (3.0, 40.0),
    "blend_time": (0.2, 1.2),
    "feed_forward": (0.5, 1.3),
    "leg_stiffness": (5.0, 150.0),
}
"""Bounds of fields of `CrawlerConfig`, searched on a logarithmic scale."""


def parameters(start: CrawlerConfig, **wider: tuple[float, float]) -> tuple[Parameter, ...]:
    """Return the parameters of a search: footsteps and phases, then margins and thrust.

    Joint speed and rate are the paper's. All other fields keep their values in `start`, which saves generations.

    Args:
        start: First guess.
        **wider: Bounds that replace the default ones.
    """

    def bounded(of: object, bounds: Mapping[str, tuple[float, float]], *, linear: bool = False) -> list[Parameter]:
        return [Parameter(name, getattr(of, name), *wider.get(name, own), linear) for name, own in bounds.items()]

    return (*bounded(start.gait, _GAIT), *bounded(start.gait, _GAIT_LINEAR, linear=True), *bounded(start, _CRAWLER))


def configuration(values: Mapping[str, float], start: CrawlerConfig = START) -> CrawlerConfig:
    """Return the crawler with these parameters (`InvalidValueError` for a start pose out of reach)."""
    gait = replace(start.gait, **{name: values[name] for name in (*_GAIT, *_GAIT_LINEAR)})
    return replace(start, gait=gait, **{name: values[name] for name in _CRAWLER})


PARAMETERS = parameters(START)
"""Parameters of the search for `robust_overlapped`."""
# On slippery floors minimising the power does not pay, and the friction is lower than the assumed 0.47. The other
# values are from manual trials with sixteen scenarios per track. A torque limit near the servos' 7 Nm is fast. With
# feet that are lowered later, more force on each foot and stiffer legs, as few randomised robots slide as with 6 Nm.
RESTART = replace(
    ROBUST_OVERLAPPED,
    gait=replace(ROBUST_OVERLAPPED.gait, swing_at=0.37, lower_at=0.25, raise_angle=0.09),
    power=False, torque_limit=6.8, foot_friction=0.3, min_normal=22.0, leg_stiffness=30.0,
)  # fmt: skip
"""Start of the search `recrawl`."""
FAST_WAY = {"distance": 0.6, "direction": 0.0, "turn": 0.0, "joint_speed": 0.8}
"""Options of the second track of `steady_crawl`: the paper's displacement, four times as fast."""
FAST_TIME = 6.4
"""Longest duration of a successful crawl there [s]."""
