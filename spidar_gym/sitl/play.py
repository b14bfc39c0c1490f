"""Run missions with the simulated robot: build the runner, run it, read its log."""

import copy
import shutil
from collections.abc import Callable, Collection
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from spidar_gym.control.presets import controller_config, crawler_config
from spidar_gym.errors import SpidarError, require_name
from spidar_gym.files import scratch_folder, whole_file
from spidar_gym.logs.runner_log import RunnerLog, read_runner_log
from spidar_gym.onboard.build import build_runner
from spidar_gym.onboard.parameters import flight_presets
from spidar_gym.paper.crawl import CrawlLog, crawl_figures, crawl_lines
from spidar_gym.paper.flight import FlightLog, flight_figures, flight_lines, noisy_robot
from spidar_gym.sim.config import PlantConfig
from spidar_gym.sim.randomize import Randomization, randomize
from spidar_gym.sitl.course_drive import NOT_SAMPLED, course_robot
from spidar_gym.sitl.faults import FAULTS, Injector
from spidar_gym.sitl.missions import Mission, hover_mission
from spidar_gym.sitl.report import crawl_log, fault_figures, flight_log, timing
from spidar_gym.sitl.robot import Robot
from spidar_gym.sitl.session import LATE, Run, Session, ros_session, socket_session
from spidar_gym.text import format_table

LINKS = ("ros", "socket")
"""Links between robot and runner: ROS 1 in real time, or a socket in lock-step."""
TRIES = 5
"""Largest number of attempts at a run in real time when the machine stalls."""
FAULT_AFTER = 3.0
"""Start of a fault after the take-over [s]."""
IN_PHASE = {
    "lie": 1.0, "crawl": 3.0, "spool": 0.7, "climb": 1.0, "hover": 1.0, "form": 0.5, "fly": 0.5, "descend": 1.0,
    "unload": 0.2,
}  # fmt: skip
"""Start of a fault in each phase of a course, after the start of the phase [s]."""


@dataclass(frozen=True)
class Played:
    """A mission with its run and log."""

    mission: Mission
    """Mission that was run."""
    run: Run
    """True course of the run."""
    log: RunnerLog
    """The runner's log."""


def make_robot(mission: Mission, seed: int = 0, robots: Randomization = NOT_SAMPLED) -> Robot:
    """Build a robot for a mission, with real sensors.

    Args:
        mission: Mission that the robot is for.
        seed: Seed of the robot and its noise.
        robots: Distribution of the robot; without any, the robots of the in-process experiments with noise.
    """
    rng = np.random.Generator(np.random.PCG64(seed))
    if not mission.from_floor:
        return Robot(randomize(PlantConfig(), rng, robots)[0] if robots.draws else noisy_robot(rng), seed=seed)
    if mission.on_stand:
        config = randomize(PlantConfig(), rng, robots)[0] if robots.draws else noisy_robot(rng)
        return Robot(config, on_stand=True, seed=seed)
    config = crawler_config(mission.crawler or mission.preset)
    speed = max(mission.speeds) if mission.is_course else config.joint_speed
    return Robot(course_robot(mission, rng, robots), crawls=True, gait=config.gait, joint_speed=speed, seed=seed)


def require_flight_presets(parameters: Path | None, *presets: str) -> None:
    """Raise an `UnknownNameError` for flight presets that a parameter file (or without one the runner) lacks."""
    known = None if parameters is None else flight_presets(parameters)
    for preset in presets:
        if known is None:
            controller_config(preset)
        else:
            require_name("flight preset of the parameters", preset, known)


def play(
    mission: Mission,
    link: str = "socket",
    *,
    seed: int = 0,
    fault: str | None = None,
    phase: str = "",
    robots: Randomization = NOT_SAMPLED,
    robot: Callable[[int], Robot] | None = None,
    silent: Collection[str] = (),
    runner: Path | None = None,
    parameters: Path | None = None,
    log: Path | None = None,
    on_tick: Callable[[], object] = lambda: None,
) -> Played:
    """Run a mission.

    Args:
        mission: Mission of the runner.
        link: `ros` or `socket`.
        seed: Seed of the robot and its noise.
        fault: Name of a fault, which begins 3 s after the take-over unless `phase` is given.
        phase: Phase of a course in which the fault begins.
        robots: Distribution of the robot, as for `make_robot`.
        robot: Returns the robot of a seed instead.
        silent: Topics that this robot does not publish.
        runner: The runner's program; the one built from the present sources by default.
        parameters: Parameter file that the runner reads; the compiled parameters by default.
        log: File for the runner's log, written when the run has ended; none by default.
        on_tick: Called 40 times a second of the robot, for progress.

    Raises:
        UnknownNameError: For a link, a fault or a flight preset that does not exist.
        MissingDependencyError: Without a compiler, or without ROS.
        SpidarError: When the runner refuses the robot.
    """
    require_name("link", link, LINKS)
    if mission.preset and mission.way is None:
        require_flight_presets(parameters, mission.preset)
    injector = None
    if fault is not None:
        require_name("fault", fault, FAULTS)
        if phase:
            require_name("phase", phase, IN_PHASE)
        after = IN_PHASE[phase] if phase else FAULT_AFTER
        injector = Injector(FAULTS[fault], after, np.random.Generator(np.random.PCG64(seed)), phase)
    runner, late = runner or build_for(link), []
    with scratch_folder() as scratch:
        text, written = scratch / "mission.txt", scratch / "run.log"
        lines = "" if injector is None else injector.fault.lines
        text.write_text(mission.text + lines, encoding="utf-8")
        # In real time, repeat the run when the machine stalled: a simulation that pauses in mid-air is no valid test.
        for _ in range(TRIES):
            session = Session(
                make_robot(mission, seed, robots) if robot is None else robot(seed),
                mission,
                copy.deepcopy(injector),
                on_tick,
                silent=silent,
            )
            if link == "socket":
                run = socket_session(session, runner, text, written, parameters=parameters)
            else:
                from spidar_gym.sitl.link_ros import RosLink  # imported only where ROS is used

                run = ros_session(session, runner, text, written, RosLink(), parameters=parameters)
            # Also repeat it when the run ended before the fault was injected.
            came = injector is None or run.fault_at < np.inf
            if run.late <= LATE and (came or link == "socket"):
                found = Played(mission, run, read_runner_log(written))
                if log is not None:  # whole, or the one of a former run
                    with whole_file(log) as made:
                        shutil.copyfile(written, made)
                return found
            late.append(f"{1e3 * run.late:.0f} ms late" if run.late > LATE else "finished before the fault")
    raise SpidarError(
        f"this machine cannot run the robot in real time: it was {', '.join(late)}; valid: one with two idle cores"
    )


def build_for(link: str, residual: Path | None = None) -> Path:
    """Build the runner for a link, optionally with a learned policy; return its path."""
    if link == "socket":
        return build_runner(residual=residual)
    from spidar_gym.sitl.build_ros import build_ros_runner

    return build_runner(build_ros_runner, "spidar-runner-ros1", residual)


def evaluate(played: Played) -> tuple[FlightLog | CrawlLog, dict[str, Any], str]:
    """Return the experiment's part of a drive, its figures with the runner's timing, and `spidar paper`'s table."""
    run, log, mission = played.run, played.log, played.mission
    if mission.way is not None:
        experiment = crawl_log(run, log, mission)
        figures, lines = crawl_figures(experiment), crawl_lines
    else:
        experiment = flight_log(run, log, mission)
        figures, lines = flight_figures(experiment), flight_lines
    figures = {**figures, "timing": timing(log)}
    return experiment, figures, format_table(lines(figures))


def play_faults(
    link: str, names: tuple[str, ...], *, seed: int = 0, robots: Randomization = NOT_SAMPLED,
    on_fault: Callable[[], object] = lambda: None,
) -> list[dict[str, Any]]:  # fmt: skip
    """Run each fault in a separate hover; return the figures of each.

    `robots` is as for `make_robot`; the faults meet the kinds of a calibrated world in turn.
    """
    rows, runner = [], build_for(link)
    for k, name in enumerate(names):
        own = robots.in_turn(k)
        played = play(hover_mission(seconds=60.0), link, seed=seed, fault=name, robots=own, runner=runner)
        rows.append(fault_figures(name, played.run, played.log))
        on_fault()
    return rows


def faults_of(link: str, *, course: bool = False) -> tuple[str, ...]:
    """Return the faults that a link supports, in a hover or in a course."""
    allowed = {name: fault for name, fault in FAULTS.items() if link == "ros" or not fault.ros}
    return tuple(name for name, fault in allowed.items() if course or not fault.only_course)
