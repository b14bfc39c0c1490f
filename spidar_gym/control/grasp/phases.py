"""The phases of grasping: reach over an object, close, grip, lift, carry, lower, let go, leave; with a guard.

All motion is that of the torso, whose feet hold the object; a phase moves one thing at a time. The guard ends grip and
payload in the tick in which the object is lost: the payload's lever would follow an object that stays behind.
"""

import math
from dataclasses import dataclass, field, replace

import numpy as np

from spidar_gym.arrays import JointVector, Quaternion, Vector3
from spidar_gym.control.flight.path import ease
from spidar_gym.control.grasp.claw import Contact, plan_contact
from spidar_gym.control.grasp.grip import Grip
from spidar_gym.robot import ROBOT, RobotSpec

GRASP_PHASES = ("reach", "close", "grip", "load", "lift", "carry", "lower", "unload", "let_go", "leave")
"""Phases of grasping, in the order of a mission."""
HOLDING = ("grip", "load", "lift", "carry", "lower", "unload", "let_go")
"""Phases in which the feet press."""
CARRYING = ("lift", "carry", "lower")
"""Phases in which the object hangs, and the guard watches."""
ABOVE = 0.35
"""Height over the place of the grip at which a robot reaches over an object, and to which it leaves [m]."""
REACH_SPEED, CARRY_SPEED = 0.2, 0.5
"""Largest speeds of the torso near an object and with it [m/s]."""
GRIP_TIME, LOAD_TIME, LET_GO_TIME = 1.5, 1.0, 1.5
"""Times in which grip and payload grow and end [s]."""
SLACK = 0.03
"""Height by which the torso rises while it lets go: feet that are pressed down on an object knock it [m]."""
BENT, AWAY = 0.15, 0.12
"""The object is lost if a joint is this far from its angle at the contact [rad], or the object from its place [m]."""
SAFE_GRIP = 33.0
"""Largest grip that legs and thrust make, by a cone program [N]."""
QUINTIC_PEAK = 1.875
"""Largest rate of the quintic `ease` over its mean."""


@dataclass(frozen=True, slots=True)
class Seen:
    """An object as it is seen by motion capture."""

    position_w: Vector3
    """Its origin, world [m]."""
    quat_wo: Quaternion
    """Its attitude."""


@dataclass(frozen=True)
class GraspTask:
    """An object to grasp."""

    shape: str
    """`box`, `cylinder` or `ball`."""
    half_size: Vector3
    """As in `ObjectConfig` [m]."""
    force: float = 20.0
    """Force of each foot [N]."""
    mass: float = 1.5
    """Mass as far as it is known [kg]."""
    height: float = 0.7
    """Height of the lift [m]."""


@dataclass(slots=True)
class GraspMemory:
    """State of a grasp between ticks."""

    phase: str = "reach"
    """One of `GRASP_PHASES`."""
    time: float = 0.0
    """Time in the phase [s]."""
    from_w: Vector3 = field(default_factory=lambda: np.zeros(3))
    """Torso's origin at the begin of the phase [m]."""
    to_w: Vector3 = field(default_factory=lambda: np.zeros(3))
    """Torso's origin at its end [m]."""
    from_form: JointVector = field(default_factory=lambda: np.zeros(16))
    """Form at its begin [rad]."""
    to_form: JointVector = field(default_factory=lambda: np.zeros(16))
    """Form at its end [rad]."""
    seconds: float = 1.0
    """Duration of the phase [s]."""
    lost: bool = False
    """Whether the object was lost."""


@dataclass(frozen=True, slots=True)
class GraspReference:
    """What the flight controller is to do."""

    torso_w: Vector3
    """Torso's origin [m]."""
    velocity_w: Vector3
    """Its velocity [m/s]."""
    yaw: float
    """Heading [rad]."""
    form: JointVector
    """Joint angles [rad]."""
    grip: Grip
    """The object among the targets of jets, and what the legs do with it."""


class Grasp:
    """One grasp, from the approach to the departure."""

    def __init__(self, task: GraspTask, seen: Seen, torso_w: Vector3, yaw: float, form: JointVector,
                 robot: RobotSpec = ROBOT) -> None:  # fmt: skip
        """Plan the contact and begin to reach (`InvalidValueError` for an object that cannot be held)."""
        self.task, self.robot = task, robot
        self.plan: Contact = plan_contact(task.shape, task.half_size, seen.quat_wo, yaw, robot)
        self.memory = GraspMemory()
        self._home = seen.position_w + self.plan.torso_o
        self._enter("reach", torso_w, self._home, form, self.plan.open)

    def _enter(self, phase: str, from_w: Vector3, to_w: Vector3, from_form: JointVector, to_form: JointVector,
               least: float = 0.0, speed: float = REACH_SPEED) -> None:  # fmt: skip
        """Begin a phase that lasts as long as way, joints and `least` [s] need."""
        way, turn = float(np.linalg.norm(to_w - from_w)), float(np.abs(to_form - from_form).max())
        seconds = max(least, QUINTIC_PEAK * way / speed, QUINTIC_PEAK * turn / self.robot.joint_speed, 0.025)
        lost = self.memory.lost
        self.memory = GraspMemory(phase, 0.0, from_w, to_w, from_form, to_form, seconds, lost)

    def carry(self, by_w: Vector3, speed: float = CARRY_SPEED) -> None:
        """Carry the object by a way [m]; only while it is held in the air."""
        m = self.memory
        self._enter("carry", m.to_w, m.to_w + by_w, self.plan.closed, self.plan.closed, speed=speed)

    def lower(self, by: float) -> None:
        """Lower the object by a height [m], and put it down there."""
        m = self.memory
        self._enter("lower", m.to_w, m.to_w - (0.0, 0.0, by), self.plan.closed, self.plan.closed)

    @property
    def waits(self) -> bool:
        """Whether the present phase has ended and waits for an order, or the grasp is over."""
        m = self.memory
        return m.phase in ("lift", "carry", "leave") and m.time >= m.seconds

    def step(self, position_w: Vector3, q: JointVector, seen: Seen, dt: float) -> GraspReference:
        """Advance by one tick; return the reference.

        Args:
            position_w: Torso's origin [m].
            q: Joint angles [rad].
            seen: The object.
            dt: Control period [s].
        """
        m = self.memory
        if m.phase in CARRYING and self._is_lost(position_w, q, seen):
            m.lost = True
            self._enter("leave", position_w, position_w + (0.0, 0.0, ABOVE), q.copy(), self.plan.open)
        elif m.time >= m.seconds:
            self._next()
        m = self.memory
        m.time += dt
        share, rate = ease(m.time / m.seconds), _rate(m.time / m.seconds) / m.seconds
        way = m.to_w - m.from_w
        form = m.from_form + share * (m.to_form - m.from_form)
        force, payload = self._terms(min(1.0, m.time / m.seconds))
        scale = self.task.half_size
        top = float(scale[0] if self.task.shape == "ball" else scale[2])
        grip = Grip(seen.position_w, float(scale[0]), top, force, payload)
        return GraspReference(m.from_w + share * way, rate * way, self.plan.yaw, form, grip)

    def _terms(self, share: float) -> tuple[float, float]:
        """Return grip [N] and payload [kg] in the present phase."""
        phase, full, mass = self.memory.phase, min(self.task.force, SAFE_GRIP), self.task.mass
        force = {"grip": share * full, "let_go": (1.0 - share) * full}.get(phase, full if phase in HOLDING else 0.0)
        carried = mass if phase in CARRYING else 0.0
        return force, {"load": share * mass, "unload": (1.0 - share) * mass}.get(phase, carried)

    def _next(self) -> None:
        m, plan = self.memory, self.plan
        here, up = m.to_w, np.array([0.0, 0.0, 1.0])
        closed = plan.closed
        if m.phase == "reach":
            self._enter("close", here, here, m.to_form, plan.pressed)
        elif m.phase == "close":
            self._enter("grip", here, here, closed, closed, GRIP_TIME)
        elif m.phase == "grip":
            self._enter("load", here, here, closed, closed, LOAD_TIME)
        elif m.phase == "load":
            self._enter("lift", here, here + self.task.height * up, closed, closed)
        elif m.phase == "lower":
            self._enter("unload", here, here, closed, closed, LOAD_TIME)
        elif m.phase == "unload":
            self._enter("let_go", here, here + SLACK * up, closed, closed, LET_GO_TIME)
        elif m.phase == "let_go":
            self._enter("leave", here, here + ABOVE * up, closed, plan.open)

    def _is_lost(self, position_w: Vector3, q: JointVector, seen: Seen) -> bool:
        off = seen.position_w + self.plan.torso_o - position_w
        return float(np.abs(q - self.plan.closed).max()) > BENT or float(np.linalg.norm(off)) > AWAY


def _rate(share: float) -> float:
    """Return the derivative of `ease`."""
    s = min(1.0, max(0.0, share))
    return 30.0 * s**2 * (1.0 - s) ** 2
