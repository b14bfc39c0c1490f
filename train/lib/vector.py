"""Vector environment for training: scaled observations, a training reward, held actions and washout.

This module imports Stable-Baselines3. Recipes import it when a run starts, so that `--help` works without it.
"""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import gymnasium
import numpy as np
from stable_baselines3.common.vec_env import VecEnv

from spidar_gym.benchmark.scenario import OFFSET
from spidar_gym.benchmark.track import find_track
from spidar_gym.control.flight.controller import CONTROL_RATE
from spidar_gym.envs.fleet import told
from spidar_gym.envs.vector import NativeVectorEnv
from spidar_gym.errors import InvalidValueError
from spidar_gym.policies import torso
from spidar_gym.policies.filters import Traces, Washout
from train.lib.envs import EnvConfig, Scaling, scaling_of, training_seed
from train.lib.rewards import RewardConfig, Tick

FARTHEST = 3.0
"""Bound of the action in torso axes: 30 N, or 0.3 rad."""


def make_vector(track: str, arguments: Mapping[str, Any], robots: int, threads: int = 1) -> NativeVectorEnv:
    """Make a vector of robots with the options of a track; their seeds determine everything that scenarios vary."""
    kind = find_track(track)
    own = {"perturbation": OFFSET} if kind.flies else {}
    return NativeVectorEnv(
        kind.env_id, robots, num_threads=threads, autoreset_mode="Disabled", horizon_s=kind.seconds,
        max_episode_steps=round(kind.seconds * CONTROL_RATE), **own, **kind.options, **arguments,
    )  # fmt: skip


def draw_disturbances(track: str, rng: np.random.Generator, robots: int) -> list[dict[str, float]]:
    """Sample the disturbances (wind, pushes) of robots on a track; empty if its scenarios have none."""
    drawn = {name: rng.uniform(*limits, robots) for name, limits in find_track(track).disturbances.items()}
    return [{name: float(values[k]) for name, values in drawn.items()} for k in range(robots)]


class _Group:
    """The robots of one track, with their observations and rewards."""

    def __init__(
        self, config: EnvConfig, reward: RewardConfig, track: str, places: np.ndarray, threads: int
    ) -> None:  # fmt: skip
        self.vector = make_vector(track, config.arguments, len(places), threads)
        self.reward, self.places = reward, places
        self.washout = Washout(config.washout_times())
        self._traces = Traces(config.traced, np.array(config.trace_times))
        self._joints = torso.Joints()
        for memory in (self._traces, self._joints):
            memory.reset(len(places))
        self._torso, self._track = config.torso, track
        self._rng = np.random.Generator(np.random.PCG64(0))
        self._said = np.full((len(places), config.mode.size), np.nan)
        self._before: dict[str, np.ndarray] = {}

    def reset(self, ids: np.ndarray, seeds: Sequence[int | None] | None = None) -> np.ndarray:
        """Reset the robots `ids`; return their observations."""
        mask = np.isin(np.arange(self.vector.num_envs), ids)
        options: dict[str, object] = {"reset_mask": mask}
        if seeds is not None and None not in seeds:
            self._rng = np.random.Generator(np.random.PCG64([7, *(int(seed or 0) for seed in seeds)]))
        if find_track(self._track).disturbances:
            options["disturbances"] = draw_disturbances(self._track, self._rng, len(mask))
        self.vector.reset(seed=seeds, options=options)
        if mask.all():
            self.washout.reset(self.vector.num_envs)
        self.washout.low_passed[ids], self._said[ids] = 0.0, np.nan
        self._before = self._now() if mask.all() else _merged(self._before, self._now(), ids)
        seen = self.vector.buffers["observations"][ids]
        return self._shown(self._traces.begin(ids, self._joints.begin(ids, seen) if self._torso else seen))

    def look(self) -> np.ndarray:
        """Return the observations of all robots after a step; call it once per step, as it updates the traces."""
        seen = self.vector.buffers["observations"]
        return self._shown(self._traces(self._joints(seen) if self._torso else seen))

    def _shown(self, seen: np.ndarray) -> np.ndarray:
        if not self._torso:
            return seen
        observations, traces = np.split(seen, [torso.SHOWN], axis=1)
        return np.concatenate([torso.features(observations), traces], axis=1)

    def step(self, said: np.ndarray, hold: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Hold the actions for `hold` ticks or until the episode ends; return rewards, done and truncated flags."""
        vector, count = self.vector, self.vector.num_envs
        seen = np.concatenate([vector.buffers["observations"], self._joints.position], axis=1) if self._torso else None
        actions = said if seen is None else torso.command(said, seen)
        change = np.nan_to_num(np.sqrt(np.square(said - self._said).mean(axis=1)))  # 0 in the first step of an episode
        self._said = said.copy()
        total, done, late = np.zeros(count), np.zeros(count, bool), np.zeros(count, bool)
        for _ in range(hold):
            ids = np.flatnonzero(~done)
            if not ids.size:
                break
            kept = self.washout.low_passed.copy()
            given = self.washout(actions)
            self.washout.low_passed[done] = kept[done]
            vector.advance(given, ids)
            now = self._now()
            gained = self.reward(Tick(vector.buffers["rewards"], now, self._before, given, change))
            total[ids] += gained[ids]
            self._before = _merged(self._before, now, ids)
            ended = vector.buffers["terminated"] | now.get("finished", np.zeros(count, bool))
            late[ids] = (vector.buffers["truncated"] & ~ended)[ids]
            done[ids] = (ended | vector.buffers["truncated"])[ids]
        return total, done, late

    def _now(self) -> dict[str, np.ndarray]:
        """Return the robots' `info` and the further quantities that rewards need."""
        robots = self.vector.robots
        now = told(self.vector.buffers["infos"].copy())
        if "finished" in now:
            return now | {"remaining": robots["distance"].copy(), "way": robots["initial_distance"].copy()}
        error = robots["truth"]["error"]
        joints = self.vector.fleet.quantities["joint_error"][:, None].copy()
        return now | {
            "velocity_error": error["velocity_w"].copy(), "rate_error": error["omega_b"].copy(), "joint_error": joints,
        }  # fmt: skip

    @property
    def succeeded(self) -> np.ndarray:
        """Mask of the robots whose episode is a success."""
        return self._before["is_success"]


def _merged(before: Mapping[str, np.ndarray], now: Mapping[str, np.ndarray], ids: np.ndarray) -> dict[str, np.ndarray]:
    """Return `before` with the entries of the robots `ids` replaced by those of `now`."""
    if len(ids) == len(next(iter(now.values()))):
        return dict(now)
    merged = {name: values.copy() for name, values in before.items()}
    for name, values in now.items():
        merged[name][ids] = values[ids]
    return merged


class TrainingVec(VecEnv):
    """Stable-Baselines3 `VecEnv` over robots of all tracks in turn; an episode that ends is reset in the same step."""

    def __init__(
        self,
        config: EnvConfig,
        reward: RewardConfig,
        robots: int,
        *,
        scaling: Scaling | None = None,
        relative_errors: Mapping[str, Sequence[float]] | None = None,
        action_scale: float = 1.0,
        threads: int = 1,
    ) -> None:
        """Create the robots.

        Args:
            config: Observation and action of the agent.
            reward: Training reward.
            robots: Number of robots.
            scaling: Scaling of the observations; None leaves them unscaled.
            relative_errors: Track → errors of the base, each divided by its mean over all tracks; they scale the error
                units of `reward`, in flight those of position and attitude. 1 for tracks not listed.
            action_scale: Environment action that corresponds to an action of 1 of the learner.
            threads: Number of threads that simulate the robots of a track.
        """
        errors = relative_errors or {}
        self._hold, self._scaling, self._does = config.hold, scaling, action_scale * (1.0 - config.still_entries())
        self._groups = []
        for k, track in enumerate(config.tracks):
            places = np.arange(k, robots, len(config.tracks))
            if places.size:
                position, attitude, *_ = errors.get(track, (1.0, 1.0))
                units = {"position": position, "velocity": position, "attitude": attitude, "rate": attitude}
                scales = {name: unit * getattr(reward, name) for name, unit in units.items()}
                self._groups.append(_Group(config, replace(reward, **scales), track, places, threads))
        self.vectors = [group.vector for group in self._groups]
        """Engine vectors, one for each track."""
        first = self.vectors[0]
        space, does = first.single_observation_space, first.single_action_space
        if config.torso:
            space = _box(np.inf, len(config.hidden_entries()))
            does = _box(FARTHEST, torso.ACTION)
        if action_scale != 1.0:
            does = _box(float(does.high[0]) / action_scale, len(does.high))
        self.raw_space = space
        """Observation space before scaling."""
        if scaling is not None:
            space = _box(scaling.clip, len(scaling.mean))
        self._began, self._returns, self._lengths = time.perf_counter(), np.zeros(robots), np.zeros(robots, int)
        self._actions = np.zeros(0)
        self._seconds, self._spent = 0.0, {"engine": 0.0, "environment": 0.0}
        super().__init__(robots, space, does)

    def reset(self) -> np.ndarray:
        """Reset every robot, with the seeds of `seed`, which are used once."""
        seen = self._nothing()
        for group in self._groups:
            seeds = [self._seeds[k] for k in group.places]
            seen[group.places] = self._scaled(group.reset(np.arange(len(seeds)), seeds))
        self._reset_seeds()
        self._reset_options()
        self._returns[:], self._lengths[:] = 0.0, 0
        return seen

    def step_async(self, actions: np.ndarray) -> None:
        """Store the actions of all robots."""
        self._actions = self._does * np.asarray(actions, np.float64)

    def step_wait(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[dict[str, Any]]]:
        """Step all robots while the actions are held; return observations, rewards, done flags and infos."""
        began = time.perf_counter()
        rewards, done = np.zeros(self.num_envs), np.zeros(self.num_envs, bool)
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        ended = []
        for group in self._groups:
            rewards[group.places], over, late = group.step(self._actions[group.places], self._hold)
            done[group.places] = over
            ended += [(group, np.flatnonzero(over), late)] if over.any() else []
        self._returns += rewards
        self._lengths += 1
        seen = self._nothing()
        for group in self._groups:
            seen[group.places] = self._scaled(group.look())
        for group, ids, late in ended:
            for k in ids.tolist():
                place = group.places[k]
                episode = {
                    "r": float(self._returns[place]), "l": int(self._lengths[place]),
                    "t": round(time.perf_counter() - self._began, 6),
                }  # fmt: skip
                infos[place] = {
                    "terminal_observation": seen[place].copy(), "TimeLimit.truncated": bool(late[k]),
                    "is_success": bool(group.succeeded[k]), "episode": episode,
                }  # fmt: skip
            begun = group.places[ids]
            seen[begun] = self._scaled(group.reset(ids))
            self._returns[begun], self._lengths[begun] = 0.0, 0
        self._seconds += time.perf_counter() - began
        return seen, rewards.astype(np.float32), done, infos

    def spent(self) -> dict[str, float]:
        """Return the wall time of the engine and of the rest of this class since the last call [s]."""
        engine = sum(vector.fleet.engine.seconds for vector in self.vectors)
        now = {"engine": engine, "environment": self._seconds - engine}
        found = {part: seconds - self._spent[part] for part, seconds in now.items()}
        self._spent = now
        return found

    def _nothing(self) -> np.ndarray:
        """Return an empty array for the observations of all robots."""
        return np.zeros((self.num_envs, *(self.observation_space.shape or ())), np.float32)

    def _scaled(self, observations: np.ndarray) -> np.ndarray:
        return observations if self._scaling is None else self._scaling(observations)

    def close(self) -> None:
        """Stop the threads; a second call does nothing."""
        for group in self._groups:
            group.vector.close()

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:  # noqa: ANN401 - Stable-Baselines3's signature
        """Return an attribute, which is the same for all robots; `render_mode` is None."""
        value = None if attr_name == "render_mode" else getattr(self._groups[0].vector, attr_name)
        return [value for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:  # noqa: ANN401 - as above
        """Raise `InvalidValueError`: the robots of a vector share their attributes."""
        raise InvalidValueError(attr_name, value, "another `TrainingVec`")

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any) -> list[Any]:  # noqa: ANN401 - SB3's signature
        """Raise `InvalidValueError`: robots have no environments of their own."""
        raise InvalidValueError("env_method", method_name, "nothing: there is no environment of each robot")

    def env_is_wrapped(self, wrapper_class: type[gymnasium.Wrapper], indices: Any = None) -> list[bool]:  # noqa: ANN401 - SB3's signature
        """Return True for `Monitor`, whose episode entries `infos` contains."""
        from stable_baselines3.common.monitor import Monitor

        return [wrapper_class is Monitor for _ in self._get_indices(indices)]


def _box(high: float, size: int) -> gymnasium.spaces.Box:
    """Return a box of the given size with bounds ± `high`."""
    return gymnasium.spaces.Box(-high, high, (size,), np.float32)


def baseline_scaling(
    config: EnvConfig, seed: int, ticks: int, spread: float = 0.0, on_tick: Callable[[], object] = lambda: None
) -> Scaling:
    """Compute mean and variance of the baseline's observations.

    Args:
        config: Observation and action of the agent.
        seed: Seed of the run.
        ticks: Number of steps of one robot on each track.
        spread: Standard deviation of random actions; 0 is the baseline. Used if there is no controller.
        on_tick: Called after each step, for progress.
    """
    seen = []
    rng = np.random.Generator(np.random.PCG64(training_seed(seed, 7)))
    bounds = np.zeros(0)
    for k, track in enumerate(config.tracks):
        robot = TrainingVec(replace(config, tracks=(track,)), RewardConfig(), 1)
        zero, bounds = np.zeros(robot.action_space.shape or ()), robot.raw_space.high
        robot.seed(training_seed(seed, 0, k))
        observation: np.ndarray = robot.reset()[0]
        for _ in range(ticks):
            seen.append(observation)
            observation = np.asarray(robot.step(np.clip(rng.normal(zero, spread), -1.0, 1.0)[None])[0])[0]
            on_tick()
        robot.close()
    shown = np.array(seen)
    return scaling_of(shown, np.where(np.isinf(bounds), np.maximum(np.abs(shown).max(axis=0), 1.0), bounds))
