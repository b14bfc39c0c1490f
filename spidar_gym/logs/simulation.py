"""Episodes of an environment as records: true state, commands, estimates and sensors, with the robot's topics."""

from collections.abc import Mapping, Sequence
from typing import Any

import gymnasium
import numpy as np

from spidar_gym import __version__
from spidar_gym.envs.env import SpidarEnv
from spidar_gym.errors import require_instance
from spidar_gym.logs.record import Record, Series, ordered
from spidar_gym.logs.topics import FORMATS
from spidar_gym.onboard.messages import STATE_NAMES
from spidar_gym.policies.policy import Policy
from spidar_gym.policies.rollout import rollout
from spidar_gym.robot import GIMBAL_NAMES, JOINT_NAMES, N_ROTORS
from spidar_gym.state import LEAST_QUATERNION, RobotState

_SETPOINTS = {
    "gimbals_ctrl": ("position", "vectoring", GIMBAL_NAMES),
    "joints_ctrl": ("position", "joint_position", JOINT_NAMES),
    "joints_torque_ctrl": ("effort", "joint_torque_limit", JOINT_NAMES),
}
"""Topic → its column, the field of the command, the names of the entries."""


class Recorder:
    """Recorder of an environment's episode; call `add` after `reset` and after every step.

    Times are those of the simulator, in s since the reset. With `sensors`, the samples of the last control period of a
    step are recorded, so that a step of several periods (`hold`) leaves gaps.
    """

    def __init__(self, env: gymnasium.Env[Any, Any]) -> None:
        """Record an environment, with or without wrappers (`InvalidValueError` for one of another package)."""
        inner = env.unwrapped
        require_instance(SpidarEnv, env=inner)
        assert isinstance(inner, SpidarEnv)
        self._env = inner
        self._rows: dict[str, list[tuple[float, float, Mapping[str, Any]]]] = {}

    def add(self) -> None:
        """Record the present state, the command that led to it, and what the sensors measured on the way."""
        env, state = self._env, self._env.state
        now = state.time
        self._state("truth/state", now, state)
        if env.ticks:
            begun = max(now - env.hold * env.plant.period, 0.0)
            command = env.command
            self._row("four_axes/command", begun, begun, {"angles": np.zeros(3), "base_thrust": command.thrust})
            for topic, (column, field, _) in _SETPOINTS.items():
                self._row(topic, begun, begun, {column: np.ravel(getattr(command, field))})
        if env.plant.record["senses"]:
            self._state("runner/estimate", now, env.seen)
            self._sensors(now)

    def _row(self, topic: str, time: float, received: float, values: Mapping[str, Any]) -> None:
        self._rows.setdefault(topic, []).append((time, received, values))

    def _state(self, topic: str, now: float, state: RobotState) -> None:
        self._row(topic, now, now, {c.name: getattr(state, c.name) for c in FORMATS[topic].columns})

    def _newest(self, topic: str) -> float:
        """Return the time of the newest sample of a topic; samples from before the reset are not recorded."""
        return self._rows[topic][-1][0] if topic in self._rows else -1e-6

    def _sensors(self, now: float) -> None:
        """Record samples that are newer than the last ones; the sensors keep them until the next ones are taken."""
        memory = self._env.plant.record["sensors"]
        for topic, stamps, valid, members in (
            ("imu", "imu_time", np.ones(len(memory["imu_time"]), bool),
             {"specific_force": "specific_force_b", "angular_velocity": "gyro_b"}),
            ("mocap/pose", "frame_time", (memory["frame_quat_wb"] ** 2).sum(axis=1) > LEAST_QUATERNION,
             {"position_w": "frame_position_w", "quat_wb": "frame_quat_wb"}),
        ):  # fmt: skip
            times = memory[stamps]
            fresh = valid & (times > self._newest(topic) + 1e-9) & (times <= now + 1e-9)
            found, rows = np.unique(times[fresh], return_index=True)
            for time, row in zip(found.tolist(), np.flatnonzero(fresh)[rows].tolist(), strict=True):
                self._row(topic, time, now, {name: memory[own][row].copy() for name, own in members.items()})
        time = float(memory["encoder_time"])
        if time > self._newest("joint_states") + 1e-9:
            effort = np.concatenate([memory["torque"], np.full(2 * N_ROTORS, np.nan)])
            self._row("joint_states", time, now, {"position": memory["angles"].copy(), "effort": effort})

    def record(self) -> Record:
        """Return what has been recorded."""
        env = self._env
        names = {topic: own for topic, (_, _, own) in _SETPOINTS.items()} | {"joint_states": STATE_NAMES}
        series = {topic: _series(topic, rows, names.get(topic, ())) for topic, rows in self._rows.items()}
        about = {} if env.spec is None else {"environment": env.spec.id}
        return Record("simulation", ordered(series), properties={**about, "version": __version__})


def _series(topic: str, rows: Sequence[tuple[float, float, Mapping[str, Any]]], names: tuple[str, ...]) -> Series:
    time, received = (np.array([row[k] for row in rows], float) for k in (0, 1))
    return Series(topic, time, received, {name: np.array([row[2][name] for row in rows]) for name in rows[0][2]}, names)


def record_env(
    env: gymnasium.Env[Any, np.ndarray], policy: Policy | None = None, *, seed: int, ticks: int | None = None
) -> Record:
    """Run one episode and record it.

    Args:
        env: Environment of this package, with or without wrappers.
        policy: The policy; None for the controller alone.
        seed: Seed of the episode.
        ticks: Largest number of steps; without a limit the environment must end the episode.

    Raises:
        InvalidValueError: For an environment of another package.
    """
    recorder = Recorder(env)
    steps = rollout(env, policy, seed=seed, ticks=ticks)
    recorder.add()
    for _ in steps:
        recorder.add()
    return recorder.record()
