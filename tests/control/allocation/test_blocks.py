"""Pins the allocation's blocks: each against its definition, computed in plain numpy from the robot's geometry."""

from dataclasses import replace

import numpy as np
import pytest
from support.parts import rotors, segments
from support.states import demand_of, model, random_demands, random_pose, random_wrench

from spidar_gym.control.allocation.blocks import (
    InterferenceBound,
    JointTorqueEffort,
    JointTorqueLimit,
    ThrustBox,
    ThrustEffort,
    VectoringLock,
    WrenchBalance,
    torque_map,
)
from spidar_gym.control.allocation.modes import ALLOCATIONS, PROJECTION
from spidar_gym.control.allocation.problem import FORCE_SCALE, INFINITY, WRENCH_SCALE, Mode, assemble, soften
from spidar_gym.model.rotor import thrust_map, vectoring_to_force
from spidar_gym.robot import GRAVITY, ROBOT

MODES = [*(mode for modes in ALLOCATIONS.values() for mode in modes.values()), PROJECTION]
FREE = np.zeros(8, bool)


def rows(block, demand):
    """(A, l, u) of one block."""
    program = assemble(Mode("one", (), (block,)), demand)
    return program.A, program.l, program.u


def scene(rng):
    """Random pose, thrusts and vectoring angles, their forces in link axes, and the demand with the pose's maps."""
    q, R_wb = random_pose(rng)
    thrust, vectoring = rng.uniform(1.0, 40.0, 8), rng.uniform(-3.0, 3.0, (8, 2))
    snapshot = model().snapshot(q, R_wb, vectoring)
    demand = replace(
        demand_of(q, R_wb, np.zeros(6)),
        thrust_map=thrust_map(snapshot.R_bl, snapshot.rotor_c),
        torque_map=torque_map(snapshot),
        gravity_torque=snapshot.gravity_torque,
    )
    return q, R_wb, vectoring, thrust, vectoring_to_force(thrust, vectoring), demand


def world_forces(q, R_wb, vectoring, thrust):
    """Rotor positions and forces in world axes about the torso's origin, from the thrust frames."""
    positions_b, attitudes = rotors(model(), q, vectoring)
    return positions_b @ R_wb.T, thrust[:, None] * (attitudes[:, :, 2] @ R_wb.T)


def potential(q, R_wb, vectoring):
    """Potential energy of the segments with a fixed torso [J]."""
    masses, positions_b, _ = segments(model(), q, vectoring)
    return GRAVITY * masses @ (positions_b @ R_wb.T)[:, 2]


def virtual_work_torque(q, R_wb, vectoring, thrust):
    """Joint torques that balance gravity and thrust, ∂V/∂q − Σ (∂p/∂q)ᵀ f by central differences [Nm]."""
    _, forces_w = world_forces(q, R_wb, vectoring, thrust)
    torque, h = np.empty(16), 1e-6
    for j, step in enumerate(h * np.eye(16)):
        moved = [world_forces(q + s, R_wb, vectoring, thrust)[0] for s in (step, -step)]
        energy = [potential(q + s, R_wb, vectoring) for s in (step, -step)]
        torque[j] = (energy[0] - energy[1] - np.sum(forces_w * (moved[0] - moved[1]))) / (2.0 * h)
    return torque


def test_wrench_rows_hold_for_the_wrench_of_the_thrusts_in_the_world_and_for_no_other():
    rng = np.random.default_rng(0)
    for _ in range(8):
        q, R_wb, vectoring, thrust, forces, demand = scene(rng)
        positions_w, forces_w = world_forces(q, R_wb, vectoring, thrust)
        masses, centres_b, _ = segments(model(), q, vectoring)
        arms_w = positions_w - R_wb @ (masses @ centres_b) / masses.sum()
        wrench = np.concatenate([R_wb.T @ forces_w.sum(axis=0), R_wb.T @ np.cross(arms_w, forces_w).sum(axis=0)])
        for other in (0.0, 0.01, -0.01):
            for axis in np.eye(6):
                A, l, u = rows(WrenchBalance(), replace(demand, wrench=wrench + other * axis))
                r = A @ forces.reshape(-1) / FORCE_SCALE
                np.testing.assert_allclose(r - l, -other * axis / WRENCH_SCALE, atol=1e-12)
                np.testing.assert_array_equal(l, u)


def test_joint_torque_rows_measure_the_distance_of_the_virtual_work_torque_from_the_limits():
    rng = np.random.default_rng(1)
    for limit in (7.0, 3.0):
        q, R_wb, vectoring, thrust, forces, demand = scene(rng)
        A, l, u = rows(JointTorqueLimit(limit), demand)
        r, torque = A @ forces.reshape(-1) / FORCE_SCALE, virtual_work_torque(q, R_wb, vectoring, thrust)
        np.testing.assert_allclose((r - l) * ROBOT.max_joint_torque, limit - torque, atol=1e-6)
        np.testing.assert_allclose((u - r) * ROBOT.max_joint_torque, limit + torque, atol=1e-6)


@pytest.mark.parametrize(("w1", "w2"), [(1.0, 1.0), (0.7, 0.0), (0.0, 3.0), (2.0, 20.0)])
def test_objective_is_the_weighted_sum_of_squared_forces_and_joint_torques(w1, w2):
    rng = np.random.default_rng(2)
    for _ in range(2):
        q, R_wb, vectoring, thrust, forces, demand = scene(rng)
        program = assemble(Mode("costs", (ThrustEffort(w1), JointTorqueEffort(w2)), (ThrustBox(),)), demand)
        torque = virtual_work_torque(q, R_wb, vectoring, thrust)
        cost = w1 * np.sum(thrust**2) + w2 * torque @ torque
        at_rest = w2 * demand.gravity_torque @ demand.gravity_torque
        value = program.objective(forces.reshape(-1) / FORCE_SCALE)
        assert 2.0 * FORCE_SCALE**2 * value + at_rest == pytest.approx(cost, rel=1e-7)
        np.testing.assert_array_equal(program.P, program.P.T)


@pytest.mark.parametrize("limit", [42.0, 40.0])
def test_box_rows_hold_exactly_inside_the_cube(limit):
    demand = random_demands(np.random.default_rng(3), 1, False)[0]
    A, l, u = rows(ThrustBox(limit), demand)
    for inner in np.random.default_rng(3).uniform(-limit, limit, (10, 24)):
        for axis in np.eye(24):
            for edge, inside in ((limit - 1e-6, True), (limit + 1e-6, False), (-limit - 1e-6, False)):
                r = A @ np.where(axis == 1.0, edge, inner) / FORCE_SCALE
                assert np.all((l <= r) & (r <= u)) == inside


def test_lock_row_is_zero_exactly_for_forces_in_the_plane_of_the_held_phi():
    rng = np.random.default_rng(4)
    for demand in random_demands(rng, 20, True):
        demand = replace(demand, locked=~FREE)
        A, l, u = rows(VectoringLock(), demand)
        np.testing.assert_array_equal([l, u], np.zeros((2, 8)))
        thrust, theta, off = rng.uniform(1, 40, 8), rng.uniform(-1.4, 1.4, 8), rng.uniform(0.01, np.pi - 0.01, 8)
        for phi, held in ((demand.phi, True), (demand.phi + np.pi, True), (demand.phi + off, False)):
            r = A @ vectoring_to_force(thrust, np.stack([phi, theta], axis=1)).reshape(-1) / FORCE_SCALE
            assert np.all((np.abs(r) < 1e-12) == held)


def test_interference_rows_hold_between_the_bounds_of_theta_and_fail_outside():
    rng, seen = np.random.default_rng(5), 0
    for demand in random_demands(rng, 60, True):
        seen += int(demand.restricted.sum())
        A, l, u = rows(InterferenceBound(), demand)
        thrust, inside = rng.uniform(1, 40, 8), rng.uniform(0.001, 0.999, 8)
        low, high = np.where(demand.restricted, demand.lower, -1.0), np.where(demand.restricted, demand.upper, 1.0)
        beyond = rng.uniform(0.001, 0.999, 8) * (np.pi - (high - low))  # a half-plane is half a turn wide
        below, above = low - beyond, high + beyond
        for theta, low_holds, high_holds in (
            (low + inside * (high - low), True, True),
            (below, False, True),
            (above, True, False),
        ):
            r = A @ vectoring_to_force(thrust, np.stack([demand.phi, theta], axis=1)).reshape(-1) / FORCE_SCALE
            holds = (l <= r) & (r <= u)
            np.testing.assert_array_equal(holds[:8], low_holds | ~demand.restricted)
            np.testing.assert_array_equal(holds[8:], high_holds | ~demand.restricted)
    assert seen > 50


def test_rows_of_free_rotors_are_zero_and_unbounded():
    for demand in random_demands(np.random.default_rng(6), 30, True):
        for block, free in (
            (VectoringLock(), ~demand.locked),
            (InterferenceBound(), np.tile(~demand.restricted, 2)),
        ):
            A, l, u = rows(block, demand)
            assert not A[free].any()
            assert np.all(l[free] <= -INFINITY)
            assert np.all(u[free] >= INFINITY)
            assert np.all(A[~free].any(axis=1))


@pytest.mark.parametrize("mode", MODES, ids=lambda mode: f"{mode.name}-{len(mode.costs)}-{len(mode.constraints)}")
def test_pattern_covers_every_nonzero(mode):
    legs = np.arange(24) // 6
    for demand in random_demands(np.random.default_rng(7), 50, True):
        program = assemble(mode, demand)
        assert program.A.shape == mode.pattern.shape
        assert not program.A[~mode.pattern].any()
        assert not program.P[legs[:, None] != legs].any(), "the forces of two legs share a cost"


@pytest.mark.parametrize("mode", MODES, ids=lambda mode: f"{mode.name}-{len(mode.costs)}-{len(mode.constraints)}")
def test_assembling_one_tick_leaves_no_trace_in_the_next(mode):
    hard, easy = random_demands(np.random.default_rng(8), 2, True)
    fresh = assemble(mode, easy)
    assemble(mode, hard)
    again = assemble(mode, easy)
    for name in ("P", "q", "A", "l", "u"):
        np.testing.assert_array_equal(getattr(again, name), getattr(fresh, name))


def test_only_wrench_and_torque_rows_are_softened_and_slack_costs_half_its_square_times_the_price():
    rng, mode = np.random.default_rng(9), ALLOCATIONS["paper"]["flight"]
    for demand in random_demands(rng, 10, True):
        hard = assemble(mode, replace(demand, wrench=random_wrench(rng, np.eye(3), hard=True)))
        soft = soften(hard, mode.soft_rows, price=50.0)
        x, s = rng.uniform(-0.5, 0.5, 24), rng.uniform(-0.5, 0.5, 22)
        shift = (soft.A @ np.concatenate([x, s])) - hard.A @ x
        np.testing.assert_allclose(shift, np.concatenate([s[:6], np.zeros(24), s[6:], np.zeros(24)]), atol=1e-12)
        assert soft.objective(np.concatenate([x, s])) == pytest.approx(hard.objective(x) + 25.0 * s @ s)
