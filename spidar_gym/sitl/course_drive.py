"""A course of both gaits, driven by the runner or in process with the same robot, and its figures."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from spidar_gym.control.allocation.allocator import ANSWERED
from spidar_gym.control.course.gates import Course
from spidar_gym.control.course.pilot import Pilot
from spidar_gym.control.course.rule import course_rule
from spidar_gym.control.crawl.footsteps import lying_pose
from spidar_gym.control.crawl.pose2 import Pose2
from spidar_gym.control.estimator import Estimator
from spidar_gym.control.flight.controller import CONTROL_RATE
from spidar_gym.control.flight.path import wrap
from spidar_gym.control.locomotion.commands import CrawlTo, FlyTo
from spidar_gym.control.locomotion.orders import PHASES, ManagerConfig
from spidar_gym.control.presets import controller_config, crawler_config
from spidar_gym.errors import SpidarError
from spidar_gym.logs.runner_log import RunnerLog
from spidar_gym.model.dynamics import Model
from spidar_gym.native.constants import ONBOARD_ITERATIONS
from spidar_gym.native.core_manager import CoreManager
from spidar_gym.native.library import STATUS
from spidar_gym.native.plant import Plant
from spidar_gym.onboard.runner_structs import Stage
from spidar_gym.paper.crawl import crawl_robot
from spidar_gym.policies.rollout import columns
from spidar_gym.processes import Pool
from spidar_gym.robot import N_JOINTS, N_ROTORS, ROBOT
from spidar_gym.sim.config import PlantConfig
from spidar_gym.sim.course_boxes import boxes
from spidar_gym.sim.ground import GroundConfig, with_boxes
from spidar_gym.sim.randomize import Randomization, randomize
from spidar_gym.sitl.missions import Mission
from spidar_gym.sitl.report import drive_times, driven, timing
from spidar_gym.sitl.session import Run, tilt_of
from spidar_gym.so3 import quat_to_matrix
from spidar_gym.state import Command, RobotState
from spidar_gym.tasks.course import DECIDE, MAX_TILT
from spidar_gym.text import format_table

IN_THE_AIR = ("climb", "hover", "form", "fly")
"""Phases whose position errors count as flight."""
HAND_OVERS = ("spool", "unload")
"""Phases in which Σλ changes at a bounded rate; in a descent it does so from the touch on."""
SETTLING = 40
"""Ticks for which the robot lies on the floor before a course in process begins."""
PERIOD = 1.0 / CONTROL_RATE
"""Length of a tick [s]."""
NOT_SAMPLED = Randomization()
"""No randomisation: the robots are those of the experiments with noise."""
LATER = 30.0
"""Time by which a course in process may exceed its limit before it is refused [s]."""


@dataclass(frozen=True)
class CourseLog:
    """True state, reference and command at each tick of a course; arrays over n ticks."""

    time: np.ndarray
    """Time since the take-over [s]."""
    phase: np.ndarray
    """One of `PHASES`."""
    position_w: np.ndarray
    """True position of the torso, shape (n, 3) [m]."""
    yaw: np.ndarray
    """True heading [rad]."""
    com_w: np.ndarray
    """True centre of mass, shape (n, 3) [m]."""
    asked_w: np.ndarray
    """Reference of the centre of mass in flight, shape (n, 3) [m]."""
    tilt: np.ndarray
    """Angle between the torso's axis and the vertical [rad]."""
    fall: np.ndarray
    """Downward speed of the torso before the tick [m/s]."""
    in_contact: np.ndarray
    """Whether anything touches the floor."""
    thrust: np.ndarray
    """Commanded Σλ [N]."""
    status: np.ndarray
    """Status of the allocation."""
    hit: np.ndarray
    """Largest force in the tick on anything but feet and pegs, where there are gates [N]."""
    energy_wh: np.ndarray
    """Energy taken from the battery since the take-over [Wh]."""


def manager_config(mission: Mission) -> ManagerConfig:
    """Return the runner's configuration for a course: presets with the course's joint speeds and the onboard cap."""
    flight, crawl = controller_config(mission.preset), crawler_config(mission.crawler)
    return ManagerConfig(
        replace(
            flight, joint_speed=mission.speeds[0], allocator=replace(flight.allocator, max_iter=ONBOARD_ITERATIONS)
        ),
        replace(
            crawl, joint_speed=mission.speeds[1], allocator=replace(crawl.allocator, max_iter=ONBOARD_ITERATIONS)
        ),
    )  # fmt: skip


def course_robot(mission: Mission, rng: np.random.Generator, robots: Randomization = NOT_SAMPLED) -> PlantConfig:
    """Return a sampled robot for the floor, with the gates of the mission's map as boxes; a course's floor is level.

    Args:
        mission: A mission that begins on the floor.
        rng: Generator for the sampling.
        robots: Distribution of the robot; without any, `crawl_robot`.
    """
    own = robots.on_level_floors() if mission.is_course else robots
    robot = randomize(PlantConfig(sense=True), rng, own)[0] if own.draws else crawl_robot(rng)
    robot = replace(robot, joint_speed=max(mission.speeds))
    return robot if mission.map is None else replace(robot, ground=with_boxes(GroundConfig(), boxes(mission.map)))


def _row(model: Model, state: RobotState, fell: float) -> dict[str, Any]:
    """Return the true quantities after a tick."""
    R_wb = quat_to_matrix(state.quat_wb)
    com_w = state.position_w + R_wb @ model.snapshot(state.joint_position, R_wb, state.vectoring).com_b
    return {
        "position_w": state.position_w, "yaw": float(np.arctan2(R_wb[1, 0], R_wb[0, 0])), "com_w": com_w,
        "tilt": tilt_of(state), "fall": fell,
    }  # fmt: skip


def driven_course(run: Run, log: RunnerLog) -> CourseLog:
    """Return the log of a course that a runner drove.

    Raises:
        SpidarError: When the course was not completed.
    """
    rows, at = driven(run, log)
    model, kept, fell = Model(), list[dict[str, Any]](), 0.0
    # In real time robot and runner tick at different times; the reference moves by a centimetre in between.
    ticks, times = drive_times(run, log)
    begins = np.array([row.time - PERIOD for row in rows])
    where = log.outputs["reference"]["position_w"][ticks]
    asked_w = np.stack([np.interp(begins, times, where[:, i]) for i in range(3)], axis=1)
    for row, tick, asked in zip(rows, at.tolist(), asked_w, strict=True):
        answer = log.outputs[tick]
        kept.append(
            {
                **_row(model, row.state, fell),
                "time": row.time - run.first_driven,
                "phase": PHASES[answer["manager_phase"]],
                "asked_w": asked,
                "in_contact": row.in_contact,
                "thrust": float(answer["command"]["thrust"].sum()),
                "status": str(STATUS[answer["status"]]),
                "hit": row.hit,
                "energy_wh": row.energy_wh - rows[0].energy_wh,
            }
        )
        fell = -float(row.state.velocity_w[2])
        if answer["finished"] and answer["stage"] == Stage.DRIVING:
            return CourseLog(**columns(kept))
    raise SpidarError(f"the course ended after {len(kept)} ticks: {run.board or 'too late'}; valid: a whole one")


class Guide:
    """Rule that selects a target from a map twice a second, as in the runner (`onboard/runner/map.c`)."""

    def __init__(self, manager: CoreManager, course: Course) -> None:
        """Command this manager along a course."""
        self._manager, self._course, self._pilot = manager, course, Pilot(manager)
        self._undecided, self._is_there = 0, False

    def decide(self, seen: RobotState) -> bool:
        """Command the manager before its tick; return whether the robot lies at the goal."""
        manager, course = self._manager, self._course
        if self._undecided == 0:
            self._undecided = DECIDE
            target = course_rule(course, seen.position_w, seen.joint_position, manager.phase)
            self._pilot.follow(target, seen, course)
            is_goal = not target.flies and Pose2(target.x, target.y, target.yaw) == course.goal
            self._is_there = is_goal and manager.phase == "lie" and manager.done
        self._undecided -= 1
        return self._is_there


def course_in_process(mission: Mission, seed: int, robots: Randomization = NOT_SAMPLED) -> CourseLog:
    """Run a course without a runner, with the core's manager and the estimator at 40 Hz on the same robot.

    Args:
        mission: A course.
        seed: Seed of the robot and its noise, as for the robot that a runner drives.
        robots: Distribution of the robot, as for `course_robot`.

    Raises:
        SpidarError: When the robot falls, or the course is not completed in time.
    """
    config, model, estimator = manager_config(mission), Model(), Estimator()
    rng = np.random.Generator(np.random.PCG64(seed))
    plant, form = Plant(course_robot(mission, rng, robots)), lying_pose(config.crawl.gait)
    state = plant.reset(np.array([0.0, 0.0, ROBOT.peg_depth]), joint_position=form, rng=rng)
    still = Command(np.zeros(N_ROTORS), np.zeros((N_ROTORS, 2)), form, np.full(N_JOINTS, ROBOT.max_joint_torque))
    for _ in range(SETTLING):
        state = plant.step(still)
    first = plant.measure()
    estimator.reset(replace(state, joint_position=first.joint_position, vectoring=first.vectoring))
    seen = estimator.update(first, state.thrust)
    manager = CoreManager(config)
    manager.reset(seen, mission.commands)
    guide = None if mission.map is None else Guide(manager, mission.map)
    kept, before_wh = list[dict[str, Any]](), plant.energy_wh
    while not (manager.done if guide is None else guide.decide(seen)):
        fell = -float(state.velocity_w[2])
        command = manager.step(seen)
        state = plant.step(command)
        seen = estimator.update(plant.measure(), command.thrust)
        kept.append(
            {
                **_row(model, state, fell),
                "time": (len(kept) + 1) * PERIOD,
                "phase": manager.phase,
                "asked_w": manager.asked_w,
                "in_contact": plant.in_contact,
                "thrust": float(command.thrust.sum()),
                "status": str(manager.status),
                "hit": plant.hit,
                "energy_wh": plant.energy_wh - before_wh,
            }
        )
        if kept[-1]["tilt"] > MAX_TILT:
            raise SpidarError(
                f"the robot fell after {len(kept) * PERIOD:.1f} s ({manager.phase}); valid: one that stays upright"
            )
        if len(kept) * PERIOD > mission.seconds + LATER:
            raise SpidarError(f"the course does not end within {mission.seconds + LATER:g} s; valid: a shorter one")
    return CourseLog(**columns(kept))


def _touched(log: CourseLog) -> np.ndarray:
    """Return the ticks of descents from the first touch on (n,)."""
    found, touched = np.zeros(len(log.phase), bool), False
    for k, (phase, in_contact) in enumerate(zip(log.phase, log.in_contact, strict=True)):
        found[k] = touched = phase == "descend" and (touched or bool(in_contact))
    return found


def _touchdowns(log: CourseLog) -> list[float]:
    """Return the downward speed of the torso before the first touch of each descent [m/s]."""
    touched = _touched(log)
    return log.fall[touched & ~np.r_[False, touched[:-1]]].tolist()


def course_figures(log: CourseLog, mission: Mission) -> dict[str, Any]:
    """Compute the figures of a course: flight, touchdown and crawl."""
    flown, near = np.isin(log.phase, IN_THE_AIR), (np.isin(log.phase, HAND_OVERS) | _touched(log))[1:]
    error = (log.asked_w - log.com_w)[flown]
    landed = np.flatnonzero(np.isin(log.phase, ("unload",)))
    places = [command.position_w for command in mission.commands if isinstance(command, FlyTo)]
    goals = [command.pose for command in mission.commands if isinstance(command, CrawlTo)]
    goals += [] if mission.map is None else [mission.map.goal]
    steps = np.abs(np.diff(log.thrust))
    figures: dict[str, Any] = {
        "seconds": float(log.time[-1]),
        "rmse_position_m": np.sqrt((error**2).mean(0)).tolist(),
        "largest_error_m": float(np.linalg.norm(error, axis=1).max()),
        "largest_tilt_rad": float(log.tilt[flown].max()),
        "touchdown_m_s": max(_touchdowns(log), default=None),
        "landing_error_m": None,
        "largest_step_n": float(steps[near].max()),
        "final_error_m": None,
        "final_yaw_rad": None,
        "flown_s": PERIOD * int((~np.isin(log.phase, ("lie", "crawl"))).sum()),
        "crawled_s": PERIOD * int((log.phase == "crawl").sum()),
        "energy_wh": float(log.energy_wh[-1]),
        "largest_hit_n": float(log.hit.max()),
        "unsolved": int((~np.isin(log.status, [str(each) for each in ANSWERED])).sum()),
    }
    if len(landed) and places:
        figures["landing_error_m"] = (log.com_w[landed[-1], :2] - places[-1][:2]).tolist()
    if goals:
        figures["final_error_m"] = (log.position_w[-1, :2] - [goals[-1].x, goals[-1].y]).tolist()
        figures["final_yaw_rad"] = wrap(float(log.yaw[-1]) - goals[-1].yaw)
    return figures


def courses_in_process(
    mission: Mission, count: int, robots: Randomization = NOT_SAMPLED, *, workers: int = 1,
    on_robot: Callable[[], object] = lambda: None,
) -> list[dict[str, Any]]:  # fmt: skip
    """Compute the figures of the same course for several robots, with seeds from 0.

    Args:
        mission: A course.
        count: Number of robots.
        robots: Distribution of the robots, as for `course_robot`; kinds of a calibrated world come in turn.
        workers: Number of processes.
        on_robot: Called after each robot, for progress.

    Returns:
        Figures of each robot; only `kind` and `failure` of a course that was not completed.
    """
    found = []
    with Pool(workers) as pool:
        jobs = [(mission, seed, robots.in_turn(seed)) for seed in range(count)]
        for figures in pool.map(_figures_in_process, jobs):
            found.append(figures)
            on_robot()
    return found


def _figures_in_process(job: tuple[Mission, int, Randomization]) -> dict[str, Any]:
    mission, seed, robots = job
    kind = {"kind": robots.name} if robots.draws else {}
    try:
        return kind | course_figures(course_in_process(mission, seed, robots), mission)
    except SpidarError as error:
        if not robots.draws:  # the robots of the experiments complete every course
            raise
        return {**kind, "failure": str(error)}


ROWS: tuple[tuple[str, str, float, int], ...] = (
    ("duration [s]", "seconds", 1.0, 1),
    ("RMSE position in the air x y z [mm]", "rmse_position_m", 1e3, 1),
    ("largest error in the air [mm]", "largest_error_m", 1e3, 0),
    ("largest tilt in the air [mrad]", "largest_tilt_rad", 1e3, 0),
    ("touchdown [m/s]", "touchdown_m_s", 1.0, 2),
    ("place of the landing x y [mm]", "landing_error_m", 1e3, 0),
    ("largest change of Σλ near the floor [N/tick]", "largest_step_n", 1.0, 1),
    ("place after the crawl x y [mm]", "final_error_m", 1e3, 1),
    ("heading after the crawl [mrad]", "final_yaw_rad", 1e3, 1),
    ("ticks without an optimum", "unsolved", 1.0, 0),
)
"""Lines of the table: label, figure, factor of the unit, digits."""
GATE_ROWS: tuple[tuple[str, str, float, int], ...] = (
    ("duration [s]", "seconds", 1.0, 1),
    ("… with rotors up [s]", "flown_s", 1.0, 1),
    ("… crawling [s]", "crawled_s", 1.0, 1),
    ("energy [Wh]", "energy_wh", 1.0, 1),
    *(row for row in ROWS[1:-1] if row[1] not in ("landing_error_m", "final_error_m", "final_yaw_rad")),
    ("largest force on anything but feet and pegs [N]", "largest_hit_n", 1.0, 1),
    ("place at the goal x y [mm]", "final_error_m", 1e3, 1),
    ("heading at the goal [mrad]", "final_yaw_rad", 1e3, 1),
    ROWS[-1],
)
"""Lines of the table of a course by a map; the touchdown is the hardest of its landings."""
MARGIN = 0.5
"""Share of the spread by which a figure may lie outside it and still count as within."""


def spread(figures: Sequence[dict[str, Any]], key: str) -> tuple[np.ndarray, np.ndarray]:
    """Return the least and the largest of a figure over the courses of several robots, element by element."""
    values = np.array([np.atleast_1d(each[key]) for each in figures], float)
    return values.min(0), values.max(0)


def within_spread(figures: dict[str, Any], others: Sequence[dict[str, Any]], key: str) -> bool:
    """Return whether a figure lies in the range of `others`, or outside by at most `MARGIN` of their spread."""
    low, high = spread(others, key)
    slack, value = MARGIN * (high - low) + 1e-9, np.atleast_1d(np.array(figures[key], float))
    return bool(((value >= low - slack) & (value <= high + slack)).all())


def rows_of(mission: Mission) -> tuple[tuple[str, str, float, int], ...]:
    """Return the lines of a course's table: label, figure, factor of the unit, digits."""
    return ROWS if mission.map is None else GATE_ROWS


def course_lines(
    figures: dict[str, Any], others: Sequence[dict[str, Any]], rows: Sequence[tuple[str, str, float, int]] = ROWS
) -> list[list[str]]:
    """Build the table: a course through the runner beside the spread of the courses in process."""

    def text(value: Any, factor: float, digits: int) -> str:  # noqa: ANN401 - a number or several
        return "–" if value is None else " ".join(f"{factor * x:.{digits}f}" for x in np.atleast_1d(value))

    lines = [["course", f"in process, {len(others)} robots: least", "largest", "through the runner", "within"]]
    for label, key, factor, digits in rows:
        low, high = spread(others, key)
        inside = "yes" if within_spread(figures, others, key) else "no"
        lines.append([label, *(text(value, factor, digits) for value in (low, high, figures[key])), inside])
    return lines


def course_report(
    run: Run, log: RunnerLog, mission: Mission, others: Sequence[dict[str, Any]]
) -> tuple[dict[str, Any], str]:
    """Return the figures of a course through the runner, with its timing and the courses in process, and the table.

    Raises:
        SpidarError: When no course in process was completed.
    """
    done = [other for other in others if "failure" not in other]
    if not done:
        raise SpidarError(f"no course in process was completed: {others[0]['failure']}")
    figures = course_figures(driven_course(run, log), mission)
    table = format_table(course_lines(figures, done, rows_of(mission)))
    failures = [
        f"{other['kind']}, robot {k}: {other['failure']}" for k, other in enumerate(others) if "failure" in other
    ]
    inside = {key: within_spread(figures, done, key) for _, key, _, _ in rows_of(mission)}
    figures = {**figures, "timing": timing(log), "in_process": list(others), "within_spread": inside}
    return figures, "\n".join([table, *failures])
