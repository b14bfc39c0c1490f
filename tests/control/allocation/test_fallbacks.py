"""Pins the fallbacks without an optimum: softened rows, spheres, held forces; ticks are independent."""

from dataclasses import replace

import numpy as np
import pytest
from support.answers import (
    EACH_PRESET,
    LEVEL_HOVER,
    NO_FORCES,
    OPTIMAL,
    assert_bounded,
    best,
    hardest,
    leaves_the_spheres,
    restricted_demand,
    same,
    spent,
    ticks,
)
from support.states import demand_of, exact, random_demands, within_spheres

from spidar_gym.control.allocation import allocator as module
from spidar_gym.control.allocation.allocator import ANSWERED, AllocationStatus, Allocator, AllocatorConfig
from spidar_gym.control.allocation.modes import ALLOCATIONS
from spidar_gym.control.allocation.problem import FORCE_SCALE, QuadraticProgram, assemble
from spidar_gym.control.allocation.solver import Workspace, closed_form
from spidar_gym.errors import InvalidValueError, UnknownNameError
from spidar_gym.robot import FORMS, ROBOT


@pytest.mark.parametrize(
    ("preset", "weights", "torque"), [("paper", 5, 0), ("as_flown", 5, 0), ("paper", 1, 60), ("as_flown", 1, 300)]
)
def test_an_infeasible_demand_is_softened_within_the_hard_limits(preset, weights, torque):
    rng, allocator, infeasible = np.random.default_rng(20), Allocator(ALLOCATIONS[preset]), 0
    for demand in random_demands(rng, 60, True):
        axis = rng.normal(size=3)
        turn = np.concatenate([np.zeros(3), torque * axis / np.linalg.norm(axis)])
        demand = replace(demand, wrench=weights * demand.wrench + turn)
        allocation = allocator.allocate(demand, "flight", NO_FORCES)
        assert_bounded(demand, preset, allocation)
        if exact(assemble(ALLOCATIONS[preset]["flight"], demand)) is None:
            infeasible += 1
            assert allocation.status in (AllocationStatus.SOFTENED, AllocationStatus.HELD)
            assert allocation.slack > 0.0
    assert infeasible > 40


def test_a_demand_of_five_weights_is_answered_with_nearly_the_largest_thrust():
    demand = demand_of(FORMS["form1"], np.eye(3), 5.0 * LEVEL_HOVER)
    allocation = Allocator(ALLOCATIONS["as_flown"]).allocate(demand, "flight", NO_FORCES)
    assert allocation.status == AllocationStatus.SOFTENED
    assert allocation.wrench[2] > 0.95 * 8 * 40.0
    assert np.abs(allocation.wrench[:2]).max() < 1.0


def softened_by_hand(demand, mode, price):
    """Optimum of the program with the cost ½ price × (violation)² in place of the wrench and torque rows."""
    program = assemble(mode, demand)
    k, m = len(mode.soft_rows), len(program.l)
    A = np.zeros((m, 24 + k))
    A[:, :24] = program.A
    A[mode.soft_rows, 24 + np.arange(k)] = 1.0
    P = np.diag(np.full(24 + k, float(price)))
    P[:24, :24] = program.P
    return best(QuadraticProgram(P, np.concatenate([program.q, np.zeros(k)]), A, program.l, program.u))


def test_softened_forces_agree_with_an_exact_solver():
    allocator, mode, compared = Allocator(ALLOCATIONS["paper"]), ALLOCATIONS["paper"]["flight"], 0
    for demand in random_demands(np.random.default_rng(21), 60, True):
        demand = replace(demand, wrench=2.5 * demand.wrench)
        allocation = allocator.allocate(demand, "flight", NO_FORCES)
        if allocation.status == AllocationStatus.SOFTENED:
            compared += 1
            forces = FORCE_SCALE * softened_by_hand(demand, mode, AllocatorConfig().price)[:24].reshape(8, 3)
            np.testing.assert_allclose(allocation.forces_l, forces, atol=1e-2, rtol=0)
    assert compared > 45


def holds_and_forgets(name, value):
    """Assert that `value` in a field of the demand holds the previous forces and does not affect the next answer."""
    good, previous = restricted_demand(), np.random.default_rng(22).uniform(-20.0, 20.0, (8, 3))
    array = getattr(good, name).copy()
    array.flat[0] = value
    allocator, fresh = Allocator(ALLOCATIONS["paper"]), Allocator(ALLOCATIONS["paper"])
    for _ in range(2):
        held = allocator.allocate(replace(good, **{name: array}), "flight", previous)
        assert held.status == AllocationStatus.HELD
        assert held.iterations == 0
        np.testing.assert_allclose(held.forces_l, previous, rtol=1e-15)
        assert same(allocator.allocate(good, "flight", previous), fresh.allocate(good, "flight", previous))


NUMBERS = ("wrench", "thrust_map", "torque_map", "gravity_torque", "phi", "lower", "upper")


@pytest.mark.parametrize("name", NUMBERS)
def test_nan_in_a_demand_holds_the_previous_forces_and_poisons_nothing(name):
    holds_and_forgets(name, np.nan)


@pytest.mark.parametrize("name", NUMBERS)
def test_nan_in_a_demand_poisons_no_workspace(name, no_shortcut):
    holds_and_forgets(name, np.nan)


@pytest.mark.parametrize("name", NUMBERS)
def test_infinity_in_a_demand_holds_the_previous_forces_and_poisons_nothing(name):
    holds_and_forgets(name, np.inf)


@pytest.mark.parametrize("bad", [np.nan, np.inf, 1e3])
def test_held_forces_are_finite_and_in_the_sphere_whatever_was_before(bad):
    demand = replace(restricted_demand(), wrench=np.full(6, np.nan))
    previous = np.full((8, 3), 10.0)
    previous[3, 1] = bad
    allocation = Allocator(ALLOCATIONS["paper"]).allocate(demand, "flight", previous)
    assert allocation.status == AllocationStatus.HELD
    assert np.isfinite(allocation.forces_l).all()
    assert np.linalg.norm(allocation.forces_l, axis=1).max() <= ROBOT.max_thrust + 1e-9
    np.testing.assert_array_equal(np.delete(allocation.forces_l, 3, axis=0), np.full((7, 3), 10.0))


@EACH_PRESET
def test_the_order_of_the_ticks_changes_no_bit(preset):
    compare_orders(preset)


def test_the_order_of_the_ticks_changes_no_bit_in_osqp_alone(no_shortcut):
    compare_orders("paper")


def compare_orders(preset):
    rng = np.random.default_rng(23)
    demands = random_demands(rng, 60, False) + random_demands(rng, 100, True)
    demands += [replace(demand, wrench=4.0 * demand.wrench) for demand in random_demands(rng, 30, True)]
    demands += [replace(demands[i], wrench=np.full(6, np.nan)) for i in range(10)]
    answers = []
    for order in (np.arange(200), rng.permutation(200)):
        allocator, answer = Allocator(ALLOCATIONS[preset]), {}
        for i in order.tolist():
            answer[i] = allocator.allocate(demands[i], "flight", np.full((8, 3), 5.0))
        answers.append(answer)
    assert {a.status for a in answers[0].values()} > {AllocationStatus.SOFTENED, AllocationStatus.HELD}
    assert all(same(answers[1][i], answers[0][i]) for i in range(200))


def rows_broken(demand, preset, forces):
    """Largest violation of a row or of a sphere, in scaled units."""
    x = forces.reshape(-1) / FORCE_SCALE
    sphere = np.linalg.norm(forces, axis=1).max() / ROBOT.max_thrust - 1.0
    return max(assemble(ALLOCATIONS[preset]["flight"], demand).violation(x), sphere)


def test_an_optimum_outside_the_spheres_is_replaced_by_the_best_within_and_every_row_holds():
    lateral = np.array([194.4, 0.0, 270.0, 0.0, 0.0, 0.0])
    demand = demand_of(FORMS["form1"], np.eye(3), lateral)
    program = assemble(ALLOCATIONS["as_flown"]["flight"], demand)
    assert leaves_the_spheres(exact(program)), "the optimum is in a corner of the cube"
    allocation = Allocator(ALLOCATIONS["as_flown"]).allocate(demand, "flight", NO_FORCES)
    assert allocation.status == AllocationStatus.PROJECTED
    assert rows_broken(demand, "as_flown", allocation.forces_l) < 1e-9
    np.testing.assert_allclose(allocation.wrench, lateral, atol=1e-6)
    cone = FORCE_SCALE * within_spheres(program).reshape(8, 3)
    assert spent("as_flown", demand, allocation.forces_l) == pytest.approx(spent("as_flown", demand, cone), rel=1e-8)
    assert allocation.thrust.max() == pytest.approx(ROBOT.max_thrust, rel=1e-6)


def test_no_hover_needs_the_spheres():
    for form in FORMS.values():
        demand = demand_of(form, np.eye(3), LEVEL_HOVER)
        assert Allocator(ALLOCATIONS["paper"]).allocate(demand, "flight", NO_FORCES).status in OPTIMAL


@EACH_PRESET
@pytest.mark.parametrize("cap", [300, 2000])
def test_an_answer_obeys_every_row_and_the_spheres_or_reports_infeasibility(preset, cap):
    allocator, seen = Allocator(ALLOCATIONS[preset], AllocatorConfig(max_iter=cap)), set()
    for demand, x in hardest(preset):
        allocation = allocator.allocate(demand, "flight", NO_FORCES)
        seen.add(allocation.status)
        assert (allocation.status in ANSWERED) == (x is not None)
        if x is not None:
            assert rows_broken(demand, preset, allocation.forces_l) < 1e-6
            oracle = spent(preset, demand, FORCE_SCALE * x.reshape(8, 3))
            assert spent(preset, demand, allocation.forces_l) == pytest.approx(oracle, rel=1e-6)
    assert seen >= {AllocationStatus.PROJECTED, AllocationStatus.SOFTENED}


@EACH_PRESET
def test_an_optimum_of_the_cube_within_the_spheres_is_returned_bit_for_bit_without_the_sphere_solver(
    preset, monkeypatch
):
    def forbidden(*_):
        raise AssertionError("the sphere solver was called")

    monkeypatch.setattr(module, "sphere_optimum", forbidden)
    allocator, mode, compared = Allocator(ALLOCATIONS[preset]), ALLOCATIONS[preset]["flight"], 0
    for demand, _ in ticks(preset, False) + ticks(preset, True):
        program = assemble(mode, demand)
        x = closed_form(program)
        if x is None:
            raw, _, _, duals, _ = allocator.solver(mode).solve(program)
            x = closed_form(program, duals, rounds=8)
            x = raw if x is None else x
        if not leaves_the_spheres(x) and program.violation(x) < 1e-6:
            compared += 1
            answer = allocator.allocate(demand, "flight", NO_FORCES)
            assert answer.status in OPTIMAL
            np.testing.assert_array_equal(answer.forces_l, (FORCE_SCALE * x).reshape(8, 3))
    assert compared > 400


def test_softened_forces_obey_the_hard_rows_and_the_slack_is_their_violation():
    allocator, mode, softened = Allocator(ALLOCATIONS["paper"]), ALLOCATIONS["paper"]["flight"], 0
    for demand, x in hardest("paper"):
        if x is None:
            softened += 1
            allocation = allocator.allocate(demand, "flight", NO_FORCES)
            program = assemble(mode, demand)
            r = program.A @ allocation.forces_l.reshape(-1) / FORCE_SCALE
            broken = np.maximum(program.l - r, r - program.u)
            assert np.delete(broken, mode.soft_rows).max() < 1e-6
            assert allocation.thrust.max() <= ROBOT.max_thrust
            assert allocation.slack == pytest.approx(broken[mode.soft_rows].max(), abs=1e-6)
            assert allocation.slack > 0.0
    assert softened > 10


@pytest.mark.parametrize(
    ("name", "index", "value"), [("u", 7, -99.0), ("l", 31, 99.0), ("u", 3, np.nan), ("q", 3, np.nan), ("A", 0, np.nan)]
)
def test_crossed_bounds_and_nan_are_not_answered_with_a_stale_solution_and_poison_nothing(name, index, value):
    mode, legs = ALLOCATIONS["paper"]["flight"], np.arange(24) // 6
    used, fresh = (Workspace(legs[:, None] == legs, mode.pattern, max_iter=2000, tolerance=1e-7) for _ in range(2))
    first, good = (assemble(mode, demand) for demand, _ in ticks("paper", True)[:2])
    assert used.solve(first)[1]
    array = getattr(first, name).copy()
    array.flat[index] = value
    assert not used.solve(replace(first, **{name: array}))[1]
    assert all(np.array_equal(a, b) for a, b in zip(used.solve(good), fresh.solve(good), strict=True))


def test_an_unknown_mode_or_a_cap_below_one_is_refused_with_the_valid_choice():
    with pytest.raises(UnknownNameError, match="flight"):
        Allocator(ALLOCATIONS["paper"]).allocate(restricted_demand(), "walk", NO_FORCES)
    with pytest.raises(InvalidValueError, match="at least 1"):
        Allocator(ALLOCATIONS["paper"], AllocatorConfig(max_iter=0))
