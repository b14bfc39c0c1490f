"""Pins the allocator's optimum: against exact solvers and the KKT conditions, within every limit."""

from dataclasses import replace

import numpy as np
import osqp
import pytest
from scipy.optimize import nnls
from support.answers import EACH_PRESET, LEVEL_HOVER, NO_FORCES, answers, assert_bounded, demands, spent, ticks
from support.states import demand_of, exact

from spidar_gym.control.allocation import solver
from spidar_gym.control.allocation.allocator import ANSWERED, AllocationStatus, Allocator, AllocatorConfig
from spidar_gym.control.allocation.modes import ALLOCATIONS
from spidar_gym.control.allocation.problem import FORCE_SCALE, QuadraticProgram, assemble
from spidar_gym.control.allocation.solver import closed_form
from spidar_gym.robot import FORMS, ROBOT


def stationarity(program: QuadraticProgram, x, *, margin):
    """Distance of −∇ from the cone of normals of the rows within `margin` of x, relative to ‖∇‖: 0 at an optimum."""
    r, equal = program.A @ x, program.l == program.u
    high, low = ~equal & (program.u - r < margin), ~equal & (r - program.l < margin)
    normals = [program.A[equal], -program.A[equal], program.A[high], -program.A[low]]
    gradient = program.P @ x + program.q
    return nnls(np.vstack(normals).T, -gradient)[1] / np.linalg.norm(gradient)


def test_the_status_codes_are_those_of_osqp():
    words = osqp.SolverStatus
    assert words.OSQP_SOLVED == solver.OSQP_SOLVED
    assert words.OSQP_PRIMAL_INFEASIBLE == solver.OSQP_INFEASIBLE
    assert words.OSQP_MAX_ITER_REACHED == solver.OSQP_MAX_ITER


def test_raw_answers_of_osqp_agree_with_the_exact_optimum_where_its_status_is_solved():
    allocator = Allocator(ALLOCATIONS["paper"])
    mode, solved = allocator.mode("flight"), 0
    for demand, _ in ticks("paper", True):
        program = assemble(mode, demand)
        x, says_solved, _, duals, _ = allocator.solver(mode).solve(program)
        optimum = closed_form(program, duals, rounds=8)
        if says_solved and optimum is not None:
            solved += 1
            np.testing.assert_allclose(FORCE_SCALE * x, FORCE_SCALE * optimum, atol=1e-3)
            assert program.objective(x) == pytest.approx(program.objective(optimum), rel=1e-6, abs=1e-6)
    assert solved > 200


def test_hover_of_the_flat_form_takes_an_eighth_of_the_weight_from_each_rotor():
    demand = demand_of(FORMS["form1"], np.eye(3), LEVEL_HOVER)
    for preset, per_rotor in (("as_flown", 0.05), ("paper", 0.15)):
        allocation = Allocator(ALLOCATIONS[preset]).allocate(demand, "flight", NO_FORCES)
        assert allocation.status == AllocationStatus.CLOSED_FORM
        assert allocation.thrust.sum() == pytest.approx(ROBOT.weight, rel=0.02)
        np.testing.assert_allclose(allocation.thrust, ROBOT.hover_thrust, rtol=per_rotor)


def test_hover_without_torque_cost_is_the_least_norm_solution():
    demand = demand_of(FORMS["form1"], np.eye(3), LEVEL_HOVER)
    allocation = Allocator(ALLOCATIONS["as_flown"]).allocate(demand, "flight", NO_FORCES)
    least_norm = np.linalg.pinv(demand.thrust_map) @ LEVEL_HOVER
    np.testing.assert_allclose(allocation.forces_l.reshape(-1), least_norm, atol=1e-9)


def unsolved(found):
    return [allocation.status for _, _, allocation in found if allocation.status not in ANSWERED]


def assert_optimal(preset, found):
    for demand, optimum, allocation in found:
        if allocation.status in ANSWERED:
            np.testing.assert_allclose(allocation.forces_l, optimum, atol=1e-3, rtol=0)
            assert spent(preset, demand, allocation.forces_l) == pytest.approx(spent(preset, demand, optimum), rel=1e-6)


BOTH = pytest.mark.parametrize("hard", [False, True], ids=["easy", "hard"])


@BOTH
@EACH_PRESET
def test_forces_and_cost_agree_with_an_exact_solver(preset, hard):
    assert_optimal(preset, answers(preset, hard))


@BOTH
@EACH_PRESET
def test_no_feasible_demand_stays_unsolved(preset, hard):
    assert unsolved(answers(preset, hard)) == []


@BOTH
@EACH_PRESET
def test_osqp_alone_agrees_with_an_exact_solver(preset, hard, no_shortcut):
    found = answers.__wrapped__(preset, hard)
    assert {allocation.status for _, _, allocation in found} >= {AllocationStatus.SOLVED}
    assert_optimal(preset, found)


@pytest.mark.slow
@BOTH
@EACH_PRESET
def test_thousands_of_demands_agree_with_an_exact_solver(preset, hard):
    assert_optimal(preset, answers(preset, hard, seed=1, n=3000))


@pytest.mark.slow
@BOTH
@EACH_PRESET
def test_none_of_thousands_of_feasible_demands_stays_unsolved(preset, hard):
    assert unsolved(answers(preset, hard, seed=1, n=3000)) == []


@pytest.mark.slow
@BOTH
@EACH_PRESET
def test_thousands_of_answers_of_osqp_alone_agree_with_an_exact_solver(preset, hard, no_shortcut):
    assert_optimal(preset, answers.__wrapped__(preset, hard, seed=1, n=3000))


def test_few_feasible_demands_fall_back_at_the_iteration_cap_of_the_robot():
    allocator, feasible, fallen = Allocator(ALLOCATIONS["paper"], AllocatorConfig(max_iter=300)), 0, 0
    for demand, optimum in ticks("paper", True):
        allocation = allocator.allocate(demand, "flight", NO_FORCES)
        assert_bounded(demand, "paper", allocation)
        if optimum is not None:
            feasible, fallen = feasible + 1, fallen + (allocation.status not in ANSWERED)
    assert feasible > 220
    assert fallen / feasible < 0.02


def test_most_hard_demands_press_against_an_inequality():
    mode, pressed, feasible = ALLOCATIONS["paper"]["flight"], 0, 0
    for demand, optimum in ticks("paper", True):
        if optimum is not None:
            program = assemble(mode, demand)
            r = program.A @ optimum.reshape(-1) / FORCE_SCALE
            touched = (program.l != program.u) & (np.minimum(r - program.l, program.u - r) < 1e-6)
            pressed, feasible = pressed + bool(touched.any()), feasible + 1
    assert pressed / feasible > 0.7


@EACH_PRESET
def test_answers_of_osqp_satisfy_the_kkt_conditions(preset, no_shortcut):
    allocator, solved = Allocator(ALLOCATIONS[preset]), 0
    for demand, _ in ticks(preset, True)[:200]:
        allocation = allocator.allocate(demand, "flight", NO_FORCES)
        if allocation.status == AllocationStatus.SOLVED:
            solved += 1
            program, x = assemble(ALLOCATIONS[preset]["flight"], demand), allocation.forces_l.reshape(-1) / FORCE_SCALE
            assert program.violation(x) < 1e-5
            assert stationarity(program, x, margin=1e-5) < 1e-5
    assert solved > 150


def test_closed_form_is_an_optimum_or_nothing():
    found = 0
    for demand in demands(True, 0, 250) + demands(False, 0, 250):
        program = assemble(ALLOCATIONS["paper"]["flight"], demand)
        x = closed_form(program)
        if x is not None:
            found += 1
            assert exact(program) is not None
            assert program.violation(x) < 1e-8
            assert stationarity(program, x, margin=1e-8) < 1e-9
    assert 250 < found <= 500


def test_optimal_answers_give_the_wrench_within_every_limit():
    allocator = Allocator(ALLOCATIONS["paper"])
    for demand, _ in ticks("paper", True)[:300]:
        allocation = allocator.allocate(demand, "flight", NO_FORCES)
        if allocation.status in ANSWERED:
            np.testing.assert_allclose(allocation.wrench, demand.wrench, atol=2e-3)
            assert np.abs(allocation.joint_torques).max() <= ROBOT.max_joint_torque + 1e-4
            assert np.abs(allocation.forces_l).max() <= ROBOT.max_thrust + 1e-3
            np.testing.assert_allclose(allocation.thrust, np.linalg.norm(allocation.forces_l, axis=1), rtol=1e-12)


def test_unallocated_wrench_is_what_the_forces_do_not_give():
    allocator = Allocator(ALLOCATIONS["paper"])
    for i, (demand, _) in enumerate(ticks("paper", True)[:80]):
        demand = replace(demand, wrench=demand.wrench * (1.0 + i % 5))
        allocation = allocator.allocate(demand, "flight", NO_FORCES)
        given = sum(demand.thrust_map[:, 3 * k : 3 * k + 3] @ f for k, f in enumerate(allocation.forces_l))
        np.testing.assert_allclose(allocation.unallocated_wrench, demand.wrench - given, atol=1e-9)
