"""The one environment class: plant, controller and task behind Gymnasium's interface."""

import math
from dataclasses import replace
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces

from spidar_gym.control.allocator import AllocatorConfig
from spidar_gym.control.controller import CONTROL_RATE, Controller, ControllerConfig, Percept
from spidar_gym.control.observation import LegMomentum, Preview, layout, observe
from spidar_gym.description import CAMERAS
from spidar_gym.envs.actions import direct_command, find_action_mode
from spidar_gym.envs.tasks import NO_NEXT_FORM, REWARD_TERMS, TASKS, Progress
from spidar_gym.errors import InvalidValueError, SpidarError, UnknownNameError
from spidar_gym.model.rotor import vectoring_to_force
from spidar_gym.robot import N_JOINTS, N_ROTORS, ROBOT
from spidar_gym.sim.plant import MAX_HEIGHT, MAX_WIDTH, Plant, PlantConfig
from spidar_gym.so3 import exp, log, matrix_to_quat
from spidar_gym.state import Command, Reference, RobotState

_LEVEL = np.array([1.0, 0.0, 0.0, 0.0])
_STILL = np.zeros(3)
_NO_JOINTS = np.zeros(N_JOINTS)


class SpidarEnv(gymnasium.Env[np.ndarray, np.ndarray]):
    """SPIDAR under the paper's controller, to which the action adds; `spidar list ENV_ID` prints its page."""

    metadata: dict[str, Any] = {  # noqa: RUF012 - Gymnasium's own declaration
        "render_modes": ["human", "rgb_array", "depth_array"],
        "render_fps": int(CONTROL_RATE),
    }

    def __init__(
        self,
        task: str = "hover",
        *,
        action_mode: str = "residual_wrench",
        preset: str = "paper",
        max_iter: int = AllocatorConfig.max_iter,
        idle_thrust: float = 0.0,
        render_mode: str | None = None,
        camera: str = "chase",
        width: int = 640,
        height: int = 480,
        **options: Any,  # noqa: ANN401 - the fields of the task
    ) -> None:
        """Build the robot, its controller and the task.

        Args:
            task: Name of the task; `gym.make` fills it in.
            action_mode: What the action means.
            preset: Which allocation the controller runs.
            max_iter: Iteration cap of the QP solver.
            idle_thrust: Least thrust of a module [N].
            render_mode: `human`, `rgb_array`, `depth_array` or None.
            camera: Camera of the pictures.
            width: Width of the pictures [px].
            height: Height of the pictures [px].
            **options: Arguments of the task.

        Raises:
            UnknownNameError: For a task, mode, preset, camera or option that does not exist; it lists the valid ones.
            InvalidValueError: For a value out of range.
            StaleAssetError: When the model file was edited by hand.
        """
        if task not in TASKS:
            raise UnknownNameError("task", task, TASKS)
        unknown = options.keys() - set(TASKS[task].option_names())
        if unknown:
            raise UnknownNameError("option", sorted(unknown)[0], TASKS[task].option_names())
        if render_mode is not None and render_mode not in self.metadata["render_modes"]:
            raise UnknownNameError("render mode", render_mode, self.metadata["render_modes"])
        if camera not in CAMERAS:
            raise UnknownNameError("camera", camera, CAMERAS)
        for name, size, most in (("width", width, MAX_WIDTH), ("height", height, MAX_HEIGHT)):
            if not (isinstance(size, int) and 1 <= size <= most):
                raise InvalidValueError(name, size, f"a whole number of pixels within 1 … {most}")
        self.task = TASKS[task](**options)
        self._mode = find_action_mode(action_mode)
        joint_speed = self.task.joint_speed
        allocator = AllocatorConfig(max_iter=max_iter)
        self.controller = Controller(ControllerConfig(preset=preset, joint_speed=joint_speed, allocator=allocator))
        self.plant = Plant(PlantConfig(joint_speed=joint_speed, idle_thrust=idle_thrust))
        self.render_mode = render_mode
        self._camera, self._size = camera, (width, height)
        self._renderer: Any = None
        self.action_space = spaces.Box(-1.0, 1.0, (self._mode.size,), np.float32)
        self.layout = layout(self._mode.size)
        self._bound = np.concatenate([np.full(f.size, f.bound) for f in self.layout])
        high = self._bound.astype(np.float32)
        self.observation_space = spaces.Box(-high, high, dtype=np.float32)
        self._state: RobotState | None = None
        self._progress: Progress | None = None
        self._reference: Reference | None = None

    @property
    def state(self) -> RobotState:
        """The true state of the robot (`SpidarError` before the first reset)."""
        if self._state is None:
            raise SpidarError("there is no state before reset(); valid: call reset() first")
        return self._state

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Start an episode.

        Args:
            seed: Seed of the environment's generator, which draws schedule and initial offset.
            options: `{"forms": name}` sets the form sequence of this episode and those after it.

        Returns:
            Observation and info.
        """
        super().reset(seed=seed)
        for name, value in (options or {}).items():
            if name != "forms":
                raise UnknownNameError("reset option", name, ["forms"])
            self.task = replace(self.task, forms=value)
        rng = self.np_random
        self._reference = None
        self._progress = Progress(self.task.schedule(rng))
        position, rotation = self.task.offset(rng)
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
        )
        self.controller.reset(self._state, q)
        self._action = np.zeros(self._mode.size)
        self._legs = LegMomentum(_STILL, _STILL)
        self._joint_velocity = _NO_JOINTS
        self._command: Command | None = None
        self._percept = self.controller.perceive(self._state, self.reference())
        if self.render_mode == "human":
            self.render()
        return self._observation(), self._info(self._errors(), "")

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """One control period of 25 ms.

        Args:
            action: In [−1, 1]; what lies outside is clipped.

        Returns:
            Observation, reward in [0, 1], terminated, truncated (always False: TimeLimit truncates), info.

        Raises:
            InvalidValueError: For an action of the wrong shape or with a NaN.
            SpidarError: When `reset` was never called.
        """
        action = np.asarray(action, np.float64)
        if action.shape != (self._mode.size,):
            raise InvalidValueError("action", action.shape, f"an array of shape ({self._mode.size},)")
        if not math.isfinite(action.sum()):
            raise InvalidValueError("action", action.tolist(), "finite numbers within −1 … 1")
        self._action = np.minimum(np.maximum(action, -1.0), 1.0)
        self._command = self._act(self.state, self._action)
        self._state = self.plant.step(self._command)
        if self.plant.diverged:
            info = self._info((np.zeros(3), np.zeros(3)), "diverged")
            return np.zeros(len(self._bound), np.float32), 0.0, True, False, info
        progress = self.progress
        errors = self._perceive()
        progress.advance(*errors, self.state.joint_position)
        tilt = math.acos(max(-1.0, min(1.0, float(self._percept.R_wb[2, 2]))))
        failure = self.task.failed(errors[0], tilt, self.plant.in_contact)
        info = self._info(errors, failure)
        reward = sum(weight * info[f"reward_{name}"] for name, (weight, _) in REWARD_TERMS.items())
        if self.render_mode == "human":
            self.render()
        return self._observation(), reward, failure != "", False, info

    def render(self) -> Any:  # noqa: ANN401 - an array or None, as Gymnasium has it
        """Picture (height, width, 3) uint8, distances (height, width) [m], or None in the mode `human`."""
        from spidar_gym.sim import renderer  # OpenGL is loaded by those who draw

        if self.render_mode is None:
            gymnasium.logger.warn("render() without a render_mode; valid: " + ", ".join(self.metadata["render_modes"]))
            return None
        if self.render_mode == "human":
            self._renderer = self._renderer or renderer.Window(self.plant.period)
            return self._renderer.render(self.plant.data.qpos)
        self._renderer = self._renderer or renderer.OffscreenRenderer(self._camera, *self._size)
        return self._renderer.render(self.plant.data.qpos, depth=self.render_mode == "depth_array")

    def close(self) -> None:
        """Release window or OpenGL context; a second call does nothing."""
        renderer, self._renderer = self._renderer, None
        if renderer is not None:
            renderer.close()

    @property
    def progress(self) -> Progress:
        """How far the episode has come (`SpidarError` before the first reset)."""
        if self._progress is None:
            raise SpidarError("there is no episode before reset(); valid: call reset() first")
        return self._progress

    def reference(self) -> Reference:
        """What the controller is asked to do now."""
        target = self.progress.goal.joint_target
        if self._reference is None or self._reference.joint_target is not target:
            self._reference = Reference(self.task.position_w, _LEVEL, _STILL, _STILL, target, self.task.mode)
        return self._reference

    def _act(self, state: RobotState, action: np.ndarray) -> Command:
        """The command of this tick; keeps what observations need of it."""
        controller = self.controller
        if self._mode.residual is not None:
            residual = self._mode.residual(action)
            command = controller.step(state, self.reference(), residual, self._percept)
            assert controller.tick is not None
            self._joint_velocity = controller.tick.joint_velocity
            return command
        memory = controller.memory
        command = direct_command(action, memory.vectoring)
        # Where the servos' slew limit takes the setpoints within this tick.
        reach = self.task.joint_speed / CONTROL_RATE
        step = np.minimum(np.maximum(command.joint_position - memory.joint_position, -reach), reach)
        self._joint_velocity = step * CONTROL_RATE
        controller.memory = replace(
            memory,
            vectoring=command.vectoring,
            forces_l=vectoring_to_force(command.thrust, command.vectoring),
            joint_position=memory.joint_position + step,
        )
        return command

    def _perceive(self) -> tuple[np.ndarray, np.ndarray]:
        """Look at the new state; returns the errors of `info`."""
        self._percept = self.controller.perceive(self.state, self.reference())
        h = self._percept.snapshot.momentum_map[3:] @ self._joint_velocity
        self._legs = LegMomentum(h, (h - self._legs.value) * CONTROL_RATE)
        return self._errors()

    def _errors(self) -> tuple[np.ndarray, np.ndarray]:
        """Position error, world [m], and attitude error log(RᵀR_d), torso axes [rad], of the true state."""
        percept: Percept = self._percept
        return percept.error.position_w, log(percept.R_wb.T)  # the reference is level

    def _observation(self) -> np.ndarray:
        progress = self.progress
        goal, upcoming = progress.goal, progress.next_goal
        preview = Preview(
            joint_target=goal.joint_target,
            next_form=goal.joint_target if upcoming is None else upcoming.joint_target,
            time_to_next=NO_NEXT_FORM if upcoming is None else upcoming.start - progress.time,
        )
        return observe(
            self.state,
            self._percept,
            self.controller.memory,
            self.state.thrust if self._command is None else self._command.thrust,
            self._joint_velocity,
            self._legs,
            preview,
            self._action,
            bound=self._bound,
        )

    def _info(self, errors: tuple[np.ndarray, np.ndarray], failure: str) -> dict[str, Any]:
        """The same keys and shapes at every step and at reset; nothing in it is written or handed out again."""
        state, command, memory, progress = self.state, self._command, self.controller.memory, self.progress
        tick = self.controller.tick
        allocation = None if tick is None else tick.allocation
        terms = self.task.reward_terms(*errors, progress.plan() - state.joint_position, self._action)
        if failure == "diverged":
            terms = dict.fromkeys(terms, 0.0)
        return {
            "position_error": errors[0].copy(),
            "attitude_error": errors[1].copy(),
            "thrust_command": (state.thrust if command is None else command.thrust).copy(),
            "thrust": state.thrust.copy(),
            "vectoring_command": memory.vectoring.copy(),
            "vectoring": state.vectoring.copy(),
            "joint_torque_allocated": np.zeros(N_JOINTS) if allocation is None else allocation.joint_torques.copy(),
            "joint_torque": state.joint_torque.copy(),
            "wrench_desired": np.zeros(6) if tick is None else tick.wrench_desired.copy(),
            "wrench_allocated": np.zeros(6) if allocation is None else allocation.wrench.copy(),
            "total_thrust": float(state.thrust.sum()),
            "qp_status": "none" if allocation is None else str(allocation.status),
            "qp_iterations": 0 if allocation is None else allocation.iterations,
            "qp_slack": 0.0 if allocation is None else allocation.slack,
            "restricted_rotors": memory.interference.restricted.copy(),
            **{f"reward_{name}": value for name, value in terms.items()},
            "is_success": failure == "" and progress.succeeded(self.task.horizon),
            "failure": failure,
        }
