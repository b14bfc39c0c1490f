"""The crawl: commands → cycles → phases → joint setpoints and allocation mode [Zhao2025, Sec. Crawling Gait].

Nothing here knows a force: what it sees is the torso's pose and the joint angles, and touchdown is a threshold on them,
because neither feet nor torso have a touch sensor.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from spidar_gym.arrays import FootForces, JointVector, Matrix3, Vector3
from spidar_gym.control.leg import INNER, OUTER, YAW, foot_positions, leg_angles
from spidar_gym.control.planar import Planar, planar_pose
from spidar_gym.errors import InvalidValueError, require_name, require_not_negative
from spidar_gym.robot import N_JOINTS, N_LEGS, ROBOT

FLOOR_Z = -ROBOT.peg_depth
"""Height of the floor seen from a torso that lies on its pegs [m]."""
STRIDES = ("centred", "home")
"""`centred`: feet go to home ± ½ stride round the torso; `home`: from home to home + stride, as in the lab's code."""
CYCLE = ("spool", "raise", "swing", "lower", "brace", "up", "forward", "down", "settle")
"""Phases of a gait cycle: legs, then torso."""
LIFT = ("spool", "raise", "hold", "lower", "settle")
"""Phases of lifting legs where they stand."""
STAND = ("brace", "up", "hold", "down", "settle")
"""Phases of standing up."""
PHASES = ("done", *CYCLE, "hold")
"""All phases."""
FILTER_TIME = 0.1
"""Time constant of the filters on pose and joint angles [s]."""
RESPONSE_TIME = 0.17
"""… and of the model of how the filtered pose follows its plan: that filter, servos, delay [s]."""
_LEGS_UP = frozenset(("spool", "raise", "swing", "lower"))
_ON_FEET = frozenset(("brace", "up", "forward", "down"))


@dataclass(frozen=True)
class GaitConfig:
    """What the gait is made of."""

    inner: float = -0.55
    """Start pose, inner pitch: the feet's home is where this pose has them, on the floor [rad]."""
    outer: float = 1.32
    """Start pose, outer pitch [rad]."""
    stride: str = "centred"
    """Where feet go: one of `STRIDES`."""
    max_distance: float = 0.2
    """Longest way of a cycle [m]; the reach may allow less."""
    max_turn: float = 0.5
    """Largest turn of a cycle [rad]."""
    raise_angle: float = 0.1
    """The inner pitch rises this far above the higher of start and end of the step [rad] [JSK]."""
    lift_height: float = 0.1
    """The torso moves at this height above where it lay [m] [Zhao2025, Sec. Crawling Motion]."""
    press: float = 0.004
    """Feet and torso are sent this far below the floor, so that they arrive [m]."""
    swing_at: float = 1.0
    """The swing begins at this share of the raise."""
    lower_at: float = 0.03
    """Legs are lowered when yaw and outer pitch are this close to their targets [rad]."""
    forward_at: float = 1.0
    """The torso moves on at this share of its lift."""
    down_at: float = 1.0
    """It goes down at this share of its way."""
    spool_time: float = 0.5
    """Time in which thrust takes over before legs or torso move [s]."""
    settle_time: float = 0.5
    """Time in which thrust fades after the torso has come down [s]; 0 goes on to the next cycle without a rest."""
    leg_touch_time: float = 0.3
    """Feet have touched down when the inner pitches are near their targets and still for so long [s]."""
    torso_touch_time: float = 0.2
    """The torso has when it is near its height and still for so long [s]."""
    arrival: float = 0.003
    """The torso is down its way when it is this close, filtered [m]; it waits for its trim until then."""
    trim_gain: float = 2.0
    """Integral gain from the torso's error to where the legs push it [1/s]; 0 is off."""
    trim_limit: float = 0.03
    """Largest trim [m]."""
    rolling: bool = False
    """Whether the kinematics know that the feet are balls, which roll as their legs turn."""
    timeout: float = 10.0
    """A phase that has not ended by then ends [s]."""

    def __post_init__(self) -> None:
        """Refuse a start pose out of reach and what is no length or time."""
        require_name("stride scheme", self.stride, STRIDES)
        positive = {k: v for k, v in vars(self).items() if k not in ("inner", "outer", "stride", "rolling")}
        require_not_negative(**positive)
        for name in ("max_distance", "max_turn", "lift_height", "timeout"):
            if getattr(self, name) == 0.0:
                raise InvalidValueError(name, 0.0, "a number above 0")
        if leg_angles(self.home_b) is None or leg_angles(self.home_b - (0.0, 0.0, self.lift_height)) is None:
            raise InvalidValueError("inner, outer", (self.inner, self.outer), "a pose whose feet reach the floor")

    @property
    def home_b(self) -> FootForces:
        """Where the feet stand under a torso on its pegs, torso axes [m]."""
        home = foot_positions(self.inner, self.outer)
        home[:, 2] = FLOOR_Z + ROBOT.foot_radius
        return home


@dataclass(frozen=True)
class Move:
    """Go to a pose seen from where the command begins, on an arc."""

    way: Planar
    """Where to."""
    cycles: int = 0
    """In how many cycles; 0 takes as few as reach and configuration allow."""


@dataclass(frozen=True)
class Lift:
    """Raise legs where they stand, hold, lower them."""

    legs: tuple[int, ...] = (0,)
    """Which, 0 … 3 from the front left counter-clockwise."""
    angle: float = 0.2
    """How far the inner pitch rises [rad]."""
    seconds: float = 2.0
    """How long they are held [s]."""


@dataclass(frozen=True)
class Stand:
    """Lift the torso, hold, put it down."""

    height: float = 0.1
    """[m]."""
    seconds: float = 2.0
    """How long it is held [s]."""


GaitCommand = Move | Lift | Stand


def stride_fits(config: GaitConfig, way: Planar, lift_height: float | None = None) -> bool:
    """Whether one cycle can go this way: every foot in reach at start and end, torso down and lifted."""
    home, height = config.home_b, config.lift_height if lift_height is None else lift_height
    ends = (way.arc(0.5), way.arc(-0.5)) if config.stride == "centred" else (way, Planar())
    for end in ends:
        feet = end.move(home)
        for z in (-config.press, height):
            if leg_angles(feet - (0.0, 0.0, z)) is None:
                return False
    return True


def largest_stride(config: GaitConfig, way: Planar) -> float:
    """Largest share of `way` that one cycle can go by the legs' reach, up to 20."""
    low, high = 0.0, 1.0
    while high < 20.0 and stride_fits(config, way.arc(high)):
        low, high = high, 2.0 * high
    for _ in range(24):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if stride_fits(config, way.arc(middle)) else (low, middle)
    return low


def plan_cycles(config: GaitConfig, move: Move) -> int:
    """How many cycles a move takes; `InvalidValueError` names the largest stride where the given number is too small."""
    way = move.way
    if not all(math.isfinite(v) for v in (way.x, way.y, way.yaw)):
        raise InvalidValueError("way", way, "finite numbers")
    share = largest_stride(config, way)
    if share <= 0.0:
        raise InvalidValueError("way", way, "a way whose first step is in reach")
    if move.cycles:
        if move.cycles < 0 or not isinstance(move.cycles, int):
            raise InvalidValueError("cycles", move.cycles, "a whole number of at least 1, or 0 for as many as needed")
        if share * move.cycles < 1.0 - 1e-9:
            stride, most = way.distance / move.cycles, share * way.distance
            turn = f" with {share * abs(way.yaw):.3f} rad" if way.yaw else ""
            raise InvalidValueError("stride", f"{stride:.3f} m", f"up to {most:.3f} m{turn} a cycle in this direction")
        return move.cycles
    wanted = max(way.distance / config.max_distance, abs(way.yaw) / config.max_turn, 1.0 / share)
    return max(1, math.ceil(wanted - 1e-6))


@dataclass(frozen=True, slots=True)
class GaitResidual:
    """What a policy adds to the gait; the defaults change nothing."""

    phase_rate: float = 1.0
    """Factor on the planned speed of the joints, at most 1 in effect where the servos' limit is planned."""
    raise_scale: float = 1.0
    """Factor on the raise angle of the next step."""
    stride_scale: float = 1.0
    """Factor on the stride of the next step, within the reach."""
    lift_scale: float = 1.0
    """Factor on the lift height of the next torso motion."""


NO_GAIT_RESIDUAL = GaitResidual()


@dataclass(frozen=True, slots=True)
class Step:
    """One run through some phases."""

    phases: tuple[str, ...]
    """In order."""
    target: Planar | None = None
    """Where the torso lies at its end, world; None where it stays."""
    legs: tuple[int, ...] = (0, 1, 2, 3)
    """Which legs are lifted."""
    angle: float | None = None
    """How far they are raised, if not by the configuration [rad]."""
    height: float | None = None
    """How far the torso is lifted, if not by the configuration [m]."""
    seconds: float = 0.0
    """How long `hold` lasts [s]."""


@dataclass
class GaitMemory:
    """All that the gait remembers from one tick to the next."""

    steps: list[Step]
    """What is still to do, the present step first."""
    plan: JointVector
    """Planned joint setpoints [rad]."""
    position_w: Vector3
    """Filtered position of the torso [m]."""
    R_wb: Matrix3
    """Attitude of the torso."""
    joints: JointVector
    """Filtered joint angles [rad]."""
    phase: str = "done"
    """One of `PHASES`."""
    index: int = 0
    """Which phase of the step."""
    time: float = 0.0
    """Time in the phase [s]."""
    still: float = 0.0
    """For how long everything has been still and where it should be [s]."""
    target: JointVector = field(default_factory=lambda: np.zeros(N_JOINTS))
    """Joint angles that the legs go to in this phase [rad]."""
    landing: JointVector = field(default_factory=lambda: np.zeros(N_JOINTS))
    """Joint angles at the end of the step [rad]."""
    highest: JointVector = field(default_factory=lambda: np.zeros(N_JOINTS))
    """Inner pitches of the raised legs [rad]."""
    start: JointVector = field(default_factory=lambda: np.zeros(N_JOINTS))
    """Joint angles at the start of the step [rad]."""
    floor_R: Matrix3 = field(default_factory=lambda: np.eye(3))
    """Axes of the floor, world: the torso's when it lay on it."""
    floor_w: Vector3 = field(default_factory=lambda: np.zeros(3))
    """Where the torso lay [m]."""
    feet_f: FootForces = field(default_factory=lambda: np.zeros((N_LEGS, 3)))
    """Where the feet stand, floor axes, from where the torso lay [m]."""
    way: Planar = field(default_factory=Planar)
    """Way of the torso from there, floor axes."""
    share: float = 0.0
    """How much of the way is done."""
    height: float = 0.0
    """Planned height over where it lay [m]."""
    lift: float = 0.0
    """Height at which it moves [m]."""
    expected: Vector3 = field(default_factory=lambda: np.zeros(3))
    """Where the filtered pose should be by now, seen from where the torso lay: x, y [m], yaw [rad]."""
    yaw: float = 0.0
    """Filtered yaw from there [rad]."""
    trim: Vector3 = field(default_factory=lambda: np.zeros(3))
    """x, y [m] and yaw [rad] added to where the legs push the torso."""
    timeouts: int = 0
    """Phases that ended by time-out."""
    planned: Planar = field(default_factory=Planar)
    """Where the last command in the list ends, world."""


class Gait:
    """The crawl's phase machine: (pose, joint angles) → joint setpoints and mode, tick after tick."""

    def __init__(self, config: GaitConfig, *, joint_speed: float, dt: float) -> None:
        """Take the configuration, the joint speed [rad/s] and the length of a tick [s]."""
        self.config, self.joint_speed, self.dt = config, joint_speed, dt
        self.home_b = config.home_b
        self.memory: GaitMemory

    def reset(self, position_w: Vector3, R_wb: Matrix3, q: JointVector) -> None:
        """Lie on the floor, nothing to do."""
        self.memory = GaitMemory([], q.copy(), position_w.copy(), R_wb.copy(), q.copy())
        self.memory.planned = planar_pose(position_w, R_wb)
        self.memory.target = q.copy()
        self._lie()

    def command(self, commands: Iterable[GaitCommand]) -> int:
        """Append commands; returns how many steps they take (`InvalidValueError` for what is out of reach)."""
        steps: list[Step] = []
        planned = self.memory.planned
        for command in commands:
            if isinstance(command, Move):
                cycles = plan_cycles(self.config, command)
                steps += [Step(CYCLE, planned @ command.way.arc((k + 1) / cycles)) for k in range(cycles)]
                planned = planned @ command.way
            elif isinstance(command, Lift):
                if not command.legs or not all(leg in range(N_LEGS) for leg in command.legs):
                    raise InvalidValueError("legs", command.legs, f"some of 0 … {N_LEGS - 1}")
                require_not_negative(angle=command.angle, seconds=command.seconds)
                steps.append(Step(LIFT, None, command.legs, angle=command.angle, seconds=command.seconds))
            else:
                require_not_negative(height=command.height, seconds=command.seconds)
                if not stride_fits(self.config, Planar(), command.height):
                    raise InvalidValueError("height", command.height, "a height in reach [m]")
                steps.append(Step(STAND, None, height=command.height, seconds=command.seconds))
        self.memory.steps += steps
        self.memory.planned = planned
        return len(steps)

    @property
    def done(self) -> bool:
        """Whether nothing is left to do."""
        return self.memory.phase == "done" and not self.memory.steps

    @property
    def mode(self) -> str:
        """Allocation mode of the present phase, see `control.modes.ground_modes`."""
        memory = self.memory
        if memory.phase in _LEGS_UP or (memory.phase == "hold" and memory.steps[0].phases is LIFT):
            return "legs" if len(memory.steps[0].legs) == N_LEGS else "leg"
        return "stance" if memory.phase in _ON_FEET or memory.phase == "hold" else "rest"

    @property
    def lifted(self) -> np.ndarray:
        """Legs that the present mode lifts (4,)."""
        mask = np.zeros(N_LEGS, bool)
        if self.mode in ("leg", "legs"):
            mask[list(self.memory.steps[0].legs)] = True
        elif self.mode == "stance":
            mask[:] = True
        return mask

    def step(
        self, position_w: Vector3, R_wb: Matrix3, q: JointVector, residual: GaitResidual = NO_GAIT_RESIDUAL
    ) -> JointVector:
        """One tick: where the joints are told to be [rad].

        Args:
            position_w: Origin of the torso [m].
            R_wb: Attitude of the torso.
            q: Joint angles [rad].
            residual: What a policy adds.
        """
        memory, dt = self.memory, self.dt
        share = 1.0 - math.exp(-dt / FILTER_TIME)
        move = share * (position_w - memory.position_w)
        turn = share * (q - memory.joints)
        memory.position_w, memory.joints, memory.R_wb = memory.position_w + move, memory.joints + turn, R_wb
        memory.time += dt
        if memory.phase == "done" and memory.steps:
            self._enter(0, residual)
        if memory.phase != "done":
            self._advance(residual, float(np.abs(turn).max()) / dt, float(np.linalg.norm(move)) / dt)
        return memory.plan

    def _advance(self, residual: GaitResidual, joint_rate: float, torso_rate: float) -> None:
        memory, config = self.memory, self.config
        speed = self.joint_speed * max(0.0, residual.phase_rate)
        if memory.phase in _ON_FEET or (memory.phase == "hold" and self.mode == "stance"):
            self._track()
            self._trim()
            self._push(speed)
        elif memory.phase in _LEGS_UP or memory.phase == "hold":
            reach = speed * self.dt
            way = memory.target - memory.plan
            memory.plan = memory.plan + np.minimum(np.maximum(way, -reach), reach)
        ended = self._ended(joint_rate, torso_rate)
        if not ended and memory.time >= config.timeout and memory.phase not in ("hold", "spool", "brace", "settle"):
            memory.timeouts += 1
            ended = True
        if ended:
            self._enter(memory.index + 1, residual)

    def _ended(self, joint_rate: float, torso_rate: float) -> bool:
        """Whether the present phase has reached what it is for."""
        memory, config = self.memory, self.config
        phase = memory.phase
        if phase in ("spool", "brace"):
            return memory.time >= config.spool_time - 1e-9
        if phase == "settle":
            return memory.time >= config.settle_time - 1e-9
        if phase == "hold":
            return memory.time >= memory.steps[0].seconds - 1e-9
        legs = list(memory.steps[0].legs)
        if phase == "raise":
            rows = INNER[legs]
            whole = memory.start[rows] - memory.highest[rows]
            done = (memory.start[rows] - memory.plan[rows]) / np.maximum(whole, 1e-6)
            late = config.swing_at >= 1.0 and np.abs(memory.joints[rows] - memory.highest[rows]).max() > 0.05
            return bool(done.min() >= config.swing_at - 1e-6 and not late)
        if phase == "swing":
            rows = np.concatenate((YAW[legs], OUTER[legs]))
            return bool(np.abs(memory.joints[rows] - memory.landing[rows]).max() <= config.lower_at)
        if phase == "lower":
            rows = INNER[legs]
            there = (
                np.abs(memory.plan - memory.landing).max() < 1e-9
                and np.abs(memory.joints[rows] - memory.landing[rows]).max() < 0.1
                and joint_rate < 0.05
            )
            return self._still(there, config.leg_touch_time)
        error, depth = self._error()
        if phase == "up":
            return memory.height >= config.forward_at * memory.lift - 1e-9
        if phase == "forward":
            near = memory.share >= config.down_at - 1e-9
            if config.down_at >= 1.0:
                arrived = math.hypot(error[0], error[1]) <= config.arrival and abs(error[2]) <= 0.003
                near = near and arrived
            return near
        there = memory.height <= -config.press + 1e-9 and memory.share >= 1.0 and torso_rate < 0.01 and depth < 0.05
        return self._still(there, config.torso_touch_time)

    def _still(self, there: bool, duration: float) -> bool:
        memory = self.memory
        memory.still = memory.still + self.dt if there else 0.0
        return memory.still >= duration - 1e-9

    def _enter(self, index: int, residual: GaitResidual) -> None:
        """Begin a phase of the present step; after its last one the next step or nothing."""
        memory, config = self.memory, self.config
        step = memory.steps[0]
        if index >= len(step.phases):
            memory.steps = memory.steps[1:]
            if not memory.steps:
                memory.phase, memory.index, memory.time = "done", 0, 0.0
                return
            index, step = 0, memory.steps[0]
        phase = step.phases[index]
        if phase == "settle" and config.settle_time == 0.0 and len(memory.steps) > 1:
            self._lie()
            return self._enter(index + 1, residual)
        memory.phase, memory.index, memory.time, memory.still = phase, index, 0.0, 0.0
        legs = list(step.legs)
        if phase == "spool":
            self._lie()
            self._footsteps(step, residual)
            memory.target = memory.plan.copy()
        elif phase == "raise":
            memory.target = memory.plan.copy()
            memory.target[INNER[legs]] = memory.highest[INNER[legs]]
        elif phase == "swing":
            for rows in (YAW[legs], OUTER[legs]):
                memory.target[rows] = memory.landing[rows]
            memory.target[OUTER[legs] - 1] = memory.landing[OUTER[legs] - 1]
        elif phase == "lower":
            memory.target = memory.landing.copy()
        elif phase == "brace":
            self._lie()
            self._stance(step, residual)
        elif phase == "settle":
            self._lie()
        return None

    def _lie(self) -> None:
        """The torso lies on the floor: targets are reset to where the joints are, and this is where the floor is."""
        memory = self.memory
        memory.plan = memory.joints.copy()
        memory.floor_w, memory.floor_R = memory.position_w.copy(), memory.R_wb.copy()

    def _way(self, target: Planar | None) -> Planar:
        """The way to a pose in the world, floor axes: along a slope it is longer than it looks from above."""
        memory = self.memory
        here = planar_pose(memory.floor_w, memory.floor_R)
        if target is None:
            return Planar()
        x, y = np.linalg.solve(memory.floor_R[:2, :2], [target.x - here.x, target.y - here.y]).tolist()
        return Planar(x, y, math.remainder(target.yaw - here.yaw, 2.0 * math.pi))

    def _footsteps(self, step: Step, residual: GaitResidual) -> None:
        """Where the lifted legs go [Zhao2025, Sec. Crawling Gait, Step 1]."""
        memory, config = self.memory, self.config
        way = self._way(step.target).arc(max(0.0, residual.stride_scale))
        legs = list(step.legs)
        landing = memory.plan.copy()
        if step.target is not None:
            centred = config.stride == "centred"
            # Errors of the last cycle may make this one longer than planned: it stays within the reach.
            while way.distance + abs(way.yaw) > 1e-6 and not stride_fits(config, way):
                way = way.arc(0.95)
            feet = way.arc(0.5 if centred else 1.0).move(self.home_b) - (0.0, 0.0, config.press)
            angles = leg_angles(feet)
            landing = memory.plan if angles is None else angles
        angle = config.raise_angle * residual.raise_scale if step.angle is None else step.angle
        highest = landing.copy()
        highest[INNER] = np.minimum(memory.plan[INNER], landing[INNER]) - angle
        memory.start, memory.landing, memory.highest = memory.plan.copy(), memory.plan.copy(), highest
        for k in range(4):
            rows = 4 * np.array(legs) + k
            memory.landing[rows] = landing[rows]

    def _stance(self, step: Step, residual: GaitResidual) -> None:
        """Where the feet stand and where the torso goes [Zhao2025, Sec. Crawling Gait, Step 2]."""
        memory, config = self.memory, self.config
        memory.way = self._way(step.target).arc(max(0.0, residual.stride_scale))
        memory.feet_f = _feet(memory.joints)
        memory.share, memory.height, memory.trim = 0.0, 0.0, np.zeros(3)
        memory.expected, memory.yaw = np.zeros(3), 0.0
        memory.lift = (config.lift_height if step.height is None else step.height) * residual.lift_scale
        while memory.lift > 0.01 and self._reach(1.0, memory.lift) is None:
            memory.lift *= 0.95

    def _reach(self, share: float, height: float) -> JointVector | None:
        """Joint angles that hold the torso at a share of its way and a height, trim included."""
        memory = self.memory
        pose = memory.way.arc(share)
        x, y, yaw = memory.trim.tolist()
        pose = Planar(pose.x + x, pose.y + y, pose.yaw + yaw)
        return leg_angles(pose.inverse().move(memory.feet_f) - (0.0, 0.0, height))

    def _push(self, speed: float) -> None:
        """Move the torso's plan on, as fast as the joints follow."""
        memory, config = self.memory, self.config
        phase, reach = memory.phase, speed * self.dt
        distance = max(memory.way.distance, 0.5 * abs(memory.way.yaw), 1e-6)
        goal_height = memory.lift
        if phase == "brace":
            goal_height = 0.0
        elif phase == "down":
            goal_height = -config.press
        goal_share = 1.0 if phase in ("forward", "down") else memory.share
        climb, advance = goal_height - memory.height, (goal_share - memory.share) * distance
        longest = max(abs(climb), abs(advance))
        now = self._reach(memory.share, memory.height)
        if longest > 0.0 and now is not None:
            # A trial step tells how far the joints turn for it; the step is then as long as they allow.
            trial = min(longest, 0.002)
            ahead = self._reach(
                memory.share + _towards(advance, trial) / distance, memory.height + _towards(climb, trial)
            )
            if ahead is not None:
                step = min(longest, trial * reach / max(float(np.abs(ahead - now).max()), 1e-9))
                memory.height += _towards(climb, step)
                memory.share += _towards(advance, step) / distance
                if abs(climb) <= step:
                    memory.height = goal_height
                if abs(advance) <= step:
                    memory.share = goal_share
        wanted = self._reach(memory.share, memory.height)
        if wanted is not None:
            before = memory.plan
            way = wanted - before
            memory.plan = before + np.minimum(np.maximum(way, -reach), reach)
            if config.rolling:
                self._roll(memory.plan - before)

    def _roll(self, turn: JointVector) -> None:
        """A leg that turns down by an angle rolls its ball outwards by the radius times that: where the feet are then."""
        memory = self.memory
        turned = memory.way.arc(memory.share).yaw
        for leg in range(N_LEGS):
            out = ROBOT.foot_radius * float(turn[4 * leg + 1] + turn[4 * leg + 3])
            heading = ROBOT.leg_azimuth(leg) + float(memory.plan[4 * leg]) + turned
            memory.feet_f[leg, :2] += out * math.cos(heading), out * math.sin(heading)

    def _track(self) -> None:
        """Follow the torso's yaw, and where its filtered pose should be by now."""
        memory = self.memory
        turned = memory.floor_R.T @ memory.R_wb
        yaw = math.atan2(turned[1, 0], turned[0, 0])
        memory.yaw += (1.0 - math.exp(-self.dt / FILTER_TIME)) * (yaw - memory.yaw)
        wanted = memory.way.arc(memory.share)
        share = 1.0 - math.exp(-self.dt / RESPONSE_TIME)
        memory.expected = memory.expected + share * (np.array([wanted.x, wanted.y, wanted.yaw]) - memory.expected)

    def _error(self) -> tuple[Vector3, float]:
        """Expected − filtered pose of the torso along the floor, x, y [m], yaw [rad]; and how far its height is off."""
        memory = self.memory
        x, y, z = ((memory.position_w - memory.floor_w) @ memory.floor_R).tolist()
        return memory.expected - (x, y, memory.yaw), abs(memory.height - z)

    def _trim(self) -> None:
        """Feet are balls that roll when their legs turn, so the torso does not go as far as the kinematics say."""
        memory, config = self.memory, self.config
        if memory.phase != "forward" or config.trim_gain == 0.0:
            return
        error, _ = self._error()
        limit = np.array([config.trim_limit, config.trim_limit, 2.0 * config.trim_limit])
        memory.trim = np.minimum(np.maximum(memory.trim + config.trim_gain * self.dt * error, -limit), limit)


def _towards(way: float, step: float) -> float:
    return max(-step, min(step, way))


def _feet(q: JointVector) -> FootForces:
    """Centres of the feet, torso axes [m], outer yaw joints included."""
    feet = np.zeros((N_LEGS, 3))
    for leg in range(N_LEGS):
        yaw, inner, twist, outer = q[4 * leg : 4 * leg + 4].tolist()
        azimuth = ROBOT.leg_azimuth(leg)
        # In the axes of the inner link: junction offset along x, then the outer link turned by twist and outer pitch.
        reach = ROBOT.yaw_to_pitch + ROBOT.pitch_to_foot * math.cos(outer)
        x = ROBOT.pitch_to_yaw + reach * math.cos(twist)
        y, z = reach * math.sin(twist), -ROBOT.pitch_to_foot * math.sin(outer)
        out = ROBOT.yaw_to_pitch + x * math.cos(inner) + z * math.sin(inner)
        down = -x * math.sin(inner) + z * math.cos(inner)
        c, s = math.cos(azimuth + yaw), math.sin(azimuth + yaw)
        hip_x, hip_y = (ROBOT.yaw_axis_radius * f(azimuth) for f in (math.cos, math.sin))
        feet[leg] = hip_x + out * c - y * s, hip_y + out * s + y * c, ROBOT.yaw_axis_z + down
    return feet


def lying_pose(config: GaitConfig) -> JointVector:
    """Joint angles of the robot at rest: torso on its pegs, feet at home on the floor [rad]."""
    angles = leg_angles(config.home_b)
    assert angles is not None
    return angles


def total_way(commands: Sequence[GaitCommand]) -> Planar:
    """Where commands end, seen from where they begin."""
    pose = Planar()
    for command in commands:
        if isinstance(command, Move):
            pose = pose @ command.way
    return pose


