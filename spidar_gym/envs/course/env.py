"""The course environment: both ways of moving, by targets, on top of a rule, or without any controller."""

import math
from dataclasses import replace
from types import MappingProxyType
from typing import Any

import numpy as np

from spidar_gym.control.course.gates import Course
from spidar_gym.control.course.observation import CourseObservables, course_layout, observe_course
from spidar_gym.control.course.pilot import Pilot
from spidar_gym.control.course.rule import course_rule
from spidar_gym.control.course.target import Target, take_target
from spidar_gym.control.flight.observation import Field
from spidar_gym.control.locomotion.orders import PHASES, ManagerConfig
from spidar_gym.control.presets import controller_config, crawler_config, for_robot
from spidar_gym.envs.actions import act_directly, course_modes, find_action_mode
from spidar_gym.envs.controllers import CONTROLS, make_manager
from spidar_gym.envs.course.task import COURSE_REWARD_TERMS, DECIDE, CourseProgress, CourseTask, parse_course
from spidar_gym.envs.env import SpidarEnv
from spidar_gym.envs.fleet import Fleet
from spidar_gym.envs.options import described_robot, own_robot, split_options
from spidar_gym.envs.rules import course_rules
from spidar_gym.envs.single import keeps_page
from spidar_gym.envs.turns import in_turn
from spidar_gym.envs.view import fps
from spidar_gym.errors import InvalidValueError, require_instance, require_least, require_name
from spidar_gym.native.course import read_course, read_target
from spidar_gym.native.engine_structs import COURSE_FAILURES
from spidar_gym.native.locomotion import CoreManager
from spidar_gym.sim.course import boxes
from spidar_gym.sim.energy import CAPACITY_WH, USABLE
from spidar_gym.sim.ground import GroundConfig, with_boxes
from spidar_gym.so3 import quat_to_matrix
from spidar_gym.state import NO_RESIDUAL, Command

_LEVEL = np.array([1.0, 0.0, 0.0, 0.0])


class CourseEnv(SpidarEnv[CourseTask, CoreManager, CourseProgress]):
    """SPIDAR on a course; `spidar list spidar_gym/Course-v0` prints its page."""

    metadata: dict[str, Any] = SpidarEnv.metadata | {"render_fps": fps(DECIDE)}
    kind = "coursing"
    reward_terms = COURSE_REWARD_TERMS
    reset_options = ("course", "disturbances")
    failures = COURSE_FAILURES
    task_type = CourseTask
    words = MappingProxyType({"phase": PHASES})
    no_goal = "its goal is a part of the course, which the observation tells"
    true_fields = (
        Field("goal_error", 3, 5.0, "m, m, rad", "goal − torso: x, y in the world, yaw"),
        Field("hit_n", 1, 100.0, "N", "largest force of the step on ducts and links"),
    )
    _kept = ("_given",)

    def __init__(
        self,
        *,
        action_mode: str = "waypoint",
        preset: str = "tuned",
        gait: str = "robust_overlapped",
        manager: ManagerConfig | None = None,
        control: str = "core",
        hold: int | None = None,
        **options: Any,  # noqa: ANN401 - the fields of the task, and what every environment takes
    ) -> None:
        """Build the task and who carries it out.

        Args:
            action_mode: What the action means.
            preset: Which controller flies.
            gait: Which crawler crawls.
            manager: Both, and how they give way to each other, in place of presets; the task's joint speeds go before
                its own.
            control: `core`, the manager that is compiled for the robot, or `python`, the readable one.
            hold: Control periods of 25 ms that a step takes: 20 by default with `waypoint`, which is read every 20th
                anyway, and 1 with the others.
            **options: Arguments of the task and of `SpidarEnv`.

        Raises:
            UnknownNameError: For a mode, preset or camera that does not exist; it lists the valid ones.
            UnknownArgumentError: For an argument that does not exist, likewise.
            InvalidValueError: For a value out of range, a course that nobody can go, a goal that nobody can reach.
        """
        own, shared = split_options(SpidarEnv, CourseEnv, CourseTask, options)
        if "course" in own:
            own["course"] = parse_course(own["course"])
        self.task = task = CourseTask(**own)
        described = described_robot(shared)
        mode = find_action_mode(action_mode, course_modes(described))
        self._is_waypoint = action_mode == "waypoint"
        if hold is None:
            hold = DECIDE if self._is_waypoint else 1
        require_least(1, hold=hold)
        self.hold = hold
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
        robot = own_robot(shared.pop("plant", None), described)
        if robot.ground.uneven or robot.ground.boxed or robot.ground.slope:
            raise InvalidValueError("plant", "a floor of its own", "an even one: the course is built on it")
        # A floor with boxes has to be one from the beginning; which they are is drawn at every reset.
        robot = replace(robot, ground=_built(task.draw(np.random.Generator(np.random.PCG64(0)))))
        super().__init__(
            mode, course_layout(mode.size, described), joint_speed=max(task.joint_speed, task.crawl_speed),
            control=control, plant=robot, **shared,
        )  # fmt: skip

    def _make_controller(self) -> Any:  # noqa: ANN401 - either manager
        manager = make_manager(self._config, self._control, self.fleet)
        self._pilot = Pilot(manager)
        return manager

    @property
    def course(self) -> Course:
        """What the map tells (`SpidarError` before the first reset)."""
        return self._known("course")

    @property
    @in_turn
    def target(self) -> Target | None:
        """What the pilot follows, if anything."""
        return self._pilot.last if self.fleet is None else read_target(self.fleet.robots[0]["pilot"])

    def rule(self) -> Target:
        """Where the rule would go from here."""
        seen = self.seen
        return course_rule(self.course, seen.position_w, seen.joint_position, self.controller.phase)

    # ---- all of it in the engine ----

    def _is_built_in(self) -> bool:
        return type(self.task) is CourseTask and keeps_page(type(self), CourseEnv)

    def _rule(self, fleet: Fleet) -> None:
        fleet.rules[()] = self.rules()

    def rules(self, *, truncates: bool = False, autoreset: str = "disabled") -> np.ndarray:
        """`sp_course_rules`."""
        record = course_rules(self.task, self._config, is_waypoint=self._is_waypoint, hold=self.hold)
        self._fill_rules(record, truncates=truncates, autoreset=autoreset)
        return record

    def _prepare(self, fleet: Fleet) -> None:
        fleet.go(0, self._given or self.task.course)

    def _read(self, name: str) -> Any:  # noqa: ANN401 - whatever is looked up
        assert self.fleet is not None
        robot = self.fleet.robots[0]
        if name == "course":
            return read_course(robot["course"])
        return CourseProgress.read(robot) if name == "episode" else super()._read(name)

    def make_fleet(
        self, robots: int, threads: int = 1, *, autoreset: str = "disabled", truncates: bool = False,
        rules: np.ndarray | None = None,
    ) -> Fleet:  # fmt: skip
        """Robots of this environment in the engine, at no episode yet."""
        record = self.rules(truncates=truncates, autoreset=autoreset) if rules is None else rules
        fleet = Fleet(self.kind, record, self._nominal, robots, threads, alike=False)
        for robot in range(robots):
            fleet.disturb(robot, self._disturbances)
            fleet.go(robot, self.task.course)
        return fleet

    # ---- manager and task in Python ----

    def _chosen(self, name: str, value: Any) -> dict[str, object]:  # noqa: ANN401 - whatever a user gives
        return {"_given": parse_course(value)} if name == "course" else super()._chosen(name, value)

    def _begin(self, rng: np.random.Generator) -> None:
        course = self._given or self.task.draw(rng)
        spent = (1.0 - self.task.draw_charge(rng)) * USABLE * CAPACITY_WH
        self._nominal = replace(self._nominal, ground=_built(course))
        self.plant.configure(replace(self.plant.config, ground=self._nominal.ground))
        self._draw_robot(rng)
        self._place(rng, np.array([0.0, 0.0, self.robot.peg_depth]), _LEVEL, self.controller.lying, spent_wh=spent)
        self._sense()
        self._now["course"] = course
        self.controller.reset(self.seen)
        self._pilot.reset()
        self._now["episode"] = progress = CourseProgress(course.goal, spent)
        self._measure()
        progress.initial_distance = max(progress.distance, 1e-6)

    def _act(self, action: np.ndarray) -> Command:
        residual, seen = self._mode.residual, self.seen
        manager: Any = self.controller
        if residual is None and not self._is_waypoint:
            return act_directly(manager.flight, action)[0]
        if self.progress.controls % DECIDE == 0:
            target = take_target(action, self.course, seen.position_w) if self._is_waypoint else self.rule()
            self._pilot.follow(target, seen, self.course)
        return manager.step(seen, NO_RESIDUAL if residual is None else residual(action))

    def _measure(self) -> None:
        """How far the goal is, how the torso lies, what is left of the battery."""
        state = self.state
        R_wb = quat_to_matrix(state.quat_wb)
        self._tilt = math.acos(max(-1.0, min(1.0, float(R_wb[2, 2]))))
        self.progress.update(self.course, state, R_wb, self.plant.energy_wh, self.robot)

    def _control_period(self) -> str:
        if self.progress.ticks != self.ticks:
            self.progress.ticks, self.progress.hit = self.ticks, 0.0
        return super()._control_period()

    def _advance(self) -> str:
        progress, phase = self.progress, self.controller.phase
        self._measure()
        progress.advance(phase, self.plant.touch().hit)
        return self.task.failed(progress, self.course, self.state.position_w, self._tilt, phase)

    def _observation(self) -> np.ndarray:
        seen, command = self.seen, self._command
        observables = CourseObservables(
            state=seen,
            course=self.course,
            phase=self.controller.phase,
            target=self._pilot.last,
            thrust_command=seen.thrust if command is None else command.thrust,
            vectoring_command=seen.vectoring if command is None else command.vectoring,
            joint_command=seen.joint_position if command is None else command.joint_position,
            charge=self.progress.charge,
            time_left=1.0 - self.ticks / self.horizon,
            previous_action=self._action,
        )
        return observe_course(observables, bound=self._bound, robot=self.robot)

    def _task_info(self, failure: str) -> dict[str, Any]:
        progress = self.progress
        terms = self.task.reward_terms(progress, self.plant.power)
        if failure == "diverged":
            terms = dict.fromkeys(terms, 0.0)
        thrust = 0.0 if self._command is None else float(self._command.thrust.sum())
        return {
            "goal_error": progress.error.copy(),
            "distance_m": progress.distance,
            "time_s": progress.arrived or progress.time,
            "flown_s": progress.flown_s,
            "crawled_s": progress.crawled_s,
            "charge": progress.charge,
            "hit_n": progress.hit,
            "most_hit_n": progress.most_hit,
            "tilt_rad": self._tilt,
            "thrust_fraction": thrust / self.robot.weight,
            "phase": self.controller.phase,
            "gate": sum(float(self.state.position_w[0]) > gate.end for gate in self.course.gates),
            "lies": progress.lies,
            "finished": progress.arrived > 0.0,
            **{f"reward_{name}": value for name, value in terms.items()},
            "is_success": failure == "" and progress.is_there,
        }


def _built(course: Course) -> GroundConfig:
    """The floor with the boxes of a course."""
    return with_boxes(GroundConfig(), boxes(course))
