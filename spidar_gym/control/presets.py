"""Presets: which allocation, which gains and which compensations make a named controller."""

from dataclasses import replace
from typing import Any

from spidar_gym.control.centroidal import CentroidalConfig
from spidar_gym.control.compensation import CompensationConfig
from spidar_gym.control.controller import ControllerConfig
from spidar_gym.errors import UnknownNameError

PRESETS: dict[str, ControllerConfig] = {
    "paper": ControllerConfig(),
    "as_flown": ControllerConfig(allocation="as_flown"),
    # By `spidar tune --seed 0`, 40 generations of 12 candidates on 6 flights each.
    "tuned": ControllerConfig(
        centroidal=CentroidalConfig(
            position_gains=((4.7, 0.16, 6.0), (4.7, 0.16, 6.0), (8.0, 1.5, 6.0)),
            attitude_gains=((18.0, 2.0, 9.0), (18.0, 2.0, 9.0), (14.0, 1.3, 8.0)),
        ),
        compensation=CompensationConfig(
            momentum_gain=1.0,
            momentum_filter=0.02,
            servo_bandwidth=40.0,
            vectoring_lead=0.05,
            observer_gain=0.8,
            observer_time=0.5,
            observer_lag=0.05,
            joint_ramp=0.4,
        ),
    ),
}
"""Controllers by name."""


def controller_config(preset: str, **changes: Any) -> ControllerConfig:  # noqa: ANN401 - the fields of ControllerConfig
    """A preset with some of its fields changed (`UnknownNameError` lists the valid presets)."""
    if preset not in PRESETS:
        raise UnknownNameError("preset", preset, PRESETS)
    return replace(PRESETS[preset], **changes)
