"""The one environment class: plant, controller and task behind Gymnasium's interface."""

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces

from spidar_gym.control.allocator import AllocatorConfig
from spidar_gym.control.controller import CONTROL_RATE, Controller, ControllerConfig
from spidar_gym.control.estimator import Estimator
from spidar_gym.control.observation import LegMomentum, Preview, layout, observe
from spidar_gym.control.presets import controller_config
from spidar_gym.description import CAMERAS
from spidar_gym.envs.actions import direct_command, find_action_mode
from spidar_gym.envs.tasks import NO_NEXT_FORM, REWARD_TERMS, TASKS, Progress
from spidar_gym.errors import InvalidValueError, SpidarError, UnknownNameError
from spidar_gym.model.rotor import thrust_map, vectoring_to_force
from spidar_gym.robot import N_JOINTS, N_ROTORS, ROBOT
from spidar_gym.sim.disturbances import Disturbances
from spidar_gym.sim.energy import endurance_min
from spidar_gym.sim.plant import Plant, PlantConfig
from spidar_gym.sim.randomize import check_strength, randomize
from spidar_gym.sim.scene import MAX_HEIGHT, MAX_WIDTH
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
        controller: ControllerConfig | None = None,
        max_iter: int = AllocatorConfig.max_iter,
        idle_thrust: float = 0.0,
        plant: PlantConfig | None = None,
        wake: bool = True,
        battery: bool = False,
        sensors: bool = False,
        randomization: float = 0.0,
        disturbances: Mapping[str, Any] | None = None,
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
            preset: Which controller: allocation, gains, compensations.
            controller: A controller of one's own in place of a preset; its joint speed is the task's.
            max_iter: Iteration cap of the QP solver.
            idle_thrust: Least thrust of a module [N].
            plant: A simulated robot of one's own, to which the arguments below are applied; the nominal one by default.
            wake: Whether there is air: jets, drag, ground effect.
            battery: Whether the largest thrust falls with the voltage.
            sensors: Whether the controller sees what the real sensors and the estimator say, or the true state.
            randomization: Strength of the domain randomisation, 0 … 1.
            disturbances: `{"wind": m/s, "push": N, "lost_rotor": 1 … 8, "fault": …, "fault_time": s}`.
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
        base = controller_config(preset) if controller is None else controller
        self.controller = Controller(replace(base, joint_speed=joint_speed, allocator=allocator))
        check_strength(randomization)
        self._strength = randomization
        self._disturbances = Disturbances.parse(disturbances)
        robot = plant or PlantConfig()
        self._nominal = replace(
            robot,
            joint_speed=joint_speed,
            idle_thrust=idle_thrust or robot.idle_thrust,
            sense=robot.sense or sensors,
            aero=replace(robot.aero, wake=robot.aero.wake and wake),
            actuators=replace(robot.actuators, battery=robot.actuators.battery or battery),
        )
        self._described = plant is None and randomization == 0.0
        self.plant = Plant(self._nominal)
        self.estimator = Estimator()
        self._draws: dict[str, np.ndarray] = {}
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
            options: `{"forms": name}` sets the form sequence, `{"disturbances": {...}}` what happens to the robot, in
                this episode and those after it.

        Returns:
            Observation and info.
        """
        super().reset(seed=seed)
        for name, value in (options or {}).items():
            if name == "forms":
                self.task = replace(self.task, forms=value)
            elif name == "disturbances":
                self._disturbances = Disturbances.parse(value)
            else:
                raise UnknownNameError("reset option", name, ["forms", "disturbances"])
        rng = self.np_random
        self._reference = None
        self._progress = Progress(self.task.schedule(rng))
        position, rotation = self.task.offset(rng)
        if self._strength > 0.0:
            config, self._draws = randomize(self._nominal, rng, self._strength)
            self.plant.configure(config)
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
        self._seen = self._state
        if self._nominal.sense:
            first = self.plant.measure()
            indicated = {"joint_position": first.joint_position, "vectoring": first.vectoring}
            self.estimator.reset(replace(self._state, **indicated))
            self._seen = self.estimator.update(first, self._state.thrust)
        # A robot off its description has hovered before the episode begins: its integrals hold what that takes.
        trim = None if self._described else self._trim(q)
        self.controller.reset(self._seen, q, trim)
        self._action = np.zeros(self._mode.size)
        self._legs = LegMomentum(_STILL, _STILL)
        self._joint_velocity = _NO_JOINTS
        self._command: Command | None = None
        self._look()
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
        progress = self.progress
        self._command = self._act(self._seen, self._action)
        self._state = self.plant.step(self._command)
        if self.plant.diverged:
            info = self._info((np.zeros(3), np.zeros(3)), "diverged")
            return np.zeros(len(self._bound), np.float32), 0.0, True, False, info
        self._seen = self._state
        if self._nominal.sense:
            self._seen = self.estimator.update(self.plant.measure(), self._command.thrust)
        self._look()
        h = self._percept.snapshot.momentum_map[3:] @ self._joint_velocity
        self._legs = LegMomentum(h, (h - self._legs.value) * CONTROL_RATE)
        errors = self._errors()
        progress.advance(*errors, self.state.joint_position)
        tilt = math.acos(max(-1.0, min(1.0, float(self._truth.R_wb[2, 2]))))
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

    def _trim(self, q: np.ndarray) -> np.ndarray:
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

    def _observation(self) -> np.ndarray:
        progress = self.progress
        goal, upcoming = progress.goal, progress.next_goal
        preview = Preview(
            joint_target=goal.joint_target,
            next_form=goal.joint_target if upcoming is None else upcoming.joint_target,
            time_to_next=NO_NEXT_FORM if upcoming is None else upcoming.start - progress.time,
        )
        return observe(
            self._seen,
            self._percept,
            self.controller.memory,
            self._seen.thrust if self._command is None else self._command.thrust,
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
            "thrust_factor": self.plant.thrust_factor,
            "air_force": self.plant.air_force,
            "power_w": self.plant.memory.power,
            "energy_wh": self.plant.memory.energy_wh,
            "endurance_min": endurance_min(self.plant.mean_power),
            "randomization": {name: draw.copy() for name, draw in self._draws.items()},
            **{f"reward_{name}": value for name, value in terms.items()},
            "is_success": failure == "" and progress.succeeded(self.task.horizon),
            "failure": failure,
        }
