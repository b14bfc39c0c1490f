"""Pins the ground blocks: bounds of pegs and feet against friction cones, wrenches against MuJoCo."""

from dataclasses import replace
from itertools import product

import mujoco
import numpy as np
import pytest
from scipy.optimize import linprog
from support.states import demand_of, exact, ground_demand, model, random_pose, random_wrench

from spidar_gym.control.allocation.blocks import JointTorqueLimit, ThrustBox, ThrustEffort, WrenchBalance
from spidar_gym.control.allocation.contact import (
    ContactWrenchRange,
    FootEffort,
    FrictionPyramid,
    PowerEffort,
    contact_wrench_bounds,
    effort_weights,
)
from spidar_gym.control.allocation.modes import ground_modes
from spidar_gym.control.allocation.problem import FORCE_SCALE, INFINITY, WRENCH_SCALE, Mode, assemble
from spidar_gym.model.rotor import thrust_map, vectoring_to_force
from spidar_gym.robot import GIMBAL_NAMES, JOINT_NAMES, ROBOT, ROTOR_SITES
from spidar_gym.sim.scene import scene
from spidar_gym.so3 import matrix_to_quat

A, D, N_MIN = ROBOT.yaw_axis_xy, ROBOT.peg_depth, 10.0
PEGS = np.array([[x, y, -D] for x, y in product((A, -A), repeat=2)])
NAMES = ("rest", "leg", "legs", "stance")
WIDE_LEGS = np.concatenate([np.arange(24) // 6, np.arange(12) // 3])


def modes(power=False):
    return ground_modes(
        power=power, torque_weight=0.7, torque_limit=5.0, foot_friction=0.6, peg_friction=0.3, min_normal=N_MIN
    )


def rows(block, demand, feet=False):
    """(A, l, u) of one block."""
    program = assemble(Mode("one", (), (block,), feet_carry=feet), demand)
    return program.A, program.l, program.u


def pegs_can_give(wrench, friction):
    """Whether four forces within the pegs' friction cones, inscribed pyramids of 64 sides, add up to this wrench."""
    turn = 2.0 * np.pi * np.arange(64) / 64
    edges = np.stack([friction * np.cos(turn), friction * np.sin(turn), np.ones(64)], axis=1)
    columns = np.hstack([np.vstack([edges.T, np.cross(peg, edges).T]) for peg in PEGS])
    return linprog(np.zeros(256), A_eq=columns, b_eq=wrench, method="highs").status == 0


def corners_of_the_box(friction, force=1.0, tilt=1.0, twist=1.0):
    """Wrenches at the corners of the box where N = N_min, the friction forces and torques scaled down."""
    _, high = contact_wrench_bounds(friction, N_MIN)
    for s in product((-1.0, 1.0), repeat=5):
        lateral = np.array([high[0], high[1], high[3], high[4], high[5]]) * s * (force, force, tilt, tilt, twist)
        yield np.array([lateral[0], lateral[1], (1.0 + 1e-9) * N_MIN, *lateral[2:]])


@pytest.mark.parametrize("friction", [0.1, 0.2, 0.3, 0.6])
def test_pegs_can_give_every_wrench_in_the_box(friction):
    for wrench in corners_of_the_box(friction):
        assert pegs_can_give(wrench, friction), wrench


def test_pegs_can_exert_every_wrench_that_the_crawler_plans_with_half_their_friction_at_any_normal_force():
    rng, friction = np.random.default_rng(0), 0.5 * ROBOT.peg_friction
    low, high = contact_wrench_bounds(friction, N_MIN)
    wrenches = list(corners_of_the_box(friction))
    for _ in range(100):
        wrenches.append(rng.uniform(low, np.where(np.isinf(high), low, high)))
        wrenches[-1][2] += rng.uniform(0.0, 100.0)
    for wrench in wrenches:
        assert pegs_can_give(wrench, ROBOT.peg_friction), wrench


@pytest.mark.parametrize("friction", [0.1, 0.3, 0.6])
def test_no_bound_exceeds_what_pegs_can_exert_and_none_is_below_a_tenth_of_it(friction):
    _, high = contact_wrench_bounds(friction, N_MIN)
    limits = {0: friction * N_MIN, 3: A * N_MIN, 5: friction * N_MIN * A * np.sqrt(2.0)}
    limits |= {1: limits[0], 4: limits[3]}
    for axis, limit in limits.items():
        for sign in (-1.0, 1.0):
            wrench = np.array([0.0, 0.0, N_MIN, 0.0, 0.0, 0.0])
            for factor, given in ((0.98, True), (1.02, False)):
                wrench[axis] = factor * sign * limit
                if axis < 2:
                    # The force acts at the floor, d below the torso's origin, and so has a moment about it.
                    wrench[3:5] = np.cross([0.0, 0.0, -D], wrench[:3])[:2]
                assert pegs_can_give(wrench, friction) == given
            assert 0.1 * limit < high[axis] < limit


def test_pegs_only_press():
    low, high = contact_wrench_bounds(0.3, N_MIN)
    assert low[2] == N_MIN
    assert high[2] == np.inf
    np.testing.assert_array_equal(low[[0, 1, 3, 4, 5]], -high[[0, 1, 3, 4, 5]])
    assert not pegs_can_give(np.array([0.0, 0.0, -1.0, 0.0, 0.0, 0.0]), 0.3)


def wrench_of_thrust_and_weight(q, R_wb, vectoring, thrust):
    """Force and torque about the torso's origin of rotors and weight, torso axes, from MuJoCo's frames."""
    engine = scene(visual=False)
    data = mujoco.MjData(engine)
    data.qpos[:3], data.qpos[3:7] = 0.0, matrix_to_quat(R_wb)
    for name, angle in zip(JOINT_NAMES + GIMBAL_NAMES, [*q, *vectoring.reshape(-1)], strict=True):
        data.joint(name).qpos = angle
    mujoco.mj_kinematics(engine, data)
    mujoco.mj_comPos(engine, data)
    sites = [data.site(name) for name in ROTOR_SITES]
    forces = [t * site.xmat.reshape(3, 3)[:, 2] for t, site in zip(thrust, sites, strict=True)]
    forces.append(engine.opt.gravity * engine.body_subtreemass[engine.body("torso").id])
    points = [site.xpos for site in sites] + [data.body("torso").subtree_com]
    force, torque = np.sum(forces, axis=0), np.sum(np.cross(points, forces), axis=0)
    return np.concatenate([R_wb.T @ force, R_wb.T @ torque])


def test_contact_rows_measure_how_far_what_thrust_and_weight_leave_to_the_pegs_is_from_the_bounds():
    rng = np.random.default_rng(1)
    for friction, min_normal in ((0.3, 10.0), (0.15, 4.0)):
        low, high = contact_wrench_bounds(friction, min_normal)
        for _ in range(6):
            q, R_wb = random_pose(rng)
            thrust, vectoring = rng.uniform(0.0, 40.0, 8), rng.uniform(-3.0, 3.0, (8, 2))
            snapshot = model().snapshot(q, R_wb, vectoring)
            demand = replace(
                demand_of(q, R_wb, np.concatenate([ROBOT.weight * R_wb[2], np.zeros(3)])),
                thrust_map=thrust_map(snapshot.R_bl, snapshot.rotor_c),
                com_b=snapshot.com_b,
            )
            A, l, u = rows(ContactWrenchRange(friction, min_normal), demand)
            r = A @ vectoring_to_force(thrust, vectoring).reshape(-1) / FORCE_SCALE
            pegs = -wrench_of_thrust_and_weight(q, R_wb, vectoring, thrust)
            np.testing.assert_allclose((u - r) * WRENCH_SCALE, pegs - low, atol=1e-8)
            bounded = np.isfinite(high)
            np.testing.assert_allclose(((r - l) * WRENCH_SCALE)[bounded], (high - pegs)[bounded], atol=1e-8)
            np.testing.assert_array_equal(l[~bounded], -INFINITY)


@pytest.mark.parametrize(("friction", "least"), [(0.6, 0.5), (0.3, 0.0), (1.1, 3.0)])
def test_friction_rows_of_a_foot_hold_exactly_where_its_force_is_in_the_pyramid(friction, least):
    rng, mode = np.random.default_rng(2), modes()["stance"]
    demand, inside = ground_demand(rng, mode), []
    A, l, u = rows(FrictionPyramid(friction, least), demand, feet=True)
    assert not A[:, :24].any()
    for _ in range(200):
        feet = rng.uniform(-10.0, 30.0, (4, 3))
        feet[:, :2] = friction * feet[:, 2:] * rng.choice([-1.02, -0.98, 0.0, 0.98, 1.02], (4, 2))
        r = A @ np.concatenate([rng.normal(size=24), feet.reshape(-1) / FORCE_SCALE])
        holds = ((l <= r) & (r <= u)).reshape(4, 5).all(axis=1)
        inside.append((np.abs(feet[:, :2]).max(axis=1) <= friction * feet[:, 2]) & (feet[:, 2] >= least))
        np.testing.assert_array_equal(holds, inside[-1])
    assert 0.1 < np.mean(inside) < 0.9


def power_optimal(demand, ticks=200):
    """Optimal forces with the cost `PowerEffort`, whose weights have been iterated for `ticks` ticks."""
    mode, effort = Mode("power", (PowerEffort(),), (WrenchBalance(), ThrustBox())), np.ones(8)
    for _ in range(ticks):
        forces = FORCE_SCALE * exact(assemble(mode, replace(demand, effort=effort))).reshape(8, 3)
        effort = effort_weights(np.linalg.norm(forces, axis=1), effort, 0.3)
    return forces


def power(forces):
    return np.sum(np.linalg.norm(forces.reshape(-1, 3), axis=1) ** 1.5)


def test_power_cost_with_its_weights_converged_minimises_the_sum_of_thrusts_to_the_power_of_three_halves():
    rng, saved = np.random.default_rng(3), []
    for _ in range(4):
        q, R_wb = random_pose(rng)
        demand = demand_of(q, R_wb, random_wrench(rng, R_wb, hard=False))
        forces = power_optimal(demand)
        thrust = np.linalg.norm(forces, axis=1)
        assert thrust.min() > 1.0, "weights stop growing at 1 N"
        assert np.abs(forces).max() < ROBOT.max_thrust - 1e-3
        null = np.linalg.svd(demand.thrust_map)[2][6:]
        gradient = (1.5 * forces / np.sqrt(thrust)[:, None]).reshape(-1)
        assert np.linalg.norm(null @ gradient) < 1e-6 * np.linalg.norm(gradient)
        for size in (1e-2, 1.0, 10.0):
            for step in rng.normal(scale=size, size=(20, 18)):
                assert power(forces.reshape(-1) + step @ null) > power(forces)
        least_squares = Mode("paper", (ThrustEffort(),), (WrenchBalance(), ThrustBox()))
        saved.append(1.0 - power(forces) / power(FORCE_SCALE * exact(assemble(least_squares, demand))))
    assert max(saved) > 1e-4, "the optimum differs from the optimum of the paper's cost"


def test_weights_turn_squares_into_powers_of_three_halves_and_are_bounded_at_zero_thrust():
    rng = np.random.default_rng(4)
    thrust, previous = rng.uniform(1.0, 42.0, 8), rng.uniform(0.5, 2.0, 8)
    ratio = effort_weights(thrust, previous, 1.0) * thrust**2 / thrust**1.5
    np.testing.assert_allclose(ratio, ratio[0], rtol=1e-12)
    np.testing.assert_allclose(effort_weights(np.full(8, ROBOT.weight / 8), previous, 1.0), 1.0, rtol=1e-12)
    np.testing.assert_array_equal(effort_weights(thrust, previous, 0.0), previous)
    half = effort_weights(thrust, previous, 0.5)
    np.testing.assert_allclose(half - previous, effort_weights(thrust, previous, 1.0) - half, rtol=1e-9)
    np.testing.assert_array_equal(effort_weights(np.zeros(8), previous, 1.0), effort_weights(np.ones(8), previous, 1.0))


@pytest.mark.parametrize("powered", [False, True], ids=["paper", "power"])
@pytest.mark.parametrize("name", NAMES)
def test_objective_is_thrust_or_weighted_thrust_and_torque_of_lifted_legs_and_a_little_of_the_feet(name, powered):
    rng, mode = np.random.default_rng(5), modes(powered)[name]
    for _ in range(5):
        demand = ground_demand(rng, mode)
        forces = rng.uniform(-20.0, 20.0, mode.size)
        torque = np.where(np.repeat(demand.lifted, 4), demand.gravity_torque - demand.torque_map @ forces, 0.0)
        at_rest = np.where(np.repeat(demand.lifted, 4), demand.gravity_torque, 0.0)
        weights = demand.effort if powered and name != "rest" else np.ones(8)
        cost = weights @ np.sum(forces[:24].reshape(8, 3) ** 2, axis=1)
        if name != "rest":
            cost += 0.7 * (torque @ torque - at_rest @ at_rest)
        cost += FootEffort().weight * np.sum(forces[24:] ** 2)
        value = assemble(mode, demand).objective(forces / FORCE_SCALE)
        assert 2.0 * FORCE_SCALE**2 * value == pytest.approx(cost, rel=1e-9)


@pytest.mark.parametrize("name", ["leg", "legs", "stance"])
def test_the_torques_of_a_leg_on_the_ground_change_no_bit_of_the_program(name):
    rng, mode = np.random.default_rng(6), modes()[name]
    for _ in range(10):
        demand = ground_demand(rng, mode)
        standing = ~np.repeat(demand.lifted, 4)
        # Copied in the same memory order, because the summation order of a product follows the layout.
        T, g = demand.torque_map.copy(order="K"), demand.gravity_torque.copy()
        T[standing], g[standing] = rng.normal(size=T[standing].shape), 1e3
        programs = assemble(mode, demand), assemble(mode, replace(demand, torque_map=T, gravity_torque=g))
        for field in ("P", "q", "A", "l", "u"):
            np.testing.assert_array_equal(*(getattr(program, field) for program in programs))


def test_joint_torque_rows_of_standing_legs_are_zero_and_unbounded_and_those_of_lifted_legs_as_in_flight():
    rng, mode = np.random.default_rng(7), modes()["stance"]
    for lifted in product((False, True), repeat=4):
        demand = ground_demand(rng, mode, lifted)
        up = np.repeat(demand.lifted, 4)
        A, l, u = rows(JointTorqueLimit(5.0), demand, feet=True)
        assert not A[~up].any()
        assert np.all(l[~up] <= -INFINITY)
        assert np.all(u[~up] >= INFINITY)
        for one, other in zip(
            (A, l, u), rows(JointTorqueLimit(5.0), replace(demand, lifted=np.ones(4, bool)), True), strict=True
        ):
            np.testing.assert_array_equal(one[up], other[up])


@pytest.mark.parametrize("powered", [False, True], ids=["paper", "power"])
@pytest.mark.parametrize("name", NAMES)
def test_pattern_covers_every_nonzero_of_a_ground_mode_and_no_two_legs_share_a_cost(name, powered):
    rng, mode = np.random.default_rng(8), modes(powered)[name]
    leg = WIDE_LEGS[: mode.size]
    for _ in range(40):
        program = assemble(mode, ground_demand(rng, mode))
        assert program.A.shape == mode.pattern.shape
        assert not program.A[~mode.pattern].any()
        assert not program.P[leg[:, None] != leg].any()
        assert np.linalg.eigvalsh(program.P).min() > 0.0, "one optimum only"


@pytest.mark.parametrize("name", NAMES)
def test_assembling_one_tick_of_a_ground_mode_leaves_no_trace_in_the_next(name):
    rng, mode = np.random.default_rng(9), modes(True)[name]
    one, other = (ground_demand(rng, mode) for _ in range(2))
    fresh = assemble(mode, one)
    assemble(mode, other)
    again = assemble(mode, one)
    for field in ("P", "q", "A", "l", "u"):
        np.testing.assert_array_equal(getattr(again, field), getattr(fresh, field))


def test_only_the_wrenches_of_floor_and_weight_feet_and_joint_torques_may_be_softened():
    """For any demand, lost rotors have no thrust, thrusts stay in their box and held angles stay held."""
    rng = np.random.default_rng(10)
    for name, mode in modes().items():
        demand = ground_demand(rng, mode, np.ones(4, bool))
        hard = np.setdiff1d(np.arange(len(mode.pattern)), mode.soft_rows)
        kept = Mode("kept", (), (ThrustBox(),) if name == "rest" else (ThrustBox(), mode.constraints[-1]))
        kept = replace(kept, feet_carry=mode.feet_carry)
        np.testing.assert_array_equal(assemble(mode, demand).A[hard], assemble(kept, demand).A)
