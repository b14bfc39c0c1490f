"""Random ticks for the tests of the controller: poses, demands, states, and an exact solver to compare with."""

from dataclasses import replace
from functools import cache

import numpy as np
import quadprog

from spidar_gym.control.blocks import torque_map
from spidar_gym.control.qp import INFINITY, Demand, QuadraticProgram
from spidar_gym.model.dynamics import Model
from spidar_gym.model.interference import InterferenceConfig, interference, no_interference
from spidar_gym.model.rotor import Lock, LockConfig, nominal_vectoring, thrust_map, update_lock
from spidar_gym.robot import FORMS, N_LEGS, N_ROTORS, ROBOT
from spidar_gym.so3 import exp, matrix_to_quat, quat_to_matrix
from spidar_gym.state import Reference, RobotState

LOW, HIGH = (-0.5, -0.2, -0.5, 0.0), (0.5, 0.8, 0.5, 1.4)
"""Range of a leg's four joints [rad]."""


@cache
def model() -> Model:
    """One model for all tests."""
    return Model()


def random_joints(rng):
    """A form of the paper, four equal legs, or four independent ones [rad]."""
    kind = rng.integers(3)
    if kind == 0:
        return FORMS[f"form{rng.integers(1, 4)}"].copy()
    return np.tile(rng.uniform(LOW, HIGH), N_LEGS) if kind == 1 else rng.uniform(np.tile(LOW, 4), np.tile(HIGH, 4))


def random_pose(rng):
    """Joints and a small attitude R_wb."""
    return random_joints(rng), exp(rng.uniform(-0.15, 0.15, 3))


def upright(q, R_wb):
    """(φ̂, θ̂) on the branch nearest to zero."""
    level = np.zeros((N_ROTORS, 2))
    return nominal_vectoring(model().snapshot(q, R_wb, level).R_bl, level)


def random_wrench(rng, R_wb, *, hard: bool):
    """Hover in torso axes, give or take 10 % of the weight and 3 Nm, or 40 % and 15 Nm."""
    share, torque = (0.4, 15.0) if hard else (0.1, 3.0)
    force_w = ROBOT.weight * (np.array([0.0, 0.0, 1.0]) + rng.uniform(-share, share, 3))
    return np.concatenate([R_wb.T @ force_w, rng.uniform(-torque, torque, 3)])


def demand_of(q, R_wb, wrench, phi_off=0.0, held=None) -> Demand:
    """The demand of a tick with upright rotors whose last φ was φ̂ + `phi_off`, held for the rotors in `held`."""
    nominal, free = upright(q, R_wb), np.zeros(N_ROTORS, bool)
    snapshot, phi = model().snapshot(q, R_wb, nominal), nominal[:, 0] + phi_off
    bounds = interference(snapshot, nominal, no_interference(), config=InterferenceConfig())
    previous = Lock(free, free if held is None else held, phi)
    lock = update_lock(previous, bounds.restricted, nominal, snapshot, phi, config=LockConfig())
    return Demand(
        wrench=wrench,
        thrust_map=thrust_map(snapshot.R_bl, snapshot.rotor_c),
        torque_map=torque_map(snapshot),
        gravity_torque=snapshot.gravity_torque,
        locked=lock.active,
        phi=lock.phi,
        restricted=bounds.restricted,
        lower=bounds.lower,
        upper=bounds.upper,
    )


def random_demands(rng, n: int, hard: bool) -> list[Demand]:
    """`n` demands around a hover; the hard ones ask for much more and find φ farther from φ̂, some of them held."""
    demands, spread = [], 0.6 if hard else 0.2
    for _ in range(n):
        q, R_wb = random_pose(rng)
        off, held = rng.uniform(-spread, spread, N_ROTORS), (rng.random(N_ROTORS) < 0.2) & hard
        demands.append(demand_of(q, R_wb, random_wrench(rng, R_wb, hard=hard), off, held))
    return demands


def exact(program: QuadraticProgram) -> np.ndarray | None:
    """The optimum by an active-set method in double precision, None where there is none; idle rows are dropped."""
    equal = program.l == program.u
    low, high = ~equal & (program.l > -INFINITY), ~equal & (program.u < INFINITY)
    C = np.vstack([program.A[equal], program.A[low], -program.A[high]])
    b = np.concatenate([program.l[equal], program.l[low], -program.u[high]])
    try:
        return quadprog.solve_qp(program.P, -program.q, C.T.copy(), b, int(equal.sum()))[0]
    except ValueError as error:
        if "inconsistent" in str(error):
            return None
        raise


def resting(q, R_wb=None, vectoring=None, **changes) -> RobotState:
    """The robot at rest at the world's origin, rotors upright unless told otherwise; `changes` replace fields."""
    R_wb = np.eye(3) if R_wb is None else R_wb
    state = RobotState(
        time=0.0,
        position_w=np.zeros(3),
        quat_wb=matrix_to_quat(R_wb),
        velocity_w=np.zeros(3),
        omega_b=np.zeros(3),
        joint_position=q,
        joint_velocity=np.zeros(16),
        vectoring=upright(q, R_wb) if vectoring is None else vectoring,
        vectoring_velocity=np.zeros((N_ROTORS, 2)),
        thrust=np.full(N_ROTORS, ROBOT.hover_thrust),
        joint_torque=np.zeros(16),
    )
    return replace(state, **changes)


def staying(state: RobotState, **changes) -> Reference:
    """The reference that `state` meets: its CoG, level, at rest, in its own form; `changes` replace fields."""
    R_wb = quat_to_matrix(state.quat_wb)
    com_b = model().snapshot(state.joint_position, R_wb, state.vectoring).com_b
    reference = Reference(
        position_w=state.position_w + R_wb @ com_b,
        quat_wb=np.array([1.0, 0.0, 0.0, 0.0]),
        velocity_w=np.zeros(3),
        omega_b=np.zeros(3),
        joint_target=state.joint_position,
    )
    return replace(reference, **changes)
