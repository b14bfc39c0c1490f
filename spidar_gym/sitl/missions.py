"""The missions of the paper's experiments and courses of both gaits, as the text that the runner reads."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from spidar_gym.control.course.gates import BEFORE, CEILING, HALF_WIDTH, Course, Gate
from spidar_gym.control.crawl.footsteps import Move, plan_cycles
from spidar_gym.control.crawl.gait import nominal_time
from spidar_gym.control.crawl.pose2 import Pose2
from spidar_gym.control.flight.controller import CONTROL_RATE
from spidar_gym.control.locomotion.commands import CrawlTo, FlyTo, Land, LocomotionCommand, TakeOff, require_order
from spidar_gym.control.presets import controller_config, crawler_config
from spidar_gym.paper.flight import FLIGHT_SECONDS, UNRESTRICTED
from spidar_gym.robot import FORMS, ROBOT, RobotSpec
from spidar_gym.tasks.course import CourseTask
from spidar_gym.tasks.crawl import PAPER_WAY
from spidar_gym.tasks.hover import HoverTask
from spidar_gym.tasks.start import draw_start

PREPARE = 8.0
"""From the take-over until the experiment begins: the legs move from the landing form to form ① [s]."""

COURSE_SPEED, COURSE_CRAWL_SPEED = 0.6, 0.2
"""Joint speed of a course in flight, where at the paper's 0.2 a form takes eight seconds, and of its crawls [rad/s]."""
MAP_SECONDS = 300.0
"""A course by a map takes no longer: the horizon of Course-v0 [s]."""


@dataclass(frozen=True)
class Mission:
    """What the runner is told, and what that means for whoever evaluates it."""

    name: str
    """flight, crawl, hover, course, or course_gates of one by a map."""
    preset: str
    """Controller."""
    text: str
    """What the runner reads."""
    seconds: float
    """How long it takes from the take-over on, at most [s]."""
    begins: float = 0.0
    """When the experiment begins, since the take-over [s]."""
    way: Pose2 | None = None
    """Where a crawl ends, seen from its start; None where nothing crawls, or where more happens than that."""
    crawler: str = ""
    """Crawler of a course; empty for every other mission."""
    commands: tuple[LocomotionCommand, ...] = ()
    """What a course consists of."""
    orders: tuple[tuple[float, str], ...] = ()
    """What it is told while it runs: when since the take-over [s], and the lines."""
    map: Course | None = None
    """Gates and goal of a course by which the runner decides itself; None where it has commands."""
    speeds: tuple[float, float] = (COURSE_SPEED, COURSE_CRAWL_SPEED)
    """Joint speed of a course in flight, and of its crawls [rad/s]."""

    @property
    def is_course(self) -> bool:
        """Whether the runner does all of it, from the floor to the floor."""
        return bool(self.crawler)

    @property
    def from_floor(self) -> bool:
        """Whether the runner takes over on the floor."""
        return self.way is not None or self.is_course


def _form(start: float, q: Iterable[float]) -> str:
    return f"form {start:g} " + " ".join(f"{angle:.6f}" for angle in q)


def flight_mission(preset: str = "as_flown", *, odometry: bool = False, residual: bool = False) -> Mission:
    """The paper's flight: ① for 4 s, ②, ③ without a stop, and the two windows without interference rows."""
    controller_config(preset)
    # The paper's sequence draws nothing.
    forms = draw_start(HoverTask(forms="paper"), np.random.Generator(np.random.PCG64(0))).goals
    lines = [f"flight {preset}", *_switches(odometry, residual), _form(0.0, forms[0].joint_target)]
    lines += [_form(PREPARE + goal.start, goal.joint_target) for goal in forms[1:]]
    lines += [f"unrestricted {PREPARE + start:g} {PREPARE + end:g}" for start, end in UNRESTRICTED]
    seconds = PREPARE + FLIGHT_SECONDS
    return Mission("flight", preset, "\n".join([*lines, f"end {seconds:g}", ""]), seconds, PREPARE)


def hover_mission(preset: str = "as_flown", seconds: float = 10.0, *, odometry: bool = False) -> Mission:
    """Form ①, held: what faults are put into."""
    controller_config(preset)
    lines = [f"flight {preset}", *_switches(odometry, False), _form(0.0, np.zeros(16)), f"end {seconds:g}", ""]
    return Mission("hover", preset, "\n".join(lines), seconds)


def crawl_mission(
    preset: str = "published", way: Pose2 = PAPER_WAY, *, odometry: bool = False,
    residual: bool = False, robot: RobotSpec = ROBOT,
) -> Mission:  # fmt: skip
    """The paper's crawl, or another way (`InvalidValueError` for one out of reach)."""
    config = crawler_config(preset, robot=robot)
    cycles = plan_cycles(config.gait, Move(way))
    lines = [f"crawl {preset}", *_switches(odometry, residual), f"move {way.x:.6f} {way.y:.6f} {way.yaw:.6f} {cycles}"]
    # Whoever waits longer than twice the nominal time waits for nothing.
    seconds = 15.0 + 2.0 * nominal_time(config.gait, [Move(way)], joint_speed=config.joint_speed, dt=1.0 / CONTROL_RATE)
    return Mission("crawl", preset, "\n".join([*lines, ""]), seconds, way=way)


def fly_over() -> tuple[LocomotionCommand, ...]:
    """The course of `spidar sitl course`: up, there in the narrow form and on in the flat one, down, and a crawl."""
    return (
        TakeOff(1.0), FlyTo((1.2, 0.0, 1.3), FORMS["form3"], 0.5), FlyTo((2.4, 0.0, 1.1), FORMS["form1"], 0.5), Land(),
        CrawlTo(Pose2(2.65, 0.0, 0.0)),
    )  # fmt: skip


def order_line(command: LocomotionCommand) -> str:
    """A command as the line that the runner reads."""
    if isinstance(command, CrawlTo):
        return f"crawl_to {command.pose.x!r} {command.pose.y!r} {command.pose.yaw!r}"
    if isinstance(command, TakeOff):
        return f"take_off {command.height!r}"
    if isinstance(command, Land):
        return f"land {command.floor!r} {command.slope!r}"
    x, y, z = command.position_w
    words = [f"fly_to {x!r} {y!r} {z!r} {command.speed!r}", *["along"] * command.along, *["at_once"] * command.at_once]
    words += [] if command.room is None else [f"room {command.room!r}"]
    words += [] if command.form is None else ["form", *(f"{float(angle)!r}" for angle in command.form)]
    return " ".join(words)


def course_mission(
    commands: Iterable[LocomotionCommand] | None = None, preset: str = "tuned", crawler: str = "robust_overlapped", *,
    seconds: float = 120.0, odometry: bool = False,
    orders: tuple[tuple[float, str], ...] = (),
) -> Mission:  # fmt: skip
    """Both gaits, from the floor to the floor.

    Args:
        commands: What it consists of; `fly_over` if not given.
        preset: Controller in flight.
        crawler: Crawler.
        seconds: How long it takes at most [s].
        odometry: Whether the runner takes the robot's own estimate.
        orders: What it is told while it runs, as in `Mission`.

    Raises:
        InvalidValueError: For commands that cannot follow on one another.
    """
    controller_config(preset)
    crawler_config(crawler)
    told = fly_over() if commands is None else tuple(commands)
    require_order(told, airborne=False)
    lines = [f"course {preset} {crawler}", *_switches(odometry, False)]
    lines += [f"speed {COURSE_SPEED:g} {COURSE_CRAWL_SPEED:g}", _fence(told)]
    text = "\n".join([*lines, *map(order_line, told), ""])
    return Mission("course", preset, text, seconds, crawler=crawler, commands=told, orders=orders)


def map_mission(
    course: Course, preset: str = "tuned", crawler: str = "robust_overlapped", *, odometry: bool = False,
    orders: tuple[tuple[float, str], ...] = (),
) -> Mission:  # fmt: skip
    """A course of gates, over, under and through which the runner finds its way by itself, at Course-v0's joint speeds.

    Args:
        course: What the map tells.
        preset: Controller in flight.
        crawler: Crawler.
        odometry: Whether the runner takes the robot's own estimate.
        orders: What it is told while it runs, as in `Mission`; from then on the map decides no more.
    """
    controller_config(preset)
    crawler_config(crawler)
    task, goal = CourseTask(), course.goal
    speeds = task.joint_speed, task.crawl_speed
    corners = (-BEFORE, -HALF_WIDTH, -0.2, course.end, HALF_WIDTH, CEILING)
    lines = [f"course {preset} {crawler}", *_switches(odometry, False), f"speed {speeds[0]:g} {speeds[1]:g}"]
    lines += ["fence " + " ".join(f"{float(x)!r}" for x in corners), *map(gate_line, course.gates)]
    text = "\n".join([*lines, f"goal {goal.x!r} {goal.y!r} {goal.yaw!r}", ""])
    return Mission("course_gates", preset, text, MAP_SECONDS, crawler=crawler, orders=orders, map=course, speeds=speeds)


def gate_line(gate: Gate) -> str:
    """A gate as the line that the runner reads."""
    return f"gate {gate.kind} {gate.begin!r} {gate.end!r} {gate.size!r} {gate.middle!r}"


def drawn_course(gates: int, seed: int = 0) -> Course:
    """The course that Course-v0 draws at a reset with this seed, where it draws so many gates."""
    return CourseTask(count=(gates, gates)).draw_course(np.random.Generator(np.random.PCG64(seed)))


def _fence(commands: Iterable[LocomotionCommand]) -> str:
    """Two metres more than a course needs on every side, above too; a floor that is a little lower than expected."""
    places, top = [np.zeros(3)], 0.0
    for command in commands:
        if isinstance(command, CrawlTo):
            places.append(np.array([command.pose.x, command.pose.y, 0.0]))
        elif isinstance(command, FlyTo):
            places.append(np.array(command.position_w))
        elif isinstance(command, TakeOff):
            top = max(top, command.height)
    low, high = np.min(places, axis=0) - 2.0, np.max(places, axis=0) + 2.0
    corners = [low[0], low[1], -0.2, high[0], high[1], max(high[2], top + 2.0)]
    return "fence " + " ".join(f"{float(x):g}" for x in corners)


def _switches(odometry: bool, residual: bool) -> list[str]:
    return ["estimate odometry"] * odometry + ["residual on"] * residual
