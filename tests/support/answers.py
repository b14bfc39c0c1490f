"""Allocations of many demands, and the conditions on every answer, for the tests of the allocator."""

from dataclasses import fields
from functools import cache

import numpy as np
import pytest
from support.states import cost, demand_of, exact, hardest_demand, random_demands, within_spheres

from spidar_gym.control.allocation.allocator import ANSWERED, AllocationStatus, Allocator
from spidar_gym.control.allocation.modes import ALLOCATIONS
from spidar_gym.control.allocation.problem import FORCE_SCALE, assemble
from spidar_gym.robot import FORMS, ROBOT

OPTIMAL = (AllocationStatus.CLOSED_FORM, AllocationStatus.SOLVED)
NO_FORCES = np.zeros((8, 3))
LEVEL_HOVER = np.array([0.0, 0.0, ROBOT.weight, 0.0, 0.0, 0.0])


@cache
def demands(hard, seed, n):
    return random_demands(np.random.default_rng(seed), n, hard)


@cache
def ticks(preset, hard, seed=0, n=250):
    """Random demands with their exact optimal forces within the spheres [N]; None where a demand is infeasible."""
    optima = [best(assemble(ALLOCATIONS[preset]["flight"], demand)) for demand in demands(hard, seed, n)]
    forces = [None if x is None else FORCE_SCALE * x.reshape(8, 3) for x in optima]
    return list(zip(demands(hard, seed, n), forces, strict=True))


def leaves_the_spheres(x):
    return np.linalg.norm(x[:24].reshape(8, 3), axis=1).max() > 1.0 + 1e-9


def best(program):
    """The optimum within the spheres: by an active-set method, or by cones if its solution leaves a sphere."""
    x = exact(program)
    return within_spheres(program) if x is not None and leaves_the_spheres(x) else x


def spent(preset, demand, forces):
    return cost(ALLOCATIONS[preset]["flight"], demand, forces)


def assert_bounded(demand, preset, allocation):
    """Assert finite forces in the spheres, within every row that no fallback may violate: box, lock, interference."""
    assert np.isfinite(allocation.forces_l).all()
    assert np.linalg.norm(allocation.forces_l, axis=1).max() <= ROBOT.max_thrust + 1e-9
    mode = ALLOCATIONS[preset]["flight"]
    program = assemble(mode, demand)
    r, hard = program.A @ allocation.forces_l.reshape(-1) / FORCE_SCALE, np.ones(len(program.l), bool)
    hard[mode.soft_rows] = False
    assert np.all((program.l - 1e-5 <= r) & (r <= program.u + 1e-5) | ~hard)


def same(a, b):
    """Whether two allocations are equal bit for bit, except for `solve_time`."""
    return all(
        np.array_equal(getattr(a, f.name), getattr(b, f.name), equal_nan=f.name != "status")
        for f in fields(a)
        if f.name != "solve_time"
    )


@cache
def answers(preset, hard, seed=0, n=250):
    """Feasible demands, each with its optimum and the allocator's answer."""
    allocator, found = Allocator(ALLOCATIONS[preset]), []
    for demand, optimum in ticks(preset, hard, seed, n):
        allocation = allocator.allocate(demand, "flight", NO_FORCES)
        if optimum is None:
            assert allocation.status not in ANSWERED
        else:
            found.append((demand, optimum, allocation))
    assert len(found) > 0.9 * n
    return found


EACH_PRESET = pytest.mark.parametrize("preset", ALLOCATIONS)


def restricted_demand():
    """A demand of which the allocation reads every field."""
    demand = demand_of(FORMS["form3"], np.eye(3), LEVEL_HOVER)
    assert demand.restricted[0]
    assert demand.locked[0]
    return demand


@cache
def hardest(preset, n=60):
    """Demands near the largest feasible wrench, each with the oracle's optimum; None where a demand is infeasible."""
    rng = np.random.default_rng(40)
    found = [hardest_demand(rng, preset) for _ in range(n)]
    return [(demand, within_spheres(assemble(ALLOCATIONS[preset]["flight"], demand))) for demand in found]
