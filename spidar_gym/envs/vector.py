"""Many robots at once in native code, behind Gymnasium's vector interface: the same bits as one by one."""

from typing import Any

import gymnasium
import numpy as np
from gymnasium.utils.seeding import np_random
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space

from spidar_gym.envs import rules
from spidar_gym.envs.crawl.env import SETTLE_TICKS, CrawlEnv
from spidar_gym.envs.hover.env import HoverEnv
from spidar_gym.envs.registry import CRAWL, HOVER, environment
from spidar_gym.errors import InvalidValueError, SpidarError, require_array, require_keys, require_least
from spidar_gym.native.draws import from_numpy
from spidar_gym.native.engine import Engine
from spidar_gym.native.engine_structs import AUTORESETS, engine_layouts
from spidar_gym.native.structs import fill
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
        self._name, self._single = name, single
        self.task, self.layout, self.num_envs = single.task, single.layout, num_envs
        if max_episode_steps is not None:
            require_least(1, max_episode_steps=max_episode_steps)
            single.horizon = int(max_episode_steps)
        self.metadata = {**single.metadata, "autoreset_mode": mode}
        self.single_action_space, self.single_observation_space = single.action_space, single.observation_space
        self.action_space = batch_space(single.action_space, num_envs)
        self.observation_space = batch_space(single.observation_space, num_envs)
        self._make_engine(num_threads, AUTORESETS[("NEXT_STEP", "SAME_STEP", "DISABLED").index(mode.name)])
        self._disabled = mode is AutoresetMode.DISABLED
        self._began = False

    def _make_engine(self, threads: int, autoreset: str) -> None:
        """Robots, and what goes in and comes out at a tick."""
        single, n = self._single, self.num_envs
        drawn, layouts = single._strength > 0.0, engine_layouts()
        if isinstance(single, HoverEnv):
            self._rules = rules.hover_rules(single.task, single.controller.config, described=single._described)
            alike = not drawn
        else:
            self._rules = rules.crawl_rules(single.task, single.controller.config, SETTLE_TICKS)
            alike = not (drawn or single.task.steps or single.task.obstacles)
        rules.common(
            self._rules["rules"], single._nominal, single._mode, single._bound, strength=single._strength,
            horizon=single.horizon, truncates=True, autoreset=autoreset,
        )  # fmt: skip
        flies = self._name == HOVER
        self._engine = engine = Engine("hover" if flies else "crawling", single._nominal, n, threads, alike=alike)
        self._jobs = ("sp_reset_hovers", "sp_step_hovers") if flies else ("sp_reset_crawlings", "sp_step_crawlings")
        kind, size = layouts["hover_info" if flies else "crawling_info"], len(single._bound)
        self._outputs = {
            "observations": np.zeros((n, size), np.float32), "final_observations": np.zeros((n, size), np.float32),
            "rewards": np.zeros(n), "terminated": np.zeros(n, bool), "truncated": np.zeros(n, bool),
            "begun": np.zeros(n, bool), "infos": np.zeros(n, kind), "final_infos": np.zeros(n, kind),
        }  # fmt: skip
        self._actions = np.zeros((n, single._mode.size))
        for name, array in {**self._outputs, "rules": self._rules, "actions": self._actions}.items():
            engine.share(name, array)
        if isinstance(single, HoverEnv):
            room = rules.most_goals(single.task.horizon_s)
            engine.share("goals", np.zeros((n, room), layouts["goal"]))
            engine.record["goal_room"] = room
            engine.robots["forms"] = rules.sequence(single.task)
        fill_all(engine.robots["episode"]["disturbances"], single._disturbances)

    @property
    def robots(self) -> np.ndarray:
        """All that there is of the robots, records of `sp_hover` or `sp_crawling`; not to be written."""
        return self._engine.robots

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
                fill(self.robots[k]["episode"]["disturbances"], chosen)
        for k, one in seeds.items():
            rng, _ = np_random(one)
            self.robots[k]["episode"]["generator"] = from_numpy(rng)
        self._began = True
        self._run(self._jobs[0], np.flatnonzero(mask))
        return self._outputs["observations"].copy(), self._info(mask)

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
        shape = self._actions.shape
        given = require_array("actions", actions, f"numbers of shape {shape}")
        if given.shape != shape:
            raise InvalidValueError("actions", given.shape, f"an array of shape {shape}")
        if not np.isfinite(given).all():
            raise InvalidValueError("actions", "nan or inf", "finite numbers within −1 … 1")
        if not self._began:
            raise SpidarError("there is no episode before reset(); valid: call reset() first")
        self._actions[:] = given
        self._run(self._jobs[1], None)
        out = self._outputs
        info = self._info(None)
        if self.metadata["autoreset_mode"] is AutoresetMode.SAME_STEP and out["begun"].any():
            begun = out["begun"].copy()
            info["final_obs"], info["_final_obs"] = out["final_observations"].copy(), begun
            info["final_info"], info["_final_info"] = views(out["final_infos"].copy()), begun
        return (
            out["observations"].copy(), out["rewards"].copy(), out["terminated"].copy(), out["truncated"].copy(), info,
        )  # fmt: skip

    def _run(self, job: str, ids: np.ndarray | None) -> None:
        failed = self._engine.run(job, ids)
        if failed:
            words = self._engine.words(failed[0])
            raise SpidarError(
                f"MuJoCo gave up robot {failed[0]}: {words}; valid: a robot and actions that it simulates"
            )
        if self._name == CRAWL and not self.robots["cycles"].all():
            robot = int(np.flatnonzero(self.robots["cycles"] == 0)[0])
            way = self.robots["way"][robot].tolist()
            raise InvalidValueError("way", way, "a way within reach, and no more steps than there is room for")

    def _info(self, mask: np.ndarray | None) -> dict[str, Any]:
        info = views(self._outputs["infos"].copy())
        if mask is not None and not mask.all():
            info["_reset"] = mask.copy()
        return info

    def close_extras(self, **kwargs: Any) -> None:  # noqa: ANN401 - Gymnasium's signature
        """Stop the threads."""
        self._engine.close()
        self._single.close()


def views(record: np.ndarray) -> dict[str, Any]:
    """Views of an array of `sp_hover_info` or `sp_crawling_info`, by name; the part that both have comes first."""
    assert record.dtype.names is not None
    common = record["info"]
    assert common.dtype.names is not None
    shared = {name: common[name] for name in common.dtype.names}
    own = {name: record[name] for name in record.dtype.names if name != "info"}
    return {**shared, **own}


def fill_all(records: np.ndarray, value: object) -> None:
    """Write a dataclass into every record of an array."""
    for record in records:
        fill(record, value)


__all__ = ["CRAWL", "HOVER", "NativeVectorEnv"]
