"""Logs of the runner: the structs of its ticks as arrays, and their conversion to a record."""

import hashlib
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from spidar_gym.border import BorderError
from spidar_gym.control.crawl.phases import PHASES as GAIT_PHASES
from spidar_gym.control.locomotion.orders import PHASES as MANAGER_PHASES
from spidar_gym.logs.record import Record, Series, ordered
from spidar_gym.logs.topics import FORMATS
from spidar_gym.native.library import STATUS
from spidar_gym.native.structs import WORDS
from spidar_gym.onboard.health import N_SERVOS
from spidar_gym.onboard.message_types import FORCE_LANDING
from spidar_gym.onboard.messages import ORDERS, STATE_NAMES
from spidar_gym.onboard.parameters import text_of
from spidar_gym.onboard.runner_header import runner_hash
from spidar_gym.onboard.runner_structs import (
    FAULTS,
    MAGIC,
    STAGES,
    Action,
    Heard,
    LogKind,
    MissionKind,
    log_layouts,
)
from spidar_gym.robot import GIMBAL_NAMES, JOINT_NAMES, N_ROTORS
from spidar_gym.state import IMU_SAMPLES, POSE_FRAMES

NEVER = -1e8
"""Upper limit of times that stand for a message which never came [s]."""
_STAGE_TEXTS = {int(stage): text for text, stage in STAGES.items()}
_FAULT_TEXTS = tuple(FAULTS.values())
ABORTED = "the excitations are ended: a joint is too far from its command"
"""Event of a test of the robot."""
SERVO_COLUMNS = {
    "angle": "servo_angle", "temperature": "servo_temperature", "load": "servo_load", "error": "servo_error",
}  # fmt: skip
"""Columns of `servo/states` → members of the runner's input."""
CODES = {
    "action": len(Action), "stage": len(STAGES), "fault": len(FAULTS), "status": len(STATUS), "finished": 2,
    "aborted": 2, "phase": len(GAIT_PHASES), "manager_phase": len(MANAGER_PHASES), "heard": len(Heard),
}  # fmt: skip
"""Codes of an output, and their upper limits (exclusive)."""


@dataclass(frozen=True)
class RunnerLog:
    """A log of the runner; the arrays have a record for every tick."""

    inputs: np.ndarray
    """(n,) records of `sp_loop_input`."""
    outputs: np.ndarray
    """(n,) records of `sp_loop_output`."""
    clock: np.ndarray
    """(n,) records of `sp_log_clock`."""
    mission: np.void
    """Record of `sp_mission`."""
    interface: str
    """Hash of the interface."""
    model: str
    """SHA-256 of the robot's model."""
    parameters: str
    """SHA-256 of the runner's parameters: robot, gains and limits."""
    digest: str
    """SHA-256 of the file."""
    warnings: tuple[str, ...] = ()
    """What could not be read."""


def is_runner_log(start: bytes) -> bool:
    """Return whether a file that starts with these bytes is a log of the runner or of a controller."""
    return start.startswith(MAGIC.encode())


def read_runner_log(path: Path) -> RunnerLog:
    """Read the log of a run; ticks that are incomplete or damaged are left out, with a warning.

    Args:
        path: File that `runner sim --log` or `runner ros1 --log` wrote.

    Raises:
        BorderError: For a file that cannot be read or is no log of a run, and for logs of another interface.
    """
    try:
        data = path.read_bytes()
    except (OSError, ValueError) as error:
        raise BorderError(f"cannot read {path}: {getattr(error, 'strerror', None) or error}") from error
    types = log_layouts()
    head_type, mission = types["log_head"], types["mission"]
    start = head_type.itemsize + mission.itemsize
    head = np.frombuffer(data[: head_type.itemsize].ljust(head_type.itemsize, b"\0"), head_type)[0]
    if not is_runner_log(data) or head["kind"] != LogKind.RUN:
        raise BorderError(f"{path} is no log of a run; valid: what `runner sim --log` or `runner ros1 --log` wrote")
    interface, ours = head["interface"].tobytes().decode(errors="replace"), runner_hash()
    if interface != ours:
        raise BorderError(
            f"{path} is of the interface {interface!r:.60}, not {ours}; valid: conversion with the version of "
            f"spidar_gym that wrote it"
        )
    if len(data) < start:
        raise BorderError(
            f"{path} is cut after {len(data)} bytes, before its first tick; valid: at least {start} bytes"
        )
    tick = np.dtype([("input", types["loop_input"]), ("output", types["loop_output"]), ("clock", types["log_clock"])])
    count, rest = divmod(len(data) - start, tick.itemsize)
    ticks, warnings = np.frombuffer(data, tick, count, start), list[str]()
    good = _whole(ticks)
    if not good.all():
        first = int(np.argmin(good))
        warnings.append(f"{int((~good).sum())} of {count} ticks are damaged, the first at byte "
                        f"{start + first * tick.itemsize}: left out")  # fmt: skip
        ticks = ticks[good]
    if rest:
        warnings.append(f"the file is cut: the last tick has {rest} of {tick.itemsize} bytes: left out")
    return RunnerLog(
        ticks["input"], ticks["output"], ticks["clock"], np.frombuffer(data, mission, 1, head_type.itemsize)[0],
        interface, text_of(head["model"]), text_of(head["parameters"]), hashlib.sha256(data).hexdigest(),
        tuple(warnings),
    )  # fmt: skip


def _whole(ticks: np.ndarray) -> np.ndarray:
    """Return which ticks a runner can have written (n,): damaged ones have other codes, counts or times."""
    inputs, outputs = ticks["input"], ticks["output"]
    m, time = inputs["measurement"], inputs["time"]
    # A link writes the tick's time twice; ticks that are not aligned in the file do not agree in it.
    good = np.isfinite(time) & (np.abs(time) < -NEVER) & (time == m["time"])
    for counts, most in ((m["pose_count"], POSE_FRAMES), (m["imu_count"], IMU_SAMPLES),
                         (inputs["has_odometry"], 1), (inputs["has_thrust"], 1)):  # fmt: skip
        good &= (counts >= 0) & (counts <= most)
    for name, most in CODES.items():
        good &= (outputs[name] >= 0) & (outputs[name] < most)
    # Zeros, which a failed disk returns: a link never sends both.
    return good & ~((time == 0.0) & (m["encoder_time"] == 0.0) & (inputs["flight_state_time"] == 0.0))


def runner_record(log: RunnerLog) -> Record:
    """Convert a log of the runner to a record."""
    found = (*_received(log), *_published(log), *_decided(log))
    return Record(
        "run",
        ordered({series.topic: series for series in found}),
        properties={
            "interface": log.interface,
            "model": log.model,
            "parameters": log.parameters,
            "mission": MissionKind(int(log.mission["kind"])).name.lower() if _is_mission(log.mission) else "unknown",
            "sha256": log.digest,
        },
        warnings=log.warnings if _is_mission(log.mission) else ("the mission is damaged", *log.warnings),
        attachments={"mission.json": json.dumps(_plain(log.mission), indent=1).encode()},
    )


def _is_mission(mission: np.void) -> bool:
    return int(mission["kind"]) in tuple(MissionKind)


def _plain(value: Any) -> Any:  # noqa: ANN401 - a numpy record and JSON
    """Convert a record to JSON; zeros at the end of lists are left out, NaN and infinity are text."""
    if isinstance(value, np.void):
        return {name: _plain(value[name]) for name in value.dtype.names or () if not name.startswith("unused")}
    if isinstance(value, np.ndarray) and value.ndim:
        used = [k for k, each in enumerate(value) if any(each.tobytes())]
        return [_plain(each) for each in value[: used[-1] + 1 if used else 0]]
    plain = value.item()
    return plain if not isinstance(plain, float) or np.isfinite(plain) else str(plain)


def _series(topic: str, received: np.ndarray, values: dict[str, np.ndarray], time: np.ndarray | None = None) -> Series:
    """Return a series of the runner, with the names of its topic."""
    shaped = dict[str, np.ndarray]()
    for column in FORMATS[topic].columns:
        if column.name in values:
            found = values[column.name]
            found = found.reshape(len(found), *column.shape) if column.shape else found
            shaped[column.name] = found.astype(np.int64) if found.dtype.kind in "iu" else found
    return Series(topic, received if time is None else time, received, shaped, FORMATS[topic].names)


def _new(times: np.ndarray) -> np.ndarray:
    """Return the ticks with a new message, from the time of the last message at every tick."""
    came = ~(times <= NEVER)
    came[1:] &= (times[1:] != times[:-1]) & ~(np.isnan(times[1:]) & np.isnan(times[:-1]))
    return np.flatnonzero(came)


def _received(log: RunnerLog) -> list[Series]:
    """Return the messages that the runner received."""
    inputs, now = log.inputs, log.inputs["time"]
    m, found = inputs["measurement"], []
    at = _new(m["encoder_time"])
    at = at[m["joint_position"][at].any(axis=1)]  # before the first message a link may send zeros
    gimbals = np.full((len(at), 2 * N_ROTORS), np.nan)
    joints = {
        "position": np.concatenate([m["joint_position"][at], m["vectoring"][at]], axis=1),
        "effort": np.concatenate([m["joint_torque"][at], gimbals], axis=1),
    }
    found.append(Series("joint_states", m["encoder_time"][at], now[at], joints, STATE_NAMES))
    for topic, count, most, stamp, members in (
        ("imu", "imu_count", IMU_SAMPLES, "imu_time", {"specific_force": ("specific_force_b", 3),
                                                       "angular_velocity": ("gyro_b", 3)}),
        ("mocap/pose", "pose_count", POSE_FRAMES, "pose_time", {"position_w": ("pose_position_w", 3),
                                                                "quat_wb": ("pose_quat_wb", 4)}),
    ):  # fmt: skip
        tick, row = np.nonzero(np.arange(most) < m[count][:, None])
        values = {name: m[own].reshape(-1, most, size)[tick, row] for name, (own, size) in members.items()}
        found.append(_series(topic, now[tick], values, m[stamp][tick, row]))
    at, odometry = np.flatnonzero(inputs["has_odometry"]), inputs["odometry"]
    values = {name: odometry[name][at] for name in ("position_w", "quat_wb", "velocity_w", "omega_b")}
    found.append(_series("uav/cog/odom", now[at], values, odometry["time"][at]))
    at = _new(inputs["flight_state_time"])
    found.append(_series("flight_state", inputs["flight_state_time"][at], {"data": inputs["flight_state"][at]}))
    found += _health(inputs["health"], now)
    at = np.flatnonzero(inputs["has_thrust"])
    found.append(_series("runner/other_command", now[at], {"base_thrust": inputs["thrust"][at]}))
    at = np.flatnonzero(inputs["orders"][:, 0])
    orders = [inputs["orders"][k].tobytes().partition(b"\0")[0].decode(errors="replace") for k in at]
    found.append(_series(ORDERS.name, now[at], {"data": np.array(orders, object)}))
    return found


def _health(health: np.ndarray, now: np.ndarray) -> list[Series]:
    """Return the messages about the robot's health, from the last one at every tick."""
    found, times = [], {name: health[name] for name in ("voltage_time", "servo_time", "motor_time")}
    at = _new(times["voltage_time"])
    found.append(_series("battery_voltage_status", now[at], {"data": health["voltage"][at]}, times["voltage_time"][at]))
    at = _new(times["servo_time"])
    values = {name: health[own][at] for name, own in SERVO_COLUMNS.items()}
    values["index"] = np.broadcast_to(np.arange(N_SERVOS), values["angle"].shape)
    found.append(_series("servo/states", now[at], values, times["servo_time"][at]))
    at = _new(times["motor_time"])
    found.append(_series("motor_pwms", now[at], {"motor_value": health["motor_output"][at]}, times["motor_time"][at]))
    return found


def _published(log: RunnerLog) -> list[Series]:
    """Return the commands that the link published."""
    action = log.outputs["action"]
    at = np.flatnonzero(action == Action.PUBLISH)
    now, command = log.inputs["time"][at], log.outputs["command"][at]
    landing = np.flatnonzero(action == Action.FORCE_LANDING)
    return [
        _series("four_axes/command", now, {"angles": np.zeros((len(at), 3)), "base_thrust": command["thrust"]}),
        Series("gimbals_ctrl", now, now, {"position": command["vectoring"]}, GIMBAL_NAMES),
        Series("joints_ctrl", now, now, {"position": command["joint_position"]}, JOINT_NAMES),
        Series("joints_torque_ctrl", now, now, {"effort": command["joint_torque_limit"]}, JOINT_NAMES),
        _series("flight_config_cmd", log.inputs["time"][landing], {"cmd": np.full(len(landing), FORCE_LANDING)}),
    ]


def _decided(log: RunnerLog) -> list[Series]:
    """Return what the runner computed: estimates, references, allocations, statuses, events."""
    outputs, now, kind, found = log.outputs, log.inputs["time"], int(log.mission["kind"]), []
    for topic, struct in (("runner/estimate", "state"), ("runner/reference", "reference")):
        at = np.flatnonzero(outputs[struct]["quat_wb"].any(axis=1))  # zeros before the first one
        part = outputs[struct][at]
        values = {column.name: part[column.name] for column in FORMATS[topic].columns}
        if "mode" in values:
            values["mode"] = _texts(WORDS["reference", "mode"], values["mode"])
        found.append(_series(topic, now[at], values))
    at = np.flatnonzero(outputs["action"] == Action.PUBLISH)
    part = outputs[at]
    values = {name: part[name] for name in ("forces_l", "joint_torques", "status", "iterations")}
    values["status_text"] = _texts([str(word) for word in STATUS], part["status"])
    found.append(_series("runner/allocation", now[at], values))
    values = {column.name: outputs[column.name] for column in FORMATS["runner/status"].columns
              if not column.name.endswith("_text")}  # fmt: skip
    values |= {
        "stage_text": _texts([_STAGE_TEXTS[k] for k in range(len(STAGES))], outputs["stage"]),
        "fault_text": _texts(_FAULT_TEXTS, outputs["fault"]),
        "phase_text": _texts(GAIT_PHASES if kind != MissionKind.FLIGHT else [""], outputs["phase"]),
        "manager_phase_text": _texts(MANAGER_PHASES if kind == MissionKind.COURSE else [""], outputs["manager_phase"]),
    }
    found.append(_series("runner/status", now, values))
    found.append(_series("runner/timing", now, {name: log.clock[name] for name in ("wait_us", "compute_us")}))
    if outputs["policy_action"].any():
        found.append(_series("runner/policy", now, {"action": outputs["policy_action"]}))
    ticks, lines = events(log)
    found.append(_series("runner/events", now[ticks], {"data": np.array(lines, object)}))
    return found


def _texts(words: Any, codes: np.ndarray) -> np.ndarray:  # noqa: ANN401 - a sequence of words
    """Return the word of every code; an unknown code is written as a number."""
    table = np.array([*words, ""], object)
    known = (codes >= 0) & (codes < len(words))
    found = table[np.where(known, codes, len(words))]
    found[~known] = [str(code) for code in codes[~known].tolist()]
    return found


def events(log: RunnerLog) -> tuple[np.ndarray, list[str]]:
    """Return the ticks of the events and their texts, with the words that the runner prints."""
    outputs, found = log.outputs, list[tuple[int, str]]()
    before = {name: np.concatenate([[0], outputs[name][:-1]]) for name in ("stage", "manager_phase", "phase", "fault")}
    changed = {name: outputs[name] != before[name] for name in before} if len(outputs) else {}
    for k in np.flatnonzero(changed["stage"]).tolist() if changed else ():
        fault = int(outputs["fault"][k])
        found.append((k, _STAGE_TEXTS[int(outputs["stage"][k])] + (f", {_FAULT_TEXTS[fault]}" if fault else "")))
    if changed:
        faulty = changed["fault"] & (outputs["fault"] > 0) & (outputs["stage"] > 0) & ~changed["stage"]
        found += [(k, f"fault: {_FAULT_TEXTS[outputs['fault'][k]]}") for k in np.flatnonzero(faulty).tolist()]
        for name, words, front in (("manager_phase", MANAGER_PHASES, ""), ("phase", GAIT_PHASES, "gait: ")):
            found += [(k, front + words[outputs[name][k]]) for k in np.flatnonzero(changed[name]).tolist()]
        for heard, text in ((Heard.TAKEN, "orders taken"), (Heard.REFUSED, "orders refused")):
            found += [(k, text) for k in np.flatnonzero(outputs["heard"] == heard).tolist()]
        over = np.flatnonzero(outputs["finished"])[:1].tolist()
        found += [(k, "the mission is over") for k in over]
        found += [(k, ABORTED) for k in np.flatnonzero(outputs["aborted"])[:1].tolist()]
    found.sort(key=lambda event: event[0])
    return np.array([k for k, _ in found], int), [text for _, text in found]
