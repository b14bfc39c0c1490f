"""The quantities that the engine computes for tasks: one table, which defines their packed block in C and NumPy."""

import numpy as np

from spidar_gym.native.structs import CStruct, Row
from spidar_gym.robot import field_docs


class Quantities:
    """Quantities of every task; arrays with one entry per robot, shape (N,)."""

    ticks: np.ndarray
    """Steps of the episode."""
    time: np.ndarray
    """Time since the reset [s]."""
    in_contact: np.ndarray
    """1 where a part of the robot touches the floor."""
    diverged: np.ndarray
    """1 where the simulation's state is no longer finite."""
    power: np.ndarray
    """Electrical power [W]."""
    effort: np.ndarray
    """Mean square of the action."""


class HoverQuantities(Quantities):
    """Quantities of robots in flight."""

    distance: np.ndarray
    """Length of the position error [m]."""
    angle: np.ndarray
    """Length of the attitude error [rad]."""
    joint_error: np.ndarray
    """Largest deviation of a joint angle from the schedule [rad]."""
    tilt: np.ndarray
    """Angle between the torso's z axis and the vertical [rad]."""
    position_rms: np.ndarray
    """RMS of the position error since the reset [m]."""
    attitude_rms: np.ndarray
    """RMS of the attitude error since the reset [rad]."""
    overdue: np.ndarray
    """Number of forms that were due by now and not reached in time."""


class CrawlQuantities(Quantities):
    """Quantities of robots on the ground."""

    distance: np.ndarray
    """Distance to the goal; a radian of yaw error counts as 0.5 m [m]."""
    initial_distance: np.ndarray
    """Distance to the goal at the start [m]."""
    position_error: np.ndarray
    """Horizontal distance to the goal [m]."""
    yaw_error: np.ndarray
    """Absolute yaw error to the goal [rad]."""
    tilt: np.ndarray
    """Angle of the torso against the floor [rad]."""
    slip: np.ndarray
    """Speed of the fastest touching point [m/s]."""
    duct_touches: np.ndarray
    """1 where a duct touches the floor."""
    duct_touched: np.ndarray
    """1 where a duct has touched the floor in this episode."""
    finished: np.ndarray
    """Time at which the gait was done, or in `direct` the robot had rested at the goal [s]; 0 before."""
    nominal_time: np.ndarray
    """Duration of the preset's gait with perfect servos [s]."""
    timeouts: np.ndarray
    """Number of phases that ended by time-out."""
    airborne: np.ndarray
    """Share of the swing time in which the worst foot was in the air; 1 before the first swing."""
    foot_slip: np.ndarray
    """Distance that the worst foot has slipped along the floor [m]."""


class CourseQuantities(Quantities):
    """Quantities of robots on a course."""

    distance: np.ndarray
    """Distance to the goal; a radian of yaw error counts as 0.5 m [m]."""
    initial_distance: np.ndarray
    """Distance to the goal at the start [m]."""
    position_error: np.ndarray
    """Horizontal distance to the goal [m]."""
    yaw_error: np.ndarray
    """Absolute yaw error to the goal [rad]."""
    hit: np.ndarray
    """Largest force of the step on anything but feet and pegs [N]."""
    tilt: np.ndarray
    """Angle between the torso's z axis and the vertical [rad]."""
    charge: np.ndarray
    """Remaining share of the battery's usable energy, 0 … 1."""
    lies: np.ndarray
    """1 where the robot lies on the floor at rest."""
    is_cut: np.ndarray
    """1 where the rotors have been cut in the air."""
    is_outside: np.ndarray
    """1 where the robot has left the field."""
    is_empty: np.ndarray
    """1 where the battery's usable energy is used up."""


class GraspQuantities(Quantities):
    """Quantities of robots that grasp."""

    reach: np.ndarray
    """Distance of the torso from its place for the grip [m]."""
    gap: np.ndarray
    """Mean horizontal distance of the feet from the object's sides [m]."""
    clear: np.ndarray
    """Least distance of a foot from the object's sides or top [m]."""
    touching: np.ndarray
    """Number of feet that touch the object."""
    lifted: np.ndarray
    """Height of the object over its stand at the start [m]."""
    most_lifted: np.ndarray
    """Largest such height of the episode [m]."""
    way: np.ndarray
    """Distance of the object from its place at the goal; a radian of heading counts as 0.5 m [m]."""
    initial_way: np.ndarray
    """That distance at the start [m]."""
    position_error: np.ndarray
    """Distance of the object from its place at the goal [m]."""
    yaw_error: np.ndarray
    """Absolute error of its heading, up to turns after which it looks the same [rad]."""
    object_tilt: np.ndarray
    """Angle between its axis and the vertical [rad]."""
    object_speed: np.ndarray
    """Speed of its middle [m/s]."""
    fall: np.ndarray
    """Largest speed at which the object has fallen in this episode [m/s]."""
    force: np.ndarray
    """Largest force of a foot on the object, a mean over a tenth of a second [N]."""
    pressed: np.ndarray
    """Largest such force of the episode over the one that the object bears."""
    is_hit: np.ndarray
    """1 where a part other than a foot has touched the object, or one other than feet and pegs anything."""
    tilt: np.ndarray
    """Angle between the torso's z axis and the vertical [rad]."""
    charge: np.ndarray
    """Remaining share of the battery's usable energy, 0 … 1."""
    is_cut: np.ndarray
    """1 where the rotors have been cut in the air."""
    is_outside: np.ndarray
    """1 where the robot has left the field."""
    is_empty: np.ndarray
    """1 where the battery's usable energy is used up."""


def quantity_struct(name: str, doc: str, kind: type[Quantities]) -> CStruct:
    """Return the struct of one robot's quantities, numbers of eight bytes each: those of every task first.

    Args:
        name: Name of the struct.
        doc: Its description.
        kind: Class that declares the quantities.
    """
    docs = field_docs(kind)
    own: list[Row] = [(each, "f8", (), docs[each]) for each in kind.__annotations__]
    inherited: list[Row] = [] if kind is Quantities else [("common", "quantities", (), "")]
    return CStruct(name, doc, (*inherited, *own))


def quantity_names(kind: type[Quantities]) -> tuple[str, ...]:
    """Return the names of the quantities in the order of the block."""
    return tuple(name for each in reversed(kind.__mro__[:-1]) for name in vars(each).get("__annotations__", ()))
