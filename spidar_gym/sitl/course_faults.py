"""Faults in every phase of a course: the reaction to each, compared with the specified one."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np

from spidar_gym.benchmark.resume import finish
from spidar_gym.control.crawl.pose2 import Pose2
from spidar_gym.control.flight.controller import CONTROL_RATE
from spidar_gym.control.locomotion.commands import CrawlTo, FlyTo, Land, LocomotionCommand, TakeOff
from spidar_gym.control.locomotion.orders import PHASES
from spidar_gym.errors import SpidarError
from spidar_gym.logs.runner_log import RunnerLog
from spidar_gym.onboard.runner_structs import Action, Stage
from spidar_gym.robot import FORMS
from spidar_gym.sim.randomize import Randomization
from spidar_gym.sitl.course_drive import NOT_SAMPLED
from spidar_gym.sitl.faults import FAULTS, FLOOR_PHASES, course_reaction
from spidar_gym.sitl.missions import Mission, course_mission
from spidar_gym.sitl.play import IN_PHASE, build_for, play
from spidar_gym.sitl.report import drive_times, within_bounds
from spidar_gym.sitl.session import Run

TOUCHDOWN = 0.35
"""Largest touchdown speed of a landing that the manager flies [m/s]."""
FORCED_TOUCHDOWN = 2.5
"""Largest touchdown speed of a landing of the board that the runner commands [m/s]: the board does not measure its
height. Where the runner is killed or stalls, the board itself holds the last command for half a second."""


def phase_mission(phase: str) -> Mission:
    """Return the shortest course that contains a phase, for injecting faults into it."""
    up = TakeOff(0.8)
    ways: dict[str, tuple[LocomotionCommand, ...]] = {
        "lie": (),
        "crawl": (CrawlTo(Pose2(0.3, 0.0, 0.0)),),
        "hover": (up,),
    }
    if phase in ("form", "fly"):
        return course_mission((up, FlyTo((0.8, 0.0, 1.2), FORMS["form3"], 0.5), Land()))
    return course_mission(ways.get(phase, (up, Land())))


def course_fault_figures(name: str, phase: str, run: Run, log: RunnerLog) -> dict[str, Any]:
    """Compute the figures of a fault in a phase.

    `as_specified` requires that the fault began in that phase, that the reaction is that of `course_reaction`, that old
    commands were in force for at most 100 ms, that no command was out of bounds or published after a landing was
    commanded, and that a landing by the manager touched down at `TOUCHDOWN`, one of the board that the
    runner commanded at `FORCED_TOUCHDOWN`, or less.

    Raises:
        SpidarError: When the fault did not begin.
    """
    if run.fault_at == np.inf:
        raise SpidarError(f"{name} never began: {phase} did not come; valid: a run that comes through the phase")
    outputs = log.outputs
    drive = outputs["stage"] > Stage.WAITING
    holds = [len(list(ticks)) for stage, ticks in groupby(outputs["stage"].tolist()) if stage == Stage.HOLDING]
    held, bounded = max(holds, default=0) / CONTROL_RATE, within_bounds(outputs[drive])
    landing = np.flatnonzero(outputs["action"] == Action.FORCE_LANDING)
    silent = not len(landing) or bool((outputs["action"][landing[0] :] != Action.PUBLISH).all())
    last = Stage(outputs["stage"][-1])
    if run.board:
        happened = "forced landing" if run.board == "commanded" else "board lands"
    elif last == Stage.RESTING:
        happened = "rests" if phase in FLOOR_PHASES else "lands"
    else:
        happened = "goes on" if last == Stage.DRIVING else "lost"
    after = [row for row in run.rows if row.time >= run.fault_at]
    touch = next((k for k, row in enumerate(after) if row.in_contact), None) if phase not in FLOOR_PHASES else None
    fall = None if touch is None else float(-after[max(touch - 1, 0)].state.velocity_w[2])
    fastest = {"lands": TOUCHDOWN, "forced landing": FORCED_TOUCHDOWN}.get(happened)
    soft = fastest is None or phase in FLOOR_PHASES or (fall is not None and fall <= fastest)
    ticks, times = drive_times(run, log)
    began = PHASES[outputs["manager_phase"][ticks[max(int(np.searchsorted(times, run.fault_at, side="right")) - 1, 0)]]]
    reaction = course_reaction(name, phase)
    return {
        "fault": name,
        "doc": FAULTS[name].doc,
        "phase": phase,
        "began": began,
        "reaction": reaction,
        "happened": happened,
        "runner_fault": int(outputs["fault"].max(initial=0)),
        "held_ms": 1e3 * held,
        "seconds": float(run.rows[-1].time - run.fault_at),
        "peak_tilt_rad": max(row.tilt for row in after),
        "touchdown_m_s": fall,
        "largest_thrust_n": float(outputs["command"]["thrust"][drive].max(initial=0.0)),
        "bounded": bounded,
        "silent_after_landing": silent,
        "as_specified": (
            began == phase and happened in reaction.split(" or ") and bounded and silent and soft and held <= 0.1 + 1e-9
        ),
    }


@dataclass(frozen=True)
class Put:
    """A fault that is injected in a phase of a course."""

    link: str
    """`ros` or `socket`."""
    fault: str
    """Name of the fault."""
    phase: str
    """One of `IN_PHASE`."""
    seed: int = 0
    """Seed of the robot, its noise and the random numbers of the fault."""
    robots: Randomization = NOT_SAMPLED
    """Distribution of the robot."""


def play_put(put: Put) -> dict[str, Any]:
    """Run a course with one fault in one phase; return its figures."""
    how: dict[str, Any] = dict(seed=put.seed, fault=put.fault, phase=put.phase, runner=build_for(put.link))
    played = play(phase_mission(put.phase), put.link, robots=put.robots, **how)
    kind = {"kind": put.robots.name} if put.robots.world else {}
    return kind | course_fault_figures(put.fault, put.phase, played.run, played.log)


def pairs_of(faults: Sequence[str], phases: Sequence[str], sample: int = 0) -> list[tuple[str, str]]:
    """Pair faults with the phases that they are injected in.

    Args:
        faults: Names of faults.
        phases: Phases of a course.
        sample: Number of phases for each fault, starting at a different phase for each; 0 for all. A smaller sample is
            the beginning of a larger one.
    """
    if not sample:
        return [(fault, phase) for phase in phases for fault in faults]
    turns = range(min(sample, len(phases)))
    return [(fault, phases[(k + turn) % len(phases)]) for turn in turns for k, fault in enumerate(faults)]


def play_course_faults(
    link: str, pairs: Iterable[tuple[str, str]], *, seed: int = 0, robots: Randomization = NOT_SAMPLED,
    workers: int = 1, folder: Path | None = None, on_fault: Callable[[], object] = lambda: None,
) -> list[dict[str, Any]]:  # fmt: skip
    """Run each fault in its phase in a separate course; return the figures of each.

    Results of an interrupted call are read from `folder` and are not computed again.

    Args:
        link: `ros` or `socket`.
        pairs: Names of faults and of phases.
        seed: Seed of the robot and its noise.
        robots: Distribution of the robots; kinds of a calibrated world come in turn.
        workers: Number of processes; use one for runs in real time.
        folder: Folder in which figures are stored as they are computed.
        on_fault: Called after each run, for progress.
    """
    build_for(link)  # once, before several processes need it
    puts = [Put(link, name, phase, seed, robots.in_turn(k)) for k, (name, phase) in enumerate(pairs)]
    return finish(play_put, puts, workers=workers, folder=folder, on_done=lambda *_: on_fault())


def course_fault_lines(rows: list[dict[str, Any]]) -> list[list[str]]:
    """Build the table: a line per fault and a column per phase; reactions other than the specified ones are marked."""
    phases = [phase for phase in IN_PHASE if any(row["phase"] == phase for row in rows)]
    lines = [["fault", "what", *phases]]
    for name in dict.fromkeys(row["fault"] for row in rows):
        cells = {row["phase"]: _cell(row) for row in rows if row["fault"] == name}
        lines.append([name, FAULTS[name].doc, *(cells.get(phase, "–") for phase in phases)])
    return lines


def _cell(row: dict[str, Any]) -> str:
    fall = row["touchdown_m_s"]
    words = row["happened"] + (f", {fall:.2f}" if fall is not None and row["happened"] != "goes on" else "")
    return words if row["as_specified"] else f"NOT AS SPECIFIED: {words}"
