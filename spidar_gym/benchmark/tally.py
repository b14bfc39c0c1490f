"""Accumulation of an episode's metrics step by step, for one robot or many robots side by side."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import reduce
from typing import Any

import numpy as np

from spidar_gym.benchmark.metrics import METRICS, told_in
from spidar_gym.benchmark.track import (
    BOTH,
    FLIGHT,
    GRASPING,
    GROUND,
    course_error,
    flight_error,
    grasp_error,
    ground_error,
)
from spidar_gym.control.allocation.allocator import ANSWERED
from spidar_gym.control.flight.controller import CONTROL_RATE
from spidar_gym.envs.fleet import Fleet
from spidar_gym.envs.progress import AnyProgress, CourseProgress, CrawlProgress, FlightProgress, GraspProgress
from spidar_gym.model.interference import InterferenceConfig, no_interference
from spidar_gym.native.constants import PROGRAMS
from spidar_gym.native.engine_structs import engine_layouts
from spidar_gym.native.library import STATUS
from spidar_gym.native.structs import fill
from spidar_gym.robot import ROBOT

INTERFERENCE_TOLERANCE = 0.05
"""Angle beyond the bound of a rotor from which the interference constraint counts as violated [rad]."""
INTERFERENCE_THRUST = 1.0
"""Rotors below this thrust are ignored in the interference count [N]."""
ALLOCATED_MOST = ROBOT.max_joint_torque + 1e-3
"""Allocated joint torque above which the torque constraint counts as violated [Nm]."""
_NO_ANSWER = [code for code, status in enumerate(STATUS) if status not in ANSWERED]
_REST = PROGRAMS.index("rest")


@dataclass(frozen=True)
class Look:
    """Quantities of N robots after a step."""

    diverged: np.ndarray
    """Whether the simulation diverged, so that the other fields are invalid (N,)."""
    finished: np.ndarray
    """Whether a crawl, a course or a grasp is finished (N,)."""
    position: np.ndarray
    """Position error of a flight, world (N, 3) [m]; zeros elsewhere."""
    attitude: np.ndarray
    """Attitude error of a flight (N, 3); tilt elsewhere (N, 1) [rad]."""
    joints: np.ndarray
    """Planned minus true joint angles of a flight or crawl (N, 16) [rad]; zeros elsewhere."""
    joint_torque: np.ndarray
    """Torque of the servos (N, 16) [Nm]."""
    torque_limit: np.ndarray
    """Torque limit of the servos (N,) [Nm]."""
    thrust_command: np.ndarray
    """Commanded thrust (N, 8) [N]."""
    unsolved: np.ndarray
    """Whether the allocation found no solution (N,)."""
    breaks: np.ndarray
    """Whether a constraint is violated in a flight or crawl (N,); False elsewhere."""


class FleetWatch:
    """Reads the quantities of robots in the engine."""

    def __init__(self, fleet: Fleet, failures: Sequence[str]) -> None:
        """Store the fleet; `failures`: reasons for the end of an episode, in the order of the engine's codes."""
        self.fleet, self._diverged = fleet, failures.index("diverged")
        self._watches = np.zeros(len(fleet.robots), engine_layouts()["watch"])
        self._watches["tolerance"], self._watches["thrust"] = INTERFERENCE_TOLERANCE, INTERFERENCE_THRUST
        for watch in self._watches:
            fill(watch["config"], InterferenceConfig())
            fill(watch["bounds"], no_interference())

    def look(self, ids: np.ndarray) -> Look:
        """Return the current quantities of the robots `ids`."""
        fleet = self.fleet
        robots, infos = fleet.robots, fleet.infos[ids]
        common, plant = infos["info"], robots["plant"]
        diverged = common["failure_code"] == self._diverged
        breaks = np.abs(common["joint_torque_allocated"]).max(axis=1) > ALLOCATED_MOST
        if fleet.kind == "hover":
            fleet.engine.run("sp_watch_hover_robots", ids[~diverged], self._watches)
            position, attitude, finished = infos["position_error"], infos["attitude_error"], np.zeros(len(ids), bool)
            wanted = self._watches["planned"][ids]
            breaks |= self._watches["interferes"][ids] > 0
        elif fleet.kind in ("course", "grasp"):
            position, attitude, finished = np.zeros((len(ids), 3)), infos["tilt_rad"][:, None], infos["finished"]
            wanted, breaks = plant["state"]["joint_position"][ids], np.zeros(len(ids), bool)
        else:
            crawl = robots["crawl"]
            position, attitude, finished = np.zeros((len(ids), 3)), infos["tilt_rad"][:, None], infos["finished"]
            wanted = crawl["memory"]["joint_position"][ids]
            breaks &= (crawl["ticked"][ids] > 0) & (crawl["memory"]["mode"][ids] != _REST)
        return Look(
            diverged, finished, position, attitude, wanted - plant["state"]["joint_position"][ids],
            common["joint_torque"], plant["config"]["actuators"]["max_joint_torque"][ids], common["thrust_command"],
            np.isin(common["qp_status_code"], _NO_ANSWER), breaks,
        )  # fmt: skip


class Tally:
    """Accumulator for N episodes; the result of each depends neither on N nor on the other episodes."""

    def __init__(self, robots: int, settle: float) -> None:
        """Initialise with zeros.

        Args:
            robots: Number of episodes.
            settle: Time from which RMS errors are computed [s].
        """
        self._settling = round(settle * CONTROL_RATE)
        self.ticks = np.zeros(robots, int)
        self._numbers = np.zeros(robots, int)
        self._under_way = np.zeros(robots, int)
        self._squares: list[tuple[np.ndarray, ...]] = []
        self._thrust, self._torque = np.zeros(robots), np.zeros(robots)
        self._violations, self._unsolved = np.zeros(robots, int), np.zeros(robots, int)

    def count(self, look: Look, ids: np.ndarray) -> None:
        """Add a step of the robots `ids`; a robot's steps must be added without gaps."""
        self.ticks[ids] += 1
        good = ~look.diverged
        if not good.all():
            ids, look = ids[good], Look(**{f.name: getattr(look, f.name)[good] for f in fields(look)})
        robots = len(self.ticks)
        rows = tuple(np.zeros(robots) for _ in range(3))
        for row, errors in zip(rows, (look.position, look.attitude, look.joints), strict=True):
            row[ids] = _sum(errors * errors)
        rows[2][ids] /= look.joints.shape[1]
        self._squares.append(rows)
        self._numbers[ids] += 1
        share = np.abs(look.joint_torque).max(axis=1, initial=0.0) / look.torque_limit
        self._torque[ids] = np.maximum(self._torque[ids], share)
        self._unsolved[ids] += look.unsolved
        under_way = ~look.finished
        self._under_way[ids] += under_way
        self._thrust[ids] += np.where(under_way, _sum(look.thrust_command) / ROBOT.weight, 0.0)
        self._violations[ids] += under_way & look.breaks

    def metrics(self, robot: int, info: dict[str, Any], progress: AnyProgress) -> dict[str, Any]:
        """Return the `METRICS` of a finished episode by name (None where not defined); `info` is the last one."""
        counted = int(self.ticks[robot])
        if isinstance(progress, FlightProgress):
            world, own = FLIGHT, self._flight(robot, info, progress)
        elif isinstance(progress, CrawlProgress):
            world, own = GROUND, _crawl(info, progress)
        else:
            is_course = isinstance(progress, CourseProgress)
            world, own = (BOTH, _course(info, progress)) if is_course else (GRASPING, _grasp(info, progress))
            counted = max(1, int(self._under_way[robot]))
        if isinstance(progress, CrawlProgress) and progress.finished:
            counted = max(1, round(progress.finished * CONTROL_RATE))
        both = {
            "success": bool(info["is_success"]),
            "attitude_rms_rad": self._rms(1, robot),
            "joint_rms_rad": self._rms(2, robot),
            "energy_wh": info["energy_wh"],
            "endurance_min": info["endurance_min"],
            "thrust_mean": float(self._thrust[robot]) / counted,
            "torque_share": float(self._torque[robot]),
            "violations": int(self._violations[robot]) / counted,
            "unsolved": int(self._unsolved[robot]),
        }
        every = {**both, **own}
        found = {name: every.get(name) for name in told_in(world)}
        # Values of a diverged simulation become None.
        return {k: None if isinstance(v, float) and not v <= METRICS[k].most else v for k, v in found.items()}

    def _flight(self, robot: int, info: dict[str, Any], progress: FlightProgress) -> dict[str, Any]:
        """Return the metrics of flights."""
        position, attitude = self._rms(0, robot), self._rms(1, robot)
        late = len(progress.overdue())
        failed = bool(info["failure"]) or late > 0
        return {
            "error": flight_error(position, attitude, failed=failed),
            "failed": failed,
            "failure": info["failure"] or ("late" if late else ""),
            "position_rms_m": position,
            "late_forms": late,
            "duration_s": int(self.ticks[robot]) / CONTROL_RATE,
        }

    def _rms(self, which: int, robot: int) -> float:
        """Return the RMS after the settling time, or over the whole of a shorter episode."""
        squares = [rows[which][robot].item() for rows in self._squares[: self._numbers[robot]]]
        counted = squares[self._settling :] or squares
        return math.sqrt(sum(counted) / len(counted)) if counted else 0.0


def _crawl(info: dict[str, Any], progress: CrawlProgress) -> dict[str, Any]:
    """Return the metrics of crawls."""
    x, y, yaw = info["goal_error"].tolist()
    failed = bool(info["failure"]) or not info["finished"]
    return {
        "error": ground_error(progress.distance, info["energy_wh"] / progress.initial_distance, failed=failed),
        "failed": failed,
        "failure": info["failure"] or info["shortfalls"],
        "final_error_m": math.hypot(x, y),
        "final_yaw_rad": abs(yaw),
        "drift": progress.distance / progress.initial_distance,
        "slip_m": info["foot_slip_m"],
        "duration_s": float(info["time_s"]),
        "cost_of_transport": info["cost_of_transport"],
    }


def _course(info: dict[str, Any], progress: CourseProgress) -> dict[str, Any]:
    """Return the metrics of courses."""
    x, y, yaw = info["goal_error"].tolist()
    seconds, way, hit = float(info["time_s"]), progress.initial_distance, float(info["most_hit_n"])
    failed = bool(info["failure"]) or not info["finished"]
    return {
        "error": course_error(seconds / way, info["energy_wh"] / way, progress.distance, hit, failed=failed),
        "failed": failed,
        "failure": info["failure"] or ("" if info["finished"] else "late"),
        "final_error_m": math.hypot(x, y),
        "final_yaw_rad": abs(yaw),
        "duration_s": seconds,
        "flown_s": float(info["flown_s"]),
        "crawled_s": float(info["crawled_s"]),
        "hit_n": hit,
    }


def _grasp(info: dict[str, Any], progress: GraspProgress) -> dict[str, Any]:
    """Return the metrics of grasps."""
    seconds, force = progress.arrived or progress.time, progress.most_force
    failed = bool(info["failure"]) or not info["is_success"]
    share = force / progress.bears
    return {
        "error": grasp_error(seconds, info["energy_wh"], float(info["way_m"]), share, failed=failed),
        "failed": failed,
        "failure": info["failure"] or ("late" if failed else ""),
        "final_error_m": float(np.linalg.norm(info["object_error"])),
        "final_yaw_rad": float(info["yaw_error_rad"]),
        "duration_s": seconds,
        "lifted_m": max(0.0, progress.most_lifted),
        "force_n": force,
        "force_share": share,
        "tries": progress.tries,
    }


def _sum(rows: np.ndarray) -> np.ndarray:
    """Sum each row entry by entry, so that the result is bit-identical for any number of rows."""
    return reduce(np.add, np.moveaxis(rows, -1, 0))
