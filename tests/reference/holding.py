"""Whether an object can be held, by a linear program over inner approximations of all cones: rotors, joints, feet.

Written from the statics alone: unknown rotor forces and foot forces, balance of robot, object and joints.
"""

import itertools
import math

import numpy as np
from scipy.optimize import linprog

from spidar_gym.control.allocation.blocks import torque_map
from spidar_gym.model.dynamics import Model
from spidar_gym.model.rotor import thrust_map
from spidar_gym.robot import GRAVITY, N_LEGS, N_ROTORS, ROBOT

SIDES = 16
"""Sides of the pyramid inside a friction cone."""


def _inside_a_ball(most: float) -> tuple[np.ndarray, float]:
    """Return the rows of a polyhedron inside a ball: 26 directions, scaled so that every corner is inside."""
    rows = np.array([row for row in itertools.product((-1, 0, 1), repeat=3) if any(row)], float)
    rows /= np.linalg.norm(rows, axis=1, keepdims=True)
    return rows, most / 1.13  # the largest distance of a corner from the middle over that of a face is below 1.13


def grips(
    form: np.ndarray, torso_height: float, mass: float, com: np.ndarray, friction: float, most_force: float
) -> tuple[bool, float]:
    """Return whether the object can be held in a form, and the least largest normal force of a foot [N].

    Args:
        form: Joint angles with the feet on the faces [rad].
        torso_height: Height of the torso's origin over the object's [m].
        mass: Of the object [kg].
        com: Its centre of mass from its middle [m].
        friction: Of its surface.
        most_force: Largest normal force of a foot [N].
    """
    model, level = Model(), np.eye(3)
    snapshot, feet = model.stance(form, level, np.zeros((N_ROTORS, 2)))
    place = feet.position_b
    Q = thrust_map(snapshot.R_bl, snapshot.rotor_c)
    T = torque_map(snapshot)
    n_f, n_F = 3 * N_ROTORS, 3 * N_LEGS
    size = n_f + n_F + 1  # the last is the largest normal force
    equal, right = [], []
    weight = ROBOT.weight
    for axis in range(3):  # robot: forces and torques about its centre of mass
        row = np.zeros(size)
        row[:n_f] = Q[axis]
        row[n_f + axis : n_f + n_F : 3] = -1.0
        equal.append(row)
        right.append(weight if axis == 2 else 0.0)
    lever = np.array([_cross(p - snapshot.com_b) for p in place])
    for axis in range(3):
        row = np.zeros(size)
        row[:n_f] = Q[3 + axis]
        row[n_f : n_f + n_F] = -np.concatenate([each[axis] for each in lever])
        equal.append(row)
        right.append(0.0)
    middle = np.array([0.0, 0.0, -torso_height])
    for axis in range(3):  # object
        row = np.zeros(size)
        row[n_f + axis : n_f + n_F : 3] = 1.0
        equal.append(row)
        right.append(mass * GRAVITY if axis == 2 else 0.0)
    arms = np.array([_cross(p - middle - com) for p in place])
    for axis in range(3):
        row = np.zeros(size)
        row[n_f : n_f + n_F] = np.concatenate([each[axis] for each in arms])
        equal.append(row)
        right.append(0.0)
    rows, bounds = [], []
    ball, most = _inside_a_ball(ROBOT.max_thrust)
    for i in range(N_ROTORS):
        for direction in ball:
            row = np.zeros(size)
            row[3 * i : 3 * i + 3] = direction
            rows.append(row)
            bounds.append(most)
    joints = np.zeros((16, size))
    joints[:, :n_f] = -T
    joints[:, n_f : n_f + n_F] = np.concatenate([feet.J[k].T for k in range(N_LEGS)], axis=1)
    for sign in (1.0, -1.0):
        rows += list(sign * joints)
        bounds += list(ROBOT.max_joint_torque - sign * snapshot.gravity_torque)
    for k in range(N_LEGS):
        inwards = middle - place[k]
        inwards[2] = 0.0
        inwards /= np.linalg.norm(inwards)
        side = np.cross([0.0, 0.0, 1.0], inwards)
        at = n_f + 3 * k
        for s in range(SIDES):
            angle = 2.0 * math.pi * s / SIDES
            along = math.cos(angle) * side + math.sin(angle) * np.array([0.0, 0.0, 1.0])
            row = np.zeros(size)
            row[at : at + 3] = along - friction * math.cos(math.pi / SIDES) * inwards
            rows.append(row)
            bounds.append(0.0)
        row = np.zeros(size)
        row[at : at + 3], row[-1] = inwards, -1.0
        rows.append(row)
        bounds.append(0.0)
    cost = np.zeros(size)
    cost[-1] = 1.0
    limits = [(None, None)] * (size - 1) + [(0.0, most_force)]
    found = linprog(cost, np.array(rows), bounds, np.array(equal), right, limits, method="highs")
    return bool(found.success), float(found.fun) if found.success else math.inf


def _cross(r: np.ndarray) -> np.ndarray:
    x, y, z = r
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
