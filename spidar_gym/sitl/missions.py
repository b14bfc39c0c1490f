"""The missions of the paper's experiments, as the text that the runner reads."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from spidar_gym.control.crawl.footsteps import Move, plan_cycles
from spidar_gym.control.crawl.gait import nominal_time
from spidar_gym.control.crawl.pose2 import Pose2
from spidar_gym.control.flight.controller import CONTROL_RATE
from spidar_gym.control.presets import controller_config, crawler_config
from spidar_gym.envs.crawl.task import PAPER_WAY
from spidar_gym.envs.hover.task import HoverTask
from spidar_gym.paper.flight import FLIGHT_SECONDS, UNRESTRICTED

PREPARE = 8.0
"""From the take-over until the experiment begins: the legs move from the landing form to form ① [s]."""


@dataclass(frozen=True)
class Mission:
    """What the runner is told, and what that means for whoever evaluates it."""

    name: str
    """flight, crawl or hover."""
    preset: str
    """Controller."""
    text: str
    """What the runner reads."""
    seconds: float
    """How long it takes from the take-over on, at most [s]."""
    begins: float = 0.0
    """When the experiment begins, since the take-over [s]."""
    way: Pose2 | None = None
    """Where a crawl ends, seen from its start; None where nothing crawls."""

    @property
    def crawls(self) -> bool:
        """Whether it stays on the ground."""
        return self.way is not None


def _form(start: float, q: Iterable[float]) -> str:
    return f"form {start:g} " + " ".join(f"{angle:.6f}" for angle in q)


def flight_mission(preset: str = "as_flown", *, odometry: bool = False, residual: bool = False) -> Mission:
    """The paper's flight: ① for 4 s, ②, ③ without a stop, and the two windows without interference rows."""
    controller_config(preset)
    # The paper's sequence draws nothing.
    forms = HoverTask(forms="paper").schedule(np.random.Generator(np.random.PCG64(0)))
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
    residual: bool = False,
) -> Mission:  # fmt: skip
    """The paper's crawl, or another way (`InvalidValueError` for one out of reach)."""
    config = crawler_config(preset)
    cycles = plan_cycles(config.gait, Move(way))
    lines = [f"crawl {preset}", *_switches(odometry, residual), f"move {way.x:.6f} {way.y:.6f} {way.yaw:.6f} {cycles}"]
    # Whoever waits longer than twice the nominal time waits for nothing.
    seconds = 15.0 + 2.0 * nominal_time(config.gait, [Move(way)], joint_speed=config.joint_speed, dt=1.0 / CONTROL_RATE)
    return Mission("crawl", preset, "\n".join([*lines, ""]), seconds, way=way)


def _switches(odometry: bool, residual: bool) -> list[str]:
    return ["estimate odometry"] * odometry + ["residual on"] * residual
