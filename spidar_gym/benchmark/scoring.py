"""One scenario from its beginning to its end: what a policy did, in numbers with units."""

import math
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from spidar_gym.benchmark.metrics import METRICS
from spidar_gym.benchmark.scenario import Scenario, check_robot, make_env, reset_options
from spidar_gym.benchmark.track import REST_S, SETTLE_S, find_track, flight_error, ground_error
from spidar_gym.control.allocation.allocator import ANSWERED
from spidar_gym.control.flight.controller import CONTROL_RATE
from spidar_gym.envs.crawl.env import CrawlEnv
from spidar_gym.envs.env import SpidarEnv
from spidar_gym.envs.hover.env import HoverEnv
from spidar_gym.errors import InvalidValueError
from spidar_gym.model.interference import Interference, InterferenceConfig, find_interference, no_interference
from spidar_gym.model.rotor import nominal_vectoring
from spidar_gym.policies.actor import Actor
from spidar_gym.policies.policy import Policy, policy_arguments
from spidar_gym.policies.rollout import rollout
from spidar_gym.robot import ROBOT

ACT_LIMIT_S = 10.0
"""How long a policy may think about one action [s]."""
CONTROL = "python"
"""With which rows are made."""
INTERFERENCE_TOLERANCE = 0.05
"""A rotor that turns this far beyond the bound that keeps it off another one breaks the constraint [rad]."""


def play_scenario(
    policy: Policy,
    name: str,
    scenario: Scenario,
    *,
    act_limit_s: float = ACT_LIMIT_S,
    control: str = CONTROL,
    on_tick: Callable[[dict[str, Any]], object] = lambda _: None,
) -> dict[str, Any]:
    """Play one scenario of a track, whole, in an environment of its own.

    Args:
        policy: Who acts.
        name: Track.
        scenario: Which episode.
        act_limit_s: How long the policy may think about one action [s].
        control: `python`, with which rows are made, or `core`, which is faster and equal to some 1e-12.
        on_tick: Called with the `info` of each tick.

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
    steps = rollout(
        env, actor, seed=scenario.seed, options=reset_options(scenario), ticks=round(track.seconds * CONTROL_RATE),
        until_finished=False,
    )  # fmt: skip
    check_robot(env, scenario, place)
    tally = _Tally(env)
    times: list[float] = []
    info: dict[str, Any] = {}
    rest = round(REST_S * CONTROL_RATE)
    for step in steps:
        info = step.info
        times.append(step.seconds)
        tally.count(info)
        on_tick(info)
        rest -= step.finished
        if rest <= 0:
            break
    metrics: dict[str, Any] = {**dict.fromkeys(METRICS), **tally.flight(info), **tally.crawl(info), **tally.both(info)}
    # What a simulation that diverged leaves behind is no number.
    metrics = {k: None if isinstance(v, float) and not v <= METRICS[k].most else v for k, v in metrics.items()}
    env.close()
    timing = {
        "act_s": np.percentile(actor.times, [50, 99]).tolist(),
        "step_s": np.percentile(times, [50, 99]).tolist(),
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
        self.unsolved += info["qp_status"] not in (*ANSWERED, "none")
        broken = float(np.abs(info["joint_torque_allocated"]).max()) > ROBOT.max_joint_torque + 1e-3
        if isinstance(env, HoverEnv):
            position, attitude = info["position_error"], info["attitude_error"]
            self.position.append(float(position @ position))
            self.attitude.append(float(attitude @ attitude))
            wanted = env.progress.plan()
            broken = broken or self._interferes(env)
        else:
            assert isinstance(env, CrawlEnv)
            self.attitude.append(info["tilt_rad"] ** 2)
            last = env.controller.last_step
            broken = broken and last is not None and last.mode != "rest"  # where the floor carries the legs
            wanted = env.controller.memory.joint_position
        off = wanted - env.state.joint_position
        self.joints.append(float(off @ off) / len(off))
        if not info.get("finished", False):
            self.thrust += float(info["thrust_command"].sum()) / ROBOT.weight
            self.violations += broken

    def _interferes(self, env: HoverEnv) -> bool:
        """Whether a thrusting rotor points where its jet meets another rotor or the torso."""
        state = env.state
        snapshot = env.truth.snapshot
        nominal = nominal_vectoring(snapshot.R_bl, state.vectoring)
        bounds = self._bounds = find_interference(snapshot, nominal, self._bounds, config=self._config)
        theta = state.vectoring[:, 1]
        beyond = np.maximum(bounds.lower - theta, theta - bounds.upper)
        return bool((bounds.restricted & (beyond > INTERFERENCE_TOLERANCE) & (state.thrust > 1.0)).any())

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
