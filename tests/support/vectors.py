"""Flights by which vectors are tested: every sampling of forms, every action mode, and kinds of robots."""

import statistics
import time
from typing import Any

import numpy as np

from spidar_gym.control.crawl.phases import PHASES
from spidar_gym.native.library import STATUS
from spidar_gym.sim.actuators import ActuatorConfig
from spidar_gym.sim.config import PlantConfig
from spidar_gym.sim.randomize import OPTIONAL_ROWS
from spidar_gym.tasks.crawl import SHORTFALLS

DRAWN: dict[str, Any] = {
    "randomization": 1.0,
    "sensors": True,
    "battery": True,
    "disturbances": {"wind": 2.0, "push": 20.0},
}
WORN: dict[str, Any] = DRAWN | {
    "randomization": {"strength": 1.0} | {row.field: (row.low, row.high) for row in OPTIONAL_ROWS},
    "plant": PlantConfig(actuators=ActuatorConfig(board_scaling=True)),
}
"""All that `DRAWN` varies, every optional row of the randomisation, and a board that scales the thrusts."""
WORN_ON_COURSES: dict[str, Any] = WORN | {
    "randomization": {name: given for name, given in WORN["randomization"].items() if not name.startswith("ground.")}
}
"""`WORN` on the even floor on which courses are built."""
FLIGHTS: dict[str, dict[str, Any]] = {
    "mixed": {},
    "the paper's forms": {"forms": "paper"},
    "narrow": {"forms": "narrow", "joint_speed": 1.0},
    "equal": {"forms": "equal", "avoid_interference": False},
    "joints": {"action_mode": "residual_joint", "forms": "independent"},
    "both": {"action_mode": "residual", "unrestricted": ((0.2, 0.5),)},
    "forces": {"action_mode": "residual_force", "forms": "independent"},
    "drawn": {"preset": "tuned", **DRAWN},
    "worn": {"preset": "tuned", **WORN},
    "half drawn, no air": {"randomization": 0.5, "wake": False},
    "a lost thrust": {"forms": "form1", "disturbances": {"lost_rotor": 3, "fault_time": 0.5}},
    "a stuck module": {"forms": "form2", "disturbances": {"lost_rotor": 6, "fault": "vectoring", "fault_time": 0.5}},
    "alone": {"action_mode": "direct", "forms": "form1"},
}


def code(word, words):
    return -1 if word in ("", "none") else words.index(word)


def expected(info, terms, failures):
    """The `info` of a single environment in the format of the vector."""
    told = {name: value for name, value in info.items() if not isinstance(value, str | dict)}
    told["term"] = [told[f"reward_{name}"] for name in terms]
    told["qp_status_code"] = code(info["qp_status"], [str(word) for word in STATUS])
    told["failure_code"] = code(info["failure"], list(failures))
    if "phase" in info:
        told["phase_code"] = PHASES.index(info["phase"])
        shortfalls = [word for word in info["shortfalls"].split(", ") if word]
        told["shortfalls_code"] = sum(1 << SHORTFALLS.index(word) for word in shortfalls)
    return told


def speed_share(built_in: Any, own: Any) -> float:
    """Speed of `own` relative to `built_in` by processor time, measured in turn, so that other load affects both."""
    spent: tuple[list[float], list[float]] = [], []
    for env in (built_in, own):
        env.reset(seed=0)
    for _ in range(9):
        for env, seconds in zip((built_in, own), spent, strict=True):
            start = time.process_time()
            for _ in range(20):
                env.step(np.zeros(env.action_space.shape))
            seconds.append(time.process_time() - start)
    built_in.close()
    own.close()
    return statistics.median(a / b for a, b in zip(*spent, strict=True))
