"""The missions of the paper's experiments and courses of both gaits, as the text that the runner reads."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from spidar_gym.control.course.gates import BEFORE, CEILING, HALF_WIDTH, Course, Gate
from spidar_gym.control.crawl.footsteps import Move, plan_cycles
from spidar_gym.control.crawl.gait import nominal_time
from spidar_gym.control.crawl.pose2 import Pose2
from spidar_gym.control.flight.controller import CONTROL_RATE
from spidar_gym.control.locomotion.commands import (
    CarryTo,
    CrawlTo,
    FlyTo,
    Grasp,
    Land,
    LocomotionCommand,
    Place,
    TakeOff,
    require_order,
)
from spidar_gym.control.presets import controller_config, crawler_config
from spidar_gym.errors import require_name
from spidar_gym.paper.flight import FLIGHT_SECONDS, UNRESTRICTED
from spidar_gym.robot import FORMS, N_JOINTS, N_LEGS, ROBOT, RobotSpec
from spidar_gym.tasks.course import CourseTask
from spidar_gym.tasks.crawl import PAPER_WAY
from spidar_gym.tasks.hover import HoverTask
from spidar_gym.tasks.start import draw_start

PREPARE = 8.0
"""Time from the take-over to the start of the experiment: the legs move from the landing form to form ① [s]."""

HANGING = np.tile([0.0, 1.4, 0.0, 0.0], N_LEGS)
"""Joint angles of a robot on a stand whose legs hang down, off the limit of the inner pitch joints [rad] [chosen]."""
BENCH_STEP, BENCH_CHIRP, LEG_SWING = 0.12, 0.03, 0.02
"""Steps and chirps of the joints on the stand, and their chirps in a hover [rad] [chosen]."""
THRUST_SWINGS = (8.0, 5.0)
"""Amplitudes of the swinging thrusts of inner and outer modules, of 20 N a module [N] [chosen]."""
THRUST_FREQUENCIES = (2.6, 2.85, 3.1, 3.35, 3.6, 3.85, 4.1, 4.35)
"""Frequency for each module: above the bandwidth of controllers and eddies, below the rotors' lag [Hz] [chosen]."""
TURNED = 11.0
"""Time for the second form and the second heading to be reached, and to settle [s]."""
COURSE_SPEED, COURSE_CRAWL_SPEED = 0.6, 0.2
"""Joint speeds of a course in flight and in crawls [rad/s]; at the paper's 0.2 a change of form takes eight seconds."""
GENTLE = ("tilt 0.4", "fence -1.5 -1.5 -0.2 1.5 1.5 2")
"""Limits of the first flight and of tests in a hover: tilt [rad], distances from the start [m]."""
MAP_SECONDS = 300.0
"""Time limit of a course by a map, which is the horizon of Course-v0 [s]."""


@dataclass(frozen=True)
class Mission:
    """The runner's mission file and the data needed to evaluate the run."""

    name: str
    """Name: flight, crawl, hover, course, or course_gates for a course by a map."""
    preset: str
    """Controller preset."""
    text: str
    """Content of the mission file."""
    seconds: float
    """Longest duration from the take-over on [s]."""
    begins: float = 0.0
    """Start of the experiment since the take-over [s]."""
    way: Pose2 | None = None
    """Displacement of a crawl, relative to its start; None for all missions other than a single crawl."""
    crawler: str = ""
    """Crawler preset of a course; empty for every other mission."""
    commands: tuple[LocomotionCommand, ...] = ()
    """Commands of a course."""
    orders: tuple[tuple[float, str], ...] = ()
    """Orders sent during the run: time since the take-over [s], and the lines."""
    map: Course | None = None
    """Gates and goal of a course whose commands the runner derives; None for a course with given commands."""
    on_stand: bool = False
    """Whether the robot is clamped to a stand."""
    speeds: tuple[float, float] = (COURSE_SPEED, COURSE_CRAWL_SPEED)
    """Joint speeds of a course in flight and in crawls [rad/s]."""

    @property
    def is_course(self) -> bool:
        """Whether the runner drives a course, which begins and ends on the floor."""
        return bool(self.crawler)

    @property
    def from_floor(self) -> bool:
        """Whether the runner takes over on the floor, or on a stand."""
        return self.way is not None or self.is_course or self.on_stand


def _form(start: float, q: Iterable[float]) -> str:
    return f"form {start:g} " + " ".join(f"{angle:.6f}" for angle in q)


def flight_mission(preset: str = "as_flown", *, odometry: bool = False, residual: bool = False) -> Mission:
    """Build the paper's flight: ① for 4 s, ②, ③ without a stop, and the two windows without interference rows."""
    # The paper's sequence uses no random numbers.
    forms = draw_start(HoverTask(forms="paper"), np.random.Generator(np.random.PCG64(0))).goals
    lines = [f"flight {preset}", *_switches(odometry, residual), _form(0.0, forms[0].joint_target)]
    lines += [_form(PREPARE + goal.start, goal.joint_target) for goal in forms[1:]]
    lines += [f"unrestricted {PREPARE + start:g} {PREPARE + end:g}" for start, end in UNRESTRICTED]
    seconds = PREPARE + FLIGHT_SECONDS
    return Mission("flight", preset, "\n".join([*lines, f"end {seconds:g}", ""]), seconds, PREPARE)


def hover_mission(preset: str = "as_flown", seconds: float = 10.0, *, odometry: bool = False) -> Mission:
    """Build a hover in form ①, into which faults are injected."""
    lines = [f"flight {preset}", *_switches(odometry, False), _form(0.0, np.zeros(16)), f"end {seconds:g}", ""]
    return Mission("hover", preset, "\n".join(lines), seconds)


def first_flight_mission(preset: str = "first_flight", seconds: float = 40.0) -> Mission:
    """Build the first flight: a hover in the form of the take-off, then form ①, with narrow limits and empty integrals.

    Args:
        preset: Controller preset.
        seconds: Duration; in the second half the legs move to form ① [s].
    """
    lines = [f"flight {preset}", "trim off", "deviation 0.3", *GENTLE]
    lines += [_form(0.5 * seconds, np.zeros(N_JOINTS)), f"end {seconds:g}", ""]
    return Mission("first_flight", preset, "\n".join(lines), seconds)


def bench_mission(seconds: float = 48.0) -> Mission:
    """Build the test of the joints on a stand: steps, then a chirp, of one joint after the other, all legs at once.

    Args:
        seconds: Duration; a quarter for each joint of a leg [s].
    """
    part = seconds / N_LEGS
    lines = ["bench", "deviation 0.3", _form(0.0, HANGING)]
    for joint in range(N_LEGS):
        begin = joint * part
        for share, angle in ((0.04, BENCH_STEP), (0.27, -BENCH_STEP), (0.5, 0.0)):
            form = HANGING.copy()
            form[joint::N_LEGS] += angle
            lines.append(_form(begin + share * part, form))
        lines += [
            f"excite joint {N_LEGS * leg + joint + 1} chirp {begin + 0.58 * part:g} {begin + 0.98 * part:g} "
            f"{BENCH_CHIRP:g} 0.5 4"
            for leg in range(N_LEGS)
        ]
        lines.append(_form(begin + 0.98 * part, HANGING))
    return Mission("bench", "", "\n".join([*lines, f"end {seconds:g}", ""]), seconds, on_stand=True)


def thrust_mission(preset: str = "as_flown", seconds: float = 72.0) -> Mission:
    """Build the test of the modules in a hover: thrusts that swing at eight frequencies, in two forms and headings.

    Args:
        preset: Controller preset, best one with little bandwidth.
        seconds: Duration, half of it in each form [s].
    """
    half = 0.5 * seconds
    lines = [f"flight {preset}", "deviation 0.3", *GENTLE, _form(0.0, np.zeros(N_JOINTS)), _form(half, FORMS["form2"])]
    lines += [f"heading {half:g} {0.5 * np.pi:.6f}"]
    for begin, end in ((PREPARE, half), (half + TURNED, seconds)):
        for rotor, frequency in enumerate(THRUST_FREQUENCIES):
            lines.append(f"excite thrust {rotor + 1} sine {begin:g} {end:g} {THRUST_SWINGS[rotor % 2]:g} {frequency:g}")
    return Mission("thrust", preset, "\n".join([*lines, f"end {seconds:g}", ""]), seconds)


def legs_mission(preset: str = "as_flown", seconds: float = 40.0) -> Mission:
    """Build the test of the legs in a hover: chirps of one joint after the other, all legs at once."""
    part = (seconds - PREPARE) / N_LEGS
    lines = [f"flight {preset}", "deviation 0.2", *GENTLE, _form(0.0, np.zeros(N_JOINTS))]
    for joint in range(N_LEGS):
        begin = PREPARE + joint * part
        lines += [
            f"excite joint {N_LEGS * leg + joint + 1} chirp {begin:g} {begin + part:g} {LEG_SWING:g} 0.3 2"
            for leg in range(N_LEGS)
        ]
    return Mission("legs", preset, "\n".join([*lines, f"end {seconds:g}", ""]), seconds)


def forms_mission(preset: str = "as_flown", seconds: float = 60.0) -> Mission:
    """Build a hover in each of the paper's forms, a third of the time each."""
    lines = [
        f"flight {preset}",
        "deviation 0.3",
        *GENTLE,
        *(_form(k * seconds / 3, form) for k, form in enumerate(FORMS.values())),
    ]
    return Mission("forms", preset, "\n".join([*lines, f"end {seconds:g}", ""]), seconds)


ROBOT_TESTS = {"bench": bench_mission, "thrust": thrust_mission, "legs": legs_mission, "forms": forms_mission}
"""Tests of the robot, by name: functions that build their missions."""


def robot_test(name: str, preset: str = "as_flown") -> Mission:
    """Build a test of the robot by name (`UnknownNameError` lists the valid ones); on the bench there is no preset."""
    require_name("test", name, ROBOT_TESTS)
    return bench_mission() if name == "bench" else ROBOT_TESTS[name](preset)


def crawl_mission(
    preset: str = "published", way: Pose2 = PAPER_WAY, *, odometry: bool = False,
    residual: bool = False, robot: RobotSpec = ROBOT,
) -> Mission:  # fmt: skip
    """Build the paper's crawl, or a crawl by another displacement (`InvalidValueError` for one out of reach)."""
    config = crawler_config(preset, robot=robot)
    cycles = plan_cycles(config.gait, Move(way))
    lines = [f"crawl {preset}", *_switches(odometry, residual), f"move {way.x:.6f} {way.y:.6f} {way.yaw:.6f} {cycles}"]
    # A crawl that takes more than twice the nominal time is not going to finish.
    seconds = 15.0 + 2.0 * nominal_time(config.gait, [Move(way)], joint_speed=config.joint_speed, dt=1.0 / CONTROL_RATE)
    return Mission("crawl", preset, "\n".join([*lines, ""]), seconds, way=way)


def fly_over() -> tuple[LocomotionCommand, ...]:
    """Return the course of `spidar sitl course`: take off, fly in the narrow and then the flat form, land, crawl."""
    return (
        TakeOff(1.0), FlyTo((1.2, 0.0, 1.3), FORMS["form3"], 0.5), FlyTo((2.4, 0.0, 1.1), FORMS["form1"], 0.5), Land(),
        CrawlTo(Pose2(2.65, 0.0, 0.0)),
    )  # fmt: skip


def order_line(command: LocomotionCommand) -> str:
    """Format a command as a line of the runner's mission file."""
    if isinstance(command, CrawlTo):
        return f"crawl_to {command.pose.x!r} {command.pose.y!r} {command.pose.yaw!r}"
    if isinstance(command, TakeOff):
        return f"take_off {command.height!r}"
    if isinstance(command, Land):
        return f"land {command.floor!r} {command.slope!r}"
    if isinstance(command, Grasp):
        size = " ".join(f"{float(each)!r}" for each in command.half_size)
        numbers = (command.most_force, command.mass, command.height, command.force, command.friction)
        return f"grasp {command.shape} {size} {' '.join(map(repr, numbers))}"
    if isinstance(command, CarryTo):
        x, y, z = command.position_w
        return f"carry_to {x!r} {y!r} {z!r} {command.speed!r}" + ("" if command.yaw is None else f" {command.yaw!r}")
    if isinstance(command, Place):
        return f"place {command.floor!r}"
    if not isinstance(command, FlyTo):
        return "release"
    x, y, z = command.position_w
    words = [f"fly_to {x!r} {y!r} {z!r} {command.speed!r}", *["along"] * command.along, *["at_once"] * command.at_once]
    words += [] if command.room is None else [f"room {command.room!r}"]
    words += [] if command.form is None else ["form", *(f"{float(angle)!r}" for angle in command.form)]
    return " ".join(words)


def course_mission(
    commands: Iterable[LocomotionCommand] | None = None, preset: str = "steady", crawler: str = "steady_crawl", *,
    seconds: float = 120.0, odometry: bool = False,
    orders: tuple[tuple[float, str], ...] = (),
) -> Mission:  # fmt: skip
    """Build a course of both gaits, which begins and ends on the floor.

    Args:
        commands: Commands of the course; `fly_over` if not given.
        preset: Controller preset in flight.
        crawler: Crawler preset.
        seconds: Longest duration [s].
        odometry: Whether the runner uses the robot's own estimate.
        orders: Orders sent during the run, as in `Mission`.

    Raises:
        InvalidValueError: For commands in an order that is not possible.
    """
    controller_config(preset)
    crawler_config(crawler)
    told = fly_over() if commands is None else tuple(commands)
    require_order(told, "floor")
    lines = [f"course {preset} {crawler}", *_switches(odometry, False)]
    lines += [f"speed {COURSE_SPEED:g} {COURSE_CRAWL_SPEED:g}", _fence(told)]
    text = "\n".join([*lines, *map(order_line, told), ""])
    return Mission("course", preset, text, seconds, crawler=crawler, commands=told, orders=orders)


def map_mission(
    course: Course, preset: str = "steady", crawler: str = "steady_crawl", *, odometry: bool = False,
    orders: tuple[tuple[float, str], ...] = (),
) -> Mission:  # fmt: skip
    """Build a course of gates for which the runner derives its commands from the map, at Course-v0's joint speeds.

    Args:
        course: Gates and goal of the map.
        preset: Controller preset in flight.
        crawler: Crawler preset.
        odometry: Whether the runner uses the robot's own estimate.
        orders: Orders sent during the run, as in `Mission`; after the first one the map is no longer used.
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
    """Format a gate as a line of the runner's mission file."""
    return f"gate {gate.kind} {gate.begin!r} {gate.end!r} {gate.size!r} {gate.middle!r}"


def drawn_course(gates: int, seed: int = 0) -> Course:
    """Return the course that Course-v0 samples at a reset with this seed and this number of gates."""
    return CourseTask(count=(gates, gates)).draw_course(np.random.Generator(np.random.PCG64(seed)))


def _fence(commands: Iterable[LocomotionCommand]) -> str:
    """Format the fence: two metres beyond the course at the sides and above, and 0.2 m below the floor."""
    places, top = [np.zeros(3)], 0.0
    for command in commands:
        if isinstance(command, CrawlTo):
            places.append(np.array([command.pose.x, command.pose.y, 0.0]))
        elif isinstance(command, FlyTo | CarryTo):
            places.append(np.array(command.position_w))
        elif isinstance(command, TakeOff):
            top = max(top, command.height)
    low, high = np.min(places, axis=0) - 2.0, np.max(places, axis=0) + 2.0
    corners = [low[0], low[1], -0.2, high[0], high[1], max(high[2], top + 2.0)]
    return "fence " + " ".join(f"{float(x):g}" for x in corners)


def _switches(odometry: bool, residual: bool) -> list[str]:
    return ["estimate odometry"] * odometry + ["residual on"] * residual
