"""The crawl environment: the paper's gait and allocation on the ground, to which the action adds; a pose to reach."""

import math
from dataclasses import replace
from types import MappingProxyType
from typing import Any

import numpy as np

from spidar_gym.control.allocation.allocator import AllocatorConfig
from spidar_gym.control.crawl.controller import CrawlerConfig
from spidar_gym.control.crawl.footsteps import Move, lying_pose
from spidar_gym.control.crawl.gait import nominal_time
from spidar_gym.control.crawl.observation import CrawlObservables, crawl_layout
from spidar_gym.control.crawl.phases import PHASES
from spidar_gym.control.crawl.pose2 import torso_pose2
from spidar_gym.control.flight.controller import CONTROL_RATE
from spidar_gym.control.flight.observation import Field
from spidar_gym.control.interface import CrawlControl
from spidar_gym.control.presets import crawler_config, for_robot
from spidar_gym.envs.actions import act_directly, crawl_modes, find_action_mode
from spidar_gym.envs.controllers import choose_crawl_control, gait_type, make_crawler
from spidar_gym.envs.crawl.task import CRAWL_REWARD_TERMS, CrawlProgress, CrawlTask
from spidar_gym.envs.env import SpidarEnv
from spidar_gym.envs.fleet import Fleet
from spidar_gym.envs.goals import CrawlGoal
from spidar_gym.envs.options import described_robot, own_robot, solver_settings, split_options
from spidar_gym.envs.rules import crawl_rules
from spidar_gym.envs.single import keeps_page
from spidar_gym.envs.turns import in_turn
from spidar_gym.errors import require_instance
from spidar_gym.native.engine_structs import CRAWL_FAILURES, SHORTFALLS
from spidar_gym.robot import N_JOINTS, N_LEGS, N_ROTORS
from spidar_gym.so3 import matrix_to_quat, quat_to_matrix
from spidar_gym.state import Command

SETTLE_TICKS = 40
"""Ticks in which the robot comes to lie on a floor that is no plane."""


class CrawlEnv(SpidarEnv[CrawlTask, CrawlControl, CrawlProgress]):
    """SPIDAR on the ground; `spidar list spidar_gym/Crawl-v0` prints its page."""

    kind = "crawling"
    reward_terms = CRAWL_REWARD_TERMS
    failures = CRAWL_FAILURES
    task_type = CrawlTask
    words = MappingProxyType({"phase": PHASES, "shortfalls": SHORTFALLS})
    goal_type = CrawlGoal
    true_fields = (
        Field("goal_error", 3, 1.0, "m, m, rad", "goal − torso: x, y in the world, yaw"),
        Field("foot_contact", N_LEGS, 1.0, "", "1 for a foot that touches the floor"),
    )

    def __init__(
        self,
        *,
        action_mode: str = "residual_gait",
        preset: str = "published",
        controller: CrawlerConfig | None = None,
        law: type | None = None,
        control: str | None = None,
        max_iter: int = AllocatorConfig.max_iter,
        **options: Any,  # noqa: ANN401 - the fields of the task, and what every environment takes
    ) -> None:
        """Build the task and its controller.

        Args:
            action_mode: What the action means.
            preset: Which crawler: gait, allocation, margins.
            controller: A crawler of one's own in place of a preset; the task's joint speed goes before its own.
            law: A gait or control law of one's own, a subclass of `Crawler`, in place of the paper's.
            control: `core`, the crawler that is compiled for the robot, or `python`, the readable one; by default the
                core, unless a law is given.
            max_iter: Iteration cap of the QP solver.
            **options: Arguments of the task and of `SpidarEnv`.

        Raises:
            UnknownNameError: For a mode, preset, schedule or camera that does not exist; it lists the valid ones.
            UnknownArgumentError: For an argument that does not exist, likewise.
            InvalidValueError: For a value out of range.
        """
        own, shared = split_options(SpidarEnv, CrawlEnv, CrawlTask, options)
        self.task = task = CrawlTask(**own)
        described = described_robot(shared)
        mode = find_action_mode(action_mode, crawl_modes(described))
        config = crawler_config(preset, task.schedule, described) if controller is None else controller
        require_instance(CrawlerConfig, controller=config)
        if config.gait.robot != described:
            config = for_robot(config, described)
        config = replace(config, allocator=solver_settings(max_iter))
        if task.joint_speed is not None:
            config = replace(config, joint_speed=task.joint_speed)
        control = choose_crawl_control(control, law)
        self._config, self._law = config, law
        robot = own_robot(shared.pop("plant", None), described)
        if task.friction is not None:
            robot = replace(robot, body=replace(robot.body, foot_friction=task.friction))
        # A floor of tiles has to be one from the beginning; the heights are drawn at every reset.
        robot = replace(robot, ground=task.ground(np.random.Generator(np.random.PCG64(0)), robot.ground))
        super().__init__(
            mode, crawl_layout(mode.size, described), joint_speed=config.joint_speed, control=control, plant=robot,
            **shared,
        )  # fmt: skip

    def _make_controller(self) -> CrawlControl:
        return make_crawler(self._config, self._control, self._law, self.fleet)

    @property
    @in_turn
    def way(self) -> tuple[float, float, float]:
        """Where the goal is, seen from the start: x, y [m], yaw [rad]."""
        return self._known("way") if self._began else (0.0, 0.0, 0.0)

    # ---- all of it in the engine ----

    def _is_built_in(self) -> bool:
        return type(self.task) is CrawlTask and keeps_page(type(self), CrawlEnv)

    def _rule(self, fleet: Fleet) -> None:
        fleet.rules[()] = self.rules()

    def rules(self, *, truncates: bool = False, autoreset: str = "disabled") -> np.ndarray:
        """`sp_crawl_rules`."""
        record = crawl_rules(self.task, self._config, SETTLE_TICKS)
        self._fill_rules(record, truncates=truncates, autoreset=autoreset)
        return record

    def _prepare(self, fleet: Fleet) -> None:
        pass

    def _read(self, name: str) -> Any:  # noqa: ANN401 - whatever is looked up
        assert self.fleet is not None
        robot = self.fleet.robots[0]
        if name == "way":
            return tuple(robot["way"].tolist())
        return CrawlProgress.read(robot) if name == "episode" else super()._read(name)

    def make_fleet(
        self, robots: int, threads: int = 1, *, autoreset: str = "disabled", truncates: bool = False,
        rules: np.ndarray | None = None,
    ) -> Fleet:  # fmt: skip
        """Robots of this environment in the engine, at no episode yet."""
        task = self.task
        alike = not (self._randomization.draws or task.steps or task.obstacles or self._loads) and rules is None
        record = self.rules(truncates=truncates, autoreset=autoreset) if rules is None else rules
        fleet = Fleet(self.kind, record, self._nominal, robots, threads, alike=alike)
        for robot in range(robots):
            fleet.disturb(robot, self._disturbances)
        return fleet

    def _begin(self, rng: np.random.Generator) -> None:
        config, task = self.controller.config, self.task
        way = task.way(rng)
        if task.steps or task.obstacles:
            self._nominal = replace(self._nominal, ground=task.ground(rng, self._nominal.ground))
            self.plant.configure(replace(self.plant.config, ground=self._nominal.ground))
        self._draw_robot(rng)
        ground = self.plant.config.ground
        q = lying_pose(config.gait)
        # Over the highest tile under torso or feet; from there it settles.
        below = ground.height(np.vstack((config.gait.home_b, np.eye(3) * 0.12, np.eye(3) * -0.12)))
        height = self.robot.peg_depth + float(below.max())
        self._place(rng, ground.R_wf @ np.array([0.0, 0.0, height]), matrix_to_quat(ground.R_wf), q)
        if ground.uneven:
            still = Command(
                np.zeros(N_ROTORS), np.zeros((N_ROTORS, 2)), q, np.full(N_JOINTS, config.joint_torque_limit)
            )
            for _ in range(SETTLE_TICKS):
                self._now["state"] = self.plant.step(still)
        self._sense()
        self._now["way"] = (way.x, way.y, way.yaw)
        move = Move(way)
        self.controller.reset(self.seen, [move])
        seconds = nominal_time(
            config.gait, [move], joint_speed=config.joint_speed, dt=1.0 / CONTROL_RATE, kind=gait_type(self._law)
        )
        # The goal is where the controller was told to go from where it believed itself; the error is the true one.
        start = torso_pose2(self.state.position_w, quat_to_matrix(self.state.quat_wb))
        self._now["episode"] = progress = CrawlProgress(start @ way, seconds, np.zeros(3))
        self._update_errors()
        progress.initial_distance = max(progress.distance, 1e-6)

    def _act(self, action: np.ndarray) -> Command:
        if self._mode.residual is not None:
            return self.controller.step(self.seen, self._mode.residual(action))
        return act_directly(self.controller, action)[0]

    def _update_errors(self) -> None:
        """What touches the floor, and how far the goal is."""
        state = self.state
        R_wb = quat_to_matrix(state.quat_wb)
        self._touch = self.plant.touch()
        upright = float(R_wb[:, 2] @ self.plant.config.ground.R_wf[:, 2])
        self._tilt = math.acos(max(-1.0, min(1.0, upright)))
        self.progress.update_errors(state.position_w, R_wb)

    def _advance(self) -> str:
        self._update_errors()
        progress, controller = self.progress, self.controller
        assert self._command is not None
        limit = min(controller.config.joint_torque_limit, self.plant.config.actuators.max_joint_torque)
        progress.advance(
            self._touch,
            controller.gait.phase,
            controller.gait.swinging,
            float(self._command.thrust.sum()),
            self.state.joint_torque,
            limit,
            self._tilt,
            self.robot.weight,
        )
        progress.timeouts = controller.gait.timeouts
        if self._mode.residual is None:
            progress.rest(self.state, self._touch, float(self._command.thrust.sum()), self.robot.weight)
        elif controller.done and not progress.finished:
            progress.finished = progress.time
        return self.task.failed(progress, self._tilt, self._touch)

    def _wanted(self) -> np.ndarray:
        goal = self.progress.goal
        return np.array([goal.x, goal.y, goal.yaw])

    def _observation(self) -> np.ndarray:
        thrust = self.seen.thrust if self._command is None else self._command.thrust
        observables = CrawlObservables(self.seen, self.progress.goal, thrust, self._action)
        return self.controller.observe(observables, bound=self._bound)

    def _task_info(self, failure: str) -> dict[str, Any]:
        progress, touch, plant = self.progress, self._touch, self.plant
        slip = max(float(touch.foot_slip.max()), float(touch.peg_slip.max()))
        terms = self.task.reward_terms(progress, self._tilt, slip, plant.power, self._action)
        if failure == "diverged":
            terms = dict.fromkeys(terms, 0.0)
        thrust = np.zeros(N_ROTORS) if self._command is None else self._command.thrust
        way = max(progress.initial_distance - progress.distance, 1e-3)
        return {
            "goal_error": progress.error.copy(),
            "phase": self.controller.gait.phase,
            "finished": progress.finished > 0.0,
            "time_s": progress.finished or progress.time,
            "nominal_time_s": progress.nominal_time,
            "airborne_share": progress.airborne,
            "foot_contact": touch.feet.copy(),
            "foot_slip_m": float(progress.foot_slip.max()),
            "peg_slip_m": float(progress.peg_slip.max()),
            "duct_clearance_m": min(touch.duct_clearance, progress.duct_clearance),
            "saturation_share": progress.saturation / progress.counted,
            "thrust_fraction": float(thrust.sum()) / self.robot.weight,
            "thrust_fraction_mean": progress.thrust / progress.counted,
            "thrust_fraction_peak": progress.thrust_peak,
            "tilt_rad": self._tilt,
            "timeouts": progress.timeouts,
            "cost_of_transport": 3600.0 * plant.energy_wh / (self.robot.weight * way),
            **{f"reward_{name}": value for name, value in terms.items()},
            "shortfalls": ", ".join(progress.shortfalls()),
            "is_success": failure == "" and not progress.shortfalls(),
        }
