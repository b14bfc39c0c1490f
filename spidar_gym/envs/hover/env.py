"""The hover environment: the paper's flight controller, to which the action adds, and forms to fly through."""

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np

from spidar_gym.control.allocation.allocator import Allocator, AllocatorConfig
from spidar_gym.control.flight.controller import CONTROL_RATE, ControllerConfig
from spidar_gym.control.flight.memory import ControlState
from spidar_gym.control.flight.observation import NO_NEXT_FORM, Field, FlightObservables, layout
from spidar_gym.control.flight.path import Path
from spidar_gym.control.interface import FlightControl
from spidar_gym.control.presets import controller_config, for_robot
from spidar_gym.envs.actions import act_directly, action_modes, find_action_mode
from spidar_gym.envs.controllers import choose_control, make_flight_controller
from spidar_gym.envs.env import SpidarEnv
from spidar_gym.envs.fleet import Fleet
from spidar_gym.envs.goals import Goal, HoverGoal
from spidar_gym.envs.hover.task import REWARD_TERMS, FlightStart, FormGoal, HoverTask, Progress, hover_height
from spidar_gym.envs.options import described_robot, solver_settings, split_options
from spidar_gym.envs.path.task import PathTask
from spidar_gym.envs.rules import hover_rules, most_goals, read_knots, sequence
from spidar_gym.envs.single import keeps_page
from spidar_gym.envs.turns import in_turn
from spidar_gym.errors import require_instance
from spidar_gym.model.rotor import thrust_map, vectoring_to_force
from spidar_gym.native.engine_structs import FLIGHT_FAILURES
from spidar_gym.native.flight import ControlStateView
from spidar_gym.native.structs import read
from spidar_gym.robot import N_JOINTS, N_ROTORS, ROBOT, RobotSpec
from spidar_gym.sim.disturbances import Disturbances
from spidar_gym.so3 import exp, log, matrix_to_quat, quat_to_matrix
from spidar_gym.state import Command, Reference

BUILT_IN = HoverTask, PathTask
"""Tasks that the engine has too."""
_LEVEL = np.array([1.0, 0.0, 0.0, 0.0])
_STILL = np.zeros(3)
_NO_JOINTS = np.zeros(N_JOINTS)


class HoverEnv(SpidarEnv[HoverTask, FlightControl, Progress]):
    """SPIDAR in flight; `spidar list spidar_gym/Hover-v0` prints its page."""

    kind = "hover"
    reward_terms = REWARD_TERMS
    reset_options = ("forms", "start", "disturbances")
    failures = FLIGHT_FAILURES
    untouchable = ("foot", "duct", "part")
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
        preset: str = "paper",
        controller: ControllerConfig | None = None,
        allocator: type[Allocator] | None = None,
        law: type | None = None,
        control: str | None = None,
        max_iter: int = AllocatorConfig.max_iter,
        **options: Any,  # noqa: ANN401 - the fields of the task, and what every environment takes
    ) -> None:
        """Build the task and its controller.

        Args:
            action_mode: What the action means.
            preset: Which controller: allocation, gains, compensations.
            controller: A configuration of one's own in place of a preset's; its joint speed is the task's.
            allocator: An allocator of one's own, a subclass of `Allocator`, in place of the QP.
            law: A control law of one's own, a subclass of `FlightController`, in place of the paper's; it is told what
                comes.
            control: `core`, the controller that is compiled for the robot, or `python`, the readable one; by default
                the core, unless an allocator or a law is given.
            max_iter: Iteration cap of the QP solver.
            **options: Arguments of the task and of `SpidarEnv`.

        Raises:
            UnknownNameError: For a mode, preset or camera that does not exist; it lists the valid ones.
            UnknownArgumentError: For an argument that does not exist, likewise.
            InvalidValueError: For a value out of range.
        """
        own, shared = split_options(SpidarEnv, HoverEnv, self.task_type, options)
        robot = described_robot(shared)
        if robot != ROBOT:
            own = dict[str, Any](joint_speed=robot.joint_speed, altitude=hover_height(robot)) | own
        self.task = self.task_type(**own)
        joint_speed = self.task.joint_speed
        mode = find_action_mode(action_mode, action_modes(robot))
        base = controller_config(preset, robot) if controller is None else controller
        require_instance(ControllerConfig, controller=base)
        if controller is not None and robot != ROBOT:
            base = for_robot(base, robot)
        self._config = replace(base, joint_speed=joint_speed, allocator=solver_settings(max_iter))
        self._allocator, self._law = allocator, law
        control = choose_control(control, allocator, law)
        self._start: FlightStart | None = None
        self._reference: Reference | None = None
        self._goals: list[FormGoal] | None = None
        self.trim: np.ndarray | None = None
        """Wrench with which the integrals began [N, Nm]; None for the described robot."""
        super().__init__(mode, self.layout_of(mode.size, robot), joint_speed=joint_speed, control=control, **shared)

    @staticmethod
    def layout_of(action_size: int, robot: RobotSpec = ROBOT) -> tuple[Field, ...]:
        """What a policy sees, by the size of its action and the robot that it flies."""
        return layout(action_size, robot)

    def _make_controller(self) -> FlightControl:
        return make_flight_controller(
            self._config, self._control, self._allocator, self._law, self.fleet, preview=self.reference_ahead,
            robot=self.robot,
        )  # fmt: skip

    @property
    def truth(self) -> ControlState:
        """What a controller with the true state would make of it."""
        return self._known("truth")

    # ---- all of it in the engine ----

    def _is_built_in(self) -> bool:
        return type(self.task) in BUILT_IN and keeps_page(type(self), HoverEnv)

    def _rule(self, fleet: Fleet) -> None:
        if replace(self.task, forms=self._ruled.forms) != self._ruled:
            fleet.rules[()] = self.rules()
        fleet.robots["forms"] = sequence(self.task)

    def rules(self, *, truncates: bool = False, autoreset: str = "disabled") -> np.ndarray:
        """`sp_hover_rules`."""
        record = hover_rules(self.task, self._config, described=self._described)
        self._fill_rules(record, truncates=truncates, autoreset=autoreset)
        return record

    def _prepare(self, fleet: Fleet) -> None:
        self._reference = self._goals = None
        fleet.begin_with(0, self._start)
        if self._judge is not None:
            self._judge.is_given[0] = self._start is not None

    def _begin_native(self, fleet: Fleet) -> None:
        super()._begin_native(fleet)
        given = self._start is not None and self._start.trim is not None
        self.trim = fleet.robots[0]["trim"].copy() if given or not self._described else None

    def _read(self, name: str) -> Any:  # noqa: ANN401 - whatever is looked up
        assert self.fleet is not None
        robot = self.fleet.robots[0]
        if name == "truth":
            return ControlStateView(self.fleet.robots["truth"][0:1].reshape(())).control_state
        if name == "path":
            return read_knots(self.fleet.knots[0, : int(robot["knots"])])
        if name != "episode":
            return super()._read(name)
        progress = Progress.read(robot, self.fleet.goals[0], self._goals)
        self._goals = progress.goals
        return progress

    def make_fleet(
        self, robots: int, threads: int = 1, *, autoreset: str = "disabled", truncates: bool = False,
        rules: np.ndarray | None = None,
    ) -> Fleet:  # fmt: skip
        """Robots of this environment in the engine, at no episode yet."""
        goals, alike = most_goals(self.task.horizon_s), not (self._randomization.draws or self._loads) and rules is None
        record = self.rules(truncates=truncates, autoreset=autoreset) if rules is None else rules
        knots = self.task.most_knots
        fleet = Fleet(self.kind, record, self._nominal, robots, threads, alike=alike, goals=goals, knots=knots)
        fleet.robots["forms"] = sequence(self.task)
        for robot in range(robots):
            fleet.disturb(robot, self._disturbances)
        return fleet

    def _chosen(self, name: str, value: Any) -> dict[str, object]:  # noqa: ANN401 - whatever a user gives
        if name == "start":
            return {"_start": None if value is None else FlightStart.parse(value)}
        return {"task": replace(self.task, forms=value)} if name == "forms" else super()._chosen(name, value)

    def _begin(self, rng: np.random.Generator) -> None:
        self._reference = None
        start = self._start or FlightStart(
            tuple(self.task.schedule(rng)), *self.task.offset(rng), path=self.task.draw_path(rng)
        )
        self._now["episode"], self._now["path"] = Progress(list(start.goals)), start.path
        self._draw_robot(rng)
        q = self.progress.goal.joint_target
        R_wb, place = exp(start.rotation), self.task.position_w
        if start.path is not None:
            place, yaw = start.path.pose_w[0, :3], float(start.path.pose_w[0, 3])
            R_wb = R_wb if yaw == 0.0 else exp(np.array([0.0, 0.0, yaw])) @ R_wb  # it looks where its path begins to
        vectoring = self.controller.rest_vectoring(q)
        com_b = self.controller.model.snapshot(q, R_wb, vectoring).com_b
        position_w = place + start.position - R_wb @ com_b
        # The start is the CoG's, and legs and rotors are at rest: so the torso's origin moves by ω × less.
        motion = np.concatenate((start.velocity - R_wb @ np.cross(start.omega, com_b), start.omega))
        thrust = np.full(N_ROTORS, self.robot.hover_thrust)
        self._place(rng, position_w, matrix_to_quat(R_wb), q, vectoring, thrust, motion=motion)
        self._sense()
        # A robot off its description has hovered before the episode begins: its integrals hold what that takes.
        self.trim = start.trim
        if self.trim is None and not self._described:
            self.trim = self.compute_trim()
        self.controller.reset(self.seen, q, self.trim)
        self._leg_momentum = self._leg_momentum_rate = _STILL
        self._joint_velocity = _NO_JOINTS
        self._update_errors()

    def disturb(self, disturbances: Mapping[str, Any] | Disturbances | None, towards: float = 0.0) -> None:
        """As `Disturbable.disturb`; the controller is told of what is lost, and of what is back."""
        super().disturb(disturbances, towards)
        self._reference = None

    @property
    def path(self) -> Path | None:
        """Where the CoG goes in this episode; None where it stays (`SpidarError` before the first reset)."""
        return self._known("path")

    @in_turn
    def reference(self) -> Reference:
        """What the controller is asked to do now."""
        if self.own_task is not None:
            assert self.fleet is not None
            return read(Reference, self.fleet.robots[0]["reference"])
        target, mode = self.progress.goal.joint_target, self.task.mode(self.progress.time)
        path, given = self.path, self._reference
        if path is not None:
            given = path.reference(self.progress.time, target, mode)
        elif given is None or given.joint_target is not target or given.mode != mode:
            given = Reference(self.task.position_w, _LEVEL, _STILL, _STILL, target, mode)
        self._reference = given
        fault = self._disturbances
        if fault.lost_rotor and self.progress.time >= fault.fault_time - 1e-9:
            lost = f"lost_{fault.fault}"
            if not getattr(given, lost).any():
                mask = np.arange(1, N_ROTORS + 1) == fault.lost_rotor
                self._reference = given = replace(given, **{lost: mask})
        return given

    @in_turn
    def reference_ahead(self, seconds: float) -> Reference:
        """What the controller will be asked to do so much later [s]: the next form and the path are known."""
        progress, now = self.progress, self.reference()
        time, upcoming = progress.time + seconds, progress.next_goal
        target = now.joint_target
        if upcoming is not None and time >= upcoming.start - 1e-9:
            target = upcoming.joint_target
        if self.path is not None:
            return self.path.reference(time, target, now.mode)
        return now if target is now.joint_target else replace(now, joint_target=target)

    def _act(self, action: np.ndarray) -> Command:
        """The command of this tick; keeps what observations need of it."""
        controller = self.controller
        if self._mode.residual is not None:
            residual = self._mode.residual(action)
            command = controller.step(self.seen, self.reference(), residual, self._control_state)
            assert controller.last_step is not None
            self._joint_velocity = controller.last_step.joint_velocity
            return command
        command, self._joint_velocity = act_directly(controller, action)
        return command

    def compute_trim(self) -> np.ndarray:
        """Wrench in {CoG} that the real robot needs at rest beyond what its description needs [N, Nm]."""
        state = self.state
        control_state = self.controller.compute_state(state, self.reference())
        snapshot, R_wb = control_state.snapshot, control_state.R_wb
        described = thrust_map(snapshot.R_bl, snapshot.rotor_c) @ (
            vectoring_to_force(np.full(N_ROTORS, self.robot.hover_thrust), state.vectoring).reshape(-1)
        )
        described[:3] -= self.robot.weight * R_wb[2]
        force_w, torque_b = self.plant.net_wrench()
        force_b = force_w @ R_wb
        real = np.concatenate([force_b, torque_b - np.cross(snapshot.com_b, force_b)])
        return described - real

    def _update_errors(self) -> None:
        """What the controller makes of what it sees, and what is true."""
        self._control_state = self.controller.compute_state(self.seen, self.reference())
        sees = not self._nominal.sense
        self._now["truth"] = (
            self._control_state if sees else self.controller.compute_state(self.state, self.reference())
        )

    def _wanted(self) -> np.ndarray:
        reference = self.reference()
        return np.concatenate((reference.position_w, reference.quat_wb, self.progress.goal.joint_target))

    def _errors(self) -> tuple[np.ndarray, np.ndarray]:
        """Position error, world [m], and attitude error log(RᵀR_d), torso axes [rad], of the true state.

        The CoG is the one that the description gives at the true state: nobody knows where the real one is.
        """
        quat = self.reference().quat_wb
        R_error = self.truth.R_wb.T @ quat_to_matrix(quat) if quat[1:].any() else self.truth.R_wb.T
        return self.truth.error.position_w, log(R_error)

    def _advance(self) -> str:
        self.progress.ticks += 1
        self._update_errors()
        before = self._leg_momentum
        self._leg_momentum = self._control_state.snapshot.momentum_map[3:] @ self._joint_velocity
        self._leg_momentum_rate = (self._leg_momentum - before) * CONTROL_RATE
        errors = self._errors()
        self.progress.advance(*errors, self.state.joint_position)
        tilt = math.acos(max(-1.0, min(1.0, float(self.truth.R_wb[2, 2]))))
        return self.task.failed(errors[0], tilt, self.plant.in_contact)

    def _observation(self) -> np.ndarray:
        progress = self.progress
        goal, upcoming = progress.goal, progress.next_goal
        observables = FlightObservables(
            state=self.seen,
            control_state=self._control_state,
            thrust_command=self.seen.thrust if self._command is None else self._command.thrust,
            joint_command_velocity=self._joint_velocity,
            leg_momentum=self._leg_momentum,
            leg_momentum_rate=self._leg_momentum_rate,
            joint_target=goal.joint_target,
            next_form=goal.joint_target if upcoming is None else upcoming.joint_target,
            time_to_next_form=NO_NEXT_FORM if upcoming is None else upcoming.start - progress.time,
            previous_action=self._action,
            path=None if self.path is None else self.path.preview(progress.time),
        )
        return self.controller.observe(observables, bound=self._bound)

    def _task_info(self, failure: str) -> dict[str, Any]:
        errors = self._errors()
        last, memory, progress = self.controller.last_step, self.controller.memory, self.progress
        terms = self.task.reward_terms(*errors, progress.plan() - self.state.joint_position, self._action)
        if failure == "diverged":
            terms = dict.fromkeys(terms, 0.0)
        return {
            "position_error": errors[0].copy(),
            "attitude_error": errors[1].copy(),
            "vectoring_command": memory.vectoring.copy(),
            "wrench_desired": np.zeros(6) if last is None else last.wrench_desired.copy(),
            "restricted_rotors": np.zeros(N_ROTORS, bool) if last is None else last.restricted.copy(),
            **{f"reward_{name}": value for name, value in terms.items()},
            "is_success": failure == "" and progress.succeeded(self.horizon),
        }
