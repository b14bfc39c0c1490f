"""Random ticks for the tests of the controller: configurations, demands, robot states, and an exact QP solver."""

from functools import cache

import numpy as np
import quadprog

from spidar_gym.control.blocks import torque_map
from spidar_gym.control.qp import INFINITY, Demand, QuadraticProgram
from spidar_gym.model.dynamics import Model, Snapshot
from spidar_gym.model.interference import InterferenceConfig, interference, no_interference
from spidar_gym.model.rotor import Lock, LockConfig, nominal_vectoring, thrust_map, update_lock
from spidar_gym.robot import FORMS, N_LEGS, N_ROTORS, ROBOT
from spidar_gym.so3 import exp

LOW, HIGH = (-0.5, -0.2, -0.5, 0.0), (0.5, 0.8, 0.5, 1.4)
"""Range of a leg's four joints [rad]."""


@cache
def model() -> Model:
    """One model for all tests of a module."""
    return Model()


def random_joints(rng):
    """A form of the paper, four equal legs, or four independent ones [rad]."""
    kind = rng.integers(3)
    if kind == 0:
        return FORMS[f"form{rng.integers(1, 4)}"].copy()
    return np.tile(rng.uniform(LOW, HIGH), N_LEGS) if kind == 1 else rng.uniform(np.tile(LOW, 4), np.tile(HIGH, 4))


def random_snapshot(rng) -> tuple[Snapshot, np.ndarray, np.ndarray, np.ndarray]:
    """A snapshot with rotors upright, and what it was taken of: joints, attitude, (φ̂, θ̂)."""
    q, R_wb = random_joints(rng), exp(rng.uniform(-0.15, 0.15, 3))
    vectoring = nominal_vectoring(model().snapshot(q, R_wb, np.zeros((N_ROTORS, 2))).R_bl, np.zeros((N_ROTORS, 2)))
    return model().snapshot(q, R_wb, vectoring), q, R_wb, vectoring


def random_wrench(rng, R_wb, *, hard: bool):
    """Hover in torso axes, ± 10 % of the weight and ± 3 Nm, or ± 40 % and ± 15 Nm."""
    share, torque = (0.4, 15.0) if hard else (0.1, 3.0)
    force_w = ROBOT.weight * (np.array([0.0, 0.0, 1.0]) + rng.uniform(-share, share, 3))
    return np.concatenate([R_wb.T @ force_w, rng.uniform(-torque, torque, 3)])


def demand_of(snapshot: Snapshot, nominal, wrench, phi=None, held=None) -> Demand:
    """The demand of a tick whose last command was `phi` (φ̂ if None), held for the rotors in `held` (none if None)."""
    free, phi = np.zeros(N_ROTORS, bool), nominal[:, 0] if phi is None else phi
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
        snapshot, _, R_wb, nominal = random_snapshot(rng)
        phi, held = nominal[:, 0] + rng.uniform(-spread, spread, N_ROTORS), (rng.random(N_ROTORS) < 0.2) & hard
        demands.append(demand_of(snapshot, nominal, random_wrench(rng, R_wb, hard=hard), phi, held))
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
        assert "inconsistent" in str(error), error
        return None
