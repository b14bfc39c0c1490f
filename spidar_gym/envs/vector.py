"""Native vector environment: many robots in one call, bit for bit equal to single environments."""

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any, TypeVar

import gymnasium
import numpy as np
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils.seeding import np_random
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space

from spidar_gym.envs import vector_options
from spidar_gym.envs.course_env import CourseEnv
from spidar_gym.envs.crawl_env import CrawlEnv
from spidar_gym.envs.env import SpidarEnv
from spidar_gym.envs.grasp_env import GraspEnv
from spidar_gym.envs.hover_env import HoverEnv
from spidar_gym.envs.info import Draws, arrays_of, info_of, words_of
from spidar_gym.envs.locking import in_turn, whole
from spidar_gym.envs.observations import Rewarding, Shown
from spidar_gym.envs.options import find_task, require_vector_options
from spidar_gym.envs.path_env import PathEnv
from spidar_gym.envs.registry import COURSE, CRAWL, GRASP, HOVER, PATH, RegisteredSteps, environment
from spidar_gym.envs.serialization.fleets import restore, save
from spidar_gym.envs.variants import make_fleet, rewrite, varied
from spidar_gym.errors import InvalidValueError, SpidarError, require_array, require_keys, require_least
from spidar_gym.native.draws import to_numpy
from spidar_gym.native.engine_structs import AUTORESETS
from spidar_gym.turn import Turn

ValueT = TypeVar("ValueT")
KINDS: dict[str, type[HoverEnv] | type[CrawlEnv] | type[CourseEnv] | type[GraspEnv]] = {
    HOVER: HoverEnv, PATH: PathEnv, CRAWL: CrawlEnv, COURSE: CourseEnv, GRASP: GraspEnv,
}  # fmt: skip
"""Class of a single robot's environment by id."""


class NativeVectorEnv(Rewarding, gymnasium.vector.VectorEnv[Any, np.ndarray, np.ndarray]):
    """Robots of one environment; the controller is the core.

    `info` consists of arrays. Words are codes (`qp_status_code`, `failure_code`, and in the crawl `phase_code` and
    `shortfalls_code`; −1 is none), and the reward terms are one array in the order of the task's table. As in
    Gymnasium's vectors, `info["_name"]` is the mask of the robots for which `info["name"]` is valid.
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
            name: `spidar_gym/Hover-v0`, `spidar_gym/Path-v0`, `spidar_gym/Crawl-v0` or `spidar_gym/Course-v0`.
            num_envs: Number of robots.
            num_threads: Number of threads, the caller's included.
            autoreset_mode: Behaviour at the end of an episode, one of Gymnasium's modes `NextStep`, `SameStep`,
                `Disabled`.
            max_episode_steps: Steps of an episode, at most those of `horizon_s` if that is given too; −1 for no end.
            **options: Arguments of the environment, including a custom task; the controller is the core.

        Raises:
            UnknownNameError: For an environment or an option that does not exist; it lists the valid ones.
            UnknownArgumentError: For an argument that does not exist; it lists the valid ones.
            InvalidValueError: For a value out of range.
        """
        environment(name)
        self.turn = Turn()
        """Lock that serialises calls from several threads."""
        require_least(1, num_envs=num_envs, num_threads=num_threads)
        mode = vector_options.autoreset(autoreset_mode)
        kind = KINDS[name]
        task = find_task(options.get("task"), kind.task_type, options.get("reward"))
        require_vector_options(SpidarEnv, kind, task if isinstance(task, type) else type(task), options)
        if options.get("render_mode") == "human":
            raise InvalidValueError("render_mode", "human", "rgb_array or depth_array: a window shows a single robot")
        single = kind(control="core", **options)
        self._single, self._envs = single, [single] * num_envs
        self.render_mode = single.render_mode
        self.task, self.layout, self.num_envs = single.task, single.layout, num_envs
        single.end(None if isinstance(max_episode_steps, RegisteredSteps) else max_episode_steps)
        ends = single.truncates
        self._steps = single.horizon if ends else None
        self._spec: EnvSpec | None = None
        self.autoreset_mode = mode
        """Behaviour at the end of an episode, as in Gymnasium's vectors."""
        self.metadata = {**single.metadata, "autoreset_mode": mode}
        self.single_action_space, self.single_observation_space = single.action_space, single.observation_space
        self.action_space = batch_space(single.action_space, num_envs)
        self.observation_space = batch_space(single.observation_space, num_envs)
        self.sight, self._shown = single.sight, None
        self._threads, self._how = num_threads, {"autoreset": "disabled", "truncates": ends}
        self.fleet = single.make_fleet(num_envs, num_threads, **self._how)
        """The robots in the engine."""
        self._draws = Draws([single.randomization] * num_envs)
        self._everybody = np.ones(num_envs, bool)
        self.set_autoreset_mode(mode)
        self._began = False
        self._seeds = [-1] * num_envs

    @in_turn
    def set_autoreset_mode(self, mode: AutoresetMode | str) -> None:
        """Set the behaviour at the end of an episode; all robots must be reset afterwards.

        Args:
            mode: As `autoreset_mode` of the constructor.

        Raises:
            InvalidValueError: For a mode that does not exist.
        """
        self.autoreset_mode = mode = vector_options.autoreset(mode)
        self.metadata = {**self.metadata, "autoreset_mode": mode}
        way, same_step = mode.name.lower(), mode is AutoresetMode.SAME_STEP
        if self.sight is not None:
            self._shown = Shown(self.sight, self.num_envs, same_step=same_step)
            way = "disabled" if same_step else way  # `Shown` resets the robots
        self._how["autoreset"] = way
        self.fleet.rules["rules"]["autoreset"] = AUTORESETS.index(way)
        self._began = False

    @property
    def np_random_seed(self) -> tuple[int, ...]:  # pyright: ignore[reportIncompatibleMethodOverride] - as in SyncVectorEnv
        """Seed of each robot's generator, as in Gymnasium's vectors; −1 before the first reset."""
        return tuple(self._seeds)

    @property
    def np_random(self) -> tuple[np.random.Generator, ...]:  # pyright: ignore[reportIncompatibleMethodOverride] - likewise
        """Copies of the robots' generators; sampling from a copy does not change the robot's generator."""
        return tuple(to_numpy(each) for each in self.robots["episode"]["generator"])

    @property
    def is_closed(self) -> bool:  # pyright: ignore[reportIncompatibleVariableOverride] - it follows `closed`
        """Whether `close` was called; other calls then raise `SpidarError`."""
        return self.closed

    @property
    def robots(self) -> np.ndarray:
        """Complete state of the robots, records of `sp_hover_robot` or another task's; do not write to it."""
        return self.fleet.robots

    @property
    def buffers(self) -> dict[str, Any]:
        """Arrays that `reset`, `step` and `advance` overwrite, with an entry for every robot; do not write to them.

        By name: ``observations``, ``rewards``, ``terminated``, ``truncated``; ``begun``, whether the step began an
        episode; ``final_observations`` and ``final_infos``, if it began in the same step; ``infos``, records. With a
        dictionary as observation, the observations are dictionaries of arrays.
        """
        names = ("rewards", "terminated", "truncated", "begun", "final_infos", "infos")
        shown = {name: getattr(self.fleet, name) for name in ("observations", "final_observations")}
        if self._shown is not None:
            shown = {"observations": self._shown.now, "final_observations": self._shown.final}
        return shown | {name: getattr(self.fleet, name) for name in names}

    @property
    def spec(self) -> EnvSpec | None:
        """Specification from `gymnasium.make_vec`, with the steps after which an episode is truncated."""
        return self._spec

    @spec.setter
    def spec(self, value: EnvSpec | None) -> None:  # pyright: ignore[reportIncompatibleVariableOverride] - gymnasium's is a plain attribute
        if value is not None:
            value.max_episode_steps, value.additional_wrappers = self._steps, ()
            value.kwargs["max_episode_steps"] = -1 if self._steps is None else self._steps
        self._spec = value

    @in_turn
    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Start episodes.

        Args:
            seed: Seed of robot 0; robot i gets `seed + i`, as in Gymnasium's vectors. Or a list of seeds.
            options: `{"reset_mask": …}` selects the robots to reset, all by default. The other options are those of the
                environment's `reset`: one value for all selected robots, or a list with an entry for every robot of the
                vector, of which the entries of the selected robots apply. (A single value that is a sequence must be a
                tuple.) An argument must first be given to all robots at once; later resets may select robots.

        Returns:
            Observations of all robots, and info, whose masks mark the robots that were reset.

        Raises:
            UnknownNameError: For an option that does not exist; the vector is unchanged.
            InvalidValueError: For seeds, a mask or a list of another length, or a value that is not valid; the vector
                is unchanged.
        """
        fleet, n = self.fleet, self.num_envs
        own, others = self._single.reset_options, self._envs[0].reset_arguments
        names = dict.fromkeys(("reset_mask", *own, *others))
        given = require_keys("options", "reset option", {} if options is None else options, names)
        mask = self._everybody
        if "reset_mask" in given:
            mask = vector_options.masked(given["reset_mask"], n)
        if not self._began and not mask.all():
            raise InvalidValueError("reset_mask", mask.tolist(), "all True at the first reset")
        generators = {k: np_random(one) for k, one in vector_options.seeds(seed, mask, began=self._began).items()}
        rest = [name for name in others if name in given and name not in own]
        asked = {name: vector_options.listed(name, given[name], n) for name in rest}
        chosen = {name: vector_options.parsed(name, given[name], n, self.task) for name in own if name in given}
        ids = np.flatnonzero(mask)
        if asked:
            self._ask(asked, ids)
            fleet = self.fleet
        for k in ids.tolist():
            vector_options.said_at_reset(fleet, k, {name: values[k] for name, values in chosen.items()})
            if k in generators:
                generator, self._seeds[k] = generators[k]
                fleet.seed(k, generator)
        self._began = False  # an interrupt may leave some robots reset and others not
        fleet.reset(ids)
        self._began = True
        return self._seen(), self._info(mask.copy())

    def _ask(self, options: Mapping[str, Sequence[Any]], ids: np.ndarray) -> None:
        """Change arguments of some robots."""
        envs = varied(self._envs, options, ids.tolist())
        alike = all(env is envs[0] for env in envs)
        if self.fleet.rules.ndim and not alike:
            rewrite(self.fleet, envs, ids.tolist(), **self._how)
        elif len(ids) < self.num_envs:
            raise InvalidValueError(
                "reset_mask", self._everybody.tolist(), f"all robots, as {', '.join(options)} were not given before"
            )
        elif self.task.is_own and not alike:
            raise InvalidValueError("options", dict(options), "one value for all robots with a custom task")
        else:
            self.fleet = make_fleet(envs, self.fleet, self._threads, alike=alike, **self._how)
        self._envs, self.task = envs, envs[0].task
        self._draws = Draws([env.randomization for env in envs])
        self._steps = max(env.horizon for env in envs) if self._how["truncates"] else None

    def _seen(self) -> Any:  # noqa: ANN401 - an array, or a dictionary of them
        """Return the current observations of all robots."""
        if self._shown is None:
            return self.fleet.observations.copy()
        self._shown.look(self.fleet, self.fleet.observations)
        return vector_options.copied(self._shown.now)

    @in_turn
    def step(self, actions: np.ndarray) -> tuple[Any, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Simulate one step of every robot.

        In the mode `Disabled` a robot whose episode is over continues until it is reset; Gymnasium's vectors refuse to
        step it.

        If an episode ends and the next begins in the same step, `info["final_obs"]` and `info["final_info"]` are those
        of the end. The masks `info["_final_obs"]` and `info["_final_info"]` mark the valid rows.

        Args:
            actions: Actions in [−1, 1], (num_envs, size of an action); entries outside are clipped.

        Returns:
            Observations, rewards, terminated, truncated, info.

        Raises:
            InvalidValueError: For actions of the wrong shape or with a NaN; no robot has moved.
            SpidarError: When `reset` was never called.
        """
        fleet, same_step = self.fleet, self.autoreset_mode is AutoresetMode.SAME_STEP
        before = self._draws.of(fleet) if same_step else {}  # the next episode overwrites them
        self.advance(actions)
        info = self._info(self._everybody.copy())
        if same_step and fleet.begun.any():
            begun = fleet.begun.copy()
            info["final_obs"], info["_final_obs"] = vector_options.copied(self.buffers["final_observations"]), begun
            info["final_info"], info["_final_info"] = self._info(begun, ended=before), begun
        ends = fleet.terminated.copy(), fleet.truncated.copy()
        return vector_options.copied(self.buffers["observations"]), fleet.rewards.copy(), *ends, info

    @in_turn
    def advance(self, actions: np.ndarray, ids: np.ndarray | None = None) -> None:
        """Step as `step` does, but write results only into `buffers`: nothing is copied, and no `info` is built.

        Args:
            actions: As for `step`.
            ids: Robots that move, in rising order (else `InvalidValueError`); all if None, as a custom task requires.
        """
        fleet = self.fleet
        shape = fleet.actions.shape
        given = require_array("actions", actions, f"numbers of shape {shape}")
        if given.shape != shape:
            raise InvalidValueError("actions", given.shape, f"an array of shape {shape}")
        if not np.isfinite(given).all():
            raise InvalidValueError("actions", "nan or inf", "finite numbers within −1 … 1")
        if not self._began:
            raise SpidarError("there is no episode before reset(); valid: call reset() first")
        if ids is not None and self.task.is_own:
            raise InvalidValueError("ids", ids, "None with a custom task: all robots move")
        ids = None if ids is None else np.array(vector_options.numbered(ids, self.num_envs, rising=True), np.int32)
        fleet.actions[:] = given
        fleet.step(ids)
        if self._shown is not None:
            with whole():
                self._shown.conclude(fleet, ids)

    def _info(self, mask: np.ndarray, *, ended: dict[str, np.ndarray] | None = None) -> dict[str, Any]:
        """Build `info` by `arrays_of`."""
        terms = self._envs[0].reward_terms
        return arrays_of(self.fleet, terms, mask, self._draws, ended=ended)

    @in_turn
    def ended(self, robot: int) -> dict[str, Any]:
        """Return the final `info` of a robot whose next episode began in the same step, as of a single environment."""
        own, fleet = self._envs[robot], self.fleet
        record, terms = fleet.final_infos[robot : robot + 1], fleet.final_terms[robot]
        return info_of(record, own.reward_terms, terms, words_of(own.failures, own.words))

    @in_turn
    def render(self, ids: Sequence[int] | None = None) -> tuple[np.ndarray, ...] | None:
        """Return pictures of robots, each on its own floor.

        Args:
            ids: Robots, all if None.

        Returns:
            A picture (height, width, 3) uint8 each, in the mode `depth_array` distances (height, width) [m]; None
            without a `render_mode`.

        Raises:
            InvalidValueError: For robots that do not exist.
            SpidarError: When `reset` was never called.
        """
        if self.render_mode is None:
            gymnasium.logger.warn("render() without a render_mode; valid: rgb_array, depth_array")
            return None
        return tuple(self._single.view.draw_plant(self.robots["plant"][k]) for k in self._choice(ids))

    @in_turn
    def save(self, ids: Sequence[int] | None = None) -> bytes:
        """Return the complete state of robots as bytes, without changing it.

        Args:
            ids: Robots, all if None.

        Raises:
            InvalidValueError: For robots that do not exist.
            SpidarError: When `reset` was never called.
        """
        return save(self.fleet, self._choice(ids))

    @in_turn
    def restore(self, saved: bytes, ids: Sequence[int] | None = None) -> tuple[Any, dict[str, Any]]:
        """Replace robots by saved ones, which continue bit for bit as the saved robots would have.

        Args:
            saved: Bytes from `save` of any vector of the same environment and options, in this or another process.
            ids: Robots to replace, in the order of the saved ones; all if None. A vector that was never reset needs
                all.

        Returns:
            Observations of all robots, and info, whose masks mark the restored robots.

        Raises:
            SpidarError: For bytes that do not match this vector; the vector is unchanged.
            InvalidValueError: For another number of robots than were saved; the vector is unchanged.
        """
        chosen = list(range(self.num_envs)) if not self._began and ids is None else self._choice(ids)
        restore(self.fleet, saved, chosen)
        self._began = True
        mask = np.zeros(self.num_envs, bool)
        mask[chosen] = True
        return self._seen(), self._info(mask)

    def _choice(self, ids: Sequence[int] | None) -> list[int]:
        """Return the indices of robots."""
        if not self._began:
            raise SpidarError("there is no episode before reset(); valid: call reset() first")
        return vector_options.numbered(ids, self.num_envs)

    def close(self, **kwargs: Any) -> None:  # noqa: ANN401 - Gymnasium's signature
        """Stop the threads after the current tick; a second call does nothing."""
        with self.turn.lock:
            super().close(**kwargs)

    @in_turn
    def __getstate__(self) -> dict[str, Any]:
        """Return the state for a copy (`SpidarError` if closed)."""
        return vars(self).copy()

    def close_extras(self, **kwargs: Any) -> None:  # noqa: ANN401 - Gymnasium's signature
        """Stop the threads, release the OpenGL context."""
        self.fleet.close()
        self._single.close()


hover_vector, path_vector, crawl_vector, course_vector, grasp_vector = (
    partial(NativeVectorEnv, name) for name in (HOVER, PATH, CRAWL, COURSE, GRASP)
)
"""Vector entry points of `gymnasium.make_vec` for each environment."""


__all__ = [
    "COURSE", "CRAWL", "GRASP", "HOVER", "PATH", "NativeVectorEnv", "course_vector", "crawl_vector", "grasp_vector",
    "hover_vector", "path_vector",
]  # fmt: skip
