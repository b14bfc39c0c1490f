"""Action modes: a table of modes, each a list of channels with their authority."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache, partial

import numpy as np
from numpy.typing import ArrayLike

from spidar_gym.arrays import JointVector
from spidar_gym.control.course.gates import CEILING
from spidar_gym.control.course.target import SWEEP, WAY
from spidar_gym.control.flight.controller import CONTROL_RATE
from spidar_gym.control.interface import CrawlControl, FlightControl
from spidar_gym.control.locomotion.commands import SPEEDS
from spidar_gym.errors import require_name
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


@dataclass(frozen=True)
class ActionMode:
    """Channels of an action and their mapping to the controller's residual."""

    channels: tuple[Channel, ...]
    """Channels in the order of the action's entries."""
    residual: Callable[[np.ndarray], Residual] | None
    """Mapping from action to residual; None without a controller."""
    doc: str
    """Description of the mode."""

    @property
    def size(self) -> int:
        """Number of entries of an action."""
        return sum(channel.size for channel in self.channels)


@lru_cache(maxsize=64)
def action_modes(robot: RobotSpec) -> dict[str, ActionMode]:
    """Return the action modes by name. A zero action is exactly the controller's command, except in `direct`."""
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
    }  # fmt: skip


ACTION_MODES = action_modes(ROBOT)
"""Action modes of the nominal robot."""


def crawl_modes(robot: RobotSpec) -> dict[str, ActionMode]:
    """Return the action modes of the crawl. A zero action is exactly the crawler's command, except in `direct`."""
    return {
        **action_modes(robot),
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


def direct_command(action: np.ndarray, vectoring: np.ndarray, robot: RobotSpec = ROBOT) -> Command:
    """Return the command of a `direct` action; angles turn the short way from the current `vectoring` (8, 2) [rad]."""
    thrust, angles, joints = np.split(action, (N_ROTORS, 3 * N_ROTORS))
    wanted = np.pi * angles.reshape(2, N_ROTORS).T
    way = np.remainder(wanted - vectoring + np.pi, 2.0 * np.pi) - np.pi
    return Command(
        0.5 * robot.max_thrust * (1.0 + thrust),
        vectoring + way,
        robot.joint_limit * joints,
        np.full(N_JOINTS, robot.max_joint_torque),
    )


def act_directly(controller: FlightControl | CrawlControl, action: np.ndarray) -> tuple[Command, JointVector]:
    """Return the command of a `direct` action and the rate of its joint setpoints [rad/s].

    Set the controller's last command to the setpoints that the servos reach within this tick at their slew limit.
    """
    memory = controller.memory
    reach = controller.config.joint_speed / CONTROL_RATE
    command = direct_command(action, memory.vectoring, controller.model.robot)
    step = np.minimum(np.maximum(command.joint_position - memory.joint_position, -reach), reach)
    controller.set_last_command(replace(command, joint_position=memory.joint_position + step))
    return command, step * CONTROL_RATE


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


def course_modes(robot: RobotSpec) -> dict[str, ActionMode]:
    """Return the action modes of the course."""
    modes = action_modes(robot)
    words = "wrench and joint residuals on the manager, which follows the targets of a rule"
    return {"waypoint": _WAYPOINT, "residual": replace(modes["residual"], doc=words), "direct": modes["direct"]}


COURSE_MODES = course_modes(ROBOT)
"""Action modes of the course for the nominal robot."""
