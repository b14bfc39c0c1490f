"""Take-off and landing by the locomotion manager: single trips, and statistics of many robots."""

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from spidar_gym.benchmark.resume import finish
from spidar_gym.control.crawl.footsteps import lying_pose
from spidar_gym.control.estimator import Estimator
from spidar_gym.control.flight.controller import CONTROL_RATE
from spidar_gym.control.locomotion.commands import Land, LocomotionCommand, TakeOff
from spidar_gym.control.locomotion.manager import NEAR_FLOOR, Manager
from spidar_gym.control.locomotion.orders import ManagerConfig
from spidar_gym.control.presets import controller_config
from spidar_gym.errors import SpidarError
from spidar_gym.native.core_manager import CoreManager
from spidar_gym.native.plant import Plant
from spidar_gym.paper.calibration import require_world
from spidar_gym.robot import N_JOINTS, N_ROTORS, ROBOT
from spidar_gym.sim.config import PlantConfig
from spidar_gym.sim.disturbances import Disturbances
from spidar_gym.sim.ground import GroundConfig
from spidar_gym.sim.randomize import Randomization, check_strength, randomize
from spidar_gym.so3 import matrix_to_quat, quat_to_matrix
from spidar_gym.state import Command

JOINT_SPEED = 0.6
"""Joint speed of the legs [rad/s]."""
HOP = (TakeOff(1.0), Land())
"""Commands of a hop: from the floor to a hover at 1 m and back."""
PRESET = "steady"
"""Default preset of the flight controller."""
HAND_OVERS = ("spool", "descend", "unload")
"""Phases in which the robot's weight changes between floor and rotors; of a descent its end."""
SETTLING = 40
"""Ticks on the floor before the first command."""
LONGEST = 100.0
"""Largest time to wait for a phase [s]."""


def manager_config(preset: str = PRESET) -> ManagerConfig:
    """Return the configuration of a manager with a preset of the flight controller (`UnknownNameError`)."""
    return ManagerConfig(flight=replace(controller_config(preset), joint_speed=JOINT_SPEED))


@dataclass
class Seen:
    """Log of a trip, with one entry per tick."""

    time: list[float] = field(default_factory=list)
    """Time [s]."""
    phase: list[str] = field(default_factory=list)
    """One of `PHASES`."""
    position_w: list[np.ndarray] = field(default_factory=list)
    """True position of the torso, world, shape (3,) [m]."""
    free: list[bool] = field(default_factory=list)
    """Whether the robot descends higher than half of `NEAR_FLOOR` above the expected floor."""
    tilt: list[float] = field(default_factory=list)
    """Angle between the torso's axis and the vertical [rad]."""
    against_floor: list[float] = field(default_factory=list)
    """Angle between the torso's axis and the floor's normal [rad]."""
    thrust: list[float] = field(default_factory=list)
    """Commanded Σλ [N]."""
    vectoring: list[np.ndarray] = field(default_factory=list)
    """Commanded vectoring angles, shape (8, 2) [rad]."""
    touchdown: float = 0.0
    """Downward speed of the torso before the first contact of a descent [m/s]."""
    slip: float = 0.0
    """Slip of the feet in spool and unload, integrated over the fastest foot of every tick [m]."""
    done: float | None = None
    """Time at which all commands are done [s]."""

    def phases(self) -> list[str]:
        """Return the phases in order."""
        return [p for k, p in enumerate(self.phase) if k == 0 or self.phase[k - 1] != p]

    def during(self, *phases: str) -> np.ndarray:
        """Return a mask of the ticks in these phases, shape (n,)."""
        return np.isin(self.phase, phases)

    def steps(self, *phases: str, after: bool = False) -> tuple[np.ndarray, np.ndarray]:
        """Return the changes of the commands in every tick of these phases, relative to the tick before.

        Ticks of a descent in free air are left out.

        Args:
            phases: Names of the phases.
            after: Whether to include the tick after each phase.

        Returns:
            Changes of Σλ, shape (k,) [N], and largest changes of a vectoring angle, shape (k,) [rad].
        """
        during = self.during(*phases) & ~np.array(self.free)
        chosen = during[1:] | (during[:-1] & after)
        thrust, vectoring = np.abs(np.diff(self.thrust)), np.abs(np.diff(self.vectoring, axis=0))
        return thrust[chosen], vectoring.max(axis=(1, 2))[chosen]


class Trip:
    """Simulation of one robot on a floor with a locomotion manager."""

    def __init__(
        self, seed: int = 0, *, strength: float | Randomization = 0.0, sense: bool = False,
        ground: GroundConfig | None = None, wind: float = 0.0, push: float = 0.0, manager: Any = None,  # noqa: ANN401 - either manager, or both at once
    ) -> None:  # fmt: skip
        """Place the robot on the floor.

        Args:
            seed: Seed of the robot, its noise and the weather.
            strength: Strength of the randomisation, 0 for the nominal robot; or a calibrated world, with its floor.
            sense: Whether the manager receives the estimate from noisy sensors instead of the true state.
            ground: Floor; if None, flat or the world's.
            wind: Mean wind [m/s].
            push: Force of pushes [N].
            manager: Locomotion manager; the Python implementation if None.
        """
        rng = np.random.Generator(np.random.PCG64(seed))
        config = PlantConfig(sense=sense, joint_speed=JOINT_SPEED)
        if Randomization.parse(strength).draws:
            config = randomize(config, rng, strength)[0]
        ground = ground or config.ground
        config = replace(config, ground=ground, sense=sense)
        self.plant, self.estimator, self.ground = Plant(config), Estimator(), ground
        self.manager = manager or Manager(manager_config())
        gait = self.manager.config.crawl.gait
        q = lying_pose(gait)
        below = ground.height(np.vstack((gait.home_b, 0.12 * np.eye(3), -0.12 * np.eye(3)))).max()
        place = ground.R_wf @ np.array([0.0, 0.0, ROBOT.peg_depth + float(below)])
        state = self.plant.reset(
            place, matrix_to_quat(ground.R_wf), q, np.zeros((N_ROTORS, 2)),
            disturbances=Disturbances(wind=wind, push=push), rng=rng,
        )  # fmt: skip
        still = Command(np.zeros(N_ROTORS), np.zeros((N_ROTORS, 2)), q, np.full(N_JOINTS, ROBOT.max_joint_torque))
        for _ in range(SETTLING):
            state = self.plant.step(still)
        self.state = self.seen = state
        """True state, and the state that the manager receives."""
        if sense:
            first = self.plant.measure()
            self.estimator.reset(replace(state, joint_position=first.joint_position, vectoring=first.vectoring))
            self.seen = self.estimator.update(first, state.thrust)
        self.seen_so_far = Seen()

    def tick(self) -> None:
        """Simulate one control period."""
        seen, m, fell = self.seen_so_far, self.manager, float(self.state.velocity_w[2])
        command = m.step(self.seen)
        self.state = self.plant.step(command)
        self.seen = self.state
        if self.plant.config.sense:
            self.seen = self.estimator.update(self.plant.measure(), command.thrust)
        if m.phase == "descend" and self.plant.in_contact and not seen.touchdown:
            seen.touchdown = -fell
        if m.phase in ("spool", "unload"):
            seen.slip += float(self.plant.touch().foot_slip.max()) / CONTROL_RATE
        R_wb = quat_to_matrix(self.state.quat_wb)
        seen.time.append(len(seen.time) / CONTROL_RATE)
        seen.phase.append(m.phase)
        seen.free.append(m.phase == "descend" and self._height() > m.floor + 0.5 * NEAR_FLOOR)
        seen.position_w.append(self.state.position_w)
        seen.tilt.append(math.acos(min(1.0, float(R_wb[2, 2]))))
        seen.against_floor.append(math.acos(min(1.0, float(R_wb[:, 2] @ self.ground.R_wf[:, 2]))))
        seen.thrust.append(float(command.thrust.sum()))
        seen.vectoring.append(command.vectoring)

    def _height(self) -> float:
        """Return the height of the centre of mass [m]."""
        state, model = self.state, self.manager.model
        R_wb = quat_to_matrix(state.quat_wb)
        return float((state.position_w + R_wb @ model.snapshot(state.joint_position, R_wb, state.vectoring).com_b)[2])

    def until(self, phase: str, ticks: int = 0) -> None:
        """Simulate until a phase begins, and `ticks` ticks more.

        Raises:
            SpidarError: If the phase does not begin within `LONGEST`.
        """
        while self.manager.phase != phase:
            self.tick()
            if len(self.seen_so_far.time) > LONGEST * CONTROL_RATE:
                raise SpidarError(f"{phase} did not begin within {LONGEST:g} s; valid: a phase of the commands")
        for _ in range(ticks):
            self.tick()

    def fly(
        self, commands: Iterable[LocomotionCommand], seconds: float = 40.0, *,
        interrupt: tuple[float, Iterable[LocomotionCommand]] | None = None,
    ) -> Seen:  # fmt: skip
        """Execute commands, and simulate half a second more.

        Args:
            commands: Commands of the manager.
            seconds: Largest duration [s].
            interrupt: Time [s], and commands that replace the others at this time.
        """
        self.manager.reset(self.seen, commands)
        seen = self.seen_so_far
        for k in range(round(CONTROL_RATE * seconds)):
            if interrupt is not None and k == round(CONTROL_RATE * interrupt[0]):
                self.manager.interrupt(interrupt[1])
            self.tick()
            if self.manager.done and seen.done is None:
                seen.done = k / CONTROL_RATE
            if seen.done is not None and k / CONTROL_RATE >= seen.done + 0.5:
                break
        return seen


# ---- statistics of many robots ----

STRENGTH, WIND = 1.0, 2.0
"""Strength of the randomisation, and mean wind speed for the randomised robots [m/s]."""
HOVERED = 10.0
"""Duration of a separate hover of each robot, for comparison of the changes of Σλ [s]."""
QUANTILE = 0.999
"""Quantile of the changes of Σλ over all robots that is reported."""
LARGEST_STEP = 5.0
"""Largest allowed change of Σλ per tick in `HAND_OVERS` for nominal robots [N]."""
BARS = {"touchdown_m_s": 0.35, "tilt_rad": 0.1, "slip_m": 0.05, "seconds": 15.0,
        "turn_rad": ROBOT.max_vectoring_speed / CONTROL_RATE}  # fmt: skip
"""Limits of a hop; the last is the largest motion of a vectoring servo in a tick."""
ROUNDING = 1e-9
"""Tolerance for commands at a limit."""


@dataclass(frozen=True)
class Hop:
    """Hop of one robot with noisy sensors and the estimator."""

    seed: int
    """Seed of the robot, its noise and the weather."""
    strength: float = 0.0
    """Strength of the randomisation, 0 for the nominal robot."""
    wind: float = 0.0
    """Mean wind [m/s]."""
    world: str = ""
    """Calibrated world with the kind of the robot, in place of the strength."""
    preset: str = PRESET
    """Preset of the flight controller."""


def fly_hop(hop: Hop) -> dict[str, Any]:
    """Simulate a hop: whether the robot landed, the figures of `BARS`, and every change of Σλ [N].

    `steps_n` are the changes in `HAND_OVERS`, `hover_steps_n` those of the same robot in a hover of `HOVERED` seconds.
    """
    strength = Randomization.parse(hop.world) if hop.world else hop.strength
    how: dict[str, Any] = dict(strength=strength, wind=hop.wind, sense=True)
    config = manager_config(hop.preset)
    seen = Trip(hop.seed, manager=CoreManager(config), **how).fly(HOP)
    hover = Trip(hop.seed, manager=CoreManager(config), **how)
    hover.manager.reset(hover.seen, HOP[:1])
    hover.until("hover", round(CONTROL_RATE * HOVERED))
    hovered = hover.seen_so_far.steps("hover")[0]
    return {
        "landed": seen.done is not None and seen.phase[-1] == "lie",
        "touchdown_m_s": seen.touchdown,
        "tilt_rad": max(seen.tilt),
        "slip_m": seen.slip,
        "seconds": LONGEST if seen.done is None else seen.done,
        "turn_rad": float(np.abs(np.diff(seen.vectoring, axis=0)).max()),
        "steps_n": seen.steps(*HAND_OVERS, after=True)[0].tolist(),
        "hover_steps_n": hovered.tolist(),
    }


def hop_study(
    robots: int = 100, *, strength: float = STRENGTH, wind: float = WIND, world: str = "", preset: str = PRESET,
    workers: int = 1, folder: Path | None = None, on_hop: Callable[[], object] = lambda: None,
) -> list[dict[str, Any]]:  # fmt: skip
    """Simulate hops of nominal robots with noise, of randomised robots in wind, and of calibrated robots.

    Finished hops are stored in `folder`, and an interrupted call resumes from them.

    Args:
        robots: Number of robots of each kind; their seeds start at 0.
        strength: Strength of the randomisation.
        wind: Mean wind speed for the randomised robots [m/s].
        world: Name of a calibrated world, none if empty; its mixtures hop in turn, each variant in a row.
        preset: Preset of the flight controller.
        workers: Number of processes.
        folder: Folder for finished hops.
        on_hop: Called after each hop, for progress bars.

    Returns:
        One row for each kind of robots.

    Raises:
        InvalidValueError: For a strength outside 0 … 1.
    """
    check_strength(strength)
    controller_config(preset)  # raises for an unknown name
    kinds: list[dict[str, Any]] = [{}, {"strength": strength, "wind": wind}]
    hops = [Hop(seed, **kind, preset=preset) for kind in kinds for seed in range(robots)]
    for variant in _variants(world):
        mixtures = [name for name, _ in require_world(world).mixtures]
        kinds.append({"world": f"{world}, {variant}"})
        hops += [
            Hop(seed, world=f"{world}:{mixtures[seed % len(mixtures)]}-{variant}", preset=preset)
            for seed in range(robots)
        ]
    found = finish(fly_hop, hops, workers=workers, folder=folder, on_done=lambda *_: on_hop())
    return [
        {
            "preset": preset,
            "robots": robots,
            "strength": 0.0,
            "wind": 0.0,
            **kind,
            **_row(found[k * robots : (k + 1) * robots], kind),
        }
        for k, kind in enumerate(kinds)
    ]


def _variants(world: str) -> list[str]:
    """Return the variants of a world; none for no world."""
    return [name for name, _ in require_world(world).variants] if world else []


def hop_count(robots: int, world: str = "") -> int:
    """Return the number of hops of a study."""
    return robots * (2 + len(_variants(world)))


def _row(hops: list[dict[str, Any]], drawn: dict[str, Any]) -> dict[str, Any]:
    """Compute the figures of many hops: median and worst robot, and quantiles of the changes of Σλ over all ticks."""
    steps, hovered = (np.concatenate([hop[key] for hop in hops]) for key in ("steps_n", "hover_steps_n"))
    largest = [max(hop["steps_n"]) for hop in hops]
    within = [hop["landed"] and all(hop[key] <= bar + ROUNDING for key, bar in BARS.items()) for hop in hops]
    if not drawn:
        within = [good and step <= LARGEST_STEP + ROUNDING for good, step in zip(within, largest, strict=True)]
    return {
        "landed": sum(hop["landed"] for hop in hops),
        "within": sum(within),
        "beyond": [seed for seed, good in enumerate(within) if not good],
        **{key: {"median": float(np.median(values)), "worst": float(np.max(values))}
           for key in BARS for values in [[hop[key] for hop in hops]]},
        "largest_step_n": {"median": float(np.median(largest)), "worst": max(largest)},
        "step_quantile_n": float(np.quantile(steps, QUANTILE)),
        "hover_step_quantile_n": float(np.quantile(hovered, QUANTILE)),
    }  # fmt: skip


_LINES = (
    ("touchdown [m/s]", "touchdown_m_s", 1.0, 2), ("tilt [mrad]", "tilt_rad", 1e3, 0),
    ("slip of the feet [mm]", "slip_m", 1e3, 1), ("from lying to 1 m and back [s]", "seconds", 1.0, 1),
    ("vectoring command, turn in a tick [mrad]", "turn_rad", 1e3, 1),
)  # fmt: skip


def hop_lines(rows: list[dict[str, Any]]) -> list[list[str]]:
    """Return the table with one column per row: median … worst robot, beside the limit."""
    names = [row.get("world") or (f"randomised at strength {row['strength']:g}, wind {row['wind']:g} m/s"
             if row["strength"] or row["wind"] else "noisy nominal") for row in rows]  # fmt: skip

    def cells(key: str, factor: float, digits: int) -> list[str]:
        return [f"{factor * row[key]['median']:.{digits}f} … {factor * row[key]['worst']:.{digits}f}" for row in rows]

    lines = [["hop", "allowed", *names]]
    lines += [["landed", "", *(f"{row['landed']} of {row['robots']}" for row in rows)]]
    lines += [["… within all limits below", "", *(f"{row['within']} of {row['robots']}" for row in rows)]]
    lines += [[label, f"{factor * BARS[key]:.{digits}f}", *cells(key, factor, digits)]
              for label, key, factor, digits in _LINES]  # fmt: skip
    lines += [["change of Σλ at hand-overs [N/tick]", f"{LARGEST_STEP:g}, nominal", *cells("largest_step_n", 1.0, 2)]]
    for label, bar, key in (
        (f"… {QUANTILE:.1%} quantile of all ticks", "that of the hover", "step_quantile_n"),
        (f"… {QUANTILE:.1%} quantile in a hover of {HOVERED:g} s", "", "hover_step_quantile_n"),
    ):
        lines.append([label, bar, *(f"{row[key]:.2f}" for row in rows)])
    return lines
