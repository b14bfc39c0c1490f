"""Margins of flight controllers with legs that bend: worst of all forms, over robots of a world."""

import hashlib
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from spidar_gym.border import BorderError, parse_json, read_file, require_form
from spidar_gym.committed import ROOT
from spidar_gym.control.estimator import EstimatorConfig
from spidar_gym.control.flight.controller import ControllerConfig, FlightController
from spidar_gym.control.presets import FORMER_PRESETS, PRESETS, controller_config
from spidar_gym.envs.registry import HOVER
from spidar_gym.errors import InvalidValueError, SpidarError
from spidar_gym.files import json_text
from spidar_gym.model.dynamics import Model
from spidar_gym.native import linear
from spidar_gym.native.linear import (
    TIMESTEP,
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
from spidar_gym.robot import FORMS, ROBOT, RobotSpec
from spidar_gym.sim.config import PlantConfig
from spidar_gym.sim.randomize import Randomization, randomize

WORLD = "calibrated_1"
"""Calibrated world over whose robots an exported preset's margins are the worst ones."""
ROBOTS, SEED = 24, 47
"""Number of robots of a world, its kinds in turn, and seed of their samples."""
LEAST_DAMPING, MOST_DAMPING = 0.05, 8.9
"""Range of damping that is tried: up to that of the described robot [Nm s/rad]."""
LATE = (0.03, 0.04)
"""Delay of the commands and lag of the thrust at which the least damping is found [s]."""
OTHER_DAMPINGS = (8.9, 0.8, 0.55)
"""Dampings of the joints of a custom robot, of which there is no calibrated world [Nm s/rad]."""
UNSETTLED = 10.0
"""Largest shortfall [1/s]: that of a controller that does not come to rest."""
LEAST_GAIN, LEAST_DELAY = 1.4, 0.02
"""Least worst gain and delay margin [s] of a preset that is exported without further ado; the preset with which the
real robot flew has 1.5 and 0.068 s."""
HELD_RINGING = 0.6
"""Gain margin of all modes, those included that ring only, that searches hold beside `LEAST_GAIN` and `LEAST_DELAY`."""
LATEST, LATE_DAMPINGS = (0.08, 0.04), (8.9, 0.8)
"""Delay and lag [s], and dampings [Nm s/rad], with which no mode of a search's controller may throw the robot over."""


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


def flight_mode(arguments: Mapping[str, Any]) -> str:
    """Return the allocation mode of the flights that `gym.make` makes of its arguments."""
    return "flight" if arguments.get("avoid_interference", True) else "flight_unrestricted"


def arguments_of(name: str) -> Mapping[str, Any]:
    """Return the arguments of `gym.make` in a flight with a preset, or with a policy `module:Class`.

    Raises:
        UnknownNameError: For an unknown preset.
        PolicyError: For an unknown policy.
        InvalidValueError: For a policy without a flight controller of the package.
    """
    if ":" not in name:
        return {"controller": controller_config(name)}
    arguments = policy_arguments(load_policy(name), HOVER) or {}
    # Without these, `flight_law` would return the default preset, which a policy of another task does not fly with.
    if not arguments.keys() & {"preset", "controller"}:
        raise InvalidValueError("controllers", name, "presets, or policies of flights that have a controller")
    return arguments


def law_of(name: str) -> FlightController:
    """Return the flight controller of a preset, or of a policy `module:Class` (errors as `arguments_of`)."""
    return flight_law(arguments_of(name))


def robots_of(world: str, count: int = ROBOTS, robot: RobotSpec = ROBOT) -> list[tuple[str, PlantConfig]]:
    """Sample robots of a calibrated world, which deviate from `robot`, its kinds in turn; returns kind and robot.

    Of a robot that is neither the nominal one nor that which was identified in the world, they are `OTHER_DAMPINGS`.
    """
    how = Randomization.parse(world)
    if robot not in (ROBOT, how.world.robot if how.world else ROBOT):
        late = with_lateness(PlantConfig(robot=robot), LATE)
        return [(f"damping {own:g}", with_damping(late, own)) for own in OTHER_DAMPINGS]
    found = []
    for k in range(count):
        own = how.in_turn(k)
        rng = np.random.Generator(np.random.PCG64([SEED, k]))
        found.append((own.name.partition(":")[2], randomize(PlantConfig(), rng, own)[0]))
    return found


def with_damping(config: PlantConfig, damping: float) -> PlantConfig:
    """Return a robot whose joints have this damping in all [Nm s/rad]."""
    return replace(config, actuators=replace(config.actuators, joint_kd=damping, joint_damping=0.0))


def with_lateness(config: PlantConfig, late: tuple[float, float]) -> PlantConfig:
    """Return a robot with this delay of the commands and lag of the thrust [s]."""
    return replace(config, actuators=replace(config.actuators, delay=late[0], thrust_lag=late[1]))


def leg_margins(
    controller: FlightController,
    robots: Iterable[tuple[str, PlantConfig]],
    described: PlantConfig | None = None,
    mode: str = "flight",
) -> LegMargins:
    """Compute the worst margins of a controller over the paper's forms and robots.

    The controller is linearised in the hovers of the described robot; each robot is linearised there, with its masses,
    gains, stiffness, damping, lag and delay. Joint angles are those of the estimator's filter.

    Args:
        controller: The controller; its memory is changed.
        robots: Kind and configuration of each robot.
        described: The robot in whose hovers everything is linearised; the nominal one by default.
        mode: Allocation mode.

    Raises:
        SpidarError: If a hover does not come to rest.
    """
    gains, delays, dampings, rings = list[tuple[float, str]](), list[tuple[float, str]](), [], []
    robots = list(robots)
    for name, form in FORMS.items():
        hover = settle(controller, form, described or PlantConfig(), mode)
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


def legs_shortfall(controller: FlightController, world: str, mode: str = "flight") -> float:
    """Return by how much a controller misses the margins that searches hold; 0 where it holds them.

    Args:
        controller: The controller; its memory is changed.
        world: Calibrated world.
        mode: Allocation mode.

    Returns:
        Growth of the fastest growing mode at a margin's gain [1/s], the largest over forms, robots and margins, at most
        10, and 10 for a controller that does not come to rest.
    """
    described, robots = PlantConfig(), [robot for _, robot in robots_of(world)]
    # Gain, delay in physics steps, and whether modes count that ring only.
    margins = ((LEAST_GAIN, 0, False), (HELD_RINGING, 0, True), (1.0, round(LEAST_DELAY / TIMESTEP), False))
    late = [with_damping(with_lateness(described, LATEST), damping) for damping in LATE_DAMPINGS]
    held = [(robot, margins) for robot in robots] + [(robot, ((1.0, 0, False),)) for robot in late]
    most, period = 0.0, 1.0 / controller.config.rate_hz
    for form in FORMS.values():
        try:
            hover = settle(controller, form, described, mode)
        except SpidarError:
            return UNSETTLED
        law = behind_encoders(linear_law(hover), EstimatorConfig().joint_bandwidth, period)
        for robot, bounds in held:
            loop = Loop(linear_robot(hover, robot), law)
            most = max(most, *(loop.growth(gain, delay, rings=rings) for gain, delay, rings in bounds))
    return min(most, UNSETTLED)


def _at(place: str, frequency: float) -> str:
    return place if frequency < 0.0 else f"{place}, {frequency:.0f} rad/s"


def least_damping(hover: Hover, law: LinearLaw) -> float:
    """Return the least damping of the joints at which no mode throws the robot over [Nm s/rad]."""
    base = with_lateness(hover.config, LATE)

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
    return f"{gain:.2f}" if gain else f"below {linear.LEAST_GAIN}"


# ---- the presets' margins, and what is exported ----

MARGINS = ROOT / "assets" / "margins.json"
"""Worst margins of the presets over calibrated robots, written by `python -m spidar_gym.studies margins --store`."""
FORM = {
    "gain": float, "gain_at": str, "delay": float, "delay_at": str, "damping": float, "damping_at": str,
    "ringing": float, "ringing_at": str,
}  # fmt: skip
"""Structure of the margins of a preset in the file, beside the digest `config` of its configuration."""


def preset_margins(name: str, robot: RobotSpec = ROBOT, world: str = WORLD) -> LegMargins:
    """Return the worst margins of a preset over the robots of a calibrated world.

    Those of the nominal robot are read from `MARGINS`; those of another robot, and of a preset that has changed since
    the file was written, are computed, which takes about a minute.

    Args:
        name: Name of the preset.
        robot: The robot; the calibrated robots deviate from it.
        world: The calibrated world, by name or file.

    Raises:
        UnknownNameError: For a preset that does not exist.
        SpidarError: If the controller does not come to rest, or the file is damaged.
    """
    config = controller_config(name, robot)
    known = read_margins().get(name) if robot == ROBOT and world == WORLD else None
    if known is not None and known["config"] == _digest(config):
        return LegMargins(**{field: known[field] for field in FORM})
    return config_margins(config, robot, world)


def config_margins(config: ControllerConfig, robot: RobotSpec = ROBOT, world: str = WORLD) -> LegMargins:
    """Compute the worst margins of a controller over the robots of a calibrated world; it takes about a minute."""
    controller = FlightController(config, Model(robot))
    return leg_margins(controller, robots_of(world, robot=robot), PlantConfig(robot=robot))


def read_margins() -> dict[str, dict[str, Any]]:
    """Read `MARGINS`: preset → margins and digest of its configuration (`SpidarError` for a damaged file)."""
    try:
        content = parse_json(read_file(MARGINS, 2**20))
        require_form(content, {str: {**FORM, "config": str}}, MARGINS.name)
    except BorderError as error:
        raise SpidarError(f"{MARGINS} is damaged ({error}); valid: the committed file") from error
    return content


def margins_text() -> str:
    """Compute the margins of all presets, as the text of `MARGINS`."""
    found = {}
    for name in (*PRESETS, *FORMER_PRESETS):
        config = controller_config(name)
        margins = leg_margins(FlightController(config), robots_of(WORLD))
        own = {key: round(value, 4) if isinstance(value, float) else value for key, value in asdict(margins).items()}
        # A controller that no damping keeps up has none.
        found[name] = {**own, "damping": min(own["damping"], MOST_DAMPING), "config": _digest(config)}
    return json_text(found) + "\n"


def _digest(config: ControllerConfig) -> str:
    return hashlib.sha256(repr(config).encode()).hexdigest()


def lacking(m: LegMargins) -> str:
    """Return which worst margins are below those that an export requires, in words; empty if none is."""
    words = []
    if m.gain < LEAST_GAIN:
        words.append(f"gain margin {_factor(m.gain)} ({m.gain_at}), at least {LEAST_GAIN:g} is required")
    if m.delay < LEAST_DELAY - 1e-9:
        words.append(
            f"delay margin {1e3 * m.delay:.0f} ms ({m.delay_at}), at least {1e3 * LEAST_DELAY:.0f} ms is required"
        )
    return "; ".join(words)


def _described(robot: RobotSpec, world: str) -> str:
    if robot == ROBOT or world != WORLD:
        return f"{ROBOTS} robots of {world}"
    return f"{len(OTHER_DAMPINGS)} such robots"


def require_margins(
    names: Sequence[str], robot: RobotSpec = ROBOT, world: str = WORLD,
    own: Mapping[str, ControllerConfig] | None = None, on_preset: Callable[[], object] = lambda: None,
) -> None:  # fmt: skip
    """Require flight controllers to have the margins that an export requires.

    Args:
        names: Names of flight presets.
        robot: The robot.
        world: Calibrated world, by name or file, over whose robots the margins are the worst ones.
        own: Further controllers by name.
        on_preset: Called after the margins of each, for progress.

    Raises:
        UnknownNameError: For a preset that does not exist.
        SpidarError: For the first controller that lacks one; names its margins.
    """
    wanted: list[tuple[str, ControllerConfig | None]] = [*((name, None) for name in names), *(own or {}).items()]
    for name, config in wanted:
        margins = preset_margins(name, robot, world) if config is None else config_margins(config, robot, world)
        on_preset()
        if lack := lacking(margins):
            raise SpidarError(
                f"preset {name} on the worst of {_described(robot, world)}: {lack}; valid: the option that exports it "
                "all the same (--fragile), or a preset with these margins"
            )
