"""Base class of the environments: one robot, a fleet of one, with Gymnasium's interface."""

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, Generic, TypeVar

import gymnasium
import numpy as np
from gymnasium import spaces

from spidar_gym.control.flight.observation import Field
from spidar_gym.control.interface import CrawlControl, FlightControl
from spidar_gym.control.locomotion.orders import Orders
from spidar_gym.envs import engine_rules
from spidar_gym.envs.actions import ActionMode
from spidar_gym.envs.commander import Commander
from spidar_gym.envs.controllers import forget, is_compiled
from spidar_gym.envs.fleet import Fleet
from spidar_gym.envs.info import drawn, info_of, words_of
from spidar_gym.envs.locking import in_turn
from spidar_gym.envs.observations import Observed
from spidar_gym.envs.options import own_robot
from spidar_gym.envs.reset import Resettable
from spidar_gym.envs.serialization.environments import Restorable
from spidar_gym.envs.view import RENDER_MODES, View, fps
from spidar_gym.errors import (
    InvalidValueError,
    SpidarError,
    require_array,
    require_flag,
    require_least,
    require_within,
)
from spidar_gym.native.draws import take_back
from spidar_gym.native.plant import Plant, read_command, read_state
from spidar_gym.robot import RobotSpec
from spidar_gym.sim.config import PlantConfig
from spidar_gym.sim.disturbances import Disturbances
from spidar_gym.sim.randomize import Randomization
from spidar_gym.state import Command, RobotState
from spidar_gym.tasks.task import Task

TaskT = TypeVar("TaskT", bound=Task[Any])
ControllerT = TypeVar("ControllerT", FlightControl, CrawlControl, Orders)
ProgressT = TypeVar("ProgressT")


class SpidarEnv(
    Resettable, Observed, Restorable, gymnasium.Env[Any, np.ndarray], Generic[TaskT, ControllerT, ProgressT]
):
    """SPIDAR with Gymnasium's interface; a subclass defines the task and the controller."""

    metadata: dict[str, Any] = {  # noqa: RUF012 - Gymnasium's own declaration
        "render_modes": [*RENDER_MODES],
        "render_fps": fps(1),
    }
    task: TaskT
    """The task."""
    controller: ControllerT
    """The controller."""
    words: Mapping[str, tuple[str, ...]] = MappingProxyType({})
    """Words in `info` besides `failure` and `qp_status`, by name, in the order of their codes."""
    reward_terms: Mapping[str, tuple[float, str]]
    """Weight and formula of each reward term; the weights add up to 1."""
    failures: tuple[str, ...]
    """Names of the failures in the order of their codes."""
    hold: int = 1
    """Control periods per step."""
    _commander: Commander | None = None

    def __init__(
        self,
        mode: ActionMode,
        layout: tuple[Field, ...],
        *,
        joint_speed: float,
        control: str,
        task: Any = None,  # noqa: ANN401 - user input, converted by `make_task`
        reward: str | None = None,
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
        hold: int = 1,
        max_episode_steps: int | None = None,
        render_mode: str | None = None,
        camera: str = "chase",
        width: int = 640,
        height: int = 480,
    ) -> None:
        """Build the robot.

        Args:
            mode: Action mode.
            layout: Layout of the observation.
            joint_speed: Speed limit of the joint servos [rad/s].
            control: `python` or `core`.
            task: Custom task in place of the built-in one: an object of a class derived from it, the class, or its
                name, `module:Class`.
            reward: Reward terms: `narrow`, the default, or `sloped` for learning from nothing.
            idle_thrust: Least commanded thrust of a module [N].
            robot: Custom robot of the controller and the simulator: a `RobotSpec`, its numbers by name, or a TOML file
                of these; the nominal robot by default.
            plant: Custom simulated robot, to which the arguments below are applied; the nominal one by default.
            wake: Whether air is simulated: jets, drag, ground effect.
            battery: Whether the largest thrust falls with the voltage.
            sensors: Whether the controller receives the estimate from simulated sensors in place of the true state.
            randomization: Strength of the domain randomisation, 0 … 1; or ranges by field, as `Randomization.parse`
                takes them: `{"body.total_mass": (15.5, 17.0)}`, or a TOML file.
            disturbances: `{"wind": m/s, "push": N, "lost_rotor": 1 … 8, "fault": …, "fault_time": s}`.
            observation: `vector`, `scaled`, `goal` or `asymmetric`, see `OBSERVATIONS`.
            goal_reward: `sparse` or `dense` with the observation `goal`, see `REWARDS`.
            hold: Control periods of 25 ms per step, through which an action is held.
            max_episode_steps: Steps after which an episode is truncated, at most those of `horizon_s` if that is given
                too; −1 for no end, which is the default of an environment that `gymnasium.make` has not made.
            render_mode: `human`, `rgb_array`, `depth_array` or None.
            camera: Camera of the pictures.
            width: Width of the pictures [px].
            height: Height of the pictures [px].

        Raises:
            UnknownNameError: For a mode, observation or camera that does not exist; it lists the valid ones.
            InvalidValueError: For a value out of range, and for the observation `goal` without a goal.
            StaleAssetError: When the model file was edited by hand.
        """
        del reward  # it selected the task
        nominal = own_robot(plant, robot)
        self.task = task
        self.reward_terms, self.failures = task.reward_terms, tuple(task.failures)
        self.robot = nominal.robot
        """The described robot."""
        if "robot" in self._arguments:  # the file is read once
            self._arguments = self._arguments | {"robot": self.robot}
        self.view = View(render_mode, camera, width, height, self.robot)
        """Renderer."""
        require_flag(wake=wake, battery=battery, sensors=sensors)
        require_least(1, hold=hold)
        self.hold = hold
        require_within(0.0, self.robot.max_thrust, "N", idle_thrust=idle_thrust)
        self._bound = np.concatenate([np.full(f.size, f.bound) for f in layout])
        layout = (*layout, *self.task.fields)
        self._mode, self.layout = mode, layout
        if max_episode_steps is not None:
            self.end(max_episode_steps)
        self._randomization = Randomization.parse(randomization)
        self._disturbances = Disturbances.parse(disturbances)
        world = self._randomization.world
        nominal = self._randomization.nominal(nominal)
        self._nominal = replace(
            nominal,
            joint_speed=joint_speed,
            idle_thrust=float(idle_thrust) or nominal.idle_thrust,
            sense=bool(nominal.sense or sensors or (world and world.sensors)),
            aero=replace(nominal.aero, wake=bool(nominal.aero.wake and wake)),
            actuators=replace(nominal.actuators, battery=bool(nominal.actuators.battery or battery)),
        )
        self._described = (plant is None and not self._randomization.draws) or bool(world and not world.trimmed)
        self._control = control
        self.sampled_parameters: dict[str, np.ndarray] = {}
        """Sampled parameters of this episode's robot, by field of `PlantConfig`; empty without randomisation."""
        self.render_mode = render_mode
        self.metadata = self.metadata | {"render_fps": fps(self.hold)}
        self.action_space = spaces.Box(-1.0, 1.0, (mode.size,), np.float32)
        self._gain = np.concatenate(
            [np.full(f.size, 1.0 / f.scale if observation == "scaled" else 1.0) for f in layout]
        )
        high = (np.concatenate([np.full(f.size, f.bound) for f in layout]) * self._gain).astype(np.float32)
        flat = spaces.Box(-high, high, dtype=np.float32)
        self.sight = self._choose_sight(observation, goal_reward, flat, layout)
        self.observation_space = flat if self.sight is None else self.sight.space
        self._now: dict[str, Any] = {}
        self.ticks = 0
        self._began = False
        self._made = self.task, self._nominal
        if not self._is_bare:
            self._furnish()

    def _furnish(self) -> None:
        """Make the robot and its controller."""
        self.fleet: Fleet = self.make_fleet(1)
        """The robot in the engine, and its task."""
        self.plant = Plant(self._nominal, engine=self.fleet.engine)
        """The simulated robot."""
        self._ruled = self.task
        if is_compiled(self._control):
            self.controller = self._look_at_controller()
        else:
            self.fleet.commander = commander = self._make_commander()
            self.controller, self._commander = commander.controller, commander

    @in_turn
    def _known(self, name: str) -> Any:  # noqa: ANN401 - any value
        """Return a value of the current tick; it is read once and cached."""
        if name not in self._now:
            if not self._began:
                raise SpidarError(f"there is no {name} before reset(); valid: call reset() first")
            self._now[name] = self._read(name)
        return self._now[name]

    def _forget(self) -> None:
        """Clear the values cached in the last tick."""
        self._now = {}
        forget(self.controller)

    def _read(self, name: str) -> Any:  # noqa: ANN401 - any value
        """Read a value from the engine: the true state, the controller's state, or the last command."""
        episode = self.fleet.robots[0]["episode"]
        if name == "command":
            return read_command(episode["command"])
        return self.plant.state() if name == "state" else read_state(episode["seen"])

    @property
    @in_turn
    def command(self) -> Command:
        """Last command (`SpidarError` before the first step)."""
        if not self.ticks:
            raise SpidarError("there is no command before step(); valid: call step() first")
        return self._known("command")

    @property
    def state(self) -> RobotState:
        """True state of the robot (`SpidarError` before the first reset)."""
        return self._known("state")

    @property
    def seen(self) -> RobotState:
        """State that the controller receives: the true state, or the estimate with sensors."""
        return self._known("seen" if self._nominal.sense else "state")

    @property
    def action_mode(self) -> ActionMode:
        """Meaning of an action."""
        return self._mode

    @property
    def is_drawn(self) -> bool:
        """Whether robots are randomised."""
        return self._randomization.draws

    @property
    def randomization(self) -> Randomization:
        """Randomisation of the robots."""
        return self._randomization

    def sampled(self, fleet: Fleet, robot: int) -> dict[str, np.ndarray]:
        """Return the sampled parameters of a robot of a fleet of this environment."""
        episode = fleet.robots[robot]["episode"]
        kind = {"kind": np.array(episode["kind"])} if self._randomization.world else {}
        return kind | drawn(episode["drawn"], self._randomization.rows) if self.is_drawn else {}

    @property
    def progress(self) -> ProgressT:
        """Progress of the episode (`SpidarError` before the first reset)."""
        return self._known("episode")

    @in_turn
    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Start an episode.

        Args:
            seed: Seed of the environment's only random generator.
            options: New values from this episode on: `disturbances`, `randomization`, every argument of the task, and
                everything else in `reset_options`.

        Returns:
            Observation and info.

        Raises:
            UnknownNameError: For an option that does not exist; the environment is unchanged.
            InvalidValueError: For a value that is not valid; the environment is unchanged.
        """
        chosen = self._choose({} if options is None else options)
        super().reset(seed=seed)
        for name, value in chosen.items():
            setattr(self, name, value)
        self.ticks, self._began, fleet = 0, True, self.fleet
        self._obey(fleet)
        fleet.disturb(0, self._disturbances)
        self._prepare(fleet)
        fleet.seed(0, self.np_random)
        fleet.reset()
        take_back(self.np_random, fleet.robots[0]["episode"]["generator"])
        self.plant.reread()
        self._forget()
        self.sampled_parameters = self.sampled(fleet, 0)
        if self.render_mode == "human":
            self.render()
        return self._shown()

    @in_turn
    def step(self, action: np.ndarray) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Simulate one step: `hold` control periods of 25 ms.

        Args:
            action: Action in [−1, 1]; entries outside are clipped.

        Returns:
            Observation, reward (in [0, 1], or as `goal_reward` specifies), terminated, truncated, info.

        Raises:
            InvalidValueError: For an action of the wrong shape or with a NaN; the robot has not moved.
            SpidarError: When `reset` was never called.
        """
        action = require_array("action", action, f"numbers of shape ({self._mode.size},)")
        if action.shape != (self._mode.size,):
            raise InvalidValueError("action", action.shape, f"an array of shape ({self._mode.size},)")
        if not np.isfinite(action).all():
            raise InvalidValueError("action", action.tolist(), "finite numbers within −1 … 1")
        if not self._began:
            raise SpidarError("there is no episode before reset(); valid: call reset() first")
        fleet = self.fleet
        self.plant.keep()
        fleet.actions[0] = action
        self._forget()
        self.ticks += 1
        fleet.step()
        observation, info = self._shown()
        if self.render_mode == "human":
            self.render()
        reward = self._rewarded(observation, float(fleet.rewards[0]))
        return observation, reward, bool(fleet.terminated[0]), self.is_over, info

    def _shown(self) -> tuple[Any, dict[str, Any]]:
        """Return the current observation and info."""
        return self._show(self.fleet.observations[0].copy()), self.tell(self.fleet)

    @in_turn
    def disturb(self, disturbances: Mapping[str, Any] | Disturbances | None, towards: float = 0.0) -> None:
        """Change the disturbances immediately, without a reset, for this episode and those after it.

        Args:
            disturbances: As at `reset`; a fault whose `fault_time` is past begins immediately, and so do pushes.
            towards: Direction in which the wind of this episode blows, 0 along x, π/2 along y [rad].

        Raises:
            UnknownNameError: For a name that does not exist; the environment is unchanged.
            InvalidValueError: For a value that is not valid; the environment is unchanged.
            SpidarError: When `reset` was never called.
        """
        chosen = Disturbances.parse(disturbances)
        require_within(-1e6, 1e6, "rad", towards=towards)
        if not self._began:
            raise SpidarError("there is no episode to disturb before reset(); valid: call reset() first")
        self._disturbances = chosen
        self._choices = self._choices | {"disturbances": chosen}  # kept by a rebuilding reset and by a restore
        self.fleet.disturb(0, chosen)
        self.plant.disturb(chosen, towards)
        self.fleet.refer()
        self._now = {}

    def _empty(self) -> None:
        self.controller.close()
        self.plant.close()

    def _chosen(self, name: str, value: Any) -> dict[str, object]:  # noqa: ANN401 - user input
        """Return the attributes that an option of `reset` sets, with their values; raise for an invalid value."""
        assert name == "disturbances"
        return {"_disturbances": Disturbances.parse(value)}

    # ---- what a subclass defines ----

    @abstractmethod
    def make_fleet(
        self, robots: int, threads: int = 1, *, autoreset: str = "disabled", truncates: bool = False,
        rules: np.ndarray | None = None,
    ) -> Fleet:  # fmt: skip
        """Make robots of this environment in the engine, before their first reset.

        Args:
            robots: Number of robots.
            threads: Number of threads.
            autoreset: Behaviour at the end of an episode, one of `AUTORESETS`.
            truncates: Whether an episode is truncated at the horizon.
            rules: Rules of each robot, from `rules` of environments of this kind; the floors must all be even or all
                of tiles. By default all robots have this environment's rules.
        """

    @abstractmethod
    def rules(self, *, truncates: bool = False, autoreset: str = "disabled") -> np.ndarray:
        """Return the engine's rules of this environment; arguments as in `make_fleet`."""

    def _fill_rules(self, record: np.ndarray, *, truncates: bool, autoreset: str) -> None:
        """Fill the part of the rules that all environments share."""
        engine_rules.common(
            record["rules"], self.task, self._nominal, self._mode, self._bound, randomization=self._randomization,
            horizon=self.horizon, hold=self.hold, truncates=truncates, autoreset=autoreset,
        )  # fmt: skip
        record["rules"]["is_scaled"] = bool((self._gain != 1.0).any())
        record["rules"]["gain"][: len(self._bound)] = self._gain[: len(self._bound)]
        record["rules"]["is_referred"] = self.task.refers
        record["rules"]["is_commanded"] = not is_compiled(self._control)
        self.task.write(record)

    @abstractmethod
    def _look_at_controller(self) -> ControllerT:
        """Return a view of the core's controller in the engine's memory."""

    @abstractmethod
    def _make_commander(self) -> Commander:
        """Make the Python controller that replaces the core's."""

    def _rule(self, fleet: Fleet) -> None:
        """Write the task into the engine's rules."""
        fleet.rules[()] = self.rules()
        fleet.take_task(self.task)

    @abstractmethod
    def _prepare(self, fleet: Fleet) -> None:
        """Write a given start or course of the next episode into the fleet."""

    def tell(self, fleet: Fleet, robot: int = 0) -> dict[str, Any]:
        """Return `info` of a robot of a fleet of this environment, with codes replaced by words."""
        draws = self.sampled(fleet, robot)
        words = words_of(self.failures, self.words)
        info = info_of(fleet.infos[robot : robot + 1], self.reward_terms, fleet.terms[robot], words)
        return info | {"randomization": draws}
