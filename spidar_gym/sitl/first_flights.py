"""First flights of many robots through the runner: whether each stays up, and how far it is off."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from spidar_gym.logs.runner_log import RunnerLog
from spidar_gym.margins import LATE, with_damping, with_lateness
from spidar_gym.model.dynamics import Model
from spidar_gym.onboard.runner_structs import FAULTS, Stage
from spidar_gym.paper.flight import noisy_robot
from spidar_gym.sim.config import PlantConfig
from spidar_gym.sim.randomize import Randomization, randomize
from spidar_gym.sitl.course_drive import NOT_SAMPLED
from spidar_gym.sitl.missions import first_flight_mission, forms_mission
from spidar_gym.sitl.play import build_for, play
from spidar_gym.sitl.report import driven
from spidar_gym.sitl.robot import Robot
from spidar_gym.sitl.session import Run
from spidar_gym.so3 import quat_to_matrix


@dataclass(frozen=True)
class Robots:
    """Robots that fly."""

    world: Randomization = NOT_SAMPLED
    """Calibrated world whose kinds come in turn; without any, described robots with noise."""
    damping: float | None = None
    """Damping of the joints without dry friction, with the delay and the lag of `spidar_gym.margins` [Nm s/rad]."""
    one: int | None = None
    """Seed of the only robot, which makes all flights with different noise; None for a robot for each flight."""

    def make(self, seed: int, index: int) -> Robot:
        """Build the robot of a flight with this seed and index."""
        rng = np.random.Generator(np.random.PCG64(seed if self.one is None else self.one))
        if self.damping is not None:
            config = with_damping(with_lateness(noisy_robot(rng), LATE), self.damping)
        elif self.world.draws:
            config = randomize(PlantConfig(), rng, self.kind(index))[0]
        else:
            config = noisy_robot(rng)
        return Robot(config, seed=seed)

    def kind(self, index: int) -> Randomization:
        """Return the distribution of a flight's robot."""
        return self.world.in_turn(index) if self.one is None else self.world

    def name(self, index: int) -> str:
        """Return what kind of robot makes a flight."""
        if self.world.draws:
            return self.kind(index).name if self.one is None else f"one of {self.world.name}"
        return "described" if self.damping is None else f"D {self.damping:g}"


def first_flight_figures(run: Run, log: RunnerLog, seconds: float) -> dict[str, Any]:
    """Compute the figures of a first flight of this length [s].

    Returns:
        `stayed_up`: whether the runner drove to the end without a fault; `fault`, its last one in words; `rms_m` and
        `most_m`, true position errors of the CoG in the drive; `sag_m`, how far it sank in the first 5 s; `tilt_rad`,
        the largest.
    """
    stages = log.outputs["stage"]
    drives = (Stage.DRIVING, Stage.HOLDING, Stage.ENDING)
    flown = [(row, tick) for row, tick in zip(*driven(run, log), strict=True) if stages[tick] in drives]
    model, errors = Model(), list[np.ndarray]()
    for row, tick in flown:
        s, R_wb = row.state, quat_to_matrix(row.state.quat_wb)
        com_w = s.position_w + R_wb @ model.snapshot(s.joint_position, R_wb, s.vectoring).com_b
        errors.append(log.outputs[tick]["reference"]["position_w"] - com_w)
    off = np.linalg.norm(errors, axis=1)
    fault = int(log.outputs["fault"][stages > Stage.WAITING].max(initial=0))
    return {
        "stayed_up": not fault and flown[-1][0].time > run.first_driven + seconds - 0.2,
        "fault": list(FAULTS.values())[fault],
        "rms_m": float(np.sqrt(np.mean(off**2))),
        "most_m": float(off.max()),
        "sag_m": float(np.array(errors)[:200, 2].max()),
        "tilt_rad": max(row.tilt for row, _ in flown),
    }


def play_first_flights(
    link: str, presets: Sequence[str], flights: int, robots: Robots, *, seed: int = 0, forms: bool = False,
    parameters: Path | None = None, on_flight: Callable[[], object] = lambda: None,
) -> list[dict[str, Any]]:  # fmt: skip
    """Fly a number of robots one after the other, the same ones with each preset; return the figures of each.

    With `forms` they hover in the paper's forms, one after the other, instead of the first flight's mission. With a
    file of `parameters` the presets are those of the file.
    """
    rows, runner = list[dict[str, Any]](), build_for(link)
    for preset in presets:
        for k in range(flights):
            mission = forms_mission(preset) if forms else first_flight_mission(preset)
            make = partial(robots.make, index=k)
            played = play(mission, link, seed=seed + k, robot=make, runner=runner, parameters=parameters)
            figures = first_flight_figures(played.run, played.log, mission.seconds)
            rows.append({"preset": preset, "robot": robots.name(k), "seed": seed + k, **figures})
            on_flight()
    return rows


def first_flight_lines(rows: Sequence[dict[str, Any]]) -> list[list[str]]:
    """Build the table: a line per preset and kind of robot."""
    lines = [["preset", "robots", "stayed up", "RMS, worst error [mm]", "sag at the take-over [mm]", "tilt [mrad]"]]
    for preset, kind in dict.fromkeys((row["preset"], row["robot"]) for row in rows):
        own = [row for row in rows if (row["preset"], row["robot"]) == (preset, kind)]
        rms, most, sag, tilt = (max(row[name] for row in own) for name in ("rms_m", "most_m", "sag_m", "tilt_rad"))
        up = sum(row["stayed_up"] for row in own)
        lines.append(
            [preset, kind, f"{up} of {len(own)}", f"{1e3 * rms:.0f}, {1e3 * most:.0f}", f"{1e3 * sag:.0f}",
             f"{1e3 * tilt:.0f}"]
        )  # fmt: skip
    return lines
