"""The one robot of a fleet, as an environment of a single robot tells of it: in objects, words and single numbers."""

import math
from collections.abc import Iterable, Sequence
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


def drawn(fleet: Fleet, robot: int = 0) -> dict[str, np.ndarray]:
    """What was drawn of a robot, by field of `PlantConfig`."""
    numbers, draws, at = fleet.robots[robot]["episode"]["drawn"], dict[str, np.ndarray](), 0
    for row in TABLE:
        size = math.prod(row.shape)
        draws[row.field] = numbers[at : at + size].reshape(row.shape).copy()
        at += size
    return draws


def info(
    fleet: Fleet, terms: Iterable[str], failures: Sequence[str], robot: int = 0, judge: Judge | None = None
) -> dict[str, Any]:
    """What is told of a robot, an array, a number or a word each.

    Args:
        fleet: It and others.
        terms: Names of the terms of the reward, in the order of who judges.
        failures: Why an episode may be over, in the same order.
        robot: Its number.
        judge: Who judges, where the engine does not.
    """
    now = told(fleet.infos[robot : robot + 1].copy())
    found = {name: value[0] if value.ndim > 1 else value.item() for name, value in now.items()}
    status, failure = found.pop("qp_status_code"), found.pop("failure_code")
    found["qp_status"] = "none" if status < 0 else str(STATUS[status])
    built_in = found.pop("term")
    values = built_in if judge is None else judge.terms[robot]
    for name, value in zip(terms, values.tolist(), strict=True):
        found[f"reward_{name}"] = value
    found["failure"] = "" if failure < 0 else failures[failure]
    return found


def readable_info(
    state: RobotState, command: Command | None, controller: FlightControl | CrawlControl | Orders, plant: Plant
) -> dict[str, Any]:
    """What `info` gives in every environment, where controller and task are in Python.

    Args:
        state: The true one.
        command: The last, if there is one.
        controller: What allocated.
        plant: What was simulated.
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
    }
