"""What every environment shares: the simulated robot, actions, seeds, pictures, and the rules of `info`."""

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, ClassVar, Generic, TypeVar

import gymnasium
import numpy as np
from gymnasium import spaces

from spidar_gym.control.estimator import Estimator
from spidar_gym.control.flight.observation import Field
from spidar_gym.control.interface import CrawlControl, FlightControl
from spidar_gym.control.locomotion.orders import Orders
from spidar_gym.envs import rules, single
from spidar_gym.envs.actions import ActionMode
from spidar_gym.envs.batch import VectorTask
from spidar_gym.envs.controllers import forget, is_compiled
from spidar_gym.envs.fleet import Fleet
from spidar_gym.envs.judge import Judge, find_task, require_task
from spidar_gym.envs.midway import Disturbable
from spidar_gym.envs.moments import Restorable
from spidar_gym.envs.observed import Observed
from spidar_gym.envs.options import Task, own_robot
from spidar_gym.envs.readable import Readable
from spidar_gym.envs.turns import in_turn
from spidar_gym.envs.view import RENDER_MODES, View, fps
from spidar_gym.errors import InvalidValueError, SpidarError, require_array, require_flag, require_within
from spidar_gym.native.plant import Plant
from spidar_gym.robot import RobotSpec
from spidar_gym.sim.config import PlantConfig
from spidar_gym.sim.disturbances import Disturbances
from spidar_gym.sim.randomize import Randomization
from spidar_gym.state import Command, RobotState

TaskT = TypeVar("TaskT", bound=Task)
ControllerT = TypeVar("ControllerT", FlightControl, CrawlControl, Orders)
ProgressT = TypeVar("ProgressT")


class SpidarEnv(
    Readable, Disturbable, Observed, Restorable, gymnasium.Env[Any, np.ndarray], Generic[TaskT, ControllerT, ProgressT]
):
    """SPIDAR behind Gymnasium's interface; what it is to do, and who controls it, is the subclass's."""

    metadata: dict[str, Any] = {  # noqa: RUF012 - Gymnasium's own declaration
        "render_modes": [*RENDER_MODES],
        "render_fps": fps(1),
    }
    task: TaskT
    """What is to be done."""
    controller: ControllerT
    """What commands the robot where no action does."""
    reward_terms: Mapping[str, tuple[float, str]]
    """Weight and formula of each term of the reward; the weights add up to 1."""
    failures: tuple[str, ...]
    """Why an episode may be over, in the engine's order."""
    words: Mapping[str, tuple[str, ...]] = MappingProxyType({})
    """Words that `info` may hold besides `failure` and `qp_status`, by name, in the order of their codes."""
    hold: int = 1
    """Control periods of a step."""
    untouchable: tuple[str, ...] = ("duct", "part")
    kind: ClassVar[str]
    """Struct of a robot in the engine."""

    def __init__(
        self,
        mode: ActionMode,
        layout: tuple[Field, ...],
        *,
        joint_speed: float,
        control: str,
        task: VectorTask[Any] | type[VectorTask[Any]] | str | None = None,
        idle_thrust: float = 0.0,
        robot: RobotSpec | str | Path | Mapping[str, Any] | None = None,
        plant: PlantConfig | None = None,
        wake: bool = True,
        battery: bool = False,
        sensors: bool = False,
        randomization: float | str | Path | Mapping[str, Any] | Randomization = 0.0,
        disturbances: Mapping[str, Any] | Disturbances | None = None,
        observation: str = "vector",
        goal_reward: str = "sparse",
        max_episode_steps: int | None = None,
        render_mode: str | None = None,
        camera: str = "chase",
        width: int = 640,
        height: int = 480,
    ) -> None:
        """Build the robot.

        Args:
            mode: What the action means.
            layout: The observation's layout.
            joint_speed: Speed limit of the joint servos [rad/s].
            control: `python` or `core`.
            task: A task of one's own in place of the built-in one: a `FlightTask` or a `WalkTask`, its class, or the
                class's name, `module:Class`.
            idle_thrust: Least commanded thrust of a module [N].
            robot: A robot of one's own, which controller and simulator know: a `RobotSpec`, its numbers by name, or a
                TOML file of these; the nominal one by default.
            plant: A simulated robot of one's own, to which the arguments below are applied; the nominal one by default.
            wake: Whether there is air: jets, drag, ground effect.
            battery: Whether the largest thrust falls with the voltage.
            sensors: Whether the controller sees what the real sensors and the estimator say, or the true state.
            randomization: Strength of the domain randomisation, 0 … 1; or ranges by field, as `Randomization.parse`
                takes them: `{"body.total_mass": (15.5, 17.0)}`, or a TOML file.
            disturbances: `{"wind": m/s, "push": N, "lost_rotor": 1 … 8, "fault": …, "fault_time": s}`.
            observation: `vector`, `goal` or `asymmetric`, see `OBSERVATIONS`.
            goal_reward: `sparse` or `dense`, where it is `goal`, see `REWARDS`.
            max_episode_steps: Steps after which an episode is truncated, at most those of `horizon_s` where that is
                given too; −1 for no end, as without it where the environment is not made by `gymnasium.make`.
            render_mode: `human`, `rgb_array`, `depth_array` or None.
            camera: Camera of the pictures.
            width: Width of the pictures [px].
            height: Height of the pictures [px].

        Raises:
            UnknownNameError: For a mode, observation or camera that does not exist; it lists the valid ones.
            InvalidValueError: For a value out of range, and a goal where there is none.
            StaleAssetError: When the model file was edited by hand.
        """
        nominal = own_robot(plant, robot)
        self.robot = nominal.robot
        """The robot as described."""
        if "robot" in self._arguments:  # what a file said holds for as long as the environment lives
            self._arguments = self._arguments | {"robot": self.robot}
        self.view = View(render_mode, camera, width, height, self.robot)
        """How it is looked at."""
        require_flag(wake=wake, battery=battery, sensors=sensors)
        require_within(0.0, self.robot.max_thrust, "N", idle_thrust=idle_thrust)
        self.own_task: VectorTask[Any] | None = find_task(task)
        """The task of one's own; None where the built-in one is done."""
        self._bound = np.concatenate([np.full(f.size, f.bound) for f in layout])
        if self.own_task is not None:
            own = self.own_task
            require_task(own, self.kind, self._arguments)
            self.reward_terms, self.failures = own.reward_terms, tuple(own.failures)
            layout = (*layout, *own.fields)
        self._mode, self.layout = mode, layout
        if max_episode_steps is not None:
            self.end(max_episode_steps)
        self._randomization = Randomization.parse(randomization)
        self._disturbances = Disturbances.parse(disturbances)
        self._nominal = replace(
            nominal,
            joint_speed=joint_speed,
            idle_thrust=float(idle_thrust) or nominal.idle_thrust,
            sense=bool(nominal.sense or sensors),
            aero=replace(nominal.aero, wake=bool(nominal.aero.wake and wake)),
            actuators=replace(nominal.actuators, battery=bool(nominal.actuators.battery or battery)),
        )
        self._described = plant is None and not self._randomization.draws
        self._control = control
        self.estimator = Estimator(robot=self.robot)
        self.sampled_parameters: dict[str, np.ndarray] = {}
        """What was drawn of this episode's robot, by field of `PlantConfig`; empty where nothing is."""
        self.render_mode = render_mode
        self.metadata = self.metadata | {"render_fps": fps(self.hold)}
        self.action_space = spaces.Box(-1.0, 1.0, (mode.size,), np.float32)
        high = np.concatenate([np.full(f.size, f.bound) for f in layout]).astype(np.float32)
        flat = spaces.Box(-high, high, dtype=np.float32)
        self.sight = self._choose_sight(observation, goal_reward, flat, layout)
        self.observation_space = flat if self.sight is None else self.sight.space
        self._now: dict[str, Any] = {}
        self.ticks = 0
        self._began = False
        self._command: Command | None = None
        self._made = self.task, self._nominal
        self.fleet: Fleet | None = None
        """Its robot in the engine, where that does all of it."""
        if not self._is_bare:
            self._furnish(native=self._is_native())

    # ---- two ways to run: all of it in the engine, or controller and task in Python over the engine's robot ----

    def _is_native(self) -> bool:
        """Whether the engine does all of it: the core flies, and task and rewards are the built-in ones."""
        return is_compiled(self._control) and self._is_built_in()

    def _furnish(self, *, native: bool) -> None:
        """Make robot and controller."""
        if not native and self.own_task is not None:
            valid = "None beside a law, an allocator or a page of one's own in Python: the core flies"
            raise InvalidValueError("task", self.own_task, valid)
        self.fleet = self.make_fleet(1) if native else None
        self._judge = self.judge(self.fleet)
        self._ruled = self.task
        self.plant = Plant(self._nominal, engine=None if self.fleet is None else self.fleet.engine)
        self.controller = self._make_controller()
        self._now = {}

    @in_turn
    def _known(self, name: str) -> Any:  # noqa: ANN401 - whatever is looked up
        """What is known of this tick; where the engine does it all, it is read when somebody asks."""
        if name not in self._now:
            if not self._began:
                raise SpidarError(f"there is no {name} before reset(); valid: call reset() first")
            self._now[name] = self._read(name)
        return self._now[name]

    def _forget(self) -> None:
        """What was read of the last tick is past."""
        self._now = {}
        forget(self.controller)

    def _read(self, name: str) -> Any:  # noqa: ANN401 - whatever is looked up
        """Read what the engine knows: the true state, what is seen of it, the last command."""
        assert self.fleet is not None
        return self.plant.state() if name == "state" else single.look(self.fleet, name)

    @property
    @in_turn
    def command(self) -> Command:
        """The last command (`SpidarError` before the first step)."""
        if not self.ticks:
            raise SpidarError("there is no command before step(); valid: call step() first")
        return self._known("command") if self._command is None else self._command

    @property
    def state(self) -> RobotState:
        """The true state of the robot (`SpidarError` before the first reset)."""
        return self._known("state")

    @property
    def seen(self) -> RobotState:
        """What the controller sees of the robot: the true state, or the estimate where there are sensors."""
        return self._known("seen" if self._nominal.sense else "state")

    @property
    def _loads(self) -> bool:
        """Whether robots get a model of their own because their task has them carry things."""
        return self.own_task is not None and self.own_task.loads

    @property
    def progress(self) -> ProgressT:
        """How far the episode has come (`SpidarError` before the first reset)."""
        return self._known("episode")

    @in_turn
    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Start an episode.

        Args:
            seed: Seed of the environment's generator, which draws everything.
            options: What is to be from this episode on: `disturbances`, `randomization`, every argument of the task,
                and what else is in `reset_options`.

        Returns:
            Observation and info.

        Raises:
            UnknownNameError: For an option that does not exist, and nothing has changed.
            InvalidValueError: For a value that is not valid, and nothing has changed.
        """
        chosen = self._choose({} if options is None else options)
        super().reset(seed=seed)
        for name, value in chosen.items():
            setattr(self, name, value)
        if self._is_native() != (self.fleet is not None):
            self._furnish(native=self.fleet is None)
        self.ticks, self._began, self._now = 0, True, {}
        self._action, self._command, self._failure = np.zeros(self._mode.size), None, ""
        if self.fleet is None:
            self._begin(self.np_random)
            self.plant.forgive()
        else:
            self._begin_native(self.fleet)
        if self.render_mode == "human":
            self.render()
        observation, info = self._shown()
        terms = {name.removeprefix("reward_") for name in info if name.startswith("reward_")}
        if terms != self.reward_terms.keys():
            raise InvalidValueError(
                "reward_terms", sorted(self.reward_terms), f"the terms of the task: {sorted(terms)}"
            )
        return observation, info

    @in_turn
    def step(self, action: np.ndarray) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """`hold` control periods of 25 ms: one, unless the environment says otherwise.

        Args:
            action: In [−1, 1]; what lies outside is clipped.

        Returns:
            Observation, reward (in [0, 1], or as `goal_reward` says), terminated, truncated, info.

        Raises:
            InvalidValueError: For an action of the wrong shape or with a NaN; nothing has moved.
            SpidarError: When `reset` was never called.
        """
        action = require_array("action", action, f"numbers of shape ({self._mode.size},)")
        if action.shape != (self._mode.size,):
            raise InvalidValueError("action", action.shape, f"an array of shape ({self._mode.size},)")
        if not np.isfinite(action).all():
            raise InvalidValueError("action", action.tolist(), "finite numbers within −1 … 1")
        if not self._began:
            raise SpidarError("there is no episode before reset(); valid: call reset() first")
        if self.fleet is not None:
            return self._step_native(self.fleet, action)
        self._action = np.minimum(np.maximum(action, -1.0), 1.0)
        self.ticks += 1
        self.plant.forgive()
        failure = self._control_period()
        for _ in range(self.hold - 1):
            failure = failure or self._control_period()
        self._failure = failure
        info = self._info(failure)
        if failure == "diverged":
            shown = self._show(np.zeros(len(self._bound), np.float32), info)
            return shown, self._judged(shown, 0.0), True, self.is_over, info
        reward = sum(weight * info[f"reward_{name}"] for name, (weight, _) in self.reward_terms.items())
        if self.render_mode == "human":
            self.render()
        shown = self._show(self._observation(), info)
        return shown, self._judged(shown, reward), failure != "", self.is_over, info

    def _shown(self) -> tuple[Any, dict[str, Any]]:
        if self.fleet is not None:
            info = self.tell(self.fleet)
            return self._show((self._judge or self.fleet).observations[0].copy(), info), info
        info = self._info(self._failure)
        has_diverged = self._failure == "diverged"
        flat = np.zeros(len(self._bound), np.float32) if has_diverged else self._observation()
        return self._show(flat, info), info

    def _empty(self) -> None:
        self.controller.close()
        self.plant.close()

    def _chosen(self, name: str, value: Any) -> dict[str, object]:  # noqa: ANN401 - whatever a user gives
        """Attributes that an option of `reset` sets from now on, and their values; refuses what is not valid."""
        assert name == "disturbances"
        return {"_disturbances": Disturbances.parse(value)}

    # ---- all of it in the engine ----

    @abstractmethod
    def make_fleet(
        self, robots: int, threads: int = 1, *, autoreset: str = "disabled", truncates: bool = False,
        rules: np.ndarray | None = None,
    ) -> Fleet:  # fmt: skip
        """Robots of this environment in the engine, at no episode yet.

        Args:
            robots: How many.
            threads: How many threads carry them.
            autoreset: What happens at the end of an episode: one of `AUTORESETS`.
            truncates: Whether an episode ends at the horizon.
            rules: For each robot those of an environment of its own of this kind, from its `rules`; their floors are
                all even or all of tiles. Those of this one for all by default.
        """

    @abstractmethod
    def rules(self, *, truncates: bool = False, autoreset: str = "disabled") -> np.ndarray:
        """What this environment is to the engine; arguments as in `make_fleet`."""

    def _fill_rules(self, record: np.ndarray, *, truncates: bool, autoreset: str) -> None:
        """Write what every environment has into its rules."""
        rules.common(
            record["rules"], self._nominal, self._mode, self._bound, randomization=self._randomization,
            horizon=self.horizon, truncates=truncates, autoreset=autoreset,
        )  # fmt: skip
        record["rules"]["is_judged"] = self.own_task is not None

    @abstractmethod
    def _make_controller(self) -> ControllerT:
        """The controller; in the engine's memory where the engine does all of it."""

    @abstractmethod
    def _rule(self, fleet: Fleet) -> None:
        """Write the task into the engine's rules."""

    @abstractmethod
    def _is_built_in(self) -> bool:
        """Whether task and rewards are those that the engine has too."""

    @abstractmethod
    def _prepare(self, fleet: Fleet) -> None:
        """Write down what the next episode begins with, where that is given."""

    def _begin_native(self, fleet: Fleet) -> None:
        self._obey(fleet)
        fleet.disturb(0, self._disturbances)
        self._prepare(fleet)
        single.begin(fleet, self._judge, self.np_random)
        self.plant.reread()
        self._forget()
        self.sampled_parameters = single.drawn(fleet.robots[0]["episode"]["drawn"]) if self.is_drawn else {}

    def _step_native(self, fleet: Fleet, action: np.ndarray) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        self.plant.keep()
        fleet.actions[0] = action
        self._forget()
        self.ticks += 1
        (self._judge or fleet).step()
        observation, info = self._shown()
        if self.render_mode == "human":
            self.render()
        reward = self._judged(observation, float(fleet.rewards[0]))
        return observation, reward, bool(fleet.terminated[0]), self.is_over, info

    def judge(self, fleet: Fleet | None, before: Judge | None = None) -> Judge | None:
        """Who judges these robots by the task of one's own, if there is one; as `Judge`."""
        if self.own_task is None or fleet is None:
            return None
        return Judge(self.own_task, fleet, self.task, before)

    def tell(self, fleet: Fleet, robot: int = 0) -> dict[str, Any]:
        """`info` of a robot in the engine that is one of this environment's: its numbers in the words of the task."""
        values = None if self._judge is None else self._judge.terms[robot]
        draws = single.drawn(fleet.robots[robot]["episode"]["drawn"]) if self.is_drawn else {}
        words = single.words_of(self.failures, self.words)
        info = single.info(fleet.infos[robot : robot + 1], self.reward_terms, values, words)
        return info | {"randomization": draws}
