"""Margins of flight controllers with legs that bend: worst of all forms, over robots of a world."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from spidar_gym.control.estimator import EstimatorConfig
from spidar_gym.control.flight.controller import ControllerConfig, FlightController
from spidar_gym.control.presets import controller_config
from spidar_gym.envs.registry import HOVER
from spidar_gym.errors import InvalidValueError
from spidar_gym.native.linear import (
    LEAST_GAIN,
    Hover,
    LinearLaw,
    Loop,
    behind_encoders,
    linear_law,
    linear_robot,
    settle,
)
from spidar_gym.policies.load import load_policy
from spidar_gym.policies.policy import policy_arguments
from spidar_gym.robot import FORMS
from spidar_gym.sim.config import PlantConfig
from spidar_gym.sim.randomize import Randomization, randomize

ROBOTS, SEED = 24, 47
"""Number of robots of a world, its kinds in turn, and seed of their samples."""
LEAST_DAMPING, MOST_DAMPING = 0.05, 8.9
"""Range of damping that is tried: up to that of the described robot [Nm s/rad]."""
LATE = (0.03, 0.04)
"""Delay of the commands and lag of the thrust at which the least damping is found [s]."""


@dataclass(frozen=True)
class LegMargins:
    """Worst margins of a controller over forms and robots, each with the place where it is worst."""

    gain: float
    """Factor on the commands' deviations from the hover from which on a mode grows that throws the robot over."""
    gain_at: str
    """Robot's kind, form and frequency of that mode."""
    delay: float
    """Further delay of all commands without such a mode [s]."""
    delay_at: str
    """Robot's kind and form."""
    damping: float
    """Least damping of the described robot's joints without such a mode [Nm s/rad]."""
    damping_at: str
    """Form."""
    ringing: float
    """Factor from which on any mode grows; below 1 it rings already."""
    ringing_at: str
    """Robot's kind, form and frequency of that mode."""


def flight_law(arguments: Mapping[str, Any]) -> FlightController:
    """Return the controller that `gym.make` makes of its arguments in a flight.

    Raises:
        InvalidValueError: For a policy without a flight controller of the package.
    """
    config = arguments.get("controller") or controller_config(arguments.get("preset", "paper"))
    if not isinstance(config, ControllerConfig):
        raise InvalidValueError("controller", type(config).__name__, "the configuration of a flight controller")
    return arguments.get("law", FlightController)(config)


def law_of(name: str) -> FlightController:
    """Return the flight controller of a preset, or of a policy `module:Class` that has one."""
    if ":" not in name:
        return FlightController(controller_config(name))
    return flight_law(policy_arguments(load_policy(name), HOVER) or {})


def robots_of(world: str, count: int = ROBOTS) -> list[tuple[str, PlantConfig]]:
    """Sample robots of a calibrated world, its kinds in turn; returns kind and robot of each."""
    found, how = [], Randomization.parse(world)
    for k in range(count):
        own = how.in_turn(k)
        rng = np.random.Generator(np.random.PCG64([SEED, k]))
        found.append((own.name.partition(":")[2], randomize(PlantConfig(), rng, own)[0]))
    return found


def with_damping(config: PlantConfig, damping: float) -> PlantConfig:
    """Return a robot whose joints have this damping in all [Nm s/rad]."""
    return replace(config, actuators=replace(config.actuators, joint_kd=damping, joint_damping=0.0))


def leg_margins(controller: FlightController, robots: Iterable[tuple[str, PlantConfig]]) -> LegMargins:
    """Compute the worst margins of a controller over the paper's forms and robots.

    The controller is linearised in the hovers of the described robot; each robot is linearised there, with its masses,
    gains, stiffness, damping, lag and delay. Joint angles are those of the estimator's filter.

    Args:
        controller: The controller; its memory is changed.
        robots: Kind and configuration of each robot.

    Raises:
        SpidarError: If a hover does not come to rest.
    """
    gains, delays, dampings, rings = list[tuple[float, str]](), list[tuple[float, str]](), [], []
    robots = list(robots)
    for name, form in FORMS.items():
        hover = settle(controller, form, PlantConfig())
        law = behind_encoders(linear_law(hover), EstimatorConfig().joint_bandwidth, 1.0 / controller.config.rate_hz)
        for kind, config in robots:
            loop = Loop(linear_robot(hover, config), law)
            place = f"{kind}, {name}"
            gain, frequency = loop.gain_margin()
            gains.append((gain, _at(place, frequency)))
            delays.append((loop.delay_margin(), place))
            gain, frequency = loop.gain_margin(rings=True)
            rings.append((gain, _at(place, frequency)))
        dampings.append((-least_damping(hover, law), name))
    damping, place = min(dampings)
    return LegMargins(*min(gains), *min(delays), -damping, place, *min(rings))


def _at(place: str, frequency: float) -> str:
    return place if frequency < 0.0 else f"{place}, {frequency:.0f} rad/s"


def least_damping(hover: Hover, law: LinearLaw) -> float:
    """Return the least damping of the joints at which no mode throws the robot over [Nm s/rad]."""
    delay, lag = LATE
    base = replace(hover.config, actuators=replace(hover.config.actuators, delay=delay, thrust_lag=lag))

    def stays(damping: float) -> bool:
        return Loop(linear_robot(hover, with_damping(base, damping)), law).growing() < 0.0

    low, high = LEAST_DAMPING, MOST_DAMPING
    if stays(low) or not stays(high):
        return low if stays(low) else math.inf
    while high > 1.02 * low:
        middle = math.sqrt(low * high)
        low, high = (low, middle) if stays(middle) else (middle, high)
    return high


def leg_lines(rows: Iterable[Mapping[str, Any]]) -> list[list[str]]:
    """Return the table of margins."""
    lines = [["controller", "gain margin", "at", "delay margin", "at", "least damping", "at", "rings from", "at"]]
    for row in rows:
        cells = _factor(row["gain"]), row["gain_at"], f"{1e3 * row['delay']:.0f} ms", row["delay_at"]
        least = "–" if row["damping"] is None else f"{row['damping']:.2f}"
        lines.append([row["controller"], *cells, least, row["damping_at"], _factor(row["ringing"]), row["ringing_at"]])
    return lines


def _factor(gain: float) -> str:
    return f"{gain:.2f}" if gain else f"below {LEAST_GAIN}"
