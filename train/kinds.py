"""Where training happens: environments of the tracks' kinds, seeds that no scenario has, rewards to learn from."""

import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np

import spidar_gym.envs.registry
from spidar_gym.benchmark.artifact import Washout
from spidar_gym.benchmark.scenario import OFFSET
from spidar_gym.benchmark.track import ENERGY_SCALE, find_track
from spidar_gym.control.controller import CONTROL_RATE
from spidar_gym.envs.crawl_task import SUCCESS_SLIP
from spidar_gym.envs.env import SpidarEnv
from spidar_gym.envs.rewards import norm, tolerance
from spidar_gym.errors import require_name

FIRST_SEED = 2**31
"""Training draws its seeds from here on; those of the scenarios lie below."""


def training_seed(*words: int) -> int:
    """A seed of an environment or a learner, from nothing but the given numbers: run, segment, place."""
    entropy = [zlib.crc32(b"train"), *words]
    return FIRST_SEED + int(np.random.SeedSequence(entropy).generate_state(1)[0] >> 2)


@dataclass(frozen=True)
class Goal:
    """What a learner is rewarded for; rows are ranked by the tracks' own errors whatever was rewarded."""

    reward: str = "environment"
    """One of `REWARDS`."""
    position_m: float = 0.01
    """`pose`: a position error of this much halves its term [m]."""
    attitude_rad: float = 0.02
    """`pose`: an attitude error of this much halves its term [rad]."""
    velocity: float = 0.0
    """`pose`: a velocity of this much halves a term of its own, 0 is no such term [m/s]; it answers sooner."""
    rate: float = 0.0
    """`pose`: … and an angular velocity [rad/s]."""
    penalty: float = 0.05
    """Share of the reward that the largest action costs."""
    shift: float = 0.0
    """Taken off the reward of every tick, so that critics begin near the truth."""
    scale: float = 1.0
    """Factor of the rest."""

    def __post_init__(self) -> None:
        """Refuse a reward that does not exist."""
        require_name("reward", self.reward, REWARDS)


@dataclass
class Tick:
    """What a reward is made of."""

    reward: float
    """The environment's own."""
    info: Mapping[str, Any]
    """Of this tick."""
    before: Mapping[str, Any]
    """Of the tick before it."""
    env: Any
    """The environment."""
    action: np.ndarray
    """In [−1, 1]."""


def _environment(goal: Goal, tick: Tick) -> float:
    """The environment's own."""
    return tick.reward


def _pose(goal: Goal, tick: Tick) -> float:
    """Mean of 1/(1 + (e/e₀)²) over the terms, less the share for a large action; 0 where the flight is over."""
    if tick.info["failure"]:
        return 0.0
    error = tick.env.truth.error
    terms = (
        (tick.info["position_error"], goal.position_m),
        (tick.info["attitude_error"], goal.attitude_rad),
        (error.velocity_w, goal.velocity),
        (error.omega_b, goal.rate),
    )
    found = [tolerance(norm(value), unit) for value, unit in terms if unit > 0.0]
    return sum(found) / len(found) * (1.0 - goal.penalty * float(tick.action @ tick.action) / len(tick.action))


def _economy(goal: Goal, tick: Tick) -> float:
    """Share of the way that was made, less its energy (20 Wh/m cost as much as the way) and slip; −1 for a failure.

    Nothing for a success: whether a goal is met within 10 mm is decided at the end of some 80 actions, and a critic
    that is to foresee it sees nothing else.
    """
    info, before, whole = tick.info, tick.before, tick.env.progress.whole
    if info["failure"]:
        return -1.0
    energy = (info["energy_wh"] - before["energy_wh"]) / (ENERGY_SCALE * whole)
    slip = (info["foot_slip_m"] - before["foot_slip_m"]) / (2.0 * SUCCESS_SLIP)
    way = (before["way"] - info["way"]) / whole
    effort = goal.penalty * float(tick.action @ tick.action) / len(tick.action) / CONTROL_RATE
    return way - energy - slip - effort


REWARDS: dict[str, Callable[[Goal, Tick], float]] = {"environment": _environment, "pose": _pose, "economy": _economy}
"""Training rewards by name."""


@dataclass(frozen=True)
class Scaling:
    """How observations enter a network; the same numbers as in the artifact."""

    mean: np.ndarray
    """Of the baseline's observations."""
    variance: np.ndarray
    """… > 0."""
    clip: float = 10.0
    """Bound of a scaled observation."""

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        """(o − mean) / √variance, clipped, float32."""
        x = (observation - self.mean) / np.sqrt(self.variance)
        return np.minimum(np.maximum(x, -self.clip), self.clip).astype(np.float32)


class TrainingEnv(gymnasium.Wrapper):
    """An environment as learners see it: scaled observations, a training reward, a washout, little in `info`."""

    def __init__(
        self,
        env: gymnasium.Env,
        goal: Goal,
        *,
        washout: np.ndarray,
        still: np.ndarray | float = 0.0,
        hold: int = 1,
        scaling: Scaling | None = None,
    ) -> None:
        """Wrap.

        Args:
            env: Environment of this package.
            goal: What is rewarded.
            washout: Time constant of each entry of the action, 0 for none [s].
            still: 1 for the entries of the action that stay 0.
            hold: Ticks for which an action is held; their rewards are added up.
            scaling: Of the observations; none if None.
        """
        super().__init__(env)
        self._goal, self._washout, self._hold, self._scaling = goal, Washout(washout), hold, scaling
        self._free = 1.0 - still
        self._before: dict[str, Any] = {}
        if scaling is not None:
            high = np.full(len(scaling.mean), scaling.clip, np.float32)
            self.observation_space = gymnasium.spaces.Box(-high, high, dtype=np.float32)

    def _show(self, observation: np.ndarray) -> np.ndarray:
        return observation if self._scaling is None else self._scaling(observation)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[np.ndarray, dict]:
        """Begin an episode."""
        observation, info = self.env.reset(seed=seed, options=options)
        self._washout.reset()
        self._before = self._look(info)
        return self._show(observation), {}

    def _look(self, info: dict[str, Any]) -> dict[str, Any]:
        """`info`, and how far the goal of a crawl is."""
        env: Any = self.unwrapped
        return {**info, "way": env.progress.rest} if "finished" in info else info

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """As long as an action is held; a crawl is over when it is finished."""
        total, action = 0.0, self._free * np.asarray(action, np.float64)
        observation, terminated, truncated = np.zeros(0), False, False
        for _ in range(self._hold):
            given = self._washout(action)
            observation, reward, terminated, truncated, info = self.env.step(given)
            info = self._look(info)
            tick = Tick(float(reward), info, self._before, self.unwrapped, given)
            total += self._goal.scale * (REWARDS[self._goal.reward](self._goal, tick) - self._goal.shift)
            self._before = info
            terminated = terminated or bool(info.get("finished", False))
            if terminated or truncated:
                break
        return self._show(observation), total, terminated, truncated, {"is_success": self._before["is_success"]}


def make_training_env(
    track: str,
    arguments: Mapping[str, Any],
    goal: Goal,
    *,
    washout: np.ndarray,
    still: np.ndarray | float = 0.0,
    hold: int = 1,
    scaling: Scaling | None = None,
    control: str = "python",
) -> TrainingEnv:
    """An environment of a track's kind, which draws its episodes from its seed; what scenarios vary is drawn too.

    Args:
        track: Whose kind: forms, speed, sensors, randomisation, length.
        arguments: Action mode and controller.
        goal: What is rewarded.
        washout: Time constant of each entry of the action, 0 for none [s].
        still: 1 for the entries of the action that stay 0.
        hold: Ticks for which an action is held.
        scaling: Of the observations; none if None.
        control: `python` or `core`.
    """
    spidar_gym.envs.registry.register()
    kind = find_track(track)
    own = {"perturbation": OFFSET} if kind.flies else {}
    env = gymnasium.make(
        kind.env_id, **own, **kind.options, **arguments, control=control, horizon_s=kind.seconds,
        max_episode_steps=round(kind.seconds * CONTROL_RATE), disable_env_checker=True,
    )  # fmt: skip
    assert isinstance(env.unwrapped, SpidarEnv)
    return TrainingEnv(env, goal, washout=washout, still=still, hold=hold, scaling=scaling)


def baseline_scaling(envs: Sequence[TrainingEnv], seed: int, ticks: int, spread: float = 0.0) -> Scaling:
    """Mean and variance of what the baseline sees, frozen from then on.

    Args:
        envs: Environments without scaling, one of each kind.
        seed: Of the run.
        ticks: How many of each.
        spread: Standard deviation of random actions; 0 is the baseline, which a learner from nothing does not have.
    """
    seen = []
    rng = np.random.Generator(np.random.PCG64(training_seed(seed, 7)))
    for k, env in enumerate(envs):
        zero = np.zeros(env.action_space.shape or ())
        observation, _ = env.reset(seed=training_seed(seed, 0, k))
        for _ in range(ticks):
            seen.append(observation)
            observation, _, terminated, truncated, _ = env.step(np.clip(rng.normal(zero, spread), -1.0, 1.0))
            if terminated or truncated:
                observation, _ = env.reset()
    space = envs[0].observation_space
    assert isinstance(space, gymnasium.spaces.Box)
    return scaling_of(np.array(seen), space.high)


def scaling_of(observations: np.ndarray, bounds: np.ndarray) -> Scaling:
    """Mean and variance of observations (number, size), of at least a thousandth of the bound.

    Entries that never change, such as the previous action of the base, are scaled by their bound.
    """
    o, bound = observations.astype(float), bounds.astype(float)
    deviation = o.std(axis=0)
    idle = deviation < 1e-6 * bound
    return Scaling(np.where(idle, 0.0, o.mean(axis=0)), np.where(idle, bound, np.maximum(deviation, 1e-3 * bound)) ** 2)
