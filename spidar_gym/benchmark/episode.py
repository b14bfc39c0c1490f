"""One scenario from its beginning to its end: what a policy did, in numbers with units."""

import math
import time
from typing import Any

import numpy as np

from spidar_gym.benchmark.policy import Actor, Policy, policy_arguments
from spidar_gym.benchmark.scenario import Scenario, check_robot, make_env, reset_options
from spidar_gym.benchmark.track import REST_S, SETTLE_S, find_track, flight_error, ground_error
from spidar_gym.control.controller import CONTROL_RATE
from spidar_gym.envs.crawl import CrawlEnv
from spidar_gym.envs.env import SpidarEnv
from spidar_gym.envs.hover import HoverEnv
from spidar_gym.errors import InvalidValueError
from spidar_gym.model.interference import Interference, InterferenceConfig, interference, no_interference
from spidar_gym.model.rotor import nominal_vectoring
from spidar_gym.robot import ROBOT

ACT_LIMIT_S = 10.0
"""How long a policy may think about one action [s]."""
BLOWN = 0.05
"""A rotor that turns this far beyond the bound that keeps it off another one breaks the constraint [rad]."""
METRICS: dict[str, tuple[str, str]] = {
    "error": ("", "the track's error, on which the score rests"),
    "success": ("", "`info['is_success']` in the end"),
    "failed": ("", "ended early, late at a form, or not finished: costs the cap"),
    "failure": ("", "why, in words"),
    "position_rms_m": ("m", "flight: RMS of ‖position error‖ after the first second"),
    "attitude_rms_rad": ("rad", "RMS of ‖attitude error‖ after the first second; on the ground of the tilt"),
    "joint_rms_rad": ("rad", "RMS over the joints of the scenario's plan − measured; ground: setpoint − measured"),
    "late_forms": ("", "flight: forms not reached within 0.5 s after their deadline"),
    "final_error_m": ("m", "ground: distance from the goal in the end"),
    "final_yaw_rad": ("rad", "ground: |heading error| in the end"),
    "drift": ("m/m", "ground: final error over the way, a radian counting 0.5 m"),
    "slip_m": ("m", "ground: way of the worst foot's touching point on the floor"),
    "duration_s": ("s", "flown, or until the crawl was finished"),
    "energy_wh": ("Wh", "electrical energy"),
    "endurance_min": ("min", "predicted from the mean power"),
    "cost_of_transport": ("", "ground: energy over weight times way"),
    "thrust_mean": ("", "mean commanded Σλ over the weight"),
    "torque_share": ("", "largest |joint torque| over the servo's limit"),
    "violations": ("", "share of ticks with a static joint torque above the limit or a rotor that blows on another"),
    "unsolved": ("", "ticks whose QP had no optimum"),
}
"""Unit and meaning of every number of an episode."""


def play(
    policy: Policy, name: str, scenario: Scenario, *, act_limit_s: float = ACT_LIMIT_S, control: str = "python"
) -> dict[str, Any]:
    """Play one scenario of a track, whole, in an environment of its own.

    Args:
        policy: Who acts.
        name: Track.
        scenario: Which episode.
        act_limit_s: How long the policy may think about one action [s].
        control: `python`, with which rows are made, or `core`, which is faster and equal to some 1e-12.

    Returns:
        The `METRICS` by name (None where one has no meaning), and `timing`: median and 99th percentile of the policy's
        answers and of whole steps [s], wall time [s].

    Raises:
        PolicyError: When the policy raises, answers with what is no action, or takes too long.
        InvalidValueError: When it is not defined on this track.
    """
    track = find_track(name)
    arguments = policy_arguments(policy, track.env_id)
    if arguments is None:
        raise InvalidValueError("track", name, "a track on which the policy is defined")
    begin = time.perf_counter()
    env = make_env(track, scenario, {**arguments, "control": control})
    place = f"{name}, scenario {scenario.index}"
    actor = Actor(policy, env.action_space.shape or (), place, limit_s=act_limit_s)
    observation, info = env.reset(seed=scenario.seed, options=reset_options(scenario))
    check_robot(env, scenario, place)
    actor.reset(scenario.seed)
    tally = _Tally(env)
    steps: list[float] = []
    rest = round(REST_S * CONTROL_RATE)
    for _ in range(round(track.seconds * CONTROL_RATE)):
        action = actor.act(observation.copy())
        start = time.perf_counter()
        observation, _, terminated, _, info = env.step(action)
        steps.append(time.perf_counter() - start)
        tally.count(info)
        rest -= bool(info.get("finished", False))
        if terminated or rest <= 0:
            break
    metrics: dict[str, Any] = {**dict.fromkeys(METRICS), **tally.flight(info), **tally.crawl(info), **tally.both(info)}
    metrics = {k: None if isinstance(v, float) and not math.isfinite(v) else v for k, v in metrics.items()}
    env.close()
    timing = {
        "act_s": np.percentile(actor.times, [50, 99]).tolist(),
        "step_s": np.percentile(steps, [50, 99]).tolist(),
        "wall_s": time.perf_counter() - begin,
    }
    return {"metrics": metrics, "timing": timing}


class _Tally:
    """What is counted, tick by tick."""

    def __init__(self, env: SpidarEnv) -> None:
        self.env = env
        self.position: list[float] = []
        self.attitude: list[float] = []
        self.joints: list[float] = []
        self.thrust = 0.0
        self.torque = 0.0
        self.violations = 0
        self.unsolved = 0
        self.ticks = 0
        self._bounds: Interference = no_interference()
        self._config = InterferenceConfig()

    def count(self, info: dict[str, Any]) -> None:
        """Count one tick."""
        env = self.env
        self.ticks += 1
        if info["failure"] == "diverged":
            return  # nothing in it is a number
        limit = env.plant.config.actuators.max_joint_torque
        self.torque = max(self.torque, float(np.abs(info["joint_torque"]).max()) / limit)
        self.unsolved += info["qp_status"] not in ("closed_form", "solved", "none")
        broken = float(np.abs(info["joint_torque_allocated"]).max()) > ROBOT.max_joint_torque + 1e-3
        if isinstance(env, HoverEnv):
            position, attitude = info["position_error"], info["attitude_error"]
            self.position.append(float(position @ position))
            self.attitude.append(float(attitude @ attitude))
            wanted = env.progress.plan()
            broken = broken or self._blows(env)
        else:
            assert isinstance(env, CrawlEnv)
            self.attitude.append(info["tilt_rad"] ** 2)
            broken = broken and env.controller.memory.mode != "rest"  # where the floor carries the legs
            wanted = env.controller.memory.joint_position
        off = wanted - env.state.joint_position
        self.joints.append(float(off @ off) / len(off))
        if not info.get("finished", False):
            self.thrust += float(info["thrust_command"].sum()) / ROBOT.weight
            self.violations += broken

    def _blows(self, env: HoverEnv) -> bool:
        """Whether a thrusting rotor points where its jet meets another rotor or the torso."""
        state = env.state
        snapshot = env.truth.snapshot
        nominal = nominal_vectoring(snapshot.R_bl, state.vectoring)
        bounds = self._bounds = interference(snapshot, nominal, self._bounds, config=self._config)
        theta = state.vectoring[:, 1]
        beyond = np.maximum(bounds.lower - theta, theta - bounds.upper)
        return bool((bounds.restricted & (beyond > BLOWN) & (state.thrust > 1.0)).any())

    def flight(self, info: dict[str, Any]) -> dict[str, Any]:
        """What only flights have."""
        if not isinstance(self.env, HoverEnv):
            return {}
        position, attitude = self._rms(self.position), self._rms(self.attitude)
        late = len(self.env.progress.overdue())
        failed = bool(info["failure"]) or late > 0
        return {
            "error": flight_error(position, attitude, failed=failed),
            "failed": failed,
            "failure": info["failure"] or ("late" if late else ""),
            "position_rms_m": position,
            "late_forms": late,
            "duration_s": self.ticks / CONTROL_RATE,
        }

    def crawl(self, info: dict[str, Any]) -> dict[str, Any]:
        """What only crawls have."""
        if not isinstance(self.env, CrawlEnv):
            return {}
        progress = self.env.progress
        x, y, yaw = info["goal_error"].tolist()
        failed = bool(info["failure"]) or not info["finished"]
        return {
            "error": ground_error(progress.rest, info["energy_wh"] / progress.whole, failed=failed),
            "failed": failed,
            "failure": info["failure"] or info["shortfalls"],
            "final_error_m": math.hypot(x, y),
            "final_yaw_rad": abs(yaw),
            "drift": progress.rest / progress.whole,
            "slip_m": info["foot_slip_m"],
            "duration_s": float(info["time_s"]),
            "cost_of_transport": info["cost_of_transport"],
        }

    def both(self, info: dict[str, Any]) -> dict[str, Any]:
        """What every episode has."""
        counted = self.ticks
        if isinstance(self.env, CrawlEnv) and self.env.progress.finished:
            counted = max(1, round(self.env.progress.finished * CONTROL_RATE))
        return {
            "success": bool(info["is_success"]),
            "attitude_rms_rad": self._rms(self.attitude),
            "joint_rms_rad": self._rms(self.joints),
            "energy_wh": info["energy_wh"],
            "endurance_min": info["endurance_min"],
            "thrust_mean": self.thrust / counted,
            "torque_share": self.torque,
            "violations": self.violations / counted,
            "unsolved": self.unsolved,
        }

    @staticmethod
    def _rms(squares: list[float]) -> float:
        """Over the episode after its first second; over all of one that is shorter."""
        counted = squares[round(SETTLE_S * CONTROL_RATE) :] or squares
        return math.sqrt(sum(counted) / len(counted)) if counted else 0.0
