"""Demands at the rotors' limits, compared with a second-order cone solver: the status of every answer is true."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from support.states import cost, demand_at_the_limit, ground_demand, within_spheres

from spidar_gym.control.allocation.allocator import ANSWERED, AllocationStatus, Allocator
from spidar_gym.control.allocation.modes import ALLOCATIONS, PROJECTION, ground_modes
from spidar_gym.control.allocation.problem import FORCE_SCALE, assemble
from spidar_gym.robot import ROBOT

SHARES = 4
"""Demands for each limit, since the search for a limit takes longer than an allocation."""
NO_FORCES = np.zeros((8, 3))


def broken(program, forces):
    """Largest violation of a row or of a sphere, in scaled units."""
    sphere = np.linalg.norm(forces, axis=1).max() / ROBOT.max_thrust - 1.0
    return max(program.violation(forces.reshape(-1) / FORCE_SCALE), sphere)


@pytest.mark.parametrize("preset", ALLOCATIONS)
def test_demands_at_the_limit(tries, rng, preset):
    mode, allocator, count, dear = ALLOCATIONS[preset]["flight"], Allocator(ALLOCATIONS[preset]), Counter(), 0
    for k in range(tries(20_000)):
        if k % SHARES == 0:
            limit = demand_at_the_limit(rng, preset)
        demand = replace(limit, wrench=rng.uniform(0.8, 1.1) * limit.wrench)
        program = assemble(mode, demand)
        best, answer = within_spheres(program), allocator.allocate(demand, "flight", NO_FORCES)
        count[str(answer.status)] += 1
        assert (answer.status in ANSWERED) == (best is not None), (k, answer.status)
        if best is None:
            continue
        assert broken(program, answer.forces_l) < 1e-6, (k, answer.status)
        ratio = cost(mode, demand, answer.forces_l) / cost(mode, demand, FORCE_SCALE * best.reshape(8, 3))
        if answer.status is AllocationStatus.PROJECTED:
            dear += ratio > 1.01
        else:
            assert ratio == pytest.approx(1.0, abs=1e-6), (k, answer.status)
    print(preset, dict(count), f"{dear} dear")
    assert dear <= 0.005 * sum(count[status] for status in ANSWERED)
    assert count["held"] == 0
    assert min(count["projected"], count["softened"]) > 0.1 * sum(count.values())


def test_projections(tries, rng):
    allocator, count = Allocator(ALLOCATIONS["paper"]), Counter()
    for k in range(tries(3000)):
        if k % SHARES == 0:
            limit = demand_at_the_limit(rng, "as_flown")
        # A robot that is heavier or lighter, or has lost rotors.
        heavy, lost = rng.uniform(0.7, 2.0), rng.random(8) < rng.choice([0.0, 0.15])
        demand = replace(limit, gravity_torque=heavy * limit.gravity_torque, lost=lost)
        wish = rng.choice([20.0, 60.0, 200.0]) * rng.uniform(-1.0, 1.0, (8, 3))
        program = replace(assemble(PROJECTION, demand), q=-wish.reshape(-1) / FORCE_SCALE)
        best, answer = within_spheres(program), allocator.project(demand, wish, NO_FORCES)
        count[str(answer.status)] += 1
        assert (answer.status in ANSWERED) == (best is not None), (k, answer.status)
        if best is not None:
            assert broken(program, answer.forces_l) < 1e-6, (k, answer.status)
            far, least = (np.linalg.norm(f - wish) for f in (answer.forces_l, FORCE_SCALE * best.reshape(8, 3)))
            assert far == pytest.approx(least, rel=1e-6, abs=1e-4), (k, answer.status)
    print(dict(count))
    assert min(count.values()) > 0.02 * sum(count.values())


@pytest.mark.parametrize("name", ["rest", "leg", "legs", "stance"])
def test_demands_of_the_ground(tries, rng, name):
    modes = ground_modes(
        power=False, torque_weight=0.7, torque_limit=5.0, foot_friction=0.6, peg_friction=0.3, min_normal=10.0
    )
    allocator, mode, count = Allocator(modes), modes[name], Counter()
    for k in range(tries(1000)):
        demand = ground_demand(rng, mode)
        heavy, pull = rng.uniform(0.5, 3.0), rng.uniform(0.0, 1.0) * ROBOT.weight * rng.normal(size=3)
        demand = replace(
            demand,
            gravity_torque=heavy * demand.gravity_torque,
            wrench=demand.wrench * rng.uniform(0.5, 2.0) + np.concatenate([pull, np.zeros(3)]),
            lost=demand.lost & (rng.random() < 0.3),
        )
        program = assemble(mode, demand)
        best, answer = within_spheres(program), allocator.allocate(demand, name, NO_FORCES)
        x = np.concatenate([answer.forces_l.reshape(-1), answer.foot_forces_f.reshape(-1)])[: mode.size] / FORCE_SCALE
        count[str(answer.status)] += 1
        assert (answer.status in ANSWERED) == (best is not None), (k, answer.status)
        if best is not None:
            assert max(program.violation(x), answer.thrust.max() / ROBOT.max_thrust - 1.0) < 1e-6, (k, answer.status)
            assert program.objective(x) == pytest.approx(program.objective(best), rel=1e-6, abs=1e-6)
    print(name, dict(count))
    assert count["held"] == 0
