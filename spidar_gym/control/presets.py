"""Presets: which allocation, which gains and which compensations make a named controller."""

from spidar_gym.control.centroidal import CentroidalConfig
from spidar_gym.control.compensation import CompensationConfig
from spidar_gym.control.controller import ControllerConfig
from spidar_gym.errors import require_name

PRESETS: dict[str, ControllerConfig] = {
    "paper": ControllerConfig(),
    "as_flown": ControllerConfig(allocation="as_flown"),
    # What `spidar tune --seed 0 --generations 30` found.
    "tuned": ControllerConfig(
        centroidal=CentroidalConfig(
            position_gains=((14.12, 0.0474, 4.193), (14.12, 0.0474, 4.193), (7.76, 6.023, 7.479)),
            attitude_gains=((24.37, 0.645, 6.978), (24.37, 0.645, 6.978), (19.5, 5.914, 7.322)),
        ),
        compensation=CompensationConfig(
            momentum_gain=1.276,
            momentum_filter=0.02851,
            servo_bandwidth=52.48,
            vectoring_lead=0.05232,
            observer_gain=0.8372,
            observer_time=0.3603,
            observer_lag=0.1621,
            joint_ramp=0.4,
        ),
    ),
}
"""Controllers by name."""


def controller_config(preset: str) -> ControllerConfig:
    """The controller of a preset (`UnknownNameError` lists the valid ones)."""
    require_name("preset", preset, PRESETS)
    return PRESETS[preset]
