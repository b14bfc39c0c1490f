"""Python controllers in place of the core: commands, estimates and observations of a fleet's only robot."""

import math
from abc import ABC, abstractmethod
from dataclasses import replace
from typing import Any

import numpy as np

from spidar_gym.arrays import JointVector, Vector3
from spidar_gym.control.allocation.allocator import Allocation
from spidar_gym.control.course.gates import Course
from spidar_gym.control.course.observation import CourseObservables, observe_course
from spidar_gym.control.course.pilot import Pilot
from spidar_gym.control.course.rule import course_rule
from spidar_gym.control.course.target import Target, take_target
from spidar_gym.control.crawl.footsteps import Move
from spidar_gym.control.crawl.gait import nominal_time
from spidar_gym.control.crawl.observation import CrawlObservables
from spidar_gym.control.crawl.phases import PHASES
from spidar_gym.control.crawl.pose2 import Pose2
from spidar_gym.control.estimator import Estimator
from spidar_gym.control.flight.controller import CONTROL_RATE
from spidar_gym.control.flight.memory import ControlState
from spidar_gym.control.flight.observation import FlightObservables
from spidar_gym.control.flight.path import AHEAD, PathPreview
from spidar_gym.control.grasp.claw import plan_contact
from spidar_gym.control.grasp.observation import GraspObservables, observe_grasp
from spidar_gym.control.grasp.phases import GRASP_PHASES, Seen
from spidar_gym.control.grasp.rule import RuleMemory, decide, grasp_orders
from spidar_gym.control.interface import CrawlControl, FlightControl
from spidar_gym.control.locomotion import orders
from spidar_gym.control.locomotion.manager import Manager
from spidar_gym.envs.actions import ActionMode, act_directly, act_in_torso_axes
from spidar_gym.envs.fleet import Fleet
from spidar_gym.model.rotor import thrust_map, vectoring_to_force
from spidar_gym.native.constants import PROGRAMS
from spidar_gym.native.course_records import read_course
from spidar_gym.native.grasp_records import read_scene
from spidar_gym.native.library import STATUS
from spidar_gym.native.plant import Plant, read_reference
from spidar_gym.native.structs import fill
from spidar_gym.robot import N_JOINTS, N_ROTORS
from spidar_gym.so3 import exp, log, matrix_to_quat, quat_to_matrix
from spidar_gym.state import NO_RESIDUAL, Command, Reference, RobotState
from spidar_gym.tasks.crawl import TURN_LENGTH
from spidar_gym.tasks.grasp import DECIDE
from spidar_gym.tasks.start import read_path

LEVEL = np.array([1.0, 0.0, 0.0, 0.0])
"""Attitude of an upright object."""
_STILL = np.zeros(3)
_NO_JOINTS = np.zeros(N_JOINTS)


class Commander(ABC):
    """Runs a Python controller: computes commands, processes the resulting state, and builds observations.

    Commands, allocation and gait phase are written into the engine's record, where the core writes them too.
    """

    controller: Any
    """The Python controller."""

    def __init__(self, fleet: Fleet, plant: Plant, mode: ActionMode, bound: np.ndarray) -> None:
        """Attach to the only robot of a fleet whose rules have `is_commanded` set.

        Args:
            fleet: The fleet.
            plant: The robot's plant.
            mode: Action mode.
            bound: Bounds of the observation, without the task's fields.
        """
        self._fleet, self._plant, self._mode, self._bound = fleet, plant, mode, bound
        self.estimator = Estimator(robot=fleet.engine.robot)
        self.seen: RobotState | None = None
        """State that the controller receives: the true state, or the estimate with sensors."""
        self.command: Command | None = None
        """Last command; None before the first step."""

    @property
    def _record(self) -> Any:  # noqa: ANN401 - a record of the engine
        return self._fleet.robots[0]

    @property
    def _action(self) -> np.ndarray:
        """Last action in [−1, 1]."""
        return self._record["episode"]["action"][: self._mode.size]

    def begin(self) -> None:
        """Start an episode that the engine has begun."""
        self.command = None
        self._begin()

    def _sense_first(self) -> RobotState:
        """Return the controller's first state: the true one, or the first estimate."""
        state = self._plant.state()
        if self._record["plant"]["senses"]:
            first = self._plant.measure()
            indicated = {"joint_position": first.joint_position, "vectoring": first.vectoring}
            self.estimator.reset(replace(state, **indicated))
            state = self.estimator.update(first, state.thrust)
        return self._see(state)

    def _see(self, state: RobotState) -> RobotState:
        record, self.seen = self._record, state
        if record["plant"]["senses"]:
            fill(record["episode"]["seen"], state)
        else:  # copy the whole true state at once
            record["episode"]["seen"] = record["plant"]["state"]
        return state

    def act(self) -> None:
        """Compute the command of the next control period."""
        action = np.minimum(np.maximum(self._fleet.actions[0], -1.0), 1.0)
        self.command = command = self._act(action)
        fill(self._record["episode"]["command"], command)

    def look(self) -> None:
        """Process the state after a control period, or the first state of an episode."""
        begins = bool(self._fleet.begun[0])
        if self._record["plant"]["diverged"]:
            return
        if not begins:
            assert self.command is not None
            state = self._plant.state()
            if self._record["plant"]["senses"]:
                state = self.estimator.update(self._plant.measure(), self.command.thrust)
            self._see(state)
        self._take_note(begins=begins)

    def _take_note(self, *, begins: bool) -> None:  # noqa: B027 - optional
        """Update what the controller derives from the state; `begins` is whether an episode has just begun."""

    def observe(self) -> None:
        """Write the observation into the fleet's array."""
        if not self._record["plant"]["diverged"]:
            seen, common = self._observation(), self._fleet.rules["rules"]
            if common["is_scaled"]:
                seen = seen * common["gain"][: len(seen)]
            self._fleet.observations[0, : len(self._bound)] = seen

    def _act_alone(
        self, controller: FlightControl | CrawlControl, action: np.ndarray, joints: JointVector, *, plans: bool = False
    ) -> tuple[Command, JointVector]:
        """Return the command of an action without a controller, and the rate of its joint setpoints [rad/s].

        Args:
            controller: Controller whose memory has the last command.
            action: The action.
            joints: Joint angles at a zero action of `torso_forces` (16,) [rad].
            plans: As in `act_in_torso_axes`.
        """
        scale, seen = self._mode.scale, self.seen
        if scale is None:
            return act_directly(controller, action)
        assert seen is not None
        R_bl = controller.model.snapshot(seen.joint_position, np.eye(3), seen.vectoring).R_bl
        return act_in_torso_axes(controller, action, scale, joints, R_bl, plans=plans)

    @abstractmethod
    def _begin(self) -> None:
        """Reset the controller for an episode."""

    @abstractmethod
    def _act(self, action: np.ndarray) -> Command:
        """Return the command of a control period."""

    @abstractmethod
    def _observation(self) -> np.ndarray:
        """Return the observation in the order of the environment's layout."""


def _write_allocation(record: Any, allocation: Allocation | None) -> None:  # noqa: ANN401 - a record of the core
    """Write the last allocation into a controller's record."""
    record["ticked"] = allocation is not None
    if allocation is not None:
        own = record["allocation"]
        own["joint_torques"], own["wrench"] = allocation.joint_torques, allocation.wrench
        own["status"], own["iterations"] = STATUS.index(allocation.status), allocation.iterations
        own["slack"] = allocation.slack


class FlightCommander(Commander):
    """Runs a flight controller, the paper's or a custom one."""

    def __init__(
        self, controller: FlightControl, fleet: Fleet, plant: Plant, mode: ActionMode, bound: np.ndarray, *,
        is_described: bool,
    ) -> None:  # fmt: skip
        """Attach to a robot; arguments as for `Commander`; `is_described` is whether a hover needs no trim."""
        super().__init__(fleet, plant, mode, bound)
        self.controller, self._is_described = controller, is_described
        self.control_state: ControlState | None = None
        """Control state computed from `seen`."""
        self.truth: ControlState | None = None
        """Control state computed from the true state."""
        self._joint_velocity: JointVector = _NO_JOINTS
        self._leg_momentum: Vector3 = _STILL
        self._leg_momentum_rate: Vector3 = _STILL
        self._reference: tuple[bytes, Reference] | None = None

    def reference(self) -> Reference:
        """Return the controller's current reference."""
        record = self._record["reference"]
        if self._reference is None or self._reference[0] != record.tobytes():
            self._reference = record.tobytes(), read_reference(record)
        return self._reference[1]

    def _begin(self) -> None:
        record, controller = self._record, self.controller
        q = self._fleet.goals[0, 0]["joint_target"].copy()
        path = read_path(self._fleet.knots[0, : int(record["knots"])])
        R_wb, place = exp(record["rotation"]), self._fleet.rules["position_w"]
        if path is not None:
            place, yaw = path.pose_w[0, :3], float(path.pose_w[0, 3])
            R_wb = R_wb if yaw == 0.0 else exp(np.array([0.0, 0.0, yaw])) @ R_wb  # heading at the beginning of the path
        vectoring = controller.rest_vectoring(q)
        com_b = controller.model.snapshot(q, R_wb, vectoring).com_b
        position_w = place + record["offset"] - R_wb @ com_b
        # `velocity` is the CoG's, and legs and rotors are at rest: the torso's origin moves slower by ω × com_b.
        motion = np.concatenate((record["velocity"] - R_wb @ np.cross(record["omega"], com_b), record["omega"]))
        thrust = np.full(N_ROTORS, self._fleet.engine.robot.hover_thrust)
        self._plant.place(position_w, matrix_to_quat(R_wb), q, vectoring, thrust, motion)
        seen = self._sense_first()
        # A robot that differs from its description starts as after hovering: the integrals hold the required wrench.
        given, trim = bool(record["is_given"] and record["has_trim"]), None
        if not given and not self._is_described:
            record["trim"] = self.compute_trim()
        if given or not self._is_described:
            trim = record["trim"].copy()
        controller.reset(seen, q, trim)
        self._leg_momentum = self._leg_momentum_rate = _STILL
        self._joint_velocity = _NO_JOINTS
        self._tell()

    def compute_trim(self) -> np.ndarray:
        """Compute the wrench in {CoG} that the simulated robot needs at rest beyond the described one [N, Nm]."""
        return compute_trim(self.controller, self._plant, self.reference())

    def _act(self, action: np.ndarray) -> Command:
        controller = self.controller
        if self._mode.residual is not None:
            residual = self._mode.residual(action)
            command = controller.step(self.seen, self.reference(), residual, self.control_state)
            self._joint_velocity = controller.last_step.joint_velocity
        else:
            joints = self.reference().joint_target
            command, self._joint_velocity = self._act_alone(controller, action, joints, plans=True)
        self._tell()
        return command

    def _tell(self) -> None:
        """Write the allocation and the controller's memory into the engine's record."""
        flight, last, memory = self._record["flight"], self.controller.last_step, self.controller.memory
        _write_allocation(flight, None if last is None else last.allocation)
        flight["memory"]["vectoring"] = np.reshape(memory.vectoring, -1)
        if last is not None:
            flight["wrench_desired"] = last.wrench_desired
            flight["memory"]["interference"]["restricted"] = last.restricted

    def _take_note(self, *, begins: bool) -> None:
        reference = self.reference()
        self.control_state = control_state = self.controller.compute_state(self.seen, reference)
        truth = control_state
        if self._record["plant"]["senses"]:
            truth = self.controller.compute_state(self._plant.state(), reference)
        self.truth = truth
        quat = reference.quat_wb
        R_error = truth.R_wb.T @ quat_to_matrix(quat) if quat[1:].any() else truth.R_wb.T
        # The CoG is computed from the described robot at the true state.
        self._record["position_error"], self._record["attitude_error"] = truth.error.position_w, log(R_error)
        if not begins:
            before = self._leg_momentum
            self._leg_momentum = control_state.snapshot.momentum_map[3:] @ self._joint_velocity
            self._leg_momentum_rate = (self._leg_momentum - before) * CONTROL_RATE

    def _observation(self) -> np.ndarray:
        seen, preview, rules = self.seen, self._record["preview"], self._fleet.rules
        assert seen is not None
        assert self.control_state is not None
        path = None
        if rules["path"]:
            shapes = {"ahead_w": (AHEAD, 3), "turn": (AHEAD,), "velocity_w": (3,), "acceleration_w": (3,)}
            path = PathPreview(**{name: preview[name].reshape(shape) for name, shape in shapes.items()})
        observables = FlightObservables(
            state=seen,
            control_state=self.control_state,
            thrust_command=seen.thrust if self.command is None else self.command.thrust,
            joint_command_velocity=self._joint_velocity,
            leg_momentum=self._leg_momentum,
            leg_momentum_rate=self._leg_momentum_rate,
            joint_target=preview["joint_target"],
            next_form=preview["next_form"],
            time_to_next_form=float(preview["time_to_next"]),
            previous_action=self._action,
            path=path,
        )
        return self.controller.observe(observables, bound=self._bound)


def compute_trim(controller: FlightControl, plant: Plant, reference: Reference) -> np.ndarray:
    """Compute the wrench in {CoG} that the simulated robot needs at rest beyond the described one [N, Nm].

    Args:
        controller: Controller with the described robot's model.
        plant: The simulated robot.
        reference: Reference of the hover.
    """
    state = plant.state()
    control_state = controller.compute_state(state, reference)
    snapshot, R_wb, robot = control_state.snapshot, control_state.R_wb, plant.config.robot
    described = thrust_map(snapshot.R_bl, snapshot.rotor_c) @ (
        vectoring_to_force(np.full(N_ROTORS, robot.hover_thrust), state.vectoring).reshape(-1)
    )
    described[:3] -= robot.weight * R_wb[2]
    force_w, torque_b = plant.net_wrench()
    force_b = force_w @ R_wb
    real = np.concatenate([force_b, torque_b - np.cross(snapshot.com_b, force_b)])
    return described - real


class CrawlCommander(Commander):
    """Runs a crawler, the paper's or a custom one."""

    def __init__(
        self, controller: CrawlControl, fleet: Fleet, plant: Plant, mode: ActionMode, bound: np.ndarray, gait: type
    ) -> None:
        """Attach to a robot; arguments as for `Commander`; `gait` is the class of the crawler's phase machine."""
        super().__init__(fleet, plant, mode, bound)
        self.controller, self._gait = controller, gait

    def _begin(self) -> None:
        record, config = self._record, self.controller.config
        move = Move(Pose2(*record["way"].tolist()))
        self.controller.reset(self._sense_first(), [move])
        record["nominal_time"] = nominal_time(
            config.gait, [move], joint_speed=config.joint_speed, dt=1.0 / CONTROL_RATE, kind=self._gait
        )
        self._tell()

    def _act(self, action: np.ndarray) -> Command:
        if self._mode.residual is not None:
            command = self.controller.step(self.seen, self._mode.residual(action))
        else:
            command = self._act_alone(self.controller, action, self._fleet.rules["lies"])[0]
        self._tell()
        return command

    def _tell(self) -> None:
        """Write the allocation and the state of the gait into the engine's record."""
        record, last, gait = self._record, self.controller.last_step, self.controller.gait
        _write_allocation(record["crawl"], None if last is None else last.allocation)
        record["phase"], record["timeouts"] = PHASES.index(gait.phase), gait.timeouts
        record["swinging"], record["is_done"] = gait.swinging, self.controller.done
        memory = self.controller.memory
        record["crawl"]["memory"]["joint_position"] = memory.joint_position
        mode = "rest" if last is None else last.mode
        record["crawl"]["memory"]["mode"] = PROGRAMS.index(mode) if mode in PROGRAMS else 0

    def _take_note(self, *, begins: bool) -> None:
        """Recompute the distance with Python's `hypot`, as committed rows did: C's differs in the last bit."""
        record = self._record
        x, y, yaw = record["error"].tolist()
        record["distance"] = math.hypot(x, y) + TURN_LENGTH * abs(yaw)
        if begins:
            record["initial_distance"] = max(float(record["distance"]), 1e-6)

    def _observation(self) -> np.ndarray:
        seen, goal = self.seen, Pose2(*self._record["goal"].tolist())
        assert seen is not None
        thrust = seen.thrust if self.command is None else self.command.thrust
        ticks = int(self._record["crawled"]) if self._mode.has_clock else -1
        return self.controller.observe(CrawlObservables(seen, goal, thrust, self._action, ticks), bound=self._bound)


class CourseCommander(Commander):
    """Runs a manager of flight and crawl, and the pilot that commands it."""

    def __init__(
        self, controller: Manager, fleet: Fleet, plant: Plant, mode: ActionMode, bound: np.ndarray, *,
        is_waypoint: bool, decide: int,
    ) -> None:  # fmt: skip
        """Attach to a robot.

        Args:
            controller: The manager.
            fleet: As for `Commander`.
            plant: As for `Commander`.
            mode: As for `Commander`.
            bound: As for `Commander`.
            is_waypoint: Whether an action is a target.
            decide: Control periods between targets.
        """
        super().__init__(fleet, plant, mode, bound)
        self.controller, self.pilot = controller, Pilot(controller)
        self._is_waypoint, self._decide = is_waypoint, decide

    @property
    def course(self) -> Course:
        """Course of the episode, as on the map."""
        return read_course(self._record["course"])

    def rule(self) -> Target:
        """Return the rule's target for the current state."""
        seen = self.seen
        assert seen is not None
        return course_rule(self.course, seen.position_w, seen.joint_position, self.controller.phase)

    def _begin(self) -> None:
        self.controller.reset(self._sense_first())
        self.pilot.reset()
        self._tell()

    def _act(self, action: np.ndarray) -> Command:
        residual, seen, manager = self._mode.residual, self.seen, self.controller
        assert seen is not None
        if residual is None and not self._is_waypoint:
            return self._act_alone(manager.flight, action, manager.lying)[0]
        if self._record["controls"] % self._decide == 0:
            target = take_target(action, self.course, seen.position_w) if self._is_waypoint else self.rule()
            self.pilot.follow(target, seen, self.course)
        command = manager.step(seen, NO_RESIDUAL if residual is None else residual(action))
        self._tell()
        return command

    def _tell(self) -> None:
        """Write the allocation and the phase into the engine's record."""
        record, manager = self._record["manager"], self.controller
        self._record["phase"] = orders.PHASES.index(manager.phase)
        for name in ("flight", "crawl"):
            _write_allocation(record[name], None)
        last = manager.last_step
        name = "crawl" if manager.phase in ("lie", "crawl") else "flight"
        _write_allocation(record[name], None if last is None else last.allocation)

    def _observation(self) -> np.ndarray:
        seen, command, record = self.seen, self.command, self._record
        assert seen is not None
        observables = CourseObservables(
            state=seen,
            course=self.course,
            phase=self.controller.phase,
            target=self.pilot.last,
            thrust_command=seen.thrust if command is None else command.thrust,
            vectoring_command=seen.vectoring if command is None else command.vectoring,
            joint_command=seen.joint_position if command is None else command.joint_position,
            charge=float(record["charge"]),
            time_left=1.0 - float(record["episode"]["ticks"]) / float(self._fleet.horizon),
            previous_action=self._action,
        )
        return observe_course(observables, bound=self._bound, robot=self._fleet.engine.robot)


class GraspCommander(Commander):
    """Runs a manager of flight and grasp, and the rule that orders it."""

    def __init__(
        self, controller: Manager, fleet: Fleet, plant: Plant, mode: ActionMode, bound: np.ndarray, *,
        grip: float | str, is_order: bool,
    ) -> None:  # fmt: skip
        """Attach to a robot; arguments as for `Commander`, `grip` of `decide`; `is_order`: whether an action steers."""
        super().__init__(fleet, plant, mode, bound)
        self.controller, self.rule, self._grip, self._is_order = controller, RuleMemory(), grip, is_order

    @property
    def object_seen(self) -> Seen:
        """The object as motion capture sees it."""
        record = self._record["seen"]
        return Seen(record["position_w"].copy(), record["quat_wo"].copy())

    def _begin(self) -> None:
        self._scene = read_scene(self._record["scene"])
        self.rule = RuleMemory()
        self.controller.reset(self._sense_first())
        assert self.seen is not None
        self.controller.begin_in_air(self.seen)
        self._tell()

    def _act(self, action: np.ndarray) -> Command:
        manager, seen, scene = self.controller, self.seen, self._scene
        assert seen is not None
        if self._mode.residual is None and not self._is_order:
            open_claw = plan_contact(scene.shape, scene.half_size, LEVEL, 0.0, manager.model.robot).open
            return self._act_alone(manager.flight, action, open_claw)[0]
        residual = NO_RESIDUAL
        if self._mode.residual is None:
            if self._record["controls"] % DECIDE == 0:
                manager.steer(grasp_orders(scene, 0.0)[0], action, seen, DECIDE / CONTROL_RATE)
        else:
            idle = manager.phase == "hover" and manager.done
            if manager.grasper.memory.held:
                self.rule.mass = manager.grasper.memory.mass
            manager.command(decide(self.rule, scene, self.object_seen, self._grip, idle=idle))
            residual = self._mode.residual(action)
        command = manager.step(seen, residual, self.object_seen)
        self._tell()
        return command

    def _tell(self) -> None:
        """Write allocation, phases and grip into the engine's record."""
        record, manager = self._record, self.controller
        memory, grasper = manager.grasper.memory, record["manager"]["grasper"]
        record["phase"] = orders.PHASES.index(manager.phase)
        record["grasp_phase"] = GRASP_PHASES.index(memory.phase)
        last = manager.last_step
        _write_allocation(record["manager"]["flight"], None if last is None else last.allocation)
        fill(grasper["memory"], memory)
        fill(grasper["grip"], manager.grip)
        fill(record["rule"], self.rule)
        if manager.grasper.plan is not None:
            fill(grasper["plan"], manager.grasper.plan)

    def _observation(self) -> np.ndarray:
        seen, command, record, manager = self.seen, self.command, self._record, self.controller
        assert seen is not None
        holds = manager.phase == "grasp"
        observables = GraspObservables(
            state=seen,
            scene=self._scene,
            seen=self.object_seen,
            grip=manager.grip.force if holds else 0.0,
            payload=manager.grip.payload if holds else 0.0,
            phase=manager.grasp_phase if holds else "none",
            thrust_command=seen.thrust if command is None else command.thrust,
            joint_command=seen.joint_position if command is None else command.joint_position,
            charge=float(record["charge"]),
            time_left=1.0 - float(record["episode"]["ticks"]) / float(self._fleet.horizon),
            previous_action=self._action,
        )
        return observe_grasp(observables, manager.model, bound=self._bound)
