"""The quantities that the engine counts for tasks: one table, from which C and NumPy have the packed block of them."""

import numpy as np

from spidar_gym.native.structs import CStruct, Row
from spidar_gym.robot import field_docs


class Quantities:
    """What is counted of every robot, an entry for each (N,)."""

    ticks: np.ndarray
    """Steps of the episode."""
    time: np.ndarray
    """Time since its beginning [s]."""
    in_contact: np.ndarray
    """1 where a part of the robot touches the floor."""
    diverged: np.ndarray
    """1 where the simulation's state is no longer finite."""
    power: np.ndarray
    """Electrical power [W]."""
    effort: np.ndarray
    """Mean square of the action."""


class HoverQuantities(Quantities):
    """What is counted of robots in flight."""

    distance: np.ndarray
    """Length of the position error [m]."""
    angle: np.ndarray
    """Length of the attitude error [rad]."""
    joint_error: np.ndarray
    """Largest difference of a joint from the schedule's plan [rad]."""
    tilt: np.ndarray
    """Angle between the torso's z axis and the vertical [rad]."""
    position_rms: np.ndarray
    """RMS of the position error since the beginning [m]."""
    attitude_rms: np.ndarray
    """RMS of the attitude error since the beginning [rad]."""
    overdue: np.ndarray
    """Forms that were due by now and not reached in time."""


class CrawlQuantities(Quantities):
    """What is counted of robots on the ground."""

    distance: np.ndarray
    """Distance to the goal, a radian counting 0.5 m [m]."""
    initial_distance: np.ndarray
    """The same at the start [m]."""
    position_error: np.ndarray
    """Way to the goal [m]."""
    yaw_error: np.ndarray
    """Turn to the goal, its size [rad]."""
    tilt: np.ndarray
    """Angle of the torso against the floor [rad]."""
    slip: np.ndarray
    """Speed of the fastest touching point [m/s]."""
    duct_touches: np.ndarray
    """1 where a duct touches the floor."""
    duct_touched: np.ndarray
    """1 where a duct has touched it in this episode."""
    finished: np.ndarray
    """When the gait was done, or in `direct` the robot had rested at the goal [s]; 0 before."""
    nominal_time: np.ndarray
    """How long the preset's gait takes, servos perfect [s]."""
    timeouts: np.ndarray
    """Phases that ended by time-out."""
    airborne: np.ndarray
    """Share of its swing in which the worst foot was in the air; 1 before the first swing."""
    foot_slip: np.ndarray
    """Way of the worst foot's touching point along the floor [m]."""


class CourseQuantities(Quantities):
    """What is counted of robots on a course."""

    distance: np.ndarray
    """Distance to the goal, a radian counting 0.5 m [m]."""
    initial_distance: np.ndarray
    """The same at the start [m]."""
    position_error: np.ndarray
    """Way to the goal [m]."""
    yaw_error: np.ndarray
    """Turn to the goal, its size [rad]."""
    hit: np.ndarray
    """Largest force of the step on anything but feet and pegs [N]."""
    tilt: np.ndarray
    """Angle between the torso's z axis and the vertical [rad]."""
    charge: np.ndarray
    """What is left of the battery's usable energy, 0 … 1."""
    lies: np.ndarray
    """1 where the robot lies on the floor at rest."""
    is_cut: np.ndarray
    """1 where the rotors are cut in the air."""
    is_outside: np.ndarray
    """1 where the robot has left the field."""
    is_empty: np.ndarray
    """1 where the battery's usable charge is used up."""


def quantity_struct(name: str, doc: str, kind: type[Quantities]) -> CStruct:
    """The block of one robot, numbers of eight bytes each: those of every robot first.

    Args:
        name: Of the struct.
        doc: What it is.
        kind: Whose quantities.
    """
    docs = field_docs(kind)
    own: list[Row] = [(each, "f8", (), docs[each]) for each in kind.__annotations__]
    inherited: list[Row] = [] if kind is Quantities else [("common", "quantities", (), "")]
    return CStruct(name, doc, (*inherited, *own))


def quantity_names(kind: type[Quantities]) -> tuple[str, ...]:
    """Names of the quantities in the order of the block."""
    return tuple(name for each in reversed(kind.__mro__[:-1]) for name in vars(each).get("__annotations__", ()))
