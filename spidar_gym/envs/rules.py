"""What the tasks of the environments, each `task.py`, are to the engine: records of their numbers."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from spidar_gym.control.course.gates import KINDS
from spidar_gym.control.crawl.controller import CrawlerConfig
from spidar_gym.control.crawl.footsteps import lying_pose
from spidar_gym.control.estimator import EstimatorConfig
from spidar_gym.control.flight.controller import ControllerConfig
from spidar_gym.control.flight.path import Path
from spidar_gym.control.locomotion.orders import ManagerConfig
from spidar_gym.envs.actions import ActionMode, authorities
from spidar_gym.envs.course import task as course
from spidar_gym.envs.crawl import task as crawl
from spidar_gym.envs.hover import task as hover
from spidar_gym.envs.path import task as path
from spidar_gym.errors import InvalidValueError
from spidar_gym.native.constants import CHANNELS
from spidar_gym.native.engine_structs import (
    AUTORESETS,
    DRAWN,
    HEADINGS,
    MAX_OBSTACLES,
    MAX_WINDOWS,
    PATHS,
    SEQUENCES,
    engine_layouts,
)
from spidar_gym.native.structs import fill
from spidar_gym.robot import FORMS, RobotSpec
from spidar_gym.sim.config import PlantConfig
from spidar_gym.sim.ground import TERRAINS
from spidar_gym.sim.randomize import Randomization

OPERATIONS = ("set", "scale", "add")
"""What a drawn number does to the nominal one, in the engine's order."""


def action_mode(mode: ActionMode, robot: RobotSpec) -> np.ndarray:
    """`sp_action_mode`."""
    record = np.zeros((), engine_layouts()["action_mode"])
    record["size"], record["is_direct"] = mode.size, mode.residual is None
    if mode.residual is not None:
        record["channels"] = sum(1 << CHANNELS.index(channel.name) for channel in mode.channels)
        known = authorities(robot)
        authority = [np.broadcast_to(known[each.name], each.size) for each in mode.channels]
        record["authority"][: mode.size] = np.concatenate(authority)
    return record


def common(
    record: np.ndarray, plant: PlantConfig, mode: ActionMode, bound: np.ndarray, *,
    randomization: Randomization, horizon: int, truncates: bool, autoreset: str,
) -> None:  # fmt: skip
    """Fill `sp_rules`.

    Args:
        record: To be filled.
        plant: The robot that others are drawn around.
        mode: What the action means.
        bound: Of the observation.
        randomization: How robots are drawn.
        horizon: Ticks of an episode.
        truncates: Whether it ends there.
        autoreset: One of `AUTORESETS`.
    """
    fill(record["plant"], plant)
    fill(record["estimator"], EstimatorConfig())
    record["mode"] = action_mode(mode, plant.robot)
    record["size"], record["bound"][: len(bound)] = len(bound), bound
    strength, table = randomization.table(plant)
    record["strength"], record["horizon"], record["truncates"] = strength, horizon, truncates
    record["autoreset"], record["draws"] = AUTORESETS.index(autoreset), len(table)
    layout = engine_layouts()["plant_config"]
    for row, draw in zip(record["draw"], table, strict=False):
        part, name = draw.field.split(".")
        row["at"] = _offset(layout, part) + _offset(layout[part], name)
        row["count"], row["operation"] = np.prod(draw.shape, dtype=int), OPERATIONS.index(draw.operation)
        row["low"], row["high"] = draw.low, draw.high


def _offset(layout: np.dtype[Any], name: Any) -> int:  # noqa: ANN401 - numpy wants a literal
    """Where a member of a struct begins [bytes]."""
    assert layout.fields is not None
    return layout.fields[name][1]


def hover_rules(task: hover.HoverTask, controller: ControllerConfig, *, described: bool) -> np.ndarray:
    """`sp_hover_rules` but for what `common` fills (`InvalidValueError` for more windows than there is room for)."""
    record = np.zeros((), engine_layouts()["hover_rules"])
    if len(task.unrestricted) > MAX_WINDOWS:
        raise InvalidValueError("unrestricted", len(task.unrestricted), f"at most {MAX_WINDOWS} windows of time")
    fill(record["controller"], controller)
    record["rules"]["is_described"], record["position_w"] = described, task.position_w
    for name in ("joint_speed", "perturbation", "horizon_s"):
        record[name] = getattr(task, name)
    record["avoids"], record["windows"] = task.avoid_interference, len(task.unrestricted)
    record["window"][: len(task.unrestricted)] = np.reshape(task.unrestricted, (-1, 2))
    record["form"] = list(FORMS.values())
    for k, name in enumerate(DRAWN):
        record["range"][k], record["drawn_legs"][k] = hover.DRAWN_FORMS[name]
    _weigh(record, hover.REWARD_TERMS)
    record["margin"][: len(hover.MARGINS)] = hover.MARGINS
    for name in (
        "max_tilt", "max_distance", "success_position", "success_attitude", "arrival_grace", "arrival_tolerance",
    ):  # fmt: skip
        record[name] = getattr(hover, name.upper())
    path_rules(task, record)
    return record


def path_rules(task: hover.HoverTask, record: np.ndarray) -> None:
    """Fill what `sp_hover_rules` says of a path."""
    if not isinstance(task, path.PathTask):
        return
    record["path"], record["heading"] = PATHS.index(task.path), HEADINGS.index(task.heading)
    record["speed"] = path.SPEEDS if task.speed is None else task.speed
    for name in ("path_begin", "half_width", "corner_radius", "corner_turn", "bend_radius", "bend_turn", "climb"):
        record[name] = getattr(path, name.upper())


def read_knots(knots: np.ndarray) -> Path | None:
    """The path of records of `sp_knot`; None where there are none."""
    if not len(knots):
        return None
    return Path(*(knots[name].copy() for name in ("time", "pose_w", "rate_w", "acceleration_w")))


def sequence(task: hover.HoverTask) -> int:
    """`sp_sequence` of a task."""
    return SEQUENCES.index(task.forms)


def most_goals(horizon_s: float) -> int:
    """How many forms an episode can have: between two of them is at least a second."""
    return int(np.ceil(horizon_s)) + 3


def crawl_rules(task: crawl.CrawlTask, controller: CrawlerConfig, settle_ticks: int) -> np.ndarray:
    """`sp_crawl_rules` but for what `common` fills (`InvalidValueError` for more obstacles than there is room for)."""
    record = np.zeros((), engine_layouts()["crawl_rules"])
    if len(task.obstacles) > MAX_OBSTACLES:
        raise InvalidValueError("obstacles", len(task.obstacles), f"at most {MAX_OBSTACLES} blocks")
    fill(record["controller"], controller)
    fill(record["way"], crawl.PAPER_WAY)
    record["lies"], record["settle_ticks"] = lying_pose(controller.gait), settle_ticks
    record["share"], record["turn"], record["distance"] = crawl.PAPER_SHARE, crawl.TURN, crawl.DISTANCES
    given = (task.distance, task.direction, task.turn)
    record["is_given"], record["given"] = [x is not None for x in given], [x or 0.0 for x in given]
    record["steps"], record["terrain"] = task.steps, TERRAINS.index(task.terrain)
    record["obstacles"] = len(task.obstacles)
    record["obstacle"][: len(task.obstacles)] = np.reshape(task.obstacles, (-1, 3))
    _weigh(record, crawl.CRAWL_REWARD_TERMS)
    for name in (
        "obstacle_height", "goal_clearance", "goal_margin", "level_margin", "slip_margin", "most_power", "turn_length",
        "max_tilt", "max_astray", "saturated", "success_position", "success_yaw", "success_airborne", "success_slip",
        "success_time", "rest_time", "rest_speed", "rest_turn", "rest_joint_speed", "rest_thrust",
    ):  # fmt: skip
        record[name] = getattr(crawl, name.upper())
    return record


def course_rules(task: course.CourseTask, manager: ManagerConfig, *, is_waypoint: bool, hold: int) -> np.ndarray:
    """`sp_course_rules` but for what `common` fills."""
    record = np.zeros((), engine_layouts()["course_rules"])
    fill(record["manager"], manager)
    floors = [len(KINDS) if floor == course.PLAIN else KINDS.index(floor) for floor in task.floors]
    record["kinds"][: len(task.gates)] = [KINDS.index(gate) for gate in task.gates]
    record["floors"][: len(floors)] = floors
    record["kind_count"], record["floor_count"], record["count"] = len(task.gates), len(floors), task.count
    record["size"] = [course.SIZES[kind] for kind in KINDS]
    record["depth"] = [course.DEPTHS.get(kind, 0.0) for kind in KINDS]
    record["charge"] = course.CHARGE if task.charge is None else task.charge
    record["is_waypoint"], record["hold"] = is_waypoint, hold
    _weigh(record, course.COURSE_REWARD_TERMS)
    for name in (
        "first_gap", "gap", "goal_way", "floor_gap", "floor_length", "middle", "goal_side", "goal_yaw", "decide",
        "goal_margin", "hit_margin", "most_power", "max_hit", "max_tilt", "lies", "at_rest", "carried",
        "turn_length",
        "success_position", "success_yaw",
    ):  # fmt: skip
        record[name] = getattr(course, name.upper())
    return record


def _weigh(record: np.ndarray, terms: Mapping[str, tuple[float, str]]) -> None:
    """Write weights of the reward's terms, which have to be as many as the engine computes (`InvalidValueError`)."""
    if len(terms) != record["weight"].size:
        expected = f'{record["weight"].size} terms, those of the engine; with others make it with control="python"'
        raise InvalidValueError("reward_terms", list(terms), expected)
    record["weight"] = [weight for weight, _ in terms.values()]
