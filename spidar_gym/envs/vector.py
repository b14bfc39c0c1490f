"""Many robots at once in native code, behind Gymnasium's vector interface: the same bits as one by one."""

from typing import Any

import gymnasium
import numpy as np
from gymnasium.utils.seeding import np_random
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space

from spidar_gym.envs.crawl.env import CrawlEnv
from spidar_gym.envs.fleet import told
from spidar_gym.envs.hover.env import HoverEnv
from spidar_gym.envs.registry import CRAWL, HOVER, environment
from spidar_gym.errors import InvalidValueError, SpidarError, require_array, require_keys, require_least
from spidar_gym.native.engine_structs import AUTORESETS
from spidar_gym.sim.disturbances import Disturbances


class NativeVectorEnv(gymnasium.vector.VectorEnv[np.ndarray, np.ndarray, np.ndarray]):
    """Robots of one environment; the controller is the core, the task the built-in one.

    `info` is arrays: its words are numbers (`qp_status_code`, `failure_code`, and in the crawl `phase_code` and
    `shortfalls_code`; −1 is none), and the terms of the reward are one array, in the order of the task's table.
    """

    def __init__(
        self,
        name: str,
        num_envs: int,
        *,
        num_threads: int = 1,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        max_episode_steps: int | None = None,
        **options: Any,  # noqa: ANN401 - those of the environment
    ) -> None:
        """Build the robots.

        Args:
            name: `spidar_gym/Hover-v0` or `spidar_gym/Crawl-v0`.
            num_envs: How many robots.
            num_threads: How many threads, the caller's included.
            autoreset_mode: What happens at the end of an episode: Gymnasium's three ways.
            max_episode_steps: Ticks of an episode; those of `horizon_s` if not given.
            **options: Arguments of the environment; the controller is the core, and there are no pictures.

        Raises:
            UnknownNameError: For an environment or an option that does not exist; it lists the valid ones.
            InvalidValueError: For a value out of range.
        """
        environment(name)
        require_least(1, num_envs=num_envs, num_threads=num_threads)
        mode = AutoresetMode(autoreset_mode)
        for refused in ("control", "allocator", "render_mode"):
            if refused in options:
                raise InvalidValueError(refused, options[refused], "no such argument: the core flies, without pictures")
        single = HoverEnv(control="core", **options) if name == HOVER else CrawlEnv(control="core", **options)
        self._single = single
        self.task, self.layout, self.num_envs = single.task, single.layout, num_envs
        if max_episode_steps is not None:
            require_least(1, max_episode_steps=max_episode_steps)
            single.horizon = int(max_episode_steps)
        self.metadata = {**single.metadata, "autoreset_mode": mode}
        self.single_action_space, self.single_observation_space = single.action_space, single.observation_space
        self.action_space = batch_space(single.action_space, num_envs)
        self.observation_space = batch_space(single.observation_space, num_envs)
        autoreset = AUTORESETS[("NEXT_STEP", "SAME_STEP", "DISABLED").index(mode.name)]
        self._fleet = single.make_fleet(num_envs, num_threads, autoreset=autoreset, truncates=True)
        self._began = False

    @property
    def robots(self) -> np.ndarray:
        """All that there is of the robots, records of `sp_hover` or `sp_crawling`; not to be written."""
        return self._fleet.robots

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Start episodes.

        Args:
            seed: Robot i gets `seed + i`, as in Gymnasium's own vectors, or its own entry of a list.
            options: `{"reset_mask": …}` says which robots (all if not given), `{"disturbances": …}` what happens to
                them from now on.

        Returns:
            Observations and info.

        Raises:
            InvalidValueError: For seeds or a mask of another length, and nothing has changed.
        """
        n = self.num_envs
        given = require_keys("options", "reset option", options or {}, ("reset_mask", "disturbances"))
        mask = np.ones(n, bool)
        if "reset_mask" in given:
            mask = np.asarray(given["reset_mask"])
            if mask.shape != (n,) or mask.dtype != bool or not mask.any():
                raise InvalidValueError("reset_mask", given["reset_mask"], f"{n} flags, one of them at least True")
        seeds = self._seeds(seed, mask)
        if not self._began and not mask.all():
            raise InvalidValueError("reset_mask", mask.tolist(), "all True at the first reset")
        if "disturbances" in given:
            chosen = Disturbances.parse(given["disturbances"])
            for k in np.flatnonzero(mask):
                self._fleet.disturb(int(k), chosen)
        for k, one in seeds.items():
            rng, _ = np_random(one)
            self._fleet.seed(k, rng)
        self._began = True
        self._fleet.reset(np.flatnonzero(mask))
        return self._fleet.observations.copy(), self._info(mask)

    def _seeds(self, seed: int | list[int | None] | None, mask: np.ndarray) -> dict[int, int | None]:
        """Seed of each robot that gets a new generator."""
        n = self.num_envs
        if seed is None:
            return {} if self._began else dict.fromkeys(range(n))
        seeds = list(seed) if isinstance(seed, list | tuple | np.ndarray) else [seed + k for k in range(n)]
        if len(seeds) != n:
            raise InvalidValueError("seed", seed, f"a whole number, or {n} of them")
        return {k: s for k, s in enumerate(seeds) if mask[k] and (s is not None or not self._began)}

    def step(self, actions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """One control period of 25 ms of every robot.

        Args:
            actions: In [−1, 1], (num_envs, size of an action); what lies outside is clipped.

        Returns:
            Observations, rewards, terminated, truncated, info.

        Raises:
            InvalidValueError: For actions of the wrong shape or with a NaN; nothing has moved.
            SpidarError: When `reset` was never called.
        """
        fleet = self._fleet
        shape = fleet.actions.shape
        given = require_array("actions", actions, f"numbers of shape {shape}")
        if given.shape != shape:
            raise InvalidValueError("actions", given.shape, f"an array of shape {shape}")
        if not np.isfinite(given).all():
            raise InvalidValueError("actions", "nan or inf", "finite numbers within −1 … 1")
        if not self._began:
            raise SpidarError("there is no episode before reset(); valid: call reset() first")
        fleet.actions[:] = given
        fleet.step()
        info = self._info(None)
        if self.metadata["autoreset_mode"] is AutoresetMode.SAME_STEP and fleet.begun.any():
            begun = fleet.begun.copy()
            info["final_obs"], info["_final_obs"] = fleet.final_observations.copy(), begun
            info["final_info"], info["_final_info"] = told(fleet.final_infos.copy()), begun
        return (
            fleet.observations.copy(), fleet.rewards.copy(), fleet.terminated.copy(), fleet.truncated.copy(), info,
        )  # fmt: skip

    def _info(self, mask: np.ndarray | None) -> dict[str, Any]:
        info = told(self._fleet.infos.copy())
        if mask is not None and not mask.all():
            info["_reset"] = mask.copy()
        return info

    def close_extras(self, **kwargs: Any) -> None:  # noqa: ANN401 - Gymnasium's signature
        """Stop the threads."""
        self._fleet.close()
        self._single.close()


__all__ = ["CRAWL", "HOVER", "NativeVectorEnv"]
