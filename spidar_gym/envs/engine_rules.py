"""Conversion of an environment's options into the engine's record of rules."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from spidar_gym.control.estimator import EstimatorConfig
from spidar_gym.envs.actions import ActionMode, authorities
from spidar_gym.native.constants import CHANNELS
from spidar_gym.native.engine_binding import check_delay
from spidar_gym.native.engine_structs import AUTORESETS, engine_layouts
from spidar_gym.native.quantities import quantity_names
from spidar_gym.native.structs import fill
from spidar_gym.robot import RobotSpec
from spidar_gym.sim.config import PlantConfig
from spidar_gym.sim.randomize import Randomization
from spidar_gym.tasks.task import Task

OPERATIONS = ("set", "scale", "add")
"""Operations by which a sampled number changes the nominal one, in the engine's order."""


def action_mode(mode: ActionMode, robot: RobotSpec) -> np.ndarray:
    """Return an action mode as an `sp_action_mode`."""
    record = np.zeros((), engine_layouts()["action_mode"])
    record["size"], record["is_direct"] = mode.size, mode.residual is None
    record["has_clock"] = mode.has_clock
    known: Mapping[str, ArrayLike] = {}
    if mode.residual is not None:
        record["channels"] = sum(1 << CHANNELS.index(channel.name) for channel in mode.channels)
        known = authorities(robot)
    if mode.scale is not None:
        record["is_in_torso_axes"], record["trim"] = 1, mode.scale.trim
        known = mode.scale.authorities
    if known:
        authority = [np.broadcast_to(known[each.name], each.size) for each in mode.channels]
        record["authority"][: mode.size] = mode.share * np.concatenate(authority)
    return record


def common(
    record: np.ndarray, task: Task[Any], plant: PlantConfig, mode: ActionMode, bound: np.ndarray, *,
    randomization: Randomization, horizon: int, hold: int, truncates: bool, autoreset: str,
) -> None:  # fmt: skip
    """Fill `sp_rules`.

    Args:
        record: Record to fill.
        task: The task.
        plant: The nominal simulated robot.
        mode: Action mode.
        bound: Bounds of the observation.
        randomization: Domain randomisation of the robots.
        horizon: Steps of an episode.
        hold: Control periods per step.
        truncates: Whether an episode is truncated at the horizon.
        autoreset: One of `AUTORESETS`.

    Raises:
        InvalidValueError: For ranges of delays that are too long.
    """
    fill(record["plant"], plant)
    fill(record["estimator"], EstimatorConfig())
    record["mode"] = action_mode(mode, plant.robot)
    record["size"], record["bound"][: len(bound)] = len(bound), bound
    strength, table = randomization.table(plant)
    check_delay(plant, {row.field: row.high for row in table} if strength > 0.0 else {})
    record["strength"], record["horizon"], record["hold"], record["truncates"] = strength, horizon, hold, truncates
    record["stop"] = math.inf
    for name, most in task.stops.items():
        record["stop"][quantity_names(task.robots.quantities).index(name)] = most
    record["autoreset"], record["draws"] = AUTORESETS.index(autoreset), len(table)
    record["kinds"] = len(randomization.world.kinds) if randomization.world else 0
    record["kind"] = randomization.kind
    layout = engine_layouts()["plant_config"]
    for row, draw in zip(record["draw"], table, strict=False):
        part, name = draw.field.split(".")
        row["at"] = _offset(layout, part) + _offset(layout[part], name)
        row["count"], row["operation"] = np.prod(draw.shape, dtype=int), OPERATIONS.index(draw.operation)
        ends = np.array(draw.kinds or [(draw.low, draw.high)])
        row["is_log"], row["low"][: len(ends)], row["high"][: len(ends)] = draw.is_log, ends[:, 0], ends[:, 1]


def _offset(layout: np.dtype[Any], name: Any) -> int:  # noqa: ANN401 - NumPy expects a literal
    """Return the offset of a struct's member [bytes]."""
    assert layout.fields is not None
    return layout.fields[name][1]
