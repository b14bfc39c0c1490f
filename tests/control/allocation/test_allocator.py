"""Pins the allocator: optimal by two independent measures, bounded when there is no optimum, the same in any order."""

from dataclasses import fields, replace
from functools import cache

import numpy as np
import osqp
import pytest
from scipy.optimize import minimize, nnls
from support.states import cost, demand_of, exact, hardest_demand, random_demands, within_spheres

from spidar_gym.control.allocation import allocator as module
from spidar_gym.control.allocation import solver
from spidar_gym.control.allocation.allocator import ANSWERED, AllocationStatus, Allocator, AllocatorConfig
from spidar_gym.control.allocation.modes import ALLOCATIONS, PROJECTION
from spidar_gym.control.allocation.problem import FORCE_SCALE, INFINITY, QuadraticProgram, assemble
from spidar_gym.control.allocation.solver import Workspace, closed_form
from spidar_gym.errors import InvalidValueError, UnknownNameError
from spidar_gym.robot import FORMS, ROBOT

OPTIMAL = (AllocationStatus.CLOSED_FORM, AllocationStatus.SOLVED)
NO_FORCES = np.zeros((8, 3))
LEVEL_HOVER = np.array([0.0, 0.0, ROBOT.weight, 0.0, 0.0, 0.0])


@cache
def demands(hard, seed, n):
    return random_demands(np.random.default_rng(seed), n, hard)


@cache
def ticks(preset, hard, seed=0, n=250):
    """Random demands with their exact optima within the spheres in N, None where there is none."""
    optima = [best(assemble(ALLOCATIONS[preset]["flight"], demand)) for demand in demands(hard, seed, n)]
    forces = [None if x is None else FORCE_SCALE * x.reshape(8, 3) for x in optima]
    return list(zip(demands(hard, seed, n), forces, strict=True))


def leaves_the_spheres(x):
    return np.linalg.norm(x[:24].reshape(8, 3), axis=1).max() > 1.0 + 1e-9


def best(program):
    """The optimum within the spheres: by an active-set method, and by cones where that one's leaves them."""
    x = exact(program)
    return within_spheres(program) if x is not None and leaves_the_spheres(x) else x


def spent(preset, demand, forces):
    return cost(ALLOCATIONS[preset]["flight"], demand, forces)


def stationarity(program: QuadraticProgram, x, *, margin):
    """Distance of −∇ from the cone of normals of the rows within `margin` of x, relative to ‖∇‖: 0 at an optimum."""
    r, equal = program.A @ x, program.l == program.u
    high, low = ~equal & (program.u - r < margin), ~equal & (r - program.l < margin)
    normals = [program.A[equal], -program.A[equal], program.A[high], -program.A[low]]
    gradient = program.P @ x + program.q
    return nnls(np.vstack(normals).T, -gradient)[1] / np.linalg.norm(gradient)


def assert_bounded(demand, preset, allocation):
    """Finite, in the sphere, and every row holds that no fallback may violate: box, lock, interference."""
    assert np.isfinite(allocation.forces_l).all()
    assert np.linalg.norm(allocation.forces_l, axis=1).max() <= ROBOT.max_thrust + 1e-9
    mode = ALLOCATIONS[preset]["flight"]
    program = assemble(mode, demand)
    r, hard = program.A @ allocation.forces_l.reshape(-1) / FORCE_SCALE, np.ones(len(program.l), bool)
    hard[mode.soft_rows] = False
    assert np.all((program.l - 1e-5 <= r) & (r <= program.u + 1e-5) | ~hard)


def same(a, b):
    """Equal bit for bit, but for the time it took."""
    return all(
        np.array_equal(getattr(a, f.name), getattr(b, f.name), equal_nan=f.name != "status")
        for f in fields(a)
        if f.name != "solve_time"
    )


@pytest.fixture
def no_shortcut(monkeypatch):
    """Every tick goes through OSQP: the closed form may refine its answer, never replace it."""

    def refine(program, duals=None, **options):
        return None if duals is None else closed_form(program, duals, **options)

    monkeypatch.setattr(module, "closed_form", refine)


def test_the_solvers_words_are_read_as_it_means_them():
    words = osqp.SolverStatus
    assert words.OSQP_SOLVED == solver.OSQP_SOLVED
    assert words.OSQP_PRIMAL_INFEASIBLE == solver.OSQP_INFEASIBLE
    assert words.OSQP_MAX_ITER_REACHED == solver.OSQP_MAX_ITER


def test_raw_answers_of_osqp_agree_with_the_exact_optimum_wherever_it_says_solved():
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


@cache
def answers(preset, hard, seed=0, n=250):
    """Demands that have an optimum, the optimum, and what the allocator answers."""
    allocator, found = Allocator(ALLOCATIONS[preset]), []
    for demand, optimum in ticks(preset, hard, seed, n):
        allocation = allocator.allocate(demand, "flight", NO_FORCES)
        if optimum is None:
            assert allocation.status not in ANSWERED
        else:
            found.append((demand, optimum, allocation))
    assert len(found) > 0.9 * n
    return found


def unsolved(found):
    return [allocation.status for _, _, allocation in found if allocation.status not in ANSWERED]


def assert_optimal(preset, found):
    for demand, optimum, allocation in found:
        if allocation.status in ANSWERED:
            np.testing.assert_allclose(allocation.forces_l, optimum, atol=1e-3, rtol=0)
            assert spent(preset, demand, allocation.forces_l) == pytest.approx(spent(preset, demand, optimum), rel=1e-6)


BOTH = pytest.mark.parametrize("hard", [False, True], ids=["easy", "hard"])
EACH_PRESET = pytest.mark.parametrize("preset", ALLOCATIONS)


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


def test_five_weights_are_answered_with_nearly_all_the_thrust_there_is():
    demand = demand_of(FORMS["form1"], np.eye(3), 5.0 * LEVEL_HOVER)
    allocation = Allocator(ALLOCATIONS["as_flown"]).allocate(demand, "flight", NO_FORCES)
    assert allocation.status == AllocationStatus.SOFTENED
    assert allocation.wrench[2] > 0.95 * 8 * 40.0
    assert np.abs(allocation.wrench[:2]).max() < 1.0


def softened_by_hand(demand, mode, price):
    """Optimum of the program whose wrench and torque rows are replaced by ½ price × (their violation)²."""
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


def restricted_demand():
    """A tick in which the allocation reads every field."""
    demand = demand_of(FORMS["form3"], np.eye(3), LEVEL_HOVER)
    assert demand.restricted[0]
    assert demand.locked[0]
    return demand


def holds_and_forgets(name, value):
    """Answers to `value` in a field of the demand hold the previous forces, and leave no trace in the next answer."""
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


def test_where_the_optimum_leaves_the_sphere_the_best_answer_within_is_given_and_every_row_holds():
    lateral = np.array([194.4, 0.0, 270.0, 0.0, 0.0, 0.0])
    demand = demand_of(FORMS["form1"], np.eye(3), lateral)
    program = assemble(ALLOCATIONS["as_flown"]["flight"], demand)
    assert leaves_the_spheres(exact(program)), "the optimum lies in a corner of the cube"
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


@cache
def hardest(preset, n=60):
    """Demands near the largest feasible wrench, and what the oracle says to them, None where they are infeasible."""
    rng = np.random.default_rng(40)
    found = [hardest_demand(rng, preset) for _ in range(n)]
    return [(demand, within_spheres(assemble(ALLOCATIONS[preset]["flight"], demand))) for demand in found]


@EACH_PRESET
@pytest.mark.parametrize("cap", [300, 2000])
def test_an_answer_obeys_every_row_and_the_spheres_or_says_that_nothing_does(preset, cap):
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
def test_an_optimum_of_the_cube_within_the_spheres_is_answered_bit_for_bit_and_the_spheres_are_not_asked(
    preset, monkeypatch
):
    def unasked(*_):
        raise AssertionError("the spheres were looked at")

    monkeypatch.setattr(module, "sphere_optimum", unasked)
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


def test_softened_forces_obey_what_is_hard_and_the_slack_is_theirs():
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


def wishes(n, size, seed=30):
    """Demands with their valid optimum and a force that a policy might wish for, up to `size` N off it per axis."""
    rng = np.random.default_rng(seed)
    for demand, optimum in ticks("paper", True)[:n] + ticks("paper", False)[:n]:
        if optimum is not None:
            yield demand, optimum, optimum + rng.uniform(-size, size, (8, 3))


def nearest(demand, wish):
    """Projection onto the rows and the spheres, None where no forces are valid."""
    x = within_spheres(replace(assemble(PROJECTION, demand), q=-wish.reshape(-1) / FORCE_SCALE))
    return None if x is None else FORCE_SCALE * x.reshape(8, 3)


def test_projection_leaves_valid_forces_where_they_are():
    allocator, valid = Allocator(ALLOCATIONS["paper"]), 0
    for demand, optimum, _ in wishes(100, 0.0):
        if assemble(PROJECTION, demand).violation(optimum.reshape(-1) / FORCE_SCALE) < 1e-12:
            valid += 1
            np.testing.assert_allclose(allocator.project(demand, optimum, NO_FORCES).forces_l, optimum, atol=1e-6)
    assert valid > 30


@pytest.mark.parametrize("size", [5.0, 30.0])
def test_projected_forces_are_valid(size):
    allocator = Allocator(ALLOCATIONS["paper"])
    for demand, _, wish in wishes(80, size):
        projected = allocator.project(demand, wish, NO_FORCES)
        assert projected.status in OPTIMAL
        assert projected.thrust.max() <= ROBOT.max_thrust + 1e-9
        assert FORCE_SCALE * assemble(PROJECTION, demand).violation(projected.forces_l.reshape(-1) / FORCE_SCALE) < 1e-4


@pytest.mark.parametrize("size", [5.0, 30.0, 300.0])
def test_projected_forces_are_the_nearest_valid_ones(size):
    allocator = Allocator(ALLOCATIONS["paper"])
    for demand, _, wish in wishes(80, size):
        projected, best = allocator.project(demand, wish, NO_FORCES).forces_l, nearest(demand, wish)
        np.testing.assert_allclose(projected, best, atol=0.01, rtol=0)
        assert np.linalg.norm(projected - wish) == pytest.approx(np.linalg.norm(best - wish), rel=1e-6, abs=1e-5)


def test_a_projection_is_held_only_where_no_forces_are_valid_and_obeys_every_limit_where_some_are():
    rng, allocator, held = np.random.default_rng(41), Allocator(ALLOCATIONS["paper"]), 0
    for demand, _ in hardest("as_flown"):
        # The links of a robot that was drawn heavier, or that lost a rotor, hang on the others' thrust.
        demand = replace(demand, gravity_torque=rng.uniform(1.0, 3.0) * demand.gravity_torque, lost=rng.random(8) < 0.2)
        wish = rng.uniform(-60.0, 60.0, (8, 3))
        best, answer = nearest(demand, wish), allocator.project(demand, wish, NO_FORCES)
        assert (answer.status == AllocationStatus.HELD) == (best is None)
        held += best is None
        if best is not None:
            assert assemble(PROJECTION, demand).violation(answer.forces_l.reshape(-1) / FORCE_SCALE) < 1e-6
            assert answer.thrust.max() <= ROBOT.max_thrust
            assert np.linalg.norm(answer.forces_l - wish) == pytest.approx(np.linalg.norm(best - wish), rel=1e-6)
    assert 3 < held < 57


def test_projected_forces_agree_with_sequential_quadratic_programming_on_the_sphere_itself():
    allocator, cut, blocks = Allocator(ALLOCATIONS["paper"]), 0, np.kron(np.eye(8), np.ones(3))
    for demand, optimum, wish in list(wishes(100, 30.0))[:90:9]:
        program = assemble(PROJECTION, demand)
        equal, low, high = program.l == program.u, program.l > -INFINITY, program.u < INFINITY
        A, above, below = program.A, low & ~equal, high & ~equal
        target = wish.reshape(-1) / FORCE_SCALE
        found = minimize(
            lambda x, target=target: (0.5 * np.sum((x - target) ** 2), x - target),
            optimum.reshape(-1) / FORCE_SCALE,
            jac=True,
            method="SLSQP",
            options={"ftol": 1e-14, "maxiter": 500},
            constraints=[
                {"type": kind, "fun": lambda x, C=C, c=c: C @ x - c, "jac": lambda _, C=C: C}
                for kind, C, c in (
                    ("eq", A[equal], program.l[equal]),
                    ("ineq", A[above], program.l[above]),
                    ("ineq", -A[below], -program.u[below]),
                )
            ]
            + [{"type": "ineq", "fun": lambda x: 1.0 - blocks @ x**2, "jac": lambda x: -2.0 * blocks * x}],
        )
        projected = allocator.project(demand, wish, NO_FORCES)
        cut += int((projected.thrust > 41.99).sum())
        np.testing.assert_allclose(projected.forces_l, FORCE_SCALE * found.x.reshape(8, 3), atol=0.05, rtol=0)
    assert cut > 2


def test_projecting_twice_is_projecting_once():
    allocator = Allocator(ALLOCATIONS["paper"])
    for demand, _, wish in wishes(60, 10.0):
        once = allocator.project(demand, wish, NO_FORCES).forces_l
        np.testing.assert_allclose(allocator.project(demand, once, NO_FORCES).forces_l, once, atol=1e-3, rtol=0)


def test_projection_brings_no_two_wishes_farther_apart():
    allocator, rng = Allocator(ALLOCATIONS["paper"]), np.random.default_rng(32)
    for demand, _, wish in wishes(60, 10.0):
        other = wish + rng.normal(scale=3.0, size=(8, 3))
        a, b = (allocator.project(demand, w, NO_FORCES).forces_l for w in (wish, other))
        assert np.linalg.norm(a - b) <= np.linalg.norm(wish - other) + 1e-2


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_wish_that_is_not_finite_holds_the_previous_forces_and_poisons_nothing(value):
    demand, previous = restricted_demand(), np.full((8, 3), 5.0)
    bad, wish = np.full((8, 3), 10.0), np.random.default_rng(33).uniform(-60.0, 60.0, (8, 3))
    bad[2, 1] = value
    allocator, fresh = Allocator(ALLOCATIONS["paper"]), Allocator(ALLOCATIONS["paper"])
    held = allocator.project(demand, bad, previous)
    assert held.status == AllocationStatus.HELD
    np.testing.assert_allclose(held.forces_l, previous, rtol=1e-15)
    assert same(allocator.project(demand, wish, previous), fresh.project(demand, wish, previous))
