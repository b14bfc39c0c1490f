"""Gait of the crawl: commands → cycles → phases → joint setpoints and allocation mode [Zhao2025, Sec. Crawling Gait].

The inputs are the torso's pose and the joint angles, not forces. Touchdown is detected by thresholds on them, because
neither feet nor torso have a touch sensor.
"""

import math
from collections.abc import Iterable, Sequence

import numpy as np

from spidar_gym.arrays import JointVector, Matrix3, Vector3
from spidar_gym.control.crawl.footsteps import GaitCommand, GaitConfig, Lift, Move, lying_pose, plan_cycles, stride_fits
from spidar_gym.control.crawl.kinematics import INNER, OUTER, YAW, feet_at, leg_angles
from spidar_gym.control.crawl.phases import CYCLE, LIFT, STAND, GaitMemory, Step
from spidar_gym.control.crawl.pose2 import Pose2, torso_pose2
from spidar_gym.errors import InvalidValueError, require_not_negative
from spidar_gym.robot import N_JOINTS, N_LEGS
from spidar_gym.so3 import rotation_z
from spidar_gym.state import NO_RESIDUAL, Residual

FILTER_TIME = 0.1
"""Time constant of the filters on pose and joint angles [s]."""
SLOW_TIME = 0.25
"""Time constant of a slower filter on the position [s]; the torso is at rest when both filters agree."""
AGREE = 0.0025
"""The two filters agree when their heights differ by less than this [m]."""
NEAR = 0.05
"""A joint has reached its target within this distance [rad] [JSK]."""
STILL = 0.05
"""The joints are still when their filtered angles are slower than this [rad/s]."""
SWINGING = 0.15
"""With corrections, share at which time counts in which feet that have touched down swing about their targets, as legs
that hardly damp do for long."""
MAX_DEPTH = 0.05
"""The torso has touched the floor only if its height is closer than this to its plan [m]."""
RESPONSE_TIME = 0.17
"""Time constant with which the filtered pose follows its plan: filter, servos, delay [s]."""
SHORTEN = 0.95
"""A stride or a lift that is out of reach is shortened by this factor until it is in reach."""
LEAST_LIFT = 0.01
"""A lift is not shortened below this [m]."""
MISSED, MISSED_TURN = 0.006, 0.012
"""A torso that lies farther from the goal of its move has missed it [m], [rad]: six tenths of a success's limits."""
TRIAL = 0.002
"""Length of the trial step of the torso that determines the joint rates [m]."""
_LEGS_UP = frozenset(("spool", "raise", "swing", "lower"))
ON_FEET = frozenset(("brace", "up", "forward", "down"))
"""Phases in which all feet stand and the torso moves."""


class Gait:
    """The crawl's phase machine: (pose, joint angles) → setpoints and mode [Zhao2025, Sec. Crawling Gait]."""

    def __init__(self, config: GaitConfig, *, joint_speed: float, dt: float) -> None:
        """Set the configuration, the joint speed [rad/s] and the length of a tick [s]."""
        self.config, self.joint_speed, self.dt = config, joint_speed, dt
        self.home_b = config.home_b
        self.memory: GaitMemory
        self.reset(np.zeros(3), np.eye(3), np.zeros(N_JOINTS))

    def reset(self, position_w: Vector3, R_wb: Matrix3, q: JointVector) -> None:
        """Start lying on the floor with an empty queue."""
        self.memory = GaitMemory([], q.copy(), position_w.copy(), position_w.copy(), R_wb.copy(), q.copy())
        self.memory.planned = torso_pose2(position_w, R_wb)
        self.memory.target = q.copy()
        self._lie()

    def command(self, commands: Iterable[GaitCommand]) -> int:
        """Append commands and return the number of their steps (`InvalidValueError` if one is out of reach)."""
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
                if not stride_fits(self.config, Pose2(), command.height):
                    raise InvalidValueError("height", command.height, "a height in reach [m]")
                steps.append(Step(STAND, None, height=command.height, seconds=command.seconds))
        self.memory.steps += steps
        self.memory.planned = planned
        return len(steps)

    @property
    def done(self) -> bool:
        """Whether all commands are executed."""
        return self.memory.phase == "done" and not self.memory.steps

    @property
    def phase(self) -> str:
        """One of `PHASES`."""
        return self.memory.phase

    @property
    def timeouts(self) -> int:
        """Number of phases that ended by time-out."""
        return self.memory.timeouts

    @property
    def swinging(self) -> np.ndarray:
        """Legs whose feet are in the air (4,)."""
        mask = np.zeros(N_LEGS, bool)
        if self.memory.phase == "swing":
            mask[list(self.memory.steps[0].legs)] = True
        return mask

    @property
    def mode(self) -> str:
        """Allocation mode of the present phase, see `control.allocation.modes.ground_modes`."""
        memory = self.memory
        if memory.phase in _LEGS_UP or (memory.phase == "hold" and memory.steps[0].phases == LIFT):
            return "legs" if len(memory.steps[0].legs) == N_LEGS else "leg"
        return "stance" if memory.phase in ON_FEET or memory.phase == "hold" else "rest"

    @property
    def lifted(self) -> np.ndarray:
        """Legs whose joint torque is allocated (4,): the lifted legs, or all legs in `stance`."""
        mask = np.zeros(N_LEGS, bool)
        if self.mode in ("leg", "legs"):
            mask[list(self.memory.steps[0].legs)] = True
        elif self.mode == "stance":
            mask[:] = True
        return mask

    def step(self, position_w: Vector3, R_wb: Matrix3, q: JointVector, residual: Residual = NO_RESIDUAL) -> JointVector:
        """Compute the joint setpoints of one tick [rad].

        Args:
            position_w: Origin of the torso [m].
            R_wb: Attitude of the torso.
            q: Joint angles [rad].
            residual: Additions of a policy.
        """
        memory, dt = self.memory, self.dt
        smoothing = 1.0 - math.exp(-dt / FILTER_TIME)
        turn = smoothing * (q - memory.joints)
        memory.joints, memory.R_wb = memory.joints + turn, R_wb
        memory.position_w = memory.position_w + smoothing * (position_w - memory.position_w)
        memory.slow_w = memory.slow_w + (1.0 - math.exp(-dt / SLOW_TIME)) * (position_w - memory.slow_w)
        memory.time += dt
        if memory.phase == "done" and memory.steps:
            self._enter(0, residual)
        if memory.phase != "done":
            self._advance(residual, float(np.abs(turn).max()) / dt)
        return memory.plan

    def _advance(self, residual: Residual, joint_rate: float) -> None:
        memory, config = self.memory, self.config
        speed = self.joint_speed * max(0.0, residual.joint_speed_scale)
        if memory.phase in ON_FEET or (memory.phase == "hold" and self.mode == "stance"):
            self._track()
            self._trim()
            self._push(speed)
        elif memory.phase in _LEGS_UP or memory.phase == "hold":
            reach = speed * self.dt
            ahead = memory.target - memory.plan
            memory.plan = memory.plan + np.minimum(np.maximum(ahead, -reach), reach)
        ended = self._ended(joint_rate)
        if not ended and memory.time >= config.timeout and memory.phase not in ("hold", "spool", "brace", "settle"):
            memory.timeouts += 1
            ended = True
        if ended:
            self._enter(memory.index + 1, residual)

    def _ended(self, joint_rate: float) -> bool:
        """Whether the present phase has reached its end; `joint_rate` is the filtered rate of the fastest joint."""
        memory, config = self.memory, self.config
        spool = config.start_time if memory.rested else config.spool_time
        waits = {"spool": spool, "brace": spool, "settle": config.settle_time, "hold": memory.steps[0].seconds}
        if memory.phase in waits:
            return memory.time >= waits[memory.phase] - 1e-9
        if memory.phase in _LEGS_UP:
            legs = list(memory.steps[0].legs)
            ends = {"raise": self._raised, "swing": self._swung, "lower": self._touched}
            return ends[memory.phase](legs, joint_rate < STILL)
        return {"up": self._lifted_torso, "forward": self._arrived, "down": self._landed}[memory.phase]()

    def _raised(self, legs: list[int], still: bool) -> bool:
        memory, config, rows = self.memory, self.config, INNER[legs]
        whole = memory.start[rows] - memory.highest[rows]
        done = (memory.start[rows] - memory.plan[rows]) / np.maximum(whole, 1e-6)
        if done.min() < config.swing_at - 1e-6:
            return False
        near = config.swing_at < 1.0 or bool(np.abs(memory.joints[rows] - memory.highest[rows]).max() <= NEAR)
        return near or self._still(still, config.stall_time)

    def _swung(self, legs: list[int], still: bool) -> bool:
        memory, config = self.memory, self.config
        rows = np.concatenate((YAW[legs], OUTER[legs]))
        if np.abs(memory.plan[rows] - memory.landing[rows]).max() > config.lower_at:
            return False
        near = bool(np.abs(memory.joints[rows] - memory.landing[rows]).max() <= config.lower_at)
        return near or self._still(still, config.stall_time)

    def _touched(self, legs: list[int], still: bool) -> bool:
        """Whether the feet have touched down: near their targets and still for `leg_touch_time`."""
        memory, rows = self.memory, INNER[legs]
        planned = float(np.abs(memory.plan - memory.landing).max()) < 1e-9
        near = float(np.abs(memory.joints[rows] - memory.landing[rows]).max()) < 3.0 * NEAR
        if planned and near and not still and self.config.corrections:
            memory.still += SWINGING * self.dt
            return memory.still >= self.config.leg_touch_time - 1e-9
        return self._still(planned and near and still, self.config.leg_touch_time)

    def _lifted_torso(self) -> bool:
        return self.memory.height >= self.config.forward_at * self.memory.lift - 1e-9

    def _arrived(self) -> bool:
        memory, config = self.memory, self.config
        if memory.share < config.down_at - 1e-9:
            return False
        error, _ = self._error()
        near = math.hypot(error[0], error[1]) <= config.arrival and abs(error[2]) <= config.arrival
        if config.corrections and self._is_last:
            # The plan is ahead of the torso, which would be lowered short of the goal.
            wanted = memory.way.arc(memory.share)
            ahead = math.hypot(wanted.x - memory.expected[0], wanted.y - memory.expected[1])
            near = near and ahead <= config.arrival
        # After half the time-out the remaining error is left for the next cycle.
        ended = bool(near) or config.down_at < 1.0 or memory.time >= 0.5 * config.timeout
        return ended or self._stalled()

    def _landed(self) -> bool:
        """Whether the torso has touched down: near the floor and not sinking for `torso_touch_time`."""
        memory, config = self.memory, self.config
        _, depth = self._error()
        sinking = abs(float((memory.position_w - memory.slow_w) @ memory.floor_R[:, 2]))
        planned = memory.height <= -config.press + 1e-9 and memory.share >= 1.0
        if not planned and config.corrections:
            return self._stalled()
        return self._still(planned and sinking < AGREE and depth < MAX_DEPTH, config.torso_touch_time)

    def _stalled(self) -> bool:
        """Whether corrections are left to do what the torso, at rest for `stall_time`, has not done."""
        memory = self.memory
        if not self.config.corrections:
            return False
        away = np.abs(memory.position_w - memory.slow_w).max()
        return self._still(bool(away < AGREE), self.config.stall_time)

    def _still(self, there: bool, duration: float) -> bool:
        memory = self.memory
        memory.still = memory.still + self.dt if there else 0.0
        return memory.still >= duration - 1e-9

    def _enter(self, index: int, residual: Residual) -> None:
        """Begin a phase of the present step; after its last phase begin the next step, or finish."""
        memory, config = self.memory, self.config
        step = memory.steps[0]
        if index >= len(step.phases):
            missed, index = self._missed(), 0
            if missed > 0.0:
                memory.corrected += 1
                # Feet that stand where they should move the torso over this distance without steps.
                index = step.phases.index("brace") if missed <= config.trim_limit else 0
            else:
                memory.corrected, memory.steps = 0, memory.steps[1:]
            if not memory.steps:
                memory.phase, memory.index, memory.time = "done", 0, 0.0
                return
            step = memory.steps[0]
        phase = step.phases[index]
        if phase == "settle" and config.settle_time == 0.0 and len(memory.steps) > 1:
            self._enter(index + 1, residual)
            return
        memory.rested = memory.phase in ("done", "settle")
        memory.phase, memory.index, memory.time, memory.still = phase, index, 0.0, 0.0
        self._aim(step, residual)

    def _missed(self) -> float:
        """Return how far the torso has missed the goal of a move in its last cycle; half a radian is a metre [m].

        It is 0 for a torso that lies within `MISSED` and `MISSED_TURN`, and where no correction is left.
        """
        memory, target = self.memory, self.memory.steps[0].target
        if target is None or memory.corrected >= self.config.corrections or not self._is_last:
            return 0.0
        here = torso_pose2(memory.position_w, memory.R_wb)
        turn = abs(math.remainder(target.yaw - here.yaw, 2.0 * math.pi))
        distance = math.hypot(target.x - here.x, target.y - here.y)
        return max(distance, 0.5 * turn) if distance > MISSED or turn > MISSED_TURN else 0.0

    @property
    def _is_last(self) -> bool:
        """Whether the present cycle is the last one of all moves in the queue that follow each other."""
        return len(self.memory.steps) == 1 or self.memory.steps[1].target is None

    def _aim(self, step: Step, residual: Residual) -> None:
        """Set the targets of the phase that begins."""
        memory, pitches = self.memory, INNER[list(step.legs)]
        if memory.phase in ("spool", "brace", "settle"):
            self._lie()
        if memory.phase == "spool":
            self._footsteps(step, residual)
        elif memory.phase == "raise":
            memory.target = memory.plan.copy()
            memory.target[pitches] = memory.highest[pitches]
        elif memory.phase == "swing":
            raised = memory.target[pitches]
            memory.target = memory.landing.copy()
            memory.target[pitches] = raised
        elif memory.phase == "lower":
            memory.target = memory.landing.copy()
        elif memory.phase == "brace":
            self._stance(step, residual)

    def _lie(self) -> None:
        """Set the targets to the measured joint angles, and the floor to the pose of the lying torso."""
        memory = self.memory
        memory.plan, memory.target = memory.joints.copy(), memory.joints.copy()
        memory.floor_w, memory.floor_R = memory.position_w.copy(), memory.R_wb.copy()

    def _way(self, target: Pose2 | None) -> Pose2:
        """Compute the displacement to a pose in the world, floor axes; on a slope it is longer than its projection."""
        memory = self.memory
        here = torso_pose2(memory.floor_w, memory.floor_R)
        if target is None:
            return Pose2()
        x, y = np.linalg.solve(memory.floor_R[:2, :2], [target.x - here.x, target.y - here.y]).tolist()
        return Pose2(x, y, math.remainder(target.yaw - here.yaw, 2.0 * math.pi))

    def _footsteps(self, step: Step, residual: Residual) -> None:
        """Compute the footsteps of the lifted legs [Zhao2025, Sec. Crawling Gait]."""
        memory, config = self.memory, self.config
        way = self._way(step.target).arc(max(0.0, residual.stride_scale))
        legs = list(step.legs)
        landing = memory.plan.copy()
        if step.target is not None:
            centred = config.stride == "centred"
            # Errors of the last cycle may make this one longer than planned, so it is shortened to the reach.
            while way.distance + abs(way.yaw) > 1e-6 and not stride_fits(config, way):
                way = way.arc(SHORTEN)
            feet = way.arc(0.5 if centred else 1.0).move(self.home_b) - (0.0, 0.0, config.press)
            angles = leg_angles(feet, config.robot)
            landing = memory.plan if angles is None else angles
        angle = config.raise_angle * residual.raise_scale if step.angle is None else step.angle
        highest = landing.copy()
        highest[INNER] = np.minimum(memory.plan[INNER], landing[INNER]) - angle
        memory.start, memory.landing, memory.highest = memory.plan.copy(), memory.plan.copy(), highest
        for k in range(4):
            rows = 4 * np.array(legs) + k
            memory.landing[rows] = landing[rows]

    def _stance(self, step: Step, residual: Residual) -> None:
        """Set the positions of the feet and the displacement of the torso [Zhao2025, Sec. Crawling Gait]."""
        memory, config = self.memory, self.config
        memory.way = self._way(step.target).arc(max(0.0, residual.stride_scale))
        memory.feet_f = feet_at(memory.joints, config.robot)
        memory.share, memory.height, memory.trim = 0.0, 0.0, np.zeros(3)
        memory.expected, memory.yaw = np.zeros(3), 0.0
        memory.lift = (config.lift_height if step.height is None else step.height) * residual.lift_scale
        while memory.lift > LEAST_LIFT and self._reach(1.0, memory.lift) is None:
            memory.lift *= SHORTEN
        while config.corrections and memory.way.distance + abs(memory.way.yaw) > 1e-6:
            if self._reach(1.0, memory.lift) is not None and self._reach(1.0, -config.press) is not None:
                break
            memory.way = memory.way.arc(SHORTEN)
        end = self._reach(1.0, 0.0)
        memory.target = memory.plan if end is None else end

    def _reach(self, share: float, height: float) -> JointVector | None:
        """Compute the joint angles for a share of the torso's displacement and a height, including the trim."""
        memory = self.memory
        pose = memory.way.arc(share)
        x, y, yaw = memory.trim.tolist()
        pose = Pose2(pose.x + x, pose.y + y, pose.yaw + yaw)
        return leg_angles(pose.inverse().move(memory.feet_f) - (0.0, 0.0, height), self.config.robot)

    def _push(self, speed: float) -> None:
        """Advance the planned pose of the torso as fast as the joint speed allows."""
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
            # A trial step determines how far the joints turn per length; the step is then as long as they allow.
            trial = min(longest, TRIAL)
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
            memory.plan = before + np.minimum(np.maximum(wanted - before, -reach), reach)
            if config.rolling:
                self._roll(memory.plan - before)

    def _roll(self, turn: JointVector) -> None:
        """Shift the feet: a leg that turns down by an angle rolls its ball outwards by the radius times the angle."""
        memory, robot = self.memory, self.config.robot
        turned = memory.way.arc(memory.share).yaw
        for leg in range(N_LEGS):
            out = robot.foot_radius * float(turn[4 * leg + 1] + turn[4 * leg + 3])
            heading = robot.leg_azimuth(leg) + float(memory.plan[4 * leg]) + turned
            memory.feet_f[leg, :2] += out * math.cos(heading), out * math.sin(heading)

    def _track(self) -> None:
        """Filter the torso's yaw and update its expected filtered pose."""
        memory = self.memory
        turned = memory.floor_R.T @ memory.R_wb
        yaw = math.atan2(turned[1, 0], turned[0, 0])
        memory.yaw += (1.0 - math.exp(-self.dt / FILTER_TIME)) * (yaw - memory.yaw)
        wanted = memory.way.arc(memory.share)
        smoothing = 1.0 - math.exp(-self.dt / RESPONSE_TIME)
        memory.expected = memory.expected + smoothing * (np.array([wanted.x, wanted.y, wanted.yaw]) - memory.expected)

    def _error(self) -> tuple[Vector3, float]:
        """Compute expected − filtered pose of the torso, x, y [m], yaw [rad], and its absolute height error [m]."""
        memory = self.memory
        x, y, z = ((memory.position_w - memory.floor_w) @ memory.floor_R).tolist()
        return memory.expected - (x, y, memory.yaw), abs(memory.height - z)

    def _trim(self) -> None:
        """Integrate the torso's error into the trim, because rolling feet shorten or lengthen the displacement."""
        memory, config = self.memory, self.config
        if memory.phase != "forward" or config.trim_gain == 0.0:
            return
        error, _ = self._error()
        limit = np.array([config.trim_limit, config.trim_limit, 2.0 * config.trim_limit])
        memory.trim = np.minimum(np.maximum(memory.trim + config.trim_gain * self.dt * error, -limit), limit)


def _towards(distance: float, step: float) -> float:
    return max(-step, min(step, distance))


def nominal_time(
    config: GaitConfig, commands: Sequence[GaitCommand], *, joint_speed: float, dt: float, kind: type[Gait] = Gait
) -> float:
    """Compute the duration of commands on flat ground if joints and torso follow the plan of the gait exactly [s]."""
    gait = kind(config, joint_speed=joint_speed, dt=dt)
    lying = np.array([0.0, 0.0, config.robot.peg_depth])
    gait.reset(lying, np.eye(3), lying_pose(config))
    gait.command(commands)
    position, yaw, q, ticks = lying, 0.0, gait.memory.plan, 0
    while not gait.done:
        q = gait.step(position, rotation_z(yaw), q)
        ticks += 1
        memory = gait.memory
        if memory.phase in ON_FEET:
            pose = memory.way.arc(memory.share)
            position = memory.floor_w + memory.floor_R @ (pose.x, pose.y, max(memory.height, 0.0))
            yaw = pose.yaw + math.atan2(memory.floor_R[1, 0], memory.floor_R[0, 0])
    return ticks * dt
