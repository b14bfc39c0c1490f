"""The phases of a grasp: over the object, down, close, grip, test lift, lift, carry, lower, let go; with a guard.

A phase moves torso, legs, grip and payload from one setting to the next. The test lift measures the object's mass from
the lift that the controller needs, and grips harder where the feet slip. The guard ends grip and payload in the tick in
which the object is lost: the lever of the payload would follow an object that stays behind.
"""

import math
from dataclasses import dataclass, field, replace

import numpy as np

from spidar_gym.arrays import JointVector, Quaternion, Vector3
from spidar_gym.control.flight.path import ease, wrap
from spidar_gym.control.grasp.claw import PRESS, Contact, claw_form, claw_height, plan_contact
from spidar_gym.control.grasp.grip import Grip
from spidar_gym.control.locomotion.commands import Grasp
from spidar_gym.errors import require_flag, require_within
from spidar_gym.robot import GRAVITY, N_LEGS, ROBOT, RobotSpec

GRASP_PHASES = ("none", "rise", "over", "down", "close", "grip", "load", "test", "back", "settle", "lift", "hold",
                "carry", "lower", "feel", "unload", "let_go", "open", "leave", "steered")  # fmt: skip
"""Phases of a grasp, in the order of a mission; `none` before and after it, `steered` while a policy leads it."""
PRESSING = GRASP_PHASES[GRASP_PHASES.index("grip") : GRASP_PHASES.index("open")]
"""Phases in which the feet press, and the guard watches."""
LEAVING = ("unload", "let_go", "open", "leave")
"""Phases that end a grasp."""
STEER_SPEED, STEER_TURN = 0.4, 0.4
"""Largest velocity along each axis [m/s] and rate of the heading [rad/s] of a steered robot."""
STEER_RADIUS = 0.18, 0.62
"""Least and largest distance of a steered robot's feet from its axis [m]."""
STEER_SIZE = 6
"""Entries of a steering action: velocity along the torso's heading, to the left, up; turn; opening; grip."""
SAFE_GRIP = 33.0
"""Largest grip of a foot that legs and thrust make, by a cone program [N]."""
QUINTIC_PEAK = 1.875
"""Largest rate of `ease` over its mean."""


@dataclass(frozen=True)
class GraspConfig:
    """Heights, speeds and thresholds of a grasp."""

    above: float = 0.55
    """Height over the place of the grip at which the robot comes over an object, and to which it leaves [m]."""
    reach_speed: float = 0.6
    """Largest speed of the torso to and over an object [m/s]."""
    near_speed: float = 0.2
    """Largest speed of the torso while its feet surround an object that stands [m/s]."""
    turn_speed: float = 0.6
    """Largest rate of the heading [rad/s]."""
    first_grip: float = 20.0
    """Force of each foot with which the test lift begins [N], or the most that the object bears."""
    more_grip: float = 5.0
    """Increase of that force after a test in which the feet slipped [N]."""
    reserve: float = 1.5
    """Force of the grip after the test over the least that holds the object with `friction`."""
    friction: float = 0.5
    """Friction that is assumed then, if the order has none."""
    unequal: float = 5.0
    """Force that is added where the friction is known [N]: the feet do not press equally."""
    close_time: float = 2.0
    """Time in which the feet come to the object at least [s]: faster ones knock it."""
    grip_time: float = 1.0
    """Time in which the grip grows or ends [s]."""
    load_time: float = 0.7
    """Time in which the payload grows or ends [s]."""
    test_height: float = 0.04
    """Height of the test lift [m]."""
    test_time: float = 1.2
    """Time of the test in the air, of whose second half the mean is taken [s]."""
    slip: float = 0.012
    """The feet slip if the object stays this far behind in the test [m]."""
    most_tests: int = 8
    """Number of tests after which the object is left."""
    feel_speed: float = 0.08
    """Speed of the descent near the expected floor [m/s]."""
    feel_height: float = 0.04
    """Height over the expected floor from which that speed is used [m]."""
    search: float = 0.1
    """A descent that finds no floor ends this far below the expected one [m]."""
    touch_error: float = 0.01
    """The floor is found when the torso is this far above its reference [m], beyond its error before."""
    touch_time: float = 0.075
    """Time for which it must be [s]."""
    slack: float = 0.02
    """Height by which the torso rises while it lets go [m]: feet that are pressed down on an object knock it."""
    bent: float = 0.2
    """The object is lost if a joint is this far from its angle at the contact [rad]."""
    away: float = 0.12
    """The object is lost if it is this far from its place below the torso [m]."""

    squeeze: float = 0.0
    """Depth by which joint setpoints lead the feet into the object in place of a grip by the allocation [m]."""
    avoids: bool = True
    """Whether the jets avoid the object as they avoid rotors and torso."""

    def __post_init__(self) -> None:
        """Raise `InvalidValueError` for numbers out of range."""
        numbers = dict(vars(self))
        require_flag(avoids=numbers.pop("avoids"))
        require_within(0.0, 0.5, "m", squeeze=numbers.pop("squeeze"))
        require_within(1e-3, 100.0, "1", **numbers)


@dataclass(frozen=True, slots=True)
class Seen:
    """An object as motion capture sees it."""

    position_w: Vector3
    """Its origin, in its middle, world [m]."""
    quat_wo: Quaternion
    """Its attitude."""


@dataclass(frozen=True, slots=True)
class Setting:
    """What a phase ends with, and the next begins with."""

    pose_w: np.ndarray = field(default_factory=lambda: np.zeros(4))
    """Torso's origin and heading (4,) [m], [rad]."""
    form: JointVector = field(default_factory=lambda: np.zeros(16))
    """Joint angles [rad]."""
    force: float = 0.0
    """Force of each foot [N]."""
    payload: float = 0.0
    """Mass that is carried [kg]."""


@dataclass(slots=True)
class GraspMemory:
    """State of a grasp between ticks."""

    phase: str = "none"
    """One of `GRASP_PHASES`."""
    time: float = 0.0
    """Time in the phase [s]."""
    seconds: float = 0.0
    """Duration of the phase [s]."""
    begin: Setting = field(default_factory=Setting)
    """Setting at the begin of the phase."""
    end: Setting = field(default_factory=Setting)
    """Setting at its end."""
    place_b: Vector3 = field(default_factory=lambda: np.zeros(3))
    """Object's origin from the torso's at the last grip, torso axes but level [m]."""
    turn: float = 0.0
    """Heading of the object beyond that of the torso at the last grip [rad]."""
    force: float = 0.0
    """Force of each foot while it holds [N]."""
    mass: float = 0.0
    """Mass of the object as far as it is known [kg]."""
    hover: float = 0.0
    """Mean lift without the object [N]."""
    height: float = 0.0
    """Height of the object over the torso before the test [m]; in `hold` the torso's error of height [m]."""
    stood: float = 0.0
    """Height of the object's origin before the test [m]."""
    tests: int = 0
    """Number of tests."""
    total: float = 0.0
    """Sum of a quantity over the ticks of the phase."""
    count: int = 0
    """Number of its summands."""
    found: float = 0.0
    """Time for which the signs of a floor have held [s]."""
    held: bool = False
    """Whether the test lift has succeeded and the object is held."""
    placed: bool = False
    """Whether the held object stands."""
    lost: bool = False
    """Whether the object was lost."""
    refused: bool = False
    """Whether the test lift found the object too heavy or too slippery for the forces that it bears."""


@dataclass(frozen=True, slots=True)
class GraspReference:
    """What the flight controller is to do."""

    position_w: Vector3
    """Torso's origin [m]."""
    velocity_w: Vector3
    """Its velocity [m/s]."""
    yaw: float
    """Heading [rad]."""
    turning: float
    """Rate of the heading [rad/s]."""
    form: JointVector
    """Joint angles [rad]."""
    grip: Grip
    """The object among the targets of jets, and what the legs do with it."""


@dataclass(frozen=True, slots=True)
class _View:
    """What a transition depends on."""

    position_w: Vector3
    """Torso's origin [m]."""
    where: Vector3
    """Object's origin, unseen where it was held [m]."""
    seen: Seen | None
    """The object, if it is seen."""


def rotated(yaw: float, v: Vector3) -> Vector3:
    """Return a vector turned about the vertical."""
    c, s = math.cos(yaw), math.sin(yaw)
    x, y, z = v.tolist()
    return np.array([c * x - s * y, s * x + c * y, z])


def heading_of(quat_wo: Quaternion) -> float:
    """Return the heading of an attitude that is nearly upright [rad]."""
    w, x, y, z = quat_wo.tolist()
    return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


class Grasper:
    """The phases of a grasp, from the way to the object until the robot has left it."""

    def __init__(
        self, config: GraspConfig | None = None, robot: RobotSpec = ROBOT, joint_speed: float | None = None
    ) -> None:
        """Build it without an object; `joint_speed` is the largest speed of the joints, else the robot's [rad/s]."""
        self.config, self.robot = config or GraspConfig(), robot
        self._joint_speed = robot.joint_speed if joint_speed is None else joint_speed
        self.memory = GraspMemory()
        self.target: Grasp | None = None
        self.plan: Contact | None = None

    def reset(self) -> None:
        """Forget everything."""
        self.memory, self.target, self.plan = GraspMemory(), None, None

    # ---- orders ----

    def begin(self, target: Grasp, seen: Seen, pose_w: np.ndarray, form: JointVector) -> None:
        """Plan the contact, and begin to move over the object (`InvalidValueError` for one that cannot be held).

        Args:
            target: The object, and how high to lift it.
            seen: Its pose.
            pose_w: Reference of the torso: origin and heading (4,) [m], [rad].
            form: Present joint setpoints [rad].
        """
        self.plan = plan_contact(target.shape, target.half_size, seen.quat_wo, float(pose_w[3]), self.robot)
        self.target = target
        self.memory = GraspMemory(end=Setting(pose_w.copy(), form.copy()))
        self.memory.mass = target.mass
        first = self._holding_force(target.mass) if target.friction else self.config.first_grip
        self.memory.force = min(target.force or first, self.most_force)
        over = float(seen.position_w[2]) + self.plan.height + self.config.above
        self._enter("rise", self._at((float(pose_w[0]), float(pose_w[1]), max(over, float(pose_w[2]))), self.plan.open))

    def carry(self, position_w: Vector3, yaw: float | None, speed: float) -> None:
        """Carry the object to a place of its origin [m] and a heading of it [rad]; None keeps the heading."""
        m = self.memory
        torso_yaw = float(m.end.pose_w[3]) if yaw is None else yaw - m.turn
        pose = np.append(position_w - rotated(torso_yaw, m.place_b), 0.0)
        pose[3] = float(m.end.pose_w[3]) + wrap(torso_yaw - float(m.end.pose_w[3]))
        self._enter("carry", Setting(pose, m.end.form, m.end.force, m.end.payload), speed=speed)

    def place(self, floor: float) -> None:
        """Put the object down on a floor at a height [m]."""
        assert self.target is not None
        m = self.memory
        z = floor + self.target.top - float(m.place_b[2])
        self._enter("lower", self._shifted(min(0.0, z + self.config.feel_height - float(m.end.pose_w[2]))))

    def release(self) -> None:
        """Let go, open the legs and leave upwards."""
        self.stop()
        self.memory.held = self.memory.placed = False
        self._enter("unload", self._shifted(0.0, payload=0.0), least=self.config.load_time)

    def stop(self) -> None:
        """Hold where it is: the present setting becomes the end."""
        m = self.memory
        if m.phase in ("lift", "carry", "lower", "feel"):
            self._hold_here()

    def steer(self, target: Grasp, action: np.ndarray, pose_w: np.ndarray, form: JointVector, seconds: float) -> None:
        """Move as a policy steers.

        Args:
            target: The object.
            action: Entries in [−1, 1], shape (6,): velocities forwards, to the left, up, turn, opening, grip.
            pose_w: Reference of the torso before the first call (4,) [m], [rad].
            form: Joint setpoints before it [rad].
            seconds: Time until the next call [s].
        """
        m = self.memory
        now = self._now()[0] if m.phase == "steered" else Setting(pose_w.copy(), form.copy())
        ahead, left, up, turn, opening, grip = (min(1.0, max(-1.0, each)) for each in action.tolist())
        yaw = float(now.pose_w[3])
        way = seconds * STEER_SPEED * rotated(yaw, np.array([ahead, left, up]))
        pose = now.pose_w + np.append(way, seconds * STEER_TURN * turn)
        least, most = STEER_RADIUS
        radius = least + 0.5 * (opening + 1.0) * (most - least)
        form = claw_form(radius, claw_height(radius, self.robot), self.robot)
        self.target = target
        end = Setting(pose, form, 0.5 * (grip + 1.0) * SAFE_GRIP)
        m.phase, m.time, m.seconds, m.begin, m.end = "steered", 0.0, seconds, now, end

    def put_down(self) -> float | None:
        """Stop in any phase in which the feet press, for an end of the mission; hold there.

        Returns:
            Height of the surface on which the object stood, until it is lifted; infinity afterwards; None where it
            stands, or the feet do not press [m].
        """
        m = self.memory
        if not self.holds or m.phase in LEAVING or m.placed:
            return None
        phase = m.phase
        if phase != "hold":
            self._hold_here()
        if phase in ("grip", "load"):
            return None
        assert self.target is not None
        return m.stood - self.target.top if phase in ("test", "back", "settle", "lift") else math.inf

    def abandon(self) -> None:
        """Open the legs and leave an object that is not held yet."""
        assert self.plan is not None
        if self.memory.phase not in (*PRESSING, *LEAVING, "none"):
            now = self._now(self.config.load_time)[0]
            self.memory.end = Setting(now.pose_w, now.form)
            self._enter("leave", self._shifted(self.config.above, self.plan.open))

    @property
    def holds(self) -> bool:
        """Whether the feet press on the object, or are about to."""
        return self.memory.phase in PRESSING

    @property
    def most_force(self) -> float:
        """Largest force of a foot on the present object [N]."""
        assert self.target is not None
        return min(self.target.most_force, SAFE_GRIP)

    def _holding_force(self, mass: float) -> float:
        """Return the force of each foot that holds a mass [kg], with a reserve [N]."""
        assert self.target is not None
        known = self.target.friction
        least = mass * GRAVITY / (N_LEGS * (known or self.config.friction))
        return self.config.reserve * least + (self.config.unequal if known else 0.0)

    @property
    def waits(self) -> bool:
        """Whether the object is held, or the robot has left it, and the next order is awaited."""
        return self.memory.phase in ("none", "hold")

    # ---- a tick ----

    def step(self, position_w: Vector3, yaw: float, q: JointVector, lift: float, seen: Seen | None, dt: float
             ) -> GraspReference:  # fmt: skip
        """Advance by one tick; return the reference.

        Args:
            position_w: Torso's origin [m].
            yaw: Heading of the torso [rad].
            q: Joint angles [rad].
            lift: Vertical force that the controller desired in the last tick [N].
            seen: The object, or None while capture does not see it.
            dt: Control period [s].
        """
        m = self.memory
        where = self._where(position_w, yaw, seen)
        if m.phase in PRESSING and self._is_lost(position_w, yaw, q, seen):
            m.lost, m.held, m.placed = True, False, False
            self._leave(position_w, q)
        else:
            self._watch(position_w, lift, where, dt)
            if m.time >= m.seconds:
                self._next(position_w, yaw, where, seen)
        m = self.memory
        m.time += dt
        setting, rate = self._now()
        return GraspReference(setting.pose_w[:3], rate[:3], float(setting.pose_w[3]), float(rate[3]), setting.form,
                              self._grip(setting, where))  # fmt: skip

    def _where(self, position_w: Vector3, yaw: float, seen: Seen | None) -> Vector3:
        """Return the object's origin, unseen where it was held [m]."""
        return position_w + rotated(yaw, self.memory.place_b) if seen is None else seen.position_w

    def _grip(self, setting: Setting, where: Vector3) -> Grip:
        assert self.target is not None
        radius = self.target.radius if self.config.avoids else 0.0
        force = 0.0 if self.config.squeeze > 0.0 else setting.force
        return Grip(where, radius, self.target.top, force, setting.payload)

    def _now(self, fade: float = 0.0) -> tuple[Setting, np.ndarray]:
        """Return the present setting and the rate of the pose; `fade` [s] later if it came to rest from now on."""
        m = self.memory
        a, b = m.begin, m.end
        if m.seconds <= 0.0:
            return b, np.zeros(4)
        u = min(1.0, m.time / m.seconds)
        if m.phase in ("feel", "steered"):  # at a constant speed
            share, speed = u, 1.0 / m.seconds if m.time < m.seconds else 0.0
        else:
            share, speed = ease(u), 30.0 * u * u * (1.0 - u) * (1.0 - u) / m.seconds
        rate = speed * (b.pose_w - a.pose_w)
        pose = a.pose_w + share * (b.pose_w - a.pose_w) + 0.5 * fade * rate
        form = a.form + share * (b.form - a.form)
        return Setting(pose, form, a.force + u * (b.force - a.force), a.payload + u * (b.payload - a.payload)), rate

    def _watch(self, position_w: Vector3, lift: float, where: Vector3, dt: float) -> None:
        """Take the means that a phase measures, and detect the floor."""
        m, config = self.memory, self.config
        late = m.time > m.seconds - 0.5 * config.test_time
        if m.phase in ("down", "test") and late:
            m.total, m.count = m.total + lift, m.count + 1
        elif m.phase == "hold":  # the torso's error before a descent
            m.height += min(1.0, dt / 0.5) * (float(position_w[2] - m.end.pose_w[2]) - m.height)
        elif m.phase == "feel":
            above = float(position_w[2] - self._now()[0].pose_w[2]) - m.height
            m.found = m.found + dt if above > config.touch_error else 0.0
            if m.found >= config.touch_time:
                m.time = m.seconds

    # ---- transitions ----

    def _at(self, position_w: tuple[float, float, float], form: JointVector | None = None) -> Setting:
        """Return the end of the present phase at another place of the torso, with another form."""
        end = self.memory.end
        pose = np.array([*position_w, float(end.pose_w[3])])
        return Setting(pose, end.form if form is None else form, end.force, end.payload)

    def _shifted(self, up: float, form: JointVector | None = None, force: float | None = None,
                 payload: float | None = None) -> Setting:  # fmt: skip
        """Return the end of the present phase, higher [m], with another form, force, payload."""
        end = self.memory.end
        x, y, z, yaw = end.pose_w.tolist()
        return Setting(
            np.array([x, y, z + up, yaw]), end.form if form is None else form,
            end.force if force is None else force, end.payload if payload is None else payload,
        )  # fmt: skip

    def _enter(self, phase: str, end: Setting, *, speed: float | None = None, least: float = 0.0) -> None:
        """Begin a phase that lasts as long as way, heading, joints and `least` [s] need."""
        m, config, begin = self.memory, self.config, self.memory.end
        way = end.pose_w - begin.pose_w
        far, turn = float(np.linalg.norm(way[:3])), abs(float(way[3]))
        bend = float(np.abs(end.form - begin.form).max())
        m.seconds = max(
            least, QUINTIC_PEAK * far / (speed or config.near_speed), QUINTIC_PEAK * turn / config.turn_speed,
            QUINTIC_PEAK * bend / self._joint_speed,
        )  # fmt: skip
        m.phase, m.time, m.begin, m.end = phase, 0.0, begin, end
        m.total, m.count, m.found = 0.0, 0, 0.0

    def _rest_at(self, setting: Setting, phase: str) -> None:
        """Begin a phase at rest."""
        self.memory.end = setting
        self._enter(phase, setting)

    def _hold_here(self) -> None:
        """Hold the object where the present phase would come to rest."""
        self.memory.height = 0.0
        self._rest_at(self._now(self.config.load_time)[0], "hold")

    def _leave(self, position_w: Vector3, q: JointVector) -> None:
        """Open and climb without grip and payload, from the present pose."""
        assert self.plan is not None
        x, y, z = position_w.tolist()
        self.memory.end = Setting(np.array([x, y, z, self.memory.end.pose_w[3]]), q.copy())
        self._enter("leave", self._at((x, y, z + self.config.above), self.plan.open))

    def _home(self, where: Vector3, up: float) -> tuple[float, float, float]:
        """Return the torso's place for the grip, or above it [m]."""
        assert self.plan is not None
        x, y, z = where.tolist()
        return x, y, z + self.plan.height + up

    def _next(self, position_w: Vector3, yaw: float, where: Vector3, seen: Seen | None) -> None:
        """Enter the phase after the present one."""
        m = self.memory
        if m.phase in ("rise", "over", "down") and seen is None:
            return  # the robot waits for a view of the object
        if m.phase in ("close", "back") or (m.phase in ("lift", "carry") and seen is not None):
            m.place_b = rotated(-yaw, where - position_w)
            m.turn = m.turn if seen is None else wrap(heading_of(seen.quat_wo) - yaw)
        after = {
            "rise": self._after_rise, "over": self._after_over, "down": self._after_down, "close": self._grip_now,
            "back": self._grip_now, "grip": self._load, "load": self._test, "test": self._judge, "settle": self._lift,
            "lift": self._hold, "carry": self._hold, "lower": self._feel, "feel": self._after_feel,
            "unload": self._let_go, "let_go": self._open, "open": self._climb, "leave": self._end,
        }.get(m.phase)  # fmt: skip
        if after is not None:
            after(_View(position_w, where, seen))

    def _after_rise(self, view: "_View") -> None:
        assert view.seen is not None
        assert self.target is not None
        end, target = self.memory.end.pose_w, self.target
        self.plan = plan_contact(target.shape, target.half_size, view.seen.quat_wo, float(end[3]), self.robot)
        x, y, z = self._home(view.where, self.config.above)
        turned = float(end[3]) + wrap(self.plan.yaw - float(end[3]))
        over = Setting(np.array([x, y, max(z, float(end[2])), turned]), self.plan.open)
        self._enter("over", over, speed=self.config.reach_speed)

    def _after_over(self, view: "_View") -> None:
        self._enter("down", self._at(self._home(view.where, 0.0)), least=self.config.test_time)

    def _after_down(self, view: "_View") -> None:
        m, plan = self.memory, self.plan
        assert plan is not None
        m.hover = m.total / max(m.count, 1)
        closed = self._at(self._home(view.where, 0.0), plan.pressed)
        self._enter("close", closed, least=self.config.close_time)

    def _grip_now(self, view: "_View") -> None:
        del view
        assert self.plan is not None
        deeper = self.config.squeeze / PRESS * (self.plan.pressed - self.plan.closed)
        pressed = self._shifted(0.0, self.plan.closed + deeper, self.memory.force)
        self._enter("grip", pressed, least=self.config.grip_time)

    def _load(self, view: "_View") -> None:
        del view
        self._enter("load", self._shifted(0.0, payload=self.memory.mass), least=self.config.load_time)

    def _test(self, view: "_View") -> None:
        m, config = self.memory, self.config
        m.stood, m.height = float(view.where[2]), float(view.where[2] - view.position_w[2])
        self._enter("test", self._shifted(config.test_height), least=2.0 * config.test_time)

    def _lift(self, view: "_View") -> None:
        del view
        assert self.target is not None
        self._enter("lift", self._shifted(self.target.height - self.config.test_height))

    def _hold(self, view: "_View") -> None:
        del view
        self.memory.height = 0.0
        self._rest_at(self.memory.end, "hold")

    def _feel(self, view: "_View") -> None:
        del view
        down = self.config.feel_height + self.config.search
        self._enter("feel", self._shifted(-down))
        self.memory.seconds = down / self.config.feel_speed

    def _after_feel(self, view: "_View") -> None:
        m = self.memory
        end = m.end
        if m.found >= self.config.touch_time:  # else there was no floor
            m.placed = True
            x, y, _, yaw = end.pose_w.tolist()
            end = replace(end, pose_w=np.array([x, y, view.position_w[2], yaw]))
        self._rest_at(end, "hold")

    def _let_go(self, view: "_View") -> None:
        del view
        self._enter("let_go", self._shifted(self.config.slack, force=0.0), least=self.config.grip_time)

    def _open(self, view: "_View") -> None:
        del view
        assert self.plan is not None
        self._enter("open", self._shifted(0.0, self.plan.open))

    def _climb(self, view: "_View") -> None:
        del view
        self._enter("leave", self._shifted(self.config.above))

    def _end(self, view: "_View") -> None:
        del view
        self._rest_at(self.memory.end, "none")

    def _judge(self, view: "_View") -> None:
        """Decide after the test lift: lift, grip harder, carry more, or let go."""
        assert self.target is not None
        m, config, is_given = self.memory, self.config, self.target.force > 0.0
        risen = float(view.where[2]) - m.stood
        sag = float(view.where[2] - view.position_w[2]) - m.height
        carried = max(0.0, self.robot.total_mass * (m.total / max(m.count, 1) / max(m.hover, 1.0) - 1.0))
        slips, m.tests = sag < -config.slip, m.tests + 1
        if not slips and risen > 0.5 * config.test_height:
            m.mass, m.held = carried, True
            m.force = m.force if is_given else min(max(m.force, self._holding_force(carried)), self.most_force)
            self._enter("settle", self._shifted(0.0, force=m.force, payload=m.mass), least=config.load_time)
        elif m.tests >= config.most_tests or (slips and (is_given or m.force >= self.most_force - 1e-6)):
            m.refused = True
            self._enter("unload", self._shifted(-config.test_height, payload=0.0))
        else:
            if slips:
                m.force = min(m.force + config.more_grip, self.most_force)
            m.mass = max(m.mass, carried)
            self._enter("back", self._shifted(-config.test_height, payload=0.0))

    def _is_lost(self, position_w: Vector3, yaw: float, q: JointVector, seen: Seen | None) -> bool:
        assert self.plan is not None
        off = 0.0
        if seen is not None:
            off = float(np.linalg.norm(seen.position_w - position_w - rotated(yaw, self.memory.place_b)))
        return float(np.abs(q - self.plan.closed).max()) > self.config.bent or off > self.config.away
