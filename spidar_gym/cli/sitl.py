"""`spidar sitl`: software in the loop; the robot's C runner drives the simulated robot through ROS 1 or a socket."""

import contextlib
import math
import sys
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import tyro

from spidar_gym import viz
from spidar_gym.arguments import CrawlPresetArg, Flag, FlightPresetArg, JsonArg, ParametersArg, WorldArg, choice
from spidar_gym.console import drawn, progress, published, studied
from spidar_gym.control.course.gates import MAX_GATES
from spidar_gym.control.crawl.pose2 import Pose2
from spidar_gym.control.presets import crawler_config
from spidar_gym.errors import InvalidValueError, SpidarError, require_above, require_least, require_name, require_within
from spidar_gym.files import output_folder, write_text
from spidar_gym.onboard.parameters import read_parameters
from spidar_gym.paper.calibration import require_robots
from spidar_gym.paper.crawl import CRAWL_DISTANCE, CrawlLog
from spidar_gym.processes import cpu_count
from spidar_gym.sim.randomize import Randomization
from spidar_gym.sitl import report
from spidar_gym.sitl.course_drive import course_report, courses_in_process
from spidar_gym.sitl.course_faults import course_fault_lines, pairs_of, play_course_faults
from spidar_gym.sitl.first_flights import Robots, first_flight_lines, play_first_flights
from spidar_gym.sitl.link_socket import SocketLink
from spidar_gym.sitl.missions import (
    ROBOT_TESTS,
    Mission,
    course_mission,
    crawl_mission,
    drawn_course,
    flight_mission,
    hover_mission,
    map_mission,
    robot_test,
)
from spidar_gym.sitl.play import (
    IN_PHASE,
    LINKS,
    Played,
    build_for,
    evaluate,
    faults_of,
    make_robot,
    play,
    play_faults,
    require_flight_presets,
)
from spidar_gym.sitl.robot import Robot
from spidar_gym.sitl.serve import Served, serve_ros, serve_socket
from spidar_gym.tasks.crawl import CrawlTask
from spidar_gym.text import format_table

sitl_app = tyro.extras.SubcommandApp()
LinkArg = Annotated[str, choice(LINKS)]
_say = partial(print, flush=True)


@dataclass(frozen=True)
class Options:
    """Options of all missions."""

    link: LinkArg = "ros"
    """ros: ROS 1 on the loopback in real time, 70 s for a flight and 40 s for a crawl;
    socket: in lock-step, faster and without ROS."""
    odometry: Flag = False
    """Make the runner use the robot's state estimate (uav/cog/odom) instead of motion capture and IMU."""
    residual: Path | None = None
    """Artifact of a learned policy whose actions are added to the controller; compiled into the runner and enabled."""
    seed: int = 0
    """Seed of the robot's noise and asymmetry."""
    world: WorldArg = ""
    parameters: ParametersArg = None
    json: JsonArg = False

    def __post_init__(self) -> None:
        require_least(0, seed=self.seed)
        require_name("link", self.link, LINKS)
        require_robots(self.world)  # raises for anything but a calibrated world
        if self.parameters is not None:
            read_parameters(self.parameters)  # raises for a file that the runner refuses

    @property
    def robots(self) -> Randomization:
        """Distribution of the robot."""
        return require_robots(self.world)

    @property
    def mission(self) -> dict[str, Any]:
        """Options that are part of the mission file."""
        return {"odometry": self.odometry, "residual": self.residual is not None}


OptionsArg = Annotated[Options, tyro.conf.arg(name="")]


def _played(mission: Mission, out: Path, options: Options) -> tuple[Played, Path]:
    """Run a mission to its end; return it, and the folder with its text and log."""
    folder = output_folder(out)
    runner = build_for(options.link, options.residual)
    with progress(unit="tick", desc=f"{mission.name} over {options.link}") as bar:
        played = play(
            mission, options.link, seed=options.seed, robots=options.robots, runner=runner,
            parameters=options.parameters, log=folder / "run.log", on_tick=bar.update,
        )  # fmt: skip
    write_text(folder / "mission.txt", mission.text)
    for line in played.run.words:
        print(line, file=sys.__stderr__)
    if played.run.board:
        raise SpidarError(f"the landing was forced after {played.run.landing_at:.2f} s: {played.run.board}")
    return played, folder


def _say_figures(folder: Path, name: str, figures: dict[str, Any], table: str, json: bool) -> None:
    """Write and print the figures, with the runner's timing."""
    print(published(folder, name, {name: figures}, table, json))
    if json:
        return
    t = figures["timing"]
    print(f"\nrunner: {t['ticks']} ticks, computing {t['compute_median_us']:.0f} µs (worst {t['compute_max_us']:.0f})")
    if "wait_median_us" in t:
        print(f"ticks begin {t['wait_median_us']:.0f} µs after they are due (p99 {t['wait_p99_us']:.0f}, worst "
              f"{t['wait_max_us']:.0f}); longest period {t['period_max_ms']:.1f} ms")  # fmt: skip


def _play(mission: Mission, out: Path, options: Options) -> None:
    played, folder = _played(mission, out, options)
    log, figures, table = evaluate(played)
    _say_figures(folder, mission.name, figures, table, options.json)
    if isinstance(log, CrawlLog):
        drawn("figure", lambda: viz.crawl_figure(log, folder / "crawl.png"))
    else:
        drawn("figure", lambda: viz.flight_figure(log, folder / "flight.png"))
    if not options.json:
        print(f"written to {folder}: {', '.join(sorted(p.name for p in folder.iterdir()))}")


@sitl_app.command(is_default=True)
def flight(
    preset: FlightPresetArg = "as_flown", out: Path = Path("out/sitl-flight"), options: OptionsArg = Options()
) -> None:
    """Run the paper's flight with the C runner, from arming to landing, and print its figures.

    Args:
        preset: Controller preset of the runner.
        out: Folder for flight.json, flight.png, mission.txt and run.log, which `runner replay` repeats bit for bit.
    """
    _play(flight_mission(preset, **options.mission), out, options)


@sitl_app.command
def crawl(
    preset: CrawlPresetArg = "published",
    distance: float = CRAWL_DISTANCE,
    out: Path = Path("out/sitl-crawl"),
    options: OptionsArg = Options(),
) -> None:
    """Run the paper's crawl of 0.6 m, or of another distance, with the C runner, and print its figures.

    Args:
        preset: Crawler preset of the runner.
        distance: Distance to the goal straight ahead [m].
        out: Folder for crawl.json, crawl.png, mission.txt and run.log, which `runner replay` repeats bit for bit.
    """
    crawler_config(preset)  # raises for an unknown name
    CrawlTask(distance=distance)  # raises for an infeasible distance
    _play(crawl_mission(preset, Pose2(distance), **options.mission), out, options)


@sitl_app.command
def course(
    robots: int = 16,
    gates: int = 0,
    out: Path = Path("out/sitl-course"),
    workers: int = cpu_count(),
    options: OptionsArg = Options(),
) -> None:
    """Run a course with the C runner: take-off, flight in a narrow form, landing, crawl; compared with in-process runs.

    Args:
        robots: Number of robots that run the same course in process, for the spread of the figures.
        gates: Number of gates of a course that Course-v0 samples at --seed, driven by its map; 0 for a fixed course.
        out: Folder for course.json or course_gates.json, mission.txt and run.log.
            `runner replay` repeats run.log bit for bit.
        workers: Number of processes for --robots.
    """
    require_least(1, robots=robots, workers=workers)
    require_within(0.0, MAX_GATES - 1.0, "1", gates=gates)
    if options.residual is not None:
        raise SpidarError("a course has no learned residual; valid: flight or crawl with --residual")
    if gates:
        mission = map_mission(drawn_course(gates, options.seed), odometry=options.odometry)
    else:
        mission = course_mission(odometry=options.odometry)
    played, folder = _played(mission, out, options)
    with progress(total=robots, unit="robot", desc=f"{mission.name} in process") as bar:
        others = courses_in_process(mission, robots, options.robots, workers=workers, on_robot=bar.update)
    figures, table = course_report(played.run, played.log, mission, others)
    _say_figures(folder, mission.name, figures, table, options.json)


@sitl_app.command(name="first-flights")
def first_flights(
    presets: tuple[FlightPresetArg, ...] = ("first_flight",),
    flights: int = 20,
    damping: float | None = None,
    forms: Flag = False,
    link: LinkArg = "socket",
    seed: int = 0,
    world: WorldArg = "",
    one_robot: Flag = False,
    parameters: ParametersArg = None,
    out: Path = Path("out/sitl-first-flights"),
    json: JsonArg = False,
) -> None:
    """Fly the first flight of many robots: a hover in the form of the take-off for 20 s, then form ①.

    Args:
        presets: Controller presets; each flies the same robots.
        flights: Number of robots.
        damping: Damping of the joints of described robots without dry friction, with late commands [Nm s/rad].
        forms: Hover in the paper's forms instead, 20 s in each: in form ② a badly damped robot falls first.
        link: ros: in real time, 55 s per flight; socket: in lock-step, faster and without ROS.
        seed: Seed of the first robot and its noise; each further robot has the next one.
        one_robot: Make all flights with the robot of --seed, with different noise.
        out: Folder for first_flights.json.
    """
    require_least(0, seed=seed)
    require_least(1, flights=flights)
    if not presets:
        raise InvalidValueError("presets", [], "at least one flight preset")
    require_flight_presets(parameters, *presets)
    require_name("link", link, LINKS)
    if damping is not None:
        require_above(damping=damping)
        if world:
            raise InvalidValueError("damping", damping, "none for robots of a world, whose joints have their own")
    robots = Robots(require_robots(world), damping, seed if one_robot else None)
    folder = output_folder(out)
    with progress(total=flights * len(presets), unit="flight", desc=f"first flights over {link}") as bar:
        rows = play_first_flights(
            link, presets, flights, robots, seed=seed, forms=forms, parameters=parameters, on_flight=bar.update
        )
    print(published(folder, "first_flights", {"flights": rows}, format_table(first_flight_lines(rows)), json))


@sitl_app.command(name="tests")
def robot_tests(
    only: tuple[str, ...] = (),
    preset: FlightPresetArg = "as_flown",
    out: Path = Path("out/sitl-tests"),
    options: OptionsArg = Options(),
) -> None:
    """Run the tests that identify a robot: its joints on a stand, and in a hover its modules, its legs and its forms.

    bench, 48 s: steps and chirps of every joint, torso clamped; thrust, 72 s: swinging thrusts, two forms and headings;
    legs, 40 s: chirps of the joints; forms, 60 s: a hover in each form.

    Args:
        only: Names of the tests; all if none is given.
        preset: Controller preset of the hovers, best one with little bandwidth.
        out: Folder for tests.json, and for each test mission and log, as thrust.txt and thrust.log.
    """
    require_flight_presets(options.parameters, preset)
    if options.residual is not None:
        raise SpidarError("tests have no learned residual; valid: flight or crawl with --residual")
    plans = [robot_test(name, preset) for name in only or ROBOT_TESTS]
    folder, runner, figures = output_folder(out), build_for(options.link), dict[str, dict[str, Any]]()
    for plan in plans:
        with progress(unit="tick", desc=f"{plan.name} over {options.link}") as bar:
            played = play(
                plan, options.link, seed=options.seed, robots=options.robots, runner=runner,
                parameters=options.parameters, log=folder / f"{plan.name}.log", on_tick=bar.update,
            )  # fmt: skip
        write_text(folder / f"{plan.name}.txt", plan.text)
        figures[plan.name] = report.robot_test_figures(played.run, played.log)
    print(published(folder, "tests", figures, report.robot_test_table(figures), options.json))


@sitl_app.command
def robot(
    link: LinkArg = "ros",
    ground: Flag = False,
    preset: CrawlPresetArg = "published",
    operate: Flag = False,
    master: str | None = None,
    seconds: float = math.inf,
    seed: int = 0,
    world: WorldArg = "",
) -> None:
    """Run the simulated robot in real time, for a runner that you start separately; Ctrl-C ends it.

    Args:
        link: ros: the robot's topics; socket: waits for `runner sim HOST:PORT MISSION`, a new robot per connection.
        ground: Start on the floor for a crawl, without a take-off.
        preset: Crawler preset whose first pose the robot has with --ground.
        operate: Arm and take off automatically; otherwise publish /spidar/teleop_command/start and so on.
        master: URI of a running ROS master; if not given, a master is started on the loopback.
        seconds: Duration [s].
        seed: Seed of the robot's noise and asymmetry.
    """
    require_least(0, seed=seed)
    require_name("link", link, LINKS)
    crawler_config(preset)  # raises for an unknown name
    require_above(seconds=seconds)
    robots = require_robots(world)
    mission = crawl_mission(preset) if ground else hover_mission()
    with contextlib.suppress(KeyboardInterrupt):
        if link == "socket":
            _serve_socket(lambda: make_robot(mission, seed, robots), operate, seconds)
        else:
            _serve_ros(make_robot(mission, seed, robots), operate, seconds, master)


def _serve_socket(make: Callable[[], Robot], operate: bool, seconds: float) -> None:
    with contextlib.closing(SocketLink()) as end:
        _say(f"runner sim {end.place} MISSION --log run.log")
        serve_socket(lambda: Served(make(), operate=operate, tell=_say), end, seconds, _say)


def _serve_ros(robot: Robot, operate: bool, seconds: float, master: str | None) -> None:
    from spidar_gym.sitl.link_ros import RosLink  # imported late, since ROS is optional

    with contextlib.closing(RosLink(master=master)) as end:
        words = " ".join(
            f"{name}={value}" for name, value in end.environment().items() if name in ("ROS_MASTER_URI", "ROS_IP")
        )
        _say(f"{words} runner ros1 MISSION --log run.log")
        serve_ros(Served(robot, operate=operate, tell=_say), end, seconds)


@sitl_app.command
def faults(
    link: LinkArg = "ros",
    only: tuple[str, ...] = (),
    course: Flag = False,
    phases: tuple[str, ...] = (),
    sample: int = 0,
    seed: int = 0,
    world: WorldArg = "",
    workers: int = 1,
    out: Path = Path("out/sitl-faults"),
    json: JsonArg = False,
) -> None:
    """Inject faults into a hover, or into every phase of a course, and print the table of the runner's reactions.

    An interrupted run over a course resumes.

    Args:
        link: ros: in real time, 20 s per fault; socket: in lock-step, without the faults of ROS.
        only: Names of the faults; all of the link if none is given.
        course: Inject the faults into the phases of a course instead of a hover.
        phases: Phases of the course; all if none is given.
        sample: Number of phases per fault, starting at a different phase for each fault; 0 for all phases.
        seed: Seed of the robot's noise and of the faults' random numbers.
        workers: Number of processes for a course over the socket; 1 in real time.
        out: Folder for faults.json, or course_faults.json.
    """
    require_least(0, seed=seed, sample=sample)
    require_name("link", link, LINKS)
    course = course or bool(phases) or bool(sample)
    require_least(1, workers=workers)
    if workers > 1 and not (course and link == "socket"):
        raise InvalidValueError("workers", workers, "1, or more for a course over the socket")
    names = only or faults_of(link, course=course)
    for name in names:
        require_name(f"fault over {link}", name, faults_of(link, course=course))
    for phase in phases:
        require_name("phase", phase, IN_PHASE)
    robots, folder = require_robots(world), output_folder(out)
    if course:
        pairs = pairs_of(names, phases or tuple(IN_PHASE), sample)
        studied(
            folder, "course_faults", "fault", len(pairs), json=json,
            play=lambda unfinished, on_fault: play_course_faults(
                link, pairs, seed=seed, robots=robots, workers=workers, folder=unfinished, on_fault=on_fault
            ),
            table=lambda rows: format_table(course_fault_lines(rows)),
        )  # fmt: skip
        return
    with progress(total=len(names), unit="fault", desc=f"faults over {link}") as bar:
        rows = play_faults(link, names, seed=seed, robots=robots, on_fault=bar.update)
    print(published(folder, "faults", {"faults": rows}, report.fault_table(rows), json))
