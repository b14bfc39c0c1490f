"""The course environment: flight and crawl by targets, by residuals on a rule's commands, or without a controller."""

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import Any

import numpy as np

from spidar_gym.control.course.gates import Course, parse_course
from spidar_gym.control.course.observation import course_layout
from spidar_gym.control.course.rule import course_rule
from spidar_gym.control.course.target import Target
from spidar_gym.control.flight.observation import Field
from spidar_gym.control.locomotion.manager import Manager
from spidar_gym.control.locomotion.orders import PHASES, ManagerConfig
from spidar_gym.control.presets import controller_config, crawler_config, for_robot
from spidar_gym.envs.actions import FLOOR, TorsoScale, course_modes, scaled_action_mode
from spidar_gym.envs.commander import CourseCommander
from spidar_gym.envs.controllers import CONTROLS, make_manager
from spidar_gym.envs.env import SpidarEnv
from spidar_gym.envs.fleet import Fleet
from spidar_gym.envs.locking import in_turn
from spidar_gym.envs.options import described_robot, make_task, own_robot
from spidar_gym.envs.progress import CourseProgress
from spidar_gym.envs.view import fps
from spidar_gym.errors import InvalidValueError, require_instance, require_name
from spidar_gym.native.core_manager import CoreManager
from spidar_gym.native.course_records import read_course, read_target
from spidar_gym.native.engine_structs import engine_layouts
from spidar_gym.native.structs import fill
from spidar_gym.sim.course_boxes import boxes
from spidar_gym.sim.ground import GroundConfig, with_boxes
from spidar_gym.sim.randomize import Randomization
from spidar_gym.tasks.course import DECIDE, CourseTask


class CourseEnv(SpidarEnv[CourseTask, CoreManager, CourseProgress]):
    """SPIDAR on a course; `spidar list spidar_gym/Course-v0` prints its page."""

    metadata: dict[str, Any] = SpidarEnv.metadata | {"render_fps": fps(DECIDE)}
    reset_options = ("course", "disturbances")
    task_type = CourseTask
    words = MappingProxyType({"phase": PHASES})
    no_goal = "its goal is a part of the course, which is observed"
    true_fields = (
        Field("goal_error", 3, 5.0, "m, m, rad", "goal − torso: x, y in the world, yaw"),
        Field("hit_n", 1, 100.0, "N", "largest force of the step on ducts and links"),
    )
    _kept = ("_given",)

    def __init__(
        self,
        *,
        action_mode: str = "waypoint",
        action_scale: Mapping[str, float] | TorsoScale | None = None,
        preset: str = "tuned",
        gait: str = "robust_overlapped",
        manager: ManagerConfig | None = None,
        control: str = "core",
        hold: int | None = None,
        **options: Any,  # noqa: ANN401 - fields of the task and arguments of `SpidarEnv`
    ) -> None:
        """Build the task and the controllers.

        Args:
            action_mode: Name of the action mode.
            action_scale: Share of a residual's authority, `{"share": 0.001 … 1}`; or zero and scale of
                `torso_forces`: `{"force": N, "joint": rad, "trim": share of weight}`, by
                default 3 N, 0.1 rad, 0.
            preset: Name of the flight controller.
            gait: Name of the crawler.
            manager: Custom configuration of both controllers and the transitions between them, in place of presets;
                the task's joint speeds override those in it.
            control: `core`, the manager that is compiled for the robot, or `python`, the Python manager.
            hold: Control periods of 25 ms per step: 20 by default with `waypoint`, whose targets are read every 20
                periods, and 1 with the others.
            **options: Arguments of the task and of `SpidarEnv`.

        Raises:
            UnknownNameError: For a mode, preset or camera that does not exist; it lists the valid ones.
            UnknownArgumentError: For an argument that does not exist; it lists the valid ones.
            InvalidValueError: For a value out of range, a course that is impassable, a goal that is out of reach.
        """
        if "course" in options:
            options["course"] = parse_course(options["course"])
        described = described_robot(options)
        task, shared = make_task(SpidarEnv, CourseEnv, self.task_type, options)
        mode = scaled_action_mode(action_mode, action_scale, FLOOR, course_modes, described)
        self._is_waypoint = action_mode == "waypoint"
        if hold is None:
            hold = DECIDE if self._is_waypoint else 1
        base = manager or ManagerConfig(
            flight=controller_config(preset, described), crawl=crawler_config(gait, robot=described)
        )
        require_instance(ManagerConfig, manager=base)
        if base.crawl.gait.robot != described:
            base = replace(base, flight=for_robot(base.flight, described), crawl=for_robot(base.crawl, described))
        flight, crawl = (
            replace(base.flight, joint_speed=task.joint_speed),
            replace(base.crawl, joint_speed=task.crawl_speed),
        )
        self._config = replace(base, flight=flight, crawl=crawl)
        require_name("control", control, CONTROLS)
        self._given: Course | None = None
        shared["randomization"] = Randomization.parse(shared.get("randomization", 0.0)).on_level_floors()
        robot = own_robot(shared.pop("plant", None), described)
        if robot.ground.uneven or robot.ground.boxed or robot.ground.slope:
            raise InvalidValueError("plant", "a floor that is not even", "an even floor: the course is built on it")
        # The model needs a floor with boxes from the start; each reset sets their sizes and positions.
        robot = replace(robot, ground=_built(task.draw_course(np.random.Generator(np.random.PCG64(0)))))
        super().__init__(
            mode, course_layout(mode.size, described), task=task, joint_speed=max(task.joint_speed, task.crawl_speed),
            control=control, plant=robot, hold=hold, **shared,
        )  # fmt: skip

    def _look_at_controller(self) -> CoreManager:
        manager = make_manager(self._config, self._control, self.fleet)
        assert isinstance(manager, CoreManager)
        return manager

    def _make_commander(self) -> CourseCommander:
        manager = make_manager(self._config, self._control)
        assert isinstance(manager, Manager)
        return CourseCommander(
            manager, self.fleet, self.plant, self._mode, self._bound, is_waypoint=self._is_waypoint, decide=DECIDE
        )

    @property
    def course(self) -> Course:
        """Course of the episode, as on the map (`SpidarError` before the first reset)."""
        return self._known("course")

    @property
    @in_turn
    def target(self) -> Target | None:
        """Target that the pilot follows, or None."""
        commander = self._commander
        if isinstance(commander, CourseCommander):
            return commander.pilot.last
        return read_target(self.fleet.robots[0]["pilot"])

    def rule(self) -> Target:
        """Return the rule's target for the current state."""
        seen = self.seen
        return course_rule(self.course, seen.position_w, seen.joint_position, self.controller.phase)

    def rules(self, *, truncates: bool = False, autoreset: str = "disabled") -> np.ndarray:
        """Return the engine's rules, an `sp_course_rules`."""
        record = np.zeros((), engine_layouts()["course_rules"])
        fill(record["manager"], self._config)
        record["is_waypoint"] = self._is_waypoint
        self._fill_rules(record, truncates=truncates, autoreset=autoreset)
        return record

    def _prepare(self, fleet: Fleet) -> None:
        fleet.go(0, self._given or self.task.course)

    def _read(self, name: str) -> Any:  # noqa: ANN401 - any value
        robot = self.fleet.robots[0]
        if name == "course":
            return read_course(robot["course"])
        return CourseProgress.read(robot) if name == "episode" else super()._read(name)

    def make_fleet(
        self, robots: int, threads: int = 1, *, autoreset: str = "disabled", truncates: bool = False,
        rules: np.ndarray | None = None,
    ) -> Fleet:  # fmt: skip
        """Make robots of this environment in the engine, before their first reset."""
        record = self.rules(truncates=truncates, autoreset=autoreset) if rules is None else rules
        fleet = Fleet(self.task, record, self._nominal, robots, threads, alike=False)
        for robot in range(robots):
            fleet.disturb(robot, self._disturbances)
            fleet.go(robot, self.task.course)
        return fleet

    def _chosen(self, name: str, value: Any) -> dict[str, object]:  # noqa: ANN401 - user input
        return {"_given": parse_course(value)} if name == "course" else super()._chosen(name, value)


def _built(course: Course) -> GroundConfig:
    """Return the floor with the boxes of a course."""
    return with_boxes(GroundConfig(), boxes(course))
