"""Action modes: a table of modes, each a list of channels with their authority."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
from functools import lru_cache, partial

import numpy as np
from numpy.typing import ArrayLike

from spidar_gym.arrays import JointVector
from spidar_gym.control.course.gates import CEILING
from spidar_gym.control.course.target import SWEEP, WAY
from spidar_gym.control.flight.controller import CONTROL_RATE, FlightController
from spidar_gym.control.grasp.phases import SAFE_GRIP, STEER_RADIUS, STEER_SPEED, STEER_TURN
from spidar_gym.control.interface import CrawlControl, FlightControl
from spidar_gym.control.locomotion.commands import SPEEDS
from spidar_gym.errors import InvalidValueError, require_name, require_within
from spidar_gym.model.rotor import MIN_FORCE, aim
from spidar_gym.robot import N_JOINTS, N_LEGS, N_ROTORS, ROBOT, RobotSpec
from spidar_gym.state import Command, Residual


def wrench_authority(robot: RobotSpec) -> np.ndarray:
    """Return the largest wrench residual per axis: a force of 15 % of the weight [N], a torque of 8 Nm."""
    return np.array([0.15 * robot.weight] * 3 + [8.0] * 3)


WRENCH_AUTHORITY = wrench_authority(ROBOT)
"""Largest wrench residual of the nominal robot."""
JOINT_AUTHORITY = 0.1
"""Largest offset of a joint target [rad]."""
SPEED_AUTHORITY = 0.5
"""Largest relative change of the planned joint speed."""
FORCE_AUTHORITY = 5.0
"""Largest force per axis and rotor, added after the allocation [N]."""
GAIT_AUTHORITY = 0.5
"""Largest relative change of raise angle, stride and lift height."""
LEG_AUTHORITY = 8.0
"""Largest force per axis and leg, added after the allocation [N]."""


def authorities(robot: RobotSpec) -> dict[str, ArrayLike]:
    """Return what an action of 1 adds, by channel in the core's order: one number for all entries or one for each."""
    return {
        "wrench": wrench_authority(robot),
        "joint_offset": JOINT_AUTHORITY,
        "joint_speed_scale": SPEED_AUTHORITY,
        "forces": FORCE_AUTHORITY,
        "gait": (SPEED_AUTHORITY, GAIT_AUTHORITY, GAIT_AUTHORITY, GAIT_AUTHORITY),
        "leg_forces": LEG_AUTHORITY,
    }


AUTHORITIES = authorities(ROBOT)
"""Authorities of the nominal robot."""


@dataclass(frozen=True)
class Channel:
    """Consecutive entries of an action with one meaning."""

    name: str
    """Name."""
    size: int
    """Number of entries."""
    authority: str
    """Range that −1 … 1 is scaled to, with unit."""


JOINTS = Channel("joint_offset", N_JOINTS, f"± {JOINT_AUTHORITY:g} rad on the joint targets q₁ … q₁₆")
SPEED = Channel("joint_speed_scale", 1, f"planned joint speed × (1 ± {SPEED_AUTHORITY:g}); the servo's limit stays")
GAIT = Channel(
    "gait", 4,
    f"phase rate × (1 ± {SPEED_AUTHORITY:g}), raise × (1 ± {GAIT_AUTHORITY:g}), stride × (1 ± {GAIT_AUTHORITY:g}), "
    f"lift height × (1 ± {GAIT_AUTHORITY:g})",
)  # fmt: skip
LEG_FORCES = Channel(
    "leg_forces",
    3 * N_LEGS,
    f"± {LEG_AUTHORITY:g} N on the sum of each leg's rotor forces, torso axes x, y, z of leg 0 …",
)
FOOT_FORCES = Channel(
    "leg_forces",
    3 * N_LEGS,
    f"± {LEG_AUTHORITY:g} N on the force with which each foot presses on the object, torso axes x, y, z of leg 0 …",
)
FORCES = Channel("forces", 3 * N_ROTORS, f"± {FORCE_AUTHORITY:g} N on each rotor force, link axes x, y, z of rotor 1 …")


def _wrench(action: np.ndarray, robot: RobotSpec) -> Residual:
    return Residual(wrench=wrench_authority(robot) * action)


def _joint(action: np.ndarray) -> Residual:
    return Residual(
        joint_offset=JOINT_AUTHORITY * action[:N_JOINTS],
        joint_speed_scale=1.0 + SPEED_AUTHORITY * float(action[N_JOINTS]),
    )


def _both(action: np.ndarray, robot: RobotSpec) -> Residual:
    joint = _joint(action[6:])
    return Residual(wrench_authority(robot) * action[:6], joint.joint_offset, joint.joint_speed_scale)


def _force(action: np.ndarray) -> Residual:
    return Residual(forces_l=FORCE_AUTHORITY * action.reshape(N_ROTORS, 3))


def _gait(action: np.ndarray) -> Residual:
    rate, lift, stride, height = action.tolist()
    return Residual(
        joint_speed_scale=1.0 + SPEED_AUTHORITY * rate,
        raise_scale=1.0 + GAIT_AUTHORITY * lift,
        stride_scale=1.0 + GAIT_AUTHORITY * stride,
        lift_scale=1.0 + GAIT_AUTHORITY * height,
    )


def _gait_force(action: np.ndarray) -> Residual:
    return replace(_gait(action[: GAIT.size]), leg_forces_b=LEG_AUTHORITY * action[GAIT.size :].reshape(N_LEGS, 3))


def _grasp(action: np.ndarray, robot: RobotSpec) -> Residual:
    feet = LEG_AUTHORITY * action[-3 * N_LEGS :].reshape(N_LEGS, 3)
    return replace(_both(action[: -3 * N_LEGS], robot), leg_forces_b=feet)


TORSO = "torso_forces"
"""Name of the action mode in torso axes."""
AIR, FLOOR = 1.0, 0.0
"""Share of the weight that the rotors bear at a zero action in torso axes: in flight, and on the floor."""


@dataclass(frozen=True)
class TorsoScale:
    """Zero and scale of an action in torso axes."""

    force: float = 3.0
    """Largest force per axis and rotor beyond the trim [N]."""
    joint: float = 0.1
    """Largest offset of a joint target [rad]; at 0 the action has no entries for joints."""
    trim: float = AIR
    """Share of the weight that the rotors bear in equal parts, along the torso's z axis, at a zero action."""

    def __post_init__(self) -> None:
        """Validate the numbers."""
        require_within(1e-3, 100.0, "N", force=self.force)
        require_within(0.0, math.pi, "rad", joint=self.joint)
        require_within(0.0, 2.0, "1", trim=self.trim)

    @classmethod
    def parse(cls, given: object, trim: float) -> "TorsoScale":
        """Return a scale from a `TorsoScale`, its numbers by name, or None for the default.

        Args:
            given: The scale.
            trim: Its default `trim`.

        Raises:
            UnknownNameError: For a number that does not exist; it lists the valid ones.
            InvalidValueError: For a value out of range.
        """
        if given is None:
            return cls(trim=trim)
        if isinstance(given, cls):
            return given
        if not isinstance(given, Mapping):
            raise InvalidValueError("action_scale", given, "numbers by name: force [N], joint [rad], trim")
        for name in given:
            require_name("number of action_scale", name, [field.name for field in fields(cls)])
        return cls(**{"trim": trim, **given})

    @property
    def channels(self) -> tuple[Channel, ...]:
        """Channels of the mode."""
        forces = Channel(
            "torso_forces", 3 * N_ROTORS,
            f"± {self.force:g} N on each rotor force beyond {self.trim / N_ROTORS:g} of the weight, torso axes x, y, z "
            "of rotor 1 …",
        )  # fmt: skip
        joints = Channel("joint_offset", N_JOINTS, f"± {self.joint:g} rad on the joint targets q₁ … q₁₆")
        return (forces, joints) if self.joint > 0.0 else (forces,)

    @property
    def authorities(self) -> dict[str, float]:
        """Value of an entry of 1, by channel."""
        return {"torso_forces": self.force, "joint_offset": self.joint}


@dataclass(frozen=True)
class ActionMode:
    """Channels of an action and their mapping to the controller's residual."""

    channels: tuple[Channel, ...]
    """Channels in the order of the action's entries."""
    residual: Callable[[np.ndarray], Residual] | None
    """Mapping from action to residual; None without a controller."""
    doc: str
    """Description of the mode."""
    scale: TorsoScale | None = None
    """Zero and scale of an action in torso axes; None for other modes."""
    share: float = 1.0
    """Share of the authority of its channels that an action of 1 has."""
    has_clock: bool = False
    """Whether the observation has a clock: a policy without a gait has no other measure of time."""

    @property
    def size(self) -> int:
        """Number of entries of an action."""
        return sum(channel.size for channel in self.channels)


def _torso_mode(scale: TorsoScale, around: str) -> ActionMode:
    return ActionMode(
        scale.channels, None,
        f"commands without any controller around a trim: forces of the rotors in torso axes, joints around {around}; "
        "for learning from nothing",
        scale,
    )  # fmt: skip


@lru_cache(maxsize=64)
def action_modes(robot: RobotSpec, scale: TorsoScale = TorsoScale()) -> dict[str, ActionMode]:
    """Return the action modes by name.

    A zero action is exactly the controller's command, except in `direct` and `torso_forces`.

    Args:
        robot: The described robot.
        scale: Zero and scale of `torso_forces`.
    """
    force, *_, torque = wrench_authority(robot)
    wrench = Channel("wrench", 6, f"± {force:.1f} N and ± {torque:g} Nm on the desired wrench, torso axes")
    quarter = "π/2" if robot.joint_limit == ROBOT.joint_limit else f"{robot.joint_limit:g}"
    return {
        "residual_wrench": ActionMode(
            (wrench,), partial(_wrench, robot=robot), "added before the allocation; its constraints hold"
        ),
        "residual_joint": ActionMode((JOINTS, SPEED), _joint, "shapes the joint motion"),
        "residual": ActionMode(
            (wrench, JOINTS, SPEED), partial(_both, robot=robot), "`residual_wrench` and `residual_joint` together"
        ),
        "residual_force": ActionMode(
            (FORCES,), _force,
            "added after the allocation, then moved to the nearest point of [Zhao2025, Eq. 12, 13, 30-32] and the "
            "thrust sphere; the wrench may differ",
        ),
        "direct": ActionMode(
            (
                Channel("thrust", N_ROTORS, f"λ = {robot.max_thrust / 2:g} (1 + a) N"),
                Channel("phi", N_ROTORS, "φ = π a rad, the nearest turn"),
                Channel("theta", N_ROTORS, "θ = π a rad, the nearest turn"),
                Channel("joint_target", N_JOINTS, f"q = {quarter} a rad, slewed by the servos"),
            ),
            None,
            "commands without any controller",
        ),
        TORSO: _torso_mode(scale, "the planned ones"),
    }  # fmt: skip


ACTION_MODES = action_modes(ROBOT)
"""Action modes of the nominal robot."""
IN_AIR = TorsoScale()
"""Zero and scale of `torso_forces` in the air."""
ON_FLOOR = TorsoScale(trim=FLOOR)
"""Zero and scale of `torso_forces` on the floor."""
_LYING = "those of the lying robot"


def crawl_modes(robot: RobotSpec, scale: TorsoScale = ON_FLOOR) -> dict[str, ActionMode]:
    """Return the action modes of the crawl, as `action_modes`."""
    return {
        **action_modes(robot),
        TORSO: replace(_torso_mode(scale, _LYING), has_clock=True),
        "residual_gait": ActionMode((GAIT,), _gait, "shapes the gait"),
        "residual_gait_force": ActionMode(
            (GAIT, LEG_FORCES), _gait_force, "shapes the gait and adds forces to legs, as `residual_force` to rotors"
        ),
    }


CRAWL_MODES = crawl_modes(ROBOT)
"""Action modes of the crawl for the nominal robot."""


def find_action_mode(name: str, modes: Mapping[str, ActionMode] = ACTION_MODES) -> ActionMode:
    """Return a mode by name (`UnknownNameError` lists the valid ones)."""
    require_name("action mode", name, modes)
    return modes[name]


def scaled_action_mode(
    name: str, given: object, trim: float,
    modes: Callable[[RobotSpec, TorsoScale], Mapping[str, ActionMode]], robot: RobotSpec = ROBOT,
) -> ActionMode:  # fmt: skip
    """Return a mode by name with a scale of its actions.

    Args:
        name: Name of the mode.
        given: For `torso_forces` its zero and scale; for a residual `{"share": s}`, s within 0.001 … 1 of the channels'
            authority; None for the default.
        trim: Share of the weight that the rotors bear at a zero action in torso axes, by default.
        modes: Function of a robot and a scale that returns the modes of an environment.
        robot: The described robot.

    Raises:
        UnknownNameError: For a mode or a number that does not exist; it lists the valid ones.
        InvalidValueError: For a value out of range, and a scale of a mode that has none.
    """
    if name == TORSO:
        return find_action_mode(name, modes(robot, TorsoScale.parse(given, trim)))
    mode = find_action_mode(name, modes(robot, TorsoScale(trim=trim)))
    if given is None:
        return mode
    if mode.residual is None:
        raise InvalidValueError("action_scale", given, f"none with {name}: it belongs to {TORSO} and to residuals")
    if not (isinstance(given, Mapping) and [*given] == ["share"]):
        raise InvalidValueError("action_scale", given, f'{{"share": number}} with {name}')
    require_within(1e-3, 1.0, "of the authority", share=given["share"])
    share = float(given["share"])
    channels = tuple(replace(each, authority=f"{share:g} × ({each.authority})") for each in mode.channels)
    return replace(mode, channels=channels, residual=partial(_shared, mode.residual, share), share=share)


def _shared(residual: Callable[[np.ndarray], Residual], share: float, action: np.ndarray) -> Residual:
    return residual(share * action)


def _turned(angles: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Turn angles the short way to the wanted ones [rad]."""
    return angles + (np.remainder(wanted - angles + np.pi, 2.0 * np.pi) - np.pi)


def direct_command(action: np.ndarray, vectoring: np.ndarray, robot: RobotSpec = ROBOT) -> Command:
    """Return the command of a `direct` action; angles turn the short way from the current `vectoring` (8, 2) [rad]."""
    thrust, angles, joints = np.split(action, (N_ROTORS, 3 * N_ROTORS))
    return Command(
        0.5 * robot.max_thrust * (1.0 + thrust),
        _turned(vectoring, np.pi * angles.reshape(2, N_ROTORS).T),
        robot.joint_limit * joints,
        np.full(N_JOINTS, robot.max_joint_torque),
    )


def act_in_torso_axes(
    controller: FlightControl | CrawlControl, action: np.ndarray, scale: TorsoScale, joints: JointVector,
    R_bl: np.ndarray, *, plans: bool,
) -> tuple[Command, JointVector]:  # fmt: skip
    """Return the command of a `torso_forces` action and the rate of its joint setpoints [rad/s].

    Set the controller's last command to it.

    Args:
        controller: Controller whose memory has the last command.
        action: The action.
        scale: Its zero and scale.
        joints: Joint angles at a zero action (16,) [rad].
        R_bl: Attitude of each link at the measured joint angles (8, 3, 3).
        plans: Whether the flight controller plans the motion of the joints, as for its own commands; otherwise the
            servos slew.
    """
    memory, robot = controller.memory, controller.model.robot
    forces, offsets = np.split(action, (3 * N_ROTORS,))
    forces_b = scale.force * forces.reshape(N_ROTORS, 3) + [0.0, 0.0, scale.trim * robot.weight / N_ROTORS]
    last = memory.vectoring
    thrust, *angles = aim(R_bl, forces_b, np.sin(last[:, 0]), np.cos(last[:, 0]))
    vectoring = np.where((thrust < MIN_FORCE)[:, None], last, _turned(last, np.stack(angles, axis=1)))
    target = joints + (scale.joint * offsets if offsets.size else 0.0)
    thrust = np.minimum(thrust, robot.max_thrust)
    command = Command(thrust, vectoring, target, np.full(N_JOINTS, robot.max_joint_torque))
    if not plans:
        return _slewed(controller, command)
    assert isinstance(controller, FlightController)
    joints_d, rate = controller.compute_joints(target, 1.0)
    command = replace(command, joint_position=joints_d)
    controller.set_last_command(command)
    controller.memory = replace(controller.memory, joint_velocity=rate)
    return command, rate


def act_directly(controller: FlightControl | CrawlControl, action: np.ndarray) -> tuple[Command, JointVector]:
    """Return the command of a `direct` action and the rate of its joint setpoints [rad/s].

    Set the controller's last command to the setpoints that the servos reach within this tick at their slew limit.
    """
    return _slewed(controller, direct_command(action, controller.memory.vectoring, controller.model.robot))


def _slewed(controller: FlightControl | CrawlControl, command: Command) -> tuple[Command, JointVector]:
    """Set a controller's last command to the setpoints that the servos reach within this tick at their slew limit."""
    memory, limit = controller.memory, controller.model.robot.joint_limit
    reach = controller.config.joint_speed / CONTROL_RATE
    command = replace(command, joint_position=np.minimum(np.maximum(command.joint_position, -limit), limit))
    step = np.minimum(np.maximum(command.joint_position - memory.joint_position, -reach), reach)
    controller.set_last_command(replace(command, joint_position=memory.joint_position + step))
    return command, step * CONTROL_RATE


_ORDER = ActionMode(
    (
        Channel("velocity", 3, f"of the torso, ± {STEER_SPEED:g} m/s along its heading, to its left, up"),
        Channel("turn", 1, f"± {STEER_TURN:g} rad/s"),
        Channel("opening", 1, f"distance of the feet from the axis, {STEER_RADIUS[0]:g} … {STEER_RADIUS[1]:g} m"),
        Channel("grip", 1, f"force of each foot towards the object's axis, 0 … {SAFE_GRIP:g} N"),
    ),
    None,
    "read every 0.5 s: velocity of the torso, opening of the legs, and grip, which the flight controller follows",
)


@lru_cache(maxsize=16)
def grasp_modes(robot: RobotSpec, scale: TorsoScale = IN_AIR) -> dict[str, ActionMode]:
    """Return the action modes of the grasp."""
    modes = action_modes(robot)
    both = modes["residual"]
    words = "wrench, joint and foot residuals on the manager, which follows the orders of a rule"
    return {
        "residual": ActionMode((*both.channels, FOOT_FORCES), partial(_grasp, robot=robot), words),
        "order": _ORDER, "direct": modes["direct"], TORSO: _torso_mode(scale, "those of the open claw"),
    }  # fmt: skip


GRASP_MODES = grasp_modes(ROBOT)
"""Action modes of the grasp for the nominal robot."""


_WAYPOINT = ActionMode(
    (
        Channel("flies", 1, "target in the air if above 0, else on the floor"),
        Channel("way", 2, f"± {WAY:g} m from the torso, world axes x, y; the target stays inside the field"),
        Channel("height", 1, f"of the CoG in the air, 0 … {CEILING:g} m"),
        Channel("heading", 1, "on the floor, ± π rad"),
        Channel("speed", 1, f"of the flight, {SPEEDS[0]:g} … {SPEEDS[1]:g} m/s"),
        Channel("narrow", 1, "from form 1, legs stretched out, to form 3, legs below"),
        Channel("sweep", 1, f"front legs to the front and hind legs to the back, ± {SWEEP:g} rad"),
    ),
    None,
    "a target every 0.5 s, which the pilot and the manager of flight and crawl follow",
)


def course_modes(robot: RobotSpec, scale: TorsoScale = ON_FLOOR) -> dict[str, ActionMode]:
    """Return the action modes of the course."""
    modes = action_modes(robot)
    words = "wrench and joint residuals on the manager, which follows the targets of a rule"
    return {
        "waypoint": _WAYPOINT, "residual": replace(modes["residual"], doc=words), "direct": modes["direct"],
        TORSO: _torso_mode(scale, _LYING),
    }  # fmt: skip


COURSE_MODES = course_modes(ROBOT)
"""Action modes of the course for the nominal robot."""
