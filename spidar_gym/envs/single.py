"""The one robot of a fleet, as an environment of a single robot tells of it: in objects, words and single numbers."""

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from spidar_gym.control.interface import CrawlControl, FlightControl
from spidar_gym.control.locomotion.orders import Orders
from spidar_gym.envs.fleet import Fleet, told
from spidar_gym.envs.judge import Judge
from spidar_gym.native.draws import take_back
from spidar_gym.native.library import STATUS
from spidar_gym.native.plant import Plant, read_command, read_state
from spidar_gym.robot import N_JOINTS
from spidar_gym.sim.energy import endurance_min
from spidar_gym.sim.randomize import TABLE
from spidar_gym.sim.violations import costs
from spidar_gym.state import Command, RobotState

PAGE = ("reward_terms", "reference", "_begin", "_act", "_advance", "_observation", "_task_info", "_info")
"""What of an environment's class the engine does itself."""


def keeps_page(kind: type, built_in: type) -> bool:
    """Whether a subclass of an environment has changed nothing of what the engine would do."""
    return all(getattr(kind, name) is getattr(built_in, name) for name in PAGE if hasattr(built_in, name))


def begin(fleet: Fleet, judge: Judge | None, rng: np.random.Generator) -> None:
    """Let the next episode begin, with what this generator draws: it is moved on by that."""
    fleet.seed(0, rng)
    (judge or fleet).reset()
    take_back(rng, fleet.robots[0]["episode"]["generator"])


def look(fleet: Fleet, name: str) -> RobotState | Command:
    """What the controller sees (`seen`), or the last `command`."""
    episode = fleet.robots[0]["episode"]
    return read_state(episode["seen"]) if name == "seen" else read_command(episode["command"])


def drawn(numbers: np.ndarray) -> dict[str, np.ndarray]:
    """What was drawn of robots (…, numbers), by field of `PlantConfig`: arrays (…, shape of the field)."""
    draws, at = dict[str, np.ndarray](), 0
    for row in TABLE:
        size = math.prod(row.shape)
        draws[row.field] = numbers[..., at : at + size].reshape((*numbers.shape[:-1], *row.shape)).copy()
        at += size
    return draws


_STATUSES = tuple(str(word) for word in STATUS)
SETS = ("shortfalls",)
"""What names several words at once: their numbers are bits."""


def words_of(failures: Iterable[str], words: Mapping[str, tuple[str, ...]]) -> dict[str, tuple[str, ...]]:
    """Words of `info` by name, in the order of their codes.

    Args:
        failures: Why an episode may be over.
        words: What else an environment has.
    """
    return {"qp_status": _STATUSES, "failure": tuple(failures), **words}


def spoken(name: str, code: int, words: Sequence[str]) -> str:
    """What a code of `info` means: −1 is none, in `SETS` bit k is the k-th word."""
    if name in SETS:
        return ", ".join(word for k, word in enumerate(words) if code >> k & 1)
    return words[code] if code >= 0 else "none" if name == "qp_status" else ""


def info(
    record: np.ndarray, terms: Iterable[str], values: np.ndarray | None, words: Mapping[str, Sequence[str]]
) -> dict[str, Any]:
    """What is told of a robot, an array, a number or a word each.

    Args:
        record: `sp_hover_info` or one of the other tasks', shape (1,).
        terms: Names of the terms of the reward.
        values: Their values in this order, where they are not the record's own.
        words: What codes mean, by the word's name, in the order of the codes.
    """
    now = told(record.copy())
    found = {name: value[0] if value.ndim > 1 else value.item() for name, value in now.items()}
    built_in = found.pop("term")
    for name, value in zip(terms, (built_in if values is None else values).tolist(), strict=True):
        found[f"reward_{name}"] = value
    coded = {name: found.pop(f"{name}_code") for name in words if f"{name}_code" in found}
    return found | {name: spoken(name, code, words[name]) for name, code in coded.items()}


def readable_info(
    state: RobotState, command: Command | None, controller: FlightControl | CrawlControl | Orders, plant: Plant,
    untouchable: Sequence[str],
) -> dict[str, Any]:  # fmt: skip
    """What `info` gives in every environment, where controller and task are in Python.

    Args:
        state: The true one.
        command: The last, if there is one.
        controller: What allocated.
        plant: What was simulated.
        untouchable: Parts of the robot that had better touch nothing.
    """
    last = controller.last_step
    allocation = None if last is None else last.allocation
    return {
        "thrust_command": (state.thrust if command is None else command.thrust).copy(),
        "thrust": state.thrust.copy(),
        "vectoring_command": (state.vectoring if command is None else command.vectoring).copy(),
        "vectoring": state.vectoring.copy(),
        "joint_torque_allocated": np.zeros(N_JOINTS) if allocation is None else allocation.joint_torques.copy(),
        "joint_torque": state.joint_torque.copy(),
        "wrench_allocated": np.zeros(6) if allocation is None else allocation.wrench.copy(),
        "total_thrust": float(state.thrust.sum()),
        "qp_status": "none" if allocation is None else str(allocation.status),
        "qp_iterations": 0 if allocation is None else allocation.iterations,
        "qp_slack": 0.0 if allocation is None else allocation.slack,
        "thrust_factor": plant.thrust_factor,
        "air_force": plant.air_force,
        "power_w": plant.power,
        "energy_wh": plant.energy_wh,
        "endurance_min": endurance_min(plant.mean_power),
        **costs(plant.violated, untouchable),
    }
