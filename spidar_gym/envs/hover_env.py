"""The hover environment: the paper's flight controller plus the action's residual, through a sequence of forms."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np

from spidar_gym.control.allocation.allocator import Allocator, AllocatorConfig
from spidar_gym.control.flight.controller import ControllerConfig
from spidar_gym.control.flight.memory import ControlState
from spidar_gym.control.flight.observation import Field, layout
from spidar_gym.control.flight.path import Path
from spidar_gym.control.interface import FlightControl
from spidar_gym.control.presets import controller_config, for_robot
from spidar_gym.envs.actions import AIR, TorsoScale, action_modes, scaled_action_mode
from spidar_gym.envs.commander import FlightCommander, compute_trim
from spidar_gym.envs.controllers import choose_control, make_flight_controller
from spidar_gym.envs.env import SpidarEnv
from spidar_gym.envs.fleet import Fleet
from spidar_gym.envs.goals import Goal, HoverGoal
from spidar_gym.envs.locking import in_turn
from spidar_gym.envs.options import described_robot, make_task, solver_settings
from spidar_gym.envs.progress import FlightProgress
from spidar_gym.errors import require_instance
from spidar_gym.native.core_flight import ControlStateView
from spidar_gym.native.engine_structs import engine_layouts
from spidar_gym.native.plant import read_reference
from spidar_gym.native.structs import fill
from spidar_gym.robot import ROBOT, RobotSpec
from spidar_gym.state import Reference
from spidar_gym.tasks.hover import HoverTask, hover_height
from spidar_gym.tasks.start import FlightStart, read_path


class HoverEnv(SpidarEnv[HoverTask, FlightControl, FlightProgress]):
    """SPIDAR in flight; `spidar list spidar_gym/Hover-v0` prints its page."""

    reset_options = ("forms", "start", "disturbances")
    goal_type: ClassVar[type[Goal] | None] = HoverGoal
    true_fields = (
        Field("position_error", 3, 1.0, "m", "desired − actual CoG, world"),
        Field("attitude_error", 3, 1.0, "rad", "log(RᵀR_d), torso axes"),
    )
    _kept = ("_start",)
    task_type: ClassVar[type[HoverTask]] = HoverTask

    def __init__(
        self,
        *,
        action_mode: str = "residual_wrench",
        action_scale: Mapping[str, float] | TorsoScale | None = None,
        preset: str = "paper",
        controller: ControllerConfig | None = None,
        allocator: type[Allocator] | None = None,
        law: type | None = None,
        control: str | None = None,
        max_iter: int = AllocatorConfig.max_iter,
        **options: Any,  # noqa: ANN401 - fields of the task and arguments of `SpidarEnv`
    ) -> None:
        """Build the task and its controller.

        Args:
            action_mode: Name of the action mode.
            action_scale: Share of a residual's authority, `{"share": 0.001 … 1}`; or zero and scale of
                `torso_forces`: `{"force": N, "joint": rad, "trim": share of weight}`, by
                default 3 N, 0.1 rad, 1.
            preset: Name of the controller: allocation, gains, compensations.
            controller: Custom configuration in place of a preset's; its joint speed is the task's.
            allocator: Custom allocator, a subclass of `Allocator`, in place of the QP.
            law: Custom control law, a subclass of `FlightController`, in place of the paper's; it can preview the
                reference.
            control: `core`, the controller that is compiled for the robot, or `python`, the Python controller; by
                default the core, unless an allocator or a law is given.
            max_iter: Iteration cap of the QP solver.
            **options: Arguments of the task and of `SpidarEnv`.

        Raises:
            UnknownNameError: For a mode, preset or camera that does not exist; it lists the valid ones.
            UnknownArgumentError: For an argument that does not exist; it lists the valid ones.
            InvalidValueError: For a value out of range.
        """
        robot = described_robot(options)
        known = {} if robot == ROBOT else {"joint_speed": robot.joint_speed, "altitude": hover_height(robot)}
        task, shared = make_task(SpidarEnv, HoverEnv, self.task_type, options, known)
        joint_speed = task.joint_speed
        mode = scaled_action_mode(action_mode, action_scale, AIR, action_modes, robot)
        base = controller_config(preset, robot) if controller is None else controller
        require_instance(ControllerConfig, controller=base)
        if controller is not None and robot != ROBOT:
            base = for_robot(base, robot)
        self._config = replace(base, joint_speed=joint_speed, allocator=solver_settings(max_iter))
        self._allocator, self._law = allocator, law
        control = choose_control(control, allocator, law)
        self._start: FlightStart | None = None
        super().__init__(
            mode, self.layout_of(mode.size, robot), task=task, joint_speed=joint_speed, control=control, **shared
        )

    @staticmethod
    def layout_of(action_size: int, robot: RobotSpec = ROBOT) -> tuple[Field, ...]:
        """Return the layout of the observation for a size of the action and a robot."""
        return layout(action_size, robot)

    def rules(self, *, truncates: bool = False, autoreset: str = "disabled") -> np.ndarray:
        """Return the engine's rules, an `sp_hover_rules`."""
        record = np.zeros((), engine_layouts()["hover_rules"])
        fill(record["controller"], self._config)
        record["rules"]["is_described"] = self._described
        self._fill_rules(record, truncates=truncates, autoreset=autoreset)
        return record

    def make_fleet(
        self, robots: int, threads: int = 1, *, autoreset: str = "disabled", truncates: bool = False,
        rules: np.ndarray | None = None,
    ) -> Fleet:  # fmt: skip
        """Make robots of this environment in the engine, before their first reset."""
        task, alike = self.task, not (self._randomization.draws or self.task.loads) and rules is None
        record = self.rules(truncates=truncates, autoreset=autoreset) if rules is None else rules
        fleet = Fleet(
            task,
            record,
            self._nominal,
            robots,
            threads,
            alike=alike,
            floors=self._randomization.tilts,
            goals=task.most_goals,
            knots=task.most_knots,
        )
        fleet.take_task(task)
        for robot in range(robots):
            fleet.disturb(robot, self._disturbances)
        return fleet

    def _look_at_controller(self) -> FlightControl:
        return make_flight_controller(self._config, self._control, fleet=self.fleet, robot=self.robot)

    def _make_commander(self) -> FlightCommander:
        controller = make_flight_controller(
            self._config, self._control, self._allocator, self._law, preview=self.reference_ahead, robot=self.robot
        )
        return FlightCommander(
            controller, self.fleet, self.plant, self._mode, self._bound, is_described=self._described
        )

    def _prepare(self, fleet: Fleet) -> None:
        fleet.give_start(0, self._start)

    def _chosen(self, name: str, value: Any) -> dict[str, object]:  # noqa: ANN401 - user input
        if name == "start":
            return {"_start": None if value is None else FlightStart.parse(value)}
        return {"task": replace(self.task, forms=value)} if name == "forms" else super()._chosen(name, value)

    def _rule(self, fleet: Fleet) -> None:
        if replace(self.task, forms=self._ruled.forms) == self._ruled:
            fleet.take_task(self.task)
        else:
            super()._rule(fleet)

    def _read(self, name: str) -> Any:  # noqa: ANN401 - any value
        robot, commander = self.fleet.robots[0], self._commander
        if name == "truth":
            if isinstance(commander, FlightCommander):
                return commander.truth
            return ControlStateView(self.fleet.robots["truth"][0:1].reshape(())).control_state
        if name == "path":
            return read_path(self.fleet.knots[0, : int(robot["knots"])])
        if name == "reference":
            return read_reference(robot["reference"])
        return FlightProgress.read(robot, self.fleet.goals[0]) if name == "episode" else super()._read(name)

    @property
    def truth(self) -> ControlState:
        """Control state computed from the true state."""
        return self._known("truth")

    @property
    def path(self) -> Path | None:
        """Path of the CoG in this episode; None for a hover (`SpidarError` before the first reset)."""
        return self._known("path")

    @property
    @in_turn
    def trim(self) -> np.ndarray | None:
        """Initial wrench of the integrals [N, Nm]; None for the described robot."""
        robot = self.fleet.robots[0]
        given = robot["is_given"] and robot["has_trim"]
        return robot["trim"].copy() if self._began and (given or not self._described) else None

    def compute_trim(self) -> np.ndarray:
        """Compute the wrench in {CoG} that the simulated robot needs at rest beyond the described one [N, Nm]."""
        return compute_trim(self.controller, self.plant, self.reference())

    def reference(self) -> Reference:
        """Return the controller's current reference."""
        return self._known("reference")

    @in_turn
    def reference_ahead(self, seconds: float) -> Reference:
        """Return the reference after `seconds`, as known from the next form and the path."""
        progress, now = self.progress, self.reference()
        time, upcoming = progress.time + seconds, progress.next_goal
        target = now.joint_target
        if upcoming is not None and time >= upcoming.start - 1e-9:
            target = upcoming.joint_target
        if self.path is not None:
            return self.path.reference(time, target, now.mode)
        return now if target is now.joint_target else replace(now, joint_target=target)
