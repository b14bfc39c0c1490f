"""The hover environment: the paper's flight controller, to which the action adds, and forms to fly through."""

import math
from dataclasses import replace
from typing import Any

import numpy as np

from spidar_gym.control.allocator import Allocation, Allocator, AllocatorConfig
from spidar_gym.control.controller import CONTROL_RATE, Controller, ControllerConfig, Percept
from spidar_gym.control.core_flight import CoreController
from spidar_gym.control.observation import LegMomentum, Preview, layout, observe
from spidar_gym.control.presets import controller_config
from spidar_gym.envs.actions import CONTROLS, direct_command, find_action_mode
from spidar_gym.envs.env import SpidarEnv, split_options
from spidar_gym.envs.hover_task import NO_NEXT_FORM, REWARD_TERMS, FlightStart, HoverTask, Progress
from spidar_gym.errors import InvalidValueError, SpidarError, UnknownNameError, require_name
from spidar_gym.model.rotor import thrust_map, vectoring_to_force
from spidar_gym.robot import N_JOINTS, N_ROTORS, ROBOT
from spidar_gym.so3 import exp, log, matrix_to_quat
from spidar_gym.state import Command, Reference

_LEVEL = np.array([1.0, 0.0, 0.0, 0.0])
_STILL = np.zeros(3)
_NO_JOINTS = np.zeros(N_JOINTS)


class HoverEnv(SpidarEnv):
    """SPIDAR in flight; `spidar list spidar_gym/Hover-v0` prints its page."""

    task: HoverTask
    reward_weights = {name: weight for name, (weight, _) in REWARD_TERMS.items()}  # noqa: RUF012 - a constant

    def __init__(
        self,
        *,
        action_mode: str = "residual_wrench",
        preset: str = "paper",
        controller: ControllerConfig | None = None,
        allocator: type[Allocator] | None = None,
        control: str = "python",
        max_iter: int = AllocatorConfig.max_iter,
        **options: Any,  # noqa: ANN401 - the fields of the task, and what every environment takes
    ) -> None:
        """Build the task and its controller.

        Args:
            action_mode: What the action means.
            preset: Which controller: allocation, gains, compensations.
            controller: A controller of one's own in place of a preset; its joint speed is the task's.
            allocator: An allocator of one's own, a subclass of `Allocator`, in place of the QP.
            control: `python`, the readable controller, or `core`, the one that is compiled for the robot.
            max_iter: Iteration cap of the QP solver.
            **options: Arguments of the task and of `SpidarEnv`.

        Raises:
            UnknownNameError: For a mode, preset, camera or option that does not exist; it lists the valid ones.
            InvalidValueError: For a value out of range.
        """
        own, shared = split_options(HoverTask, options)
        self.task = HoverTask(**own)
        joint_speed = self.task.joint_speed
        mode = find_action_mode(action_mode)
        base = controller_config(preset) if controller is None else controller
        config = replace(base, joint_speed=joint_speed, allocator=AllocatorConfig(max_iter=max_iter))
        require_name("control", control, CONTROLS)
        self.controller: Any
        if control == "python":
            self.controller = Controller(config, allocator=allocator or Allocator)
        elif allocator is not None:
            raise InvalidValueError("allocator", allocator, "None: the core has its own")
        else:
            self.controller = CoreController(config)
        super().__init__(mode, layout(mode.size), joint_speed=joint_speed, **shared)
        self._start: FlightStart | None = None
        self.preload: np.ndarray | None = None
        """Wrench with which the integrals began [N, Nm]; None for the described robot."""
        self._progress: Progress | None = None
        self._reference: Reference | None = None

    def _choose(self, name: str, value: object) -> None:
        if name == "start":
            self._start = None if value is None else FlightStart.parse(value)  # type: ignore[arg-type] - it refuses
        elif name == "forms":
            self.task = replace(self.task, forms=str(value))
        else:
            raise UnknownNameError("reset option", name, ["forms", "start", "disturbances"])

    def _begin(self, rng: np.random.Generator) -> None:
        self._reference = None
        start = self._start or FlightStart(tuple(self.task.schedule(rng)), *self.task.offset(rng))
        self._progress = Progress(list(start.goals))
        position, rotation = start.position, start.rotation
        self._draw_robot(rng)
        q = self.progress.goal.joint_target
        R_wb = exp(rotation)
        vectoring = self.controller.rest_vectoring(q)
        com_b = self.controller.model.snapshot(q, R_wb, vectoring).com_b
        self._state = self.plant.reset(
            self.task.position_w + position - R_wb @ com_b,
            matrix_to_quat(R_wb),
            q,
            vectoring,
            np.full(N_ROTORS, ROBOT.hover_thrust),
            disturbances=self._disturbances,
            # Of its own, so that what the weather draws does not change what the next episode is.
            rng=rng.spawn(1)[0],
        )
        self._sense()
        # A robot off its description has hovered before the episode begins: its integrals hold what that takes.
        trim = start.trim
        if trim is None and not self._described:
            trim = self.trim(q)
        self.preload = trim
        self.controller.reset(self._seen, q, trim)
        self._legs = LegMomentum(_STILL, _STILL)
        self._joint_velocity = _NO_JOINTS
        self._look()

    @property
    def progress(self) -> Progress:
        """How far the episode has come (`SpidarError` before the first reset)."""
        if self._progress is None:
            raise SpidarError("there is no episode before reset(); valid: call reset() first")
        return self._progress

    @property
    def truth(self) -> Percept:
        """What a controller with the true state would make of it."""
        return self._truth

    def reference(self) -> Reference:
        """What the controller is asked to do now."""
        target = self.progress.goal.joint_target
        given = self._reference
        if given is None or given.joint_target is not target or given.mode != self.task.mode:
            given = Reference(self.task.position_w, _LEVEL, _STILL, _STILL, target, self.task.mode)
            self._reference = given
        fault = self._disturbances
        if fault.lost_rotor and self.progress.time >= fault.fault_time - 1e-9:
            lost = f"lost_{fault.fault}"
            if not getattr(given, lost).any():
                mask = np.arange(1, N_ROTORS + 1) == fault.lost_rotor
                self._reference = given = replace(given, **{lost: mask})
        return given

    def _act(self, action: np.ndarray) -> Command:
        """The command of this tick; keeps what observations need of it."""
        controller = self.controller
        if self._mode.residual is not None:
            residual = self._mode.residual(action)
            command = controller.step(self._seen, self.reference(), residual, self._percept)
            assert controller.tick is not None
            self._joint_velocity = controller.tick.joint_velocity
            return command
        memory = controller.memory
        command = direct_command(action, memory.vectoring)
        # Where the servos' slew limit takes the setpoints within this tick.
        reach = self.task.joint_speed / CONTROL_RATE
        step = np.minimum(np.maximum(command.joint_position - memory.joint_position, -reach), reach)
        self._joint_velocity = step * CONTROL_RATE
        controller.note(replace(command, joint_position=memory.joint_position + step))
        return command

    def trim(self, q: np.ndarray) -> np.ndarray:
        """Wrench in {CoG} that the real robot needs at rest beyond what its description needs [N, Nm]."""
        state = self.state
        percept = self.controller.perceive(state, self.reference())
        snapshot, R_wb = percept.snapshot, percept.R_wb
        described = thrust_map(snapshot.R_bl, snapshot.rotor_c) @ (
            vectoring_to_force(np.full(N_ROTORS, ROBOT.hover_thrust), state.vectoring).reshape(-1)
        )
        described[:3] -= ROBOT.weight * R_wb[2]
        force_w, torque_b = self.plant.net_wrench()
        force_b = force_w @ R_wb
        real = np.concatenate([force_b, torque_b - np.cross(snapshot.com_b, force_b)])
        return described - real

    def _look(self) -> None:
        """What the controller makes of what it sees, and what is true."""
        self._percept = self.controller.perceive(self._seen, self.reference())
        self._truth = self._percept
        if self._seen is not self._state:
            self._truth = self.controller.perceive(self.state, self.reference())

    def _errors(self) -> tuple[np.ndarray, np.ndarray]:
        """Position error, world [m], and attitude error log(RᵀR_d), torso axes [rad], of the true state.

        The CoG is the one that the description gives at the true state: nobody knows where the real one is.
        """
        return self._truth.error.position_w, log(self._truth.R_wb.T)  # the reference is level

    def _advance(self) -> str:
        self._look()
        h = self._percept.snapshot.momentum_map[3:] @ self._joint_velocity
        self._legs = LegMomentum(h, (h - self._legs.value) * CONTROL_RATE)
        errors = self._errors()
        self.progress.advance(*errors, self.state.joint_position)
        tilt = math.acos(max(-1.0, min(1.0, float(self._truth.R_wb[2, 2]))))
        return self.task.failed(errors[0], tilt, self.plant.in_contact)

    def _observation(self) -> np.ndarray:
        progress = self.progress
        goal, upcoming = progress.goal, progress.next_goal
        preview = Preview(
            joint_target=goal.joint_target,
            next_form=goal.joint_target if upcoming is None else upcoming.joint_target,
            time_to_next=NO_NEXT_FORM if upcoming is None else upcoming.start - progress.time,
        )
        thrust = self._seen.thrust if self._command is None else self._command.thrust
        rest = thrust, self._joint_velocity, self._legs, preview, self._action
        controller = self.controller
        if isinstance(controller, CoreController):
            return controller.observe(self._seen, self._percept, *rest, bound=self._bound)
        return observe(self._seen, self._percept, controller.memory, *rest, bound=self._bound)

    @property
    def _allocation(self) -> Allocation | None:
        return None if self.controller.tick is None else self.controller.tick.allocation

    def _task_info(self, failure: str) -> dict[str, Any]:
        errors = (np.zeros(3), np.zeros(3)) if failure == "diverged" else self._errors()
        tick, memory, progress = self.controller.tick, self.controller.memory, self.progress
        terms = self.task.reward_terms(*errors, progress.plan() - self.state.joint_position, self._action)
        if failure == "diverged":
            terms = dict.fromkeys(terms, 0.0)
        return {
            "position_error": errors[0].copy(),
            "attitude_error": errors[1].copy(),
            "vectoring_command": memory.vectoring.copy(),
            "wrench_desired": np.zeros(6) if tick is None else tick.wrench_desired.copy(),
            "restricted_rotors": memory.interference.restricted.copy(),
            **{f"reward_{name}": value for name, value in terms.items()},
            "is_success": failure == "" and progress.succeeded(self.task.horizon),
        }
