"""Figures of a run with the simulated robot: those of the paper's experiments, and the table of faults."""

import math
from collections.abc import Mapping
from itertools import groupby
from types import SimpleNamespace
from typing import Any

import numpy as np

from spidar_gym.control.crawl.footsteps import Move
from spidar_gym.control.crawl.gait import nominal_time
from spidar_gym.control.crawl.phases import PHASES
from spidar_gym.control.crawl.pose2 import Pose2, torso_pose2
from spidar_gym.control.flight.controller import CONTROL_RATE
from spidar_gym.control.presets import crawler_config
from spidar_gym.errors import SpidarError
from spidar_gym.logs.runner_log import RunnerLog
from spidar_gym.model.dynamics import Model
from spidar_gym.native.library import STATUS
from spidar_gym.onboard.runner_structs import Action, FlightState, Stage
from spidar_gym.paper.crawl import CrawlLog
from spidar_gym.paper.flight import FLIGHT_SECONDS, FlightLog
from spidar_gym.policies.rollout import columns
from spidar_gym.robot import GRAVITY, ROBOT
from spidar_gym.sim.ground import Touch
from spidar_gym.sitl.faults import FAULTS
from spidar_gym.sitl.missions import Mission
from spidar_gym.sitl.robot import DT
from spidar_gym.sitl.session import AFTER_FAULT, Row, Run
from spidar_gym.so3 import euler_angles, quat_to_matrix
from spidar_gym.so3 import log as so3_log
from spidar_gym.tasks.crawl import SATURATED, TURN_LENGTH, CrawlTask
from spidar_gym.text import format_table


def drive_times(run: Run, log: RunnerLog) -> tuple[np.ndarray, np.ndarray]:
    """Return the ticks of the drive and their times by the robot's clock [s].

    Raises:
        SpidarError: When the runner never drove.
    """
    driving = np.flatnonzero(log.outputs["stage"] > Stage.WAITING)
    if not len(driving) or not math.isfinite(run.first_driven):
        raise SpidarError("the runner never drove; valid: a run whose runner says `driving`")
    times = log.inputs["time"][driving]
    # Over ROS the two clocks start at different times; the robot's stamps are multiples of its step.
    stamp = float(log.inputs["measurement"]["encoder_time"][driving[0]])
    return driving, times - (stamp - DT * round((stamp - float(times[0]) + run.first_driven) / DT))


def driven(run: Run, log: RunnerLog) -> tuple[list[Row], np.ndarray]:
    """Return the rows of the drive, and for each row the runner's tick whose command acted in it."""
    driving, times = drive_times(run, log)
    rows = [row for row in run.rows if run.first_driven < row.time <= times[-1] + 1.0 / CONTROL_RATE]
    at = np.searchsorted(times, [row.time - 1.0 / CONTROL_RATE + 1e-9 for row in rows], side="right") - 1
    return rows, driving[np.clip(at, 0, len(driving) - 1)]


def flight_log(run: Run, log: RunnerLog, mission: Mission) -> FlightLog:
    """Return the experiment's part of a flight, with the true errors relative to the runner's reference."""
    rows, at = driven(run, log)
    model, kept = Model(), list[dict[str, Any]]()
    for row, tick in zip(rows, at.tolist(), strict=True):
        time = row.time - run.first_driven - mission.begins
        if not 0.0 < time <= FLIGHT_SECONDS + 1e-9:
            continue
        s, answer, compute = row.state, log.outputs[tick], log.clock[tick]["compute_us"]
        R_wb, R_d = quat_to_matrix(s.quat_wb), quat_to_matrix(answer["reference"]["quat_wb"])
        com_w = s.position_w + R_wb @ model.snapshot(s.joint_position, R_wb, s.vectoring).com_b
        kept.append(
            {
                "time": time,
                "position_error": answer["reference"]["position_w"] - com_w,
                "attitude_error": so3_log(R_wb.T @ R_d),
                "joint_position": s.joint_position,
                "joint_torque": answer["joint_torques"],
                "vectoring": s.vectoring,
                "thrust": s.thrust,
                "solve_time": 1e-6 * compute,
                "status": str(STATUS[answer["status"]]),
                "air_force": row.air_force,
                "power": row.power,
                "qpos": row.qpos,
            }
        )
    if len(kept) < round(FLIGHT_SECONDS * CONTROL_RATE) - 2:
        raise SpidarError(
            f"the flight ended after {len(kept) / CONTROL_RATE:.1f} s of the experiment; valid: a whole one"
        )
    return FlightLog(mission.preset, **columns(kept), noise=True)


def _to_goal(goal: Pose2, position_w: np.ndarray, R_wb: np.ndarray) -> np.ndarray:
    """Return goal − torso: x, y in the world [m], and yaw [rad]."""
    yaw = math.remainder(goal.yaw - math.atan2(R_wb[1, 0], R_wb[0, 0]), 2.0 * math.pi)
    return np.array([goal.x - position_w[0], goal.y - position_w[1], yaw])


def crawl_log(run: Run, log: RunnerLog, mission: Mission) -> CrawlLog:
    """Return the crawl, with the true errors and the `info` that the environment would report."""
    rows, at = driven(run, log)
    config = crawler_config(mission.preset)
    assert mission.way is not None
    first = rows[0].state
    start = torso_pose2(first.position_w, quat_to_matrix(first.quat_wb))
    seconds = nominal_time(config.gait, [Move(mission.way)], joint_speed=config.joint_speed, dt=1.0 / CONTROL_RATE)
    goal, weight = start @ mission.way, ROBOT.weight
    kept, touches, attitudes, contacts, energy = list[dict[str, Any]](), list[Touch](), [], [], 0.0
    finished, timeouts = 0.0, 0
    for row, tick in zip(rows, at.tolist(), strict=True):
        s, answer = row.state, log.outputs[tick]
        R_wb, phase = quat_to_matrix(s.quat_wb), PHASES[answer["phase"]]
        assert isinstance(row.touch, Touch)
        touches.append(row.touch)
        attitudes.append(R_wb)
        kept.append(
            {
                "time": row.time - run.first_driven,
                "phase": phase,
                "position_w": s.position_w,
                "euler": euler_angles(R_wb),
                "joint_position": s.joint_position,
                "joint_torque": s.joint_torque,
                "vectoring": s.vectoring,
                "thrust": s.thrust,
                "thrust_command": answer["command"]["thrust"],
                "power": row.power,
                "solve_time": 1e-6 * log.clock[tick]["compute_us"],
                "status": str(STATUS[answer["status"]]),
                "qpos": row.qpos,
            }
        )
        contacts.append(row.contacts)
        energy = row.energy_wh - rows[0].energy_wh
        timeouts = int(answer["timeouts"])
        if answer["finished"]:
            finished = len(kept) / CONTROL_RATE
            break
    series = columns(kept)
    swings = series["phase"] == "swing"
    feet, slips = np.array([touch.feet for touch in touches]), np.array([touch.foot_slip for touch in touches])
    off = np.array([_to_goal(goal, place, R) for place, R in zip(series["position_w"], attitudes, strict=True)])
    distance = np.hypot(off[:, 0], off[:, 1]) + TURN_LENGTH * np.abs(off[:, 2])
    share = series["thrust_command"].sum(axis=1) / weight
    reached = {
        "finished": finished, "nominal_time": seconds, "timeouts": timeouts,
        "position_error": math.hypot(off[-1, 0], off[-1, 1]), "yaw_error": abs(off[-1, 2]),
        "airborne": float((~feet[swings]).mean(axis=0).min()) if swings.any() else 1.0,
        "foot_slip": float(slips.sum(axis=0).max() / CONTROL_RATE),
        "duct_touched": any(touch.ducts for touch in touches),
    }  # fmt: skip
    shown: Any = SimpleNamespace(**{name: np.array([value], float) for name, value in reached.items()})
    missed = [word for word, is_missed in CrawlTask().shortfalls(shown).items() if is_missed[0]]
    saturated = np.abs(series["joint_torque"]) >= config.joint_torque_limit - SATURATED
    info = {
        "time_s": finished or len(kept) / CONTROL_RATE,
        "thrust_fraction_mean": float(share.mean()),
        "thrust_fraction_peak": float(share.max()),
        "foot_slip_m": reached["foot_slip"],
        "peg_slip_m": float(np.sum([touch.peg_slip for touch in touches], axis=0).max() / CONTROL_RATE),
        "airborne_share": reached["airborne"],
        "duct_clearance_m": min(touch.duct_clearance for touch in touches),
        "saturation_share": float(saturated.mean()),
        "timeouts": timeouts,
        "energy_wh": energy,
        "cost_of_transport": 3600.0 * energy / (ROBOT.total_mass * GRAVITY * max(distance[0] - distance[-1], 1e-3)),
        "is_success": not missed,
        "shortfalls": ", ".join(missed),
    }
    return CrawlLog(
        mission.preset,
        joint_speed=config.joint_speed,
        noise=True,
        **series,
        contacts=contacts,
        goal_error=off[-1],
        info=info,
    )


def robot_test_figures(run: Run, log: RunnerLog) -> dict[str, Any]:
    """Compute the figures of a test of the robot: its time, what it moved, and whether it was ended early.

    Returns:
        `seconds`; `deviation_rad`, the largest difference of an estimated joint angle from its command;
        `joint_rate_rad_s`, the largest true one; `tilt_rad`; `off_m`, the largest distance of the torso from where the
        test began; `aborted`, whether the runner ended its excitations; `landed`, whether the board landed the robot.
    """
    drive = log.outputs[np.isin(log.outputs["stage"], (Stage.DRIVING, Stage.RESTING))]
    off = np.abs(drive["state"]["joint_position"] - drive["command"]["joint_position"])
    rows = [row for row in run.rows if run.first_driven < row.time <= run.first_driven + drive["mission_time"].max()]
    places = np.array([row.state.position_w for row in rows])
    return {
        "seconds": float(drive["mission_time"].max()),
        "deviation_rad": float(off.max()),
        "joint_rate_rad_s": float(max(np.abs(row.state.joint_velocity).max() for row in rows)),
        "tilt_rad": max(row.tilt for row in rows),
        "off_m": float(np.linalg.norm(places - places[0], axis=1).max()),
        "aborted": bool(log.outputs["aborted"].any()),
        "landed": bool(run.board),
    }


def robot_test_table(tests: Mapping[str, Mapping[str, Any]]) -> str:
    """Format the table of tests of the robot."""
    lines = [("test", "time [s]", "joint off its command [mrad]", "joint rate [rad/s]", "tilt [mrad]",
            "torso moved [mm]", "ended early")]  # fmt: skip
    lines += [
        (
            name, f"{t['seconds']:.1f}", f"{1e3 * t['deviation_rad']:.0f}", f"{t['joint_rate_rad_s']:.2f}",
            f"{1e3 * t['tilt_rad']:.0f}", f"{1e3 * t['off_m']:.0f}",
            "landing forced" if t["landed"] else "yes" if t["aborted"] else "no",
        )
        for name, t in tests.items()
    ]  # fmt: skip
    return format_table(lines)


def timing(log: RunnerLog) -> dict[str, float]:
    """Compute the runner's timing: computing time and delay of a tick [µs], longest period [ms], number of ticks."""
    compute, wait = log.clock["compute_us"], log.clock["wait_us"]
    periods = np.diff(log.inputs["time"])
    figures = {"compute_median_us": float(np.median(compute)), "compute_max_us": float(compute.max())}
    if (wait >= 0.0).any():
        figures |= {"wait_median_us": float(np.median(wait)), "wait_p99_us": float(np.percentile(wait, 99)),
                    "wait_max_us": float(wait.max())}  # fmt: skip
    return {**figures, "period_max_ms": 1e3 * float(periods.max()) if len(periods) else 0.0, "ticks": len(compute)}


def within_bounds(outputs: np.ndarray) -> bool:
    """Return whether all commands of a drive (`sp_loop_output`) are within the limits of rotors and joints."""
    thrust, joints = outputs["command"]["thrust"], np.abs(outputs["command"]["joint_position"])
    return bool(
        np.isfinite(thrust).all() and thrust.min() >= -1e-9 and thrust.max() <= ROBOT.max_thrust + 1e-6
        and joints.max() <= ROBOT.joint_limit + 1e-6
    )  # fmt: skip


def fault_figures(name: str, run: Run, log: RunnerLog) -> dict[str, Any]:
    """Compute the figures of a fault.

    `reaction` is the specified reaction. `as_specified` requires that the reaction happened, that commands were held
    for at most 100 ms, that no command was out of bounds, and that nothing was published after the landing was
    commanded.
    """
    end = run.fault_at + AFTER_FAULT if run.landing_at == math.inf else math.inf
    after = [row for row in run.rows if run.fault_at <= row.time <= end]
    drive = log.outputs["stage"] > Stage.WAITING
    holds = [len(list(ticks)) for stage, ticks in groupby(log.outputs["stage"].tolist()) if stage == Stage.HOLDING]
    held = max(holds, default=0) / CONTROL_RATE
    thrust, bounded = log.outputs["command"]["thrust"][drive], within_bounds(log.outputs[drive])
    actions = log.outputs["action"]
    landing = np.flatnonzero(actions == Action.FORCE_LANDING)
    silent = not len(landing) or bool((actions[landing[0] :] != Action.PUBLISH).all() and actions[-1] == Action.SILENT)
    if run.board == "commanded":
        happened = "lands"
    elif run.board:
        happened = "board lands"
    elif (log.outputs["stage"] == Stage.ENDING).any():
        happened = "ends"
    else:
        happened = "flies on" if after and after[-1].flight_state == FlightState.HOVER else "lost"
    specified = FAULTS[name]
    fall = [row for row in after if row.time >= run.landing_at]
    touch = next((k for k, row in enumerate(fall) if row.in_contact), None)
    down = math.inf if touch is None else fall[touch].time
    fault = int(log.outputs["fault"][-1]) if len(log.outputs) else 0
    if not fault:
        fault = int(log.outputs["fault"].max(initial=0))
    return {
        "fault": name,
        "doc": specified.doc,
        "reaction": specified.reaction,
        "happened": happened,
        "runner_fault": fault,
        "runner_words": next((line for line in run.words if "holding" in line or "forcing" in line), ""),
        "held_ms": 1e3 * held,
        "landing_after_ms": None if run.landing_at == math.inf else 1e3 * (run.landing_at - run.fault_at),
        "peak_tilt_rad": max((row.tilt for row in after if row.time <= down), default=0.0),
        "touchdown_speed_m_s": None if touch is None else float(-fall[max(touch - 1, 0)].state.velocity_w[2]),
        "largest_thrust_n": float(thrust.max()) if len(thrust) else 0.0,
        "bounded": bounded,
        "silent_after_landing": silent,
        "as_specified": happened == specified.reaction and bounded and silent and held <= 0.1 + 1e-9,
    }


def fault_table(rows: list[dict[str, Any]]) -> str:
    """Format the table of faults."""

    def number(value: float | None, digits: int) -> str:
        return "–" if value is None else f"{value:.{digits}f}"

    lines = [("fault", "what", "specified", "happened", "held [ms]", "landing after [ms]", "peak tilt [rad]",
            "touchdown [m/s]", "largest λ [N]", "as specified")]  # fmt: skip
    lines += [
        (
            r["fault"], r["doc"], r["reaction"], r["happened"], number(r["held_ms"], 0),
            number(r["landing_after_ms"], 0), number(r["peak_tilt_rad"], 3), number(r["touchdown_speed_m_s"], 2),
            number(r["largest_thrust_n"], 1), "yes" if r["as_specified"] else "NO",
        )
        for r in rows
    ]  # fmt: skip
    return format_table(lines)
