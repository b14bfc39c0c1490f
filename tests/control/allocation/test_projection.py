"""Pins the projection of requested forces: the nearest valid ones, on the sphere too, or the previous ones."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize
from support.answers import NO_FORCES, OPTIMAL, hardest, restricted_demand, same, ticks
from support.states import within_spheres

from spidar_gym.control.allocation.allocator import AllocationStatus, Allocator
from spidar_gym.control.allocation.modes import ALLOCATIONS, PROJECTION
from spidar_gym.control.allocation.problem import FORCE_SCALE, INFINITY, assemble
from spidar_gym.robot import ROBOT


def wishes(n, size, seed=30):
    """Demands with their valid optimum, and random requested forces up to `size` N from it per axis."""
    rng = np.random.default_rng(seed)
    for demand, optimum in ticks("paper", True)[:n] + ticks("paper", False)[:n]:
        if optimum is not None:
            yield demand, optimum, optimum + rng.uniform(-size, size, (8, 3))


def nearest(demand, wish):
    """Projection onto the rows and the spheres; None where no forces are valid."""
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
        # Randomised heavier links and lost rotors.
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
