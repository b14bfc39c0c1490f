"""Courses of the runner with a nearly empty battery and a payload: λ̄ that follows the voltage, and λ̄ of the robot."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from spidar_gym.benchmark.resume import finish
from spidar_gym.control.locomotion.commands import FlyTo, Land, TakeOff
from spidar_gym.control.presets import crawler_config
from spidar_gym.model.dynamics import Model
from spidar_gym.native.formulas import max_thrust, voltage
from spidar_gym.onboard.health import HEALTH_TOPICS
from spidar_gym.onboard.runner_structs import Stage
from spidar_gym.paper.flight import noisy_robot
from spidar_gym.robot import FORMS, ROBOT
from spidar_gym.sim.energy import CAPACITY_WH, USABLE
from spidar_gym.sitl.missions import Mission, course_mission
from spidar_gym.sitl.play import Played, build_for, play
from spidar_gym.sitl.report import driven
from spidar_gym.sitl.robot import Robot
from spidar_gym.so3 import quat_to_matrix

SPENT = 0.9
"""Spent share of the battery's usable energy at the start."""
PAYLOADS = (0.0, 2.0, 2.5, 3.0)
"""Masses that the torso carries [kg]."""
SPEED = 1.5
"""Speed of the flights [m/s]."""
FELL = 0.5
"""Error of the position above which a robot has fallen, even if it flies on from the floor [m]."""
UNLIMITED = "voltage 15 15\nmotors 1 1000\n"
"""Lines without which the runner would land before the thrust limits the flight."""


@dataclass(frozen=True)
class Sagging:
    """One course of one robot."""

    payload: float
    """Mass that the torso carries [kg]."""
    follows: bool
    """Whether the robot publishes its voltage, which λ̄ follows."""
    seed: int
    """Seed of the robot and its noise."""


def sagging_mission() -> Mission:
    """Build a course of fast flights with a change of form."""
    course = course_mission(
        (
            TakeOff(1.0), FlyTo((2.0, 0.0, 2.0), None, SPEED), FlyTo((0.0, 1.0, 1.0), FORMS["form2"], SPEED),
            FlyTo((2.0, 0.0, 2.2), None, SPEED), Land(),
        )
    )  # fmt: skip
    return replace(course, text=course.text + UNLIMITED)


def sagging_robot(payload: float, mission: Mission, seed: int) -> Robot:
    """Build a noisy robot whose thrust is limited by its battery, and whose board scales all thrusts by one factor."""
    config = noisy_robot(np.random.Generator(np.random.PCG64(seed)))
    config = replace(
        config,
        body=replace(config.body, payload_mass=payload),
        actuators=replace(config.actuators, battery=True, board_scaling=True, battery_spent=SPENT),
    )
    gait = crawler_config(mission.crawler).gait
    return Robot(config, crawls=True, gait=gait, joint_speed=max(mission.speeds), seed=seed)


def sagging_figures(played: Played) -> dict[str, Any]:
    """Compute the figures of a course in the air.

    Returns:
        `completed`: without a landing, a fault or an error above `FELL`; `rms_m`, `most_m`, true position errors of the
        CoG; `scaled`, ticks whose thrusts the board scaled, of `ticks`; `volts`, the least voltage.
    """
    run, log = played.run, played.log
    rows, at = driven(run, log)
    drives, spent = (Stage.DRIVING, Stage.HOLDING, Stage.ENDING), SPENT * USABLE * CAPACITY_WH
    model, errors, scaled, least = Model(), list[float](), 0, np.inf
    for row, tick in zip(rows, at.tolist(), strict=True):
        answer, s = log.outputs[tick], row.state
        if answer["stage"] not in drives or row.in_contact:
            continue
        R_wb = quat_to_matrix(s.quat_wb)
        com_w = s.position_w + R_wb @ model.snapshot(s.joint_position, R_wb, s.vectoring).com_b
        errors.append(float(np.linalg.norm(answer["reference"]["position_w"] - com_w)))
        volts = voltage(spent + row.energy_wh, row.power)
        least = min(least, volts)
        scaled += bool(answer["command"]["thrust"].max() > min(ROBOT.max_thrust, max_thrust(volts)) + 1e-9)
    return {
        "completed": not run.board and not log.outputs["fault"][-1] and max(errors) < FELL,
        "rms_m": float(np.sqrt(np.mean(np.square(errors)))),
        "most_m": max(errors),
        "scaled": scaled,
        "ticks": len(errors),
        "volts": float(least),
    }


def play_sagging(course: Sagging) -> dict[str, Any]:
    """Run a course; return its figures."""
    mission, silent = sagging_mission(), () if course.follows else (HEALTH_TOPICS["voltage"][0],)
    played = play(
        mission, seed=course.seed, silent=silent, robot=lambda seed: sagging_robot(course.payload, mission, seed)
    )
    return {"payload_kg": course.payload, "follows": course.follows, "seed": course.seed, **sagging_figures(played)}


def sagging_courses(payloads: Iterable[float], robots: int) -> list[Sagging]:
    """Return the courses of a study: each robot with each payload, with and without the voltage."""
    return [Sagging(kg, follows, seed) for kg in payloads for follows in (True, False) for seed in range(robots)]


def sagging_study(
    payloads: Iterable[float] = PAYLOADS, robots: int = 4, *, workers: int = 1, folder: Path | None = None,
    on_course: Callable[[], object] = lambda: None,
) -> list[dict[str, Any]]:  # fmt: skip
    """Run every course; return the figures of each. Figures in `folder` are not computed again."""
    build_for("socket")  # once, before several processes need it
    courses = sagging_courses(payloads, robots)
    return finish(play_sagging, courses, workers=workers, folder=folder, on_done=lambda *_: on_course())


def sagging_lines(rows: Sequence[dict[str, Any]]) -> list[list[str]]:
    """Build the table: a line per payload, with and without the voltage."""
    lines = [["payload [kg]", "λ̄", "completed", "RMS error [mm]", "worst error [mm]", "ticks scaled by the board",
              "least voltage [V]"]]  # fmt: skip
    for payload, follows in dict.fromkeys((row["payload_kg"], row["follows"]) for row in rows):
        own = [row for row in rows if (row["payload_kg"], row["follows"]) == (payload, follows)]
        rms, most, scaled, volts = ([row[name] for row in own] for name in ("rms_m", "most_m", "scaled", "volts"))
        lines.append(
            [f"{payload:g}", "follows" if follows else "42 N", f"{sum(row['completed'] for row in own)} of {len(own)}",
             f"{1e3 * min(rms):.0f} … {1e3 * max(rms):.0f}", f"{1e3 * max(most):.0f}",
             f"{min(scaled)} … {max(scaled)}", f"{min(volts):.1f}"]
        )  # fmt: skip
    return lines
