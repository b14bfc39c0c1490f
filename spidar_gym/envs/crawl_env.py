"""The crawl environment: reach a pose on the floor with the paper's gait and allocation, plus the action's residual."""

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import Any

import numpy as np

from spidar_gym.control.allocation.allocator import AllocatorConfig
from spidar_gym.control.crawl.controller import CrawlerConfig
from spidar_gym.control.crawl.footsteps import lying_pose
from spidar_gym.control.crawl.observation import crawl_layout
from spidar_gym.control.crawl.phases import PHASES
from spidar_gym.control.flight.observation import Field
from spidar_gym.control.interface import CrawlControl
from spidar_gym.control.presets import crawler_config, for_robot
from spidar_gym.envs.actions import FLOOR, TorsoScale, crawl_modes, scaled_action_mode
from spidar_gym.envs.commander import CrawlCommander
from spidar_gym.envs.controllers import choose_crawl_control, gait_type, make_crawler
from spidar_gym.envs.env import SpidarEnv
from spidar_gym.envs.fleet import Fleet
from spidar_gym.envs.goals import CrawlGoal
from spidar_gym.envs.locking import in_turn
from spidar_gym.envs.options import described_robot, make_task, own_robot, solver_settings
from spidar_gym.envs.progress import CrawlProgress
from spidar_gym.errors import require_instance
from spidar_gym.native.engine_structs import engine_layouts
from spidar_gym.native.structs import fill
from spidar_gym.robot import N_LEGS
from spidar_gym.sim.randomize import Randomization
from spidar_gym.tasks.crawl import SHORTFALLS, CrawlTask


class CrawlEnv(SpidarEnv[CrawlTask, CrawlControl, CrawlProgress]):
    """SPIDAR on the ground; `spidar list spidar_gym/Crawl-v0` prints its page."""

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
        action_scale: Mapping[str, float] | TorsoScale | None = None,
        preset: str = "published",
        controller: CrawlerConfig | None = None,
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
                default 3 N, 0.1 rad, 0.
            preset: Name of the crawler: gait, allocation, margins.
            controller: Custom configuration of the crawler in place of a preset; the task's joint speed overrides its
                own.
            law: Custom gait or control law, a subclass of `Crawler`, in place of the paper's.
            control: `core`, the crawler that is compiled for the robot, or `python`, the Python crawler; by default the
                core, unless a law is given.
            max_iter: Iteration cap of the QP solver.
            **options: Arguments of the task and of `SpidarEnv`.

        Raises:
            UnknownNameError: For a mode, preset, schedule or camera that does not exist; it lists the valid ones.
            UnknownArgumentError: For an argument that does not exist; it lists the valid ones.
            InvalidValueError: For a value out of range.
        """
        described = described_robot(options)
        task, shared = make_task(SpidarEnv, CrawlEnv, self.task_type, options)
        shared["randomization"] = randomization = Randomization.parse(shared.get("randomization", 0.0))
        if randomization.world and not task.steps:
            task = replace(task, steps=randomization.world.floor_steps)
        mode = scaled_action_mode(action_mode, action_scale, FLOOR, crawl_modes, described)
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
        # The model needs a floor of tiles from the start; each reset samples their heights.
        ground = task.floor(robot.ground)
        if randomization.tilts and task.slope_direction:  # without `slope` the task does not set it
            ground = replace(ground, heading=task.slope_direction)
        robot = replace(robot, ground=ground)
        super().__init__(
            mode, crawl_layout(mode.size, described, clock=mode.has_clock), task=task,
            joint_speed=config.joint_speed, control=control, plant=robot, **shared,
        )  # fmt: skip

    def _look_at_controller(self) -> CrawlControl:
        return make_crawler(self._config, self._control, fleet=self.fleet)

    def _make_commander(self) -> CrawlCommander:
        crawler = make_crawler(self._config, self._control, self._law)
        return CrawlCommander(crawler, self.fleet, self.plant, self._mode, self._bound, gait_type(self._law))

    @property
    @in_turn
    def way(self) -> tuple[float, float, float]:
        """Goal relative to the start: x, y [m], yaw [rad]."""
        return self._known("way") if self._began else (0.0, 0.0, 0.0)

    def rules(self, *, truncates: bool = False, autoreset: str = "disabled") -> np.ndarray:
        """Return the engine's rules, an `sp_crawl_rules`."""
        record = np.zeros((), engine_layouts()["crawl_rules"])
        fill(record["controller"], self._config)
        record["lies"] = lying_pose(self._config.gait)
        self._fill_rules(record, truncates=truncates, autoreset=autoreset)
        return record

    def _prepare(self, fleet: Fleet) -> None:
        pass

    def _read(self, name: str) -> Any:  # noqa: ANN401 - any value
        robot = self.fleet.robots[0]
        if name == "way":
            return tuple(robot["way"].tolist())
        return CrawlProgress.read(robot) if name == "episode" else super()._read(name)

    def make_fleet(
        self, robots: int, threads: int = 1, *, autoreset: str = "disabled", truncates: bool = False,
        rules: np.ndarray | None = None,
    ) -> Fleet:  # fmt: skip
        """Make robots of this environment in the engine, before their first reset."""
        task = self.task
        alike = not (self._randomization.draws or task.steps or task.obstacles or task.loads) and rules is None
        record = self.rules(truncates=truncates, autoreset=autoreset) if rules is None else rules
        fleet = Fleet(task, record, self._nominal, robots, threads, alike=alike, floors=self._randomization.tilts)
        for robot in range(robots):
            fleet.disturb(robot, self._disturbances)
        return fleet
