"""Random ticks for the tests of the controller: poses, demands, states, and an exact solver to compare with."""

from dataclasses import replace
from functools import cache

import clarabel
import numpy as np
import quadprog
from scipy import sparse

from spidar_gym.control.allocation.blocks import JointTorqueEffort, ThrustEffort, torque_map
from spidar_gym.control.allocation.modes import ALLOCATIONS
from spidar_gym.control.allocation.problem import INFINITY, Demand, Mode, QuadraticProgram, assemble
from spidar_gym.control.crawl.controller import with_feet
from spidar_gym.control.crawl.footsteps import GaitConfig, lying_pose
from spidar_gym.control.rotors import ALL_FREE, flight_demand, fresh_rotors
from spidar_gym.model.dynamics import Model
from spidar_gym.model.interference import InterferenceConfig
from spidar_gym.model.rotor import LockConfig, nominal_vectoring, thrust_map
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
    """Hover wrench in torso axes, ±10 % of the weight and ±3 Nm; hard: ±40 % and ±15 Nm."""
    share, torque = (0.4, 15.0) if hard else (0.1, 3.0)
    force_w = ROBOT.weight * (np.array([0.0, 0.0, 1.0]) + rng.uniform(-share, share, 3))
    return np.concatenate([R_wb.T @ force_w, rng.uniform(-torque, torque, 3)])


def demand_of(q, R_wb, wrench, phi_off=0.0, held=None) -> Demand:
    """The demand of a tick with upright rotors; the last φ was φ̂ + `phi_off`, locked for the rotors in `held`."""
    nominal = upright(q, R_wb)
    last = nominal + np.stack([np.broadcast_to(phi_off, N_ROTORS), np.zeros(N_ROTORS)], axis=1)
    memory = fresh_rotors(last, np.zeros((N_ROTORS, 3)))
    if held is not None:
        memory = replace(memory, lock=replace(memory.lock, active=held))
    return flight_demand(
        memory, ALLOCATIONS["paper"]["flight"], model().snapshot(q, R_wb, nominal), nominal, wrench,
        lost_thrust=ALL_FREE, lost_vectoring=ALL_FREE, interference_config=InterferenceConfig(),
        lock_config=LockConfig(),
    )[0]  # fmt: skip


def random_demands(rng, n: int, hard: bool) -> list[Demand]:
    """`n` demands around a hover; the hard ones have larger wrenches, φ farther from φ̂, and some locked rotors."""
    demands, spread = [], 0.6 if hard else 0.2
    for _ in range(n):
        q, R_wb = random_pose(rng)
        off, held = rng.uniform(-spread, spread, N_ROTORS), (rng.random(N_ROTORS) < 0.2) & hard
        demands.append(demand_of(q, R_wb, random_wrench(rng, R_wb, hard=hard), off, held))
    return demands


def exact(program: QuadraticProgram) -> np.ndarray | None:
    """The optimum by an active-set method in double precision, None if infeasible; rows without limits are dropped."""
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


def within_spheres(program: QuadraticProgram) -> np.ndarray | None:
    """The optimum with each ‖f_i‖ ≤ λ̄ in addition, by second-order cones; None if the solver proves infeasibility.

    The first 24 unknowns are the rotor forces in units of λ̄. An undecided solver is an error.
    """
    equal = program.l == program.u
    low, high = ~equal & (program.l > -INFINITY), ~equal & (program.u < INFINITY)
    n, cone = len(program.q), np.zeros((4 * N_ROTORS, len(program.q)))
    for i in range(N_ROTORS):
        cone[4 * i + 1 : 4 * i + 4, 3 * i : 3 * i + 3] = -np.eye(3)
    A = np.vstack([program.A[equal], program.A[high], -program.A[low], cone])
    b = np.concatenate([program.l[equal], program.u[high], -program.l[low], np.tile([1.0, 0.0, 0.0, 0.0], N_ROTORS)])
    kinds = [clarabel.ZeroConeT(int(equal.sum())), clarabel.NonnegativeConeT(int(high.sum() + low.sum()))]
    kinds += [clarabel.SecondOrderConeT(4)] * N_ROTORS
    settings, words = clarabel.DefaultSettings(), clarabel.SolverStatus
    settings.verbose = False
    settings.max_threads = 1
    P = sparse.csc_matrix(np.triu(program.P), shape=(n, n))
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-10
    # Default steps first, then more careful ones: rounding stops one in 10 000 programs, within 1e-5 of the limit.
    for settings.max_step_fraction, settings.static_regularization_constant in ((0.99, 1e-8), (0.9, 1e-7), (0.9, 1e-6)):
        answer = clarabel.DefaultSolver(P, program.q, sparse.csc_matrix(A), b, kinds, settings).solve()
        if answer.status in (words.Solved, words.AlmostSolved):
            return np.array(answer.x)
        if answer.status in (words.PrimalInfeasible, words.AlmostPrimalInfeasible):
            return None
    raise AssertionError(f"the oracle returned {answer.status}")


def largest_feasible(mode: Mode, demand: Demand) -> float:
    """Largest multiple of the demand's wrench that some forces produce within every limit.

    0 or less where not even a small part of the wrench is feasible.
    """
    still, full = (assemble(mode, replace(demand, wrench=share * demand.wrench)) for share in (0.0, 1.0))
    n = mode.size
    A, P, q = np.hstack([still.A, -(full.l - still.l)[:, None]]), np.zeros((n + 1, n + 1)), np.zeros(n + 1)
    A[still.l != still.u, n] = 0.0
    q[n] = -1.0
    x = within_spheres(QuadraticProgram(P, q, A, still.l, still.u))
    return -1.0 if x is None else float(x[n])


def demand_at_the_limit(rng, preset: str) -> Demand:
    """The largest feasible wrench in a random direction, in a random form and attitude with random vectoring.

    Half of the forces are the weight plus half a weight in a random direction, so that gravity is covered.
    """
    while True:
        q, R_wb = random_joints(rng), exp(rng.normal(scale=0.3, size=3))
        off, held = rng.uniform(-0.6, 0.6, N_ROTORS), rng.random(N_ROTORS) < 0.2
        force, torque = rng.normal(size=3), rng.normal(size=3)
        force *= ROBOT.weight / np.linalg.norm(force)
        torque *= rng.uniform(0.0, 40.0) / np.linalg.norm(torque)
        if rng.random() < 0.5:
            force = R_wb.T @ np.array([0.0, 0.0, ROBOT.weight]) + 0.5 * force
        demand = demand_of(q, R_wb, np.concatenate([force, torque]), off, held)
        largest = largest_feasible(ALLOCATIONS[preset]["flight"], demand)
        if largest > 0.0:
            return replace(demand, wrench=largest * demand.wrench)


def hardest_demand(rng, preset: str) -> Demand:
    """0.8 … 1.1 of a demand at the limit."""
    demand = demand_at_the_limit(rng, preset)
    return replace(demand, wrench=rng.uniform(0.8, 1.1) * demand.wrench)


def cost(mode: Mode, demand: Demand, forces) -> float:
    """w₁ Σ‖f‖² + w₂ ‖τ‖² of a flight mode [N²]."""
    torque = demand.gravity_torque - demand.torque_map @ forces.reshape(-1)
    terms = {ThrustEffort: np.sum(forces**2), JointTorqueEffort: torque @ torque}
    return float(sum(term.weight * terms[type(term)] for term in mode.costs))


def ground_demand(rng, mode: Mode, lifted=None) -> Demand:
    """A demand near the crawl's start pose, tilted, with random values of every field that the ground modes read."""
    q, R_wb = lying_pose(GaitConfig()) + rng.normal(scale=0.15, size=16), exp(rng.uniform(-0.15, 0.15, 3))
    snapshot, feet = model().stance(q, R_wb, rng.uniform(-0.5, 0.5, (8, 2)))
    Q, T, R_bf = thrust_map(snapshot.R_bl, snapshot.rotor_c), torque_map(snapshot), R_wb.T @ exp(rng.normal(size=3) / 9)
    if mode.feet_carry:
        Q, T = with_feet(Q, T, snapshot, feet, R_bf)
    return replace(
        demand_of(q, R_wb, np.concatenate([ROBOT.weight * R_wb[2], np.zeros(3)])),
        thrust_map=Q,
        torque_map=T,
        gravity_torque=snapshot.gravity_torque,
        locked=rng.random(8) < 0.3,
        lost=rng.random(8) < 0.2,
        lifted=rng.random(4) < 0.6 if lifted is None else np.array(lifted),
        com_b=snapshot.com_b,
        R_bf=R_bf,
        effort=rng.uniform(0.5, 2.0, 8),
    )


def resting(q, R_wb=None, vectoring=None, **changes) -> RobotState:
    """The robot at rest at the world's origin, rotors upright by default; `changes` replace fields."""
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
    """The reference that `state` satisfies: its CoG and form, level, at rest; `changes` replace fields."""
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
