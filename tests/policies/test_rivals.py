"""Pins the rivals: each is the method that it is called after, by an implementation of its own or an invariant."""

import importlib
import sys
from pathlib import Path

import numpy as np
import pytest
from support.answers import NO_FORCES, OPTIMAL
from support.states import cost, demand_of, exact, random_demands, random_wrench

from spidar_gym.control.allocation.allocator import Allocator
from spidar_gym.control.allocation.blocks import ThrustBox, ThrustEffort, WrenchBalance
from spidar_gym.control.allocation.modes import FORCE_ROWS, find_allocation
from spidar_gym.control.allocation.problem import FORCE_SCALE, Mode, assemble
from spidar_gym.robot import FORMS, ROBOT

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(autouse=True)
def checkout(monkeypatch):
    """The baselines are importable, as they are in a checkout."""
    monkeypatch.setattr(sys, "path", [str(ROOT), *sys.path])


def rival(name):
    return importlib.import_module(f"baselines.{name}")


def heavy(rng, count):
    """Demands of stacked and flat forms, some of which load the joints beyond their limit."""
    found = random_demands(rng, count, hard=True)
    return found + [
        demand_of(FORMS[name], np.eye(3), scale * random_wrench(rng, np.eye(3), hard=False))
        for name in ("form1", "form3")
        for scale in (1.0, 1.4, 1.8)
    ]


# The allocation's neighbours


def test_unlimited_is_the_least_thrust_with_every_other_row():
    unlimited = rival("unlimited").WithoutTorques(find_allocation("paper"))
    assert set(unlimited.modes) == set(find_allocation("paper"))
    mode = Mode("flight", (ThrustEffort(1.0),), (WrenchBalance(), ThrustBox(), *FORCE_ROWS))
    beyond, answered = 0, 0
    for demand in heavy(np.random.default_rng(11), 40):
        answer, optimum = unlimited.allocate(demand, "flight", NO_FORCES), exact(assemble(mode, demand))
        if answer.status not in OPTIMAL:
            continue
        answered += 1
        assert answer.forces_l.reshape(-1) == pytest.approx(FORCE_SCALE * optimum, abs=1e-4)
        limited = Allocator(find_allocation("paper")).allocate(demand, "flight", NO_FORCES)
        if limited.status in OPTIMAL:
            assert cost(mode, demand, answer.forces_l) <= cost(mode, demand, limited.forces_l) + 1e-9
        beyond += np.abs(answer.joint_torques).max() > ROBOT.max_joint_torque
    assert answered > 20
    assert beyond > 2


def test_scaled_forces_keep_direction_and_the_torques_that_can_be_kept():
    module, rng = rival("scaled"), np.random.default_rng(12)
    modes = find_allocation("paper")
    scaled, whole = module.ScaledThrust(modes), rival("unlimited").WithoutTorques(modes)
    cut = 0
    for demand in heavy(rng, 60):
        answer, full = scaled.allocate(demand, "flight", NO_FORCES), whole.allocate(demand, "flight", NO_FORCES)
        assert np.cross(answer.forces_l, full.forces_l) == pytest.approx(NO_FORCES, abs=1e-6)
        assert (answer.thrust <= full.thrust + 1e-9).all()
        assert answer.joint_torques == pytest.approx(
            demand.gravity_torque - demand.torque_map @ answer.forces_l.reshape(-1), abs=1e-9
        )
        over, limit = np.abs(full.joint_torques).max(), ROBOT.max_joint_torque
        if over <= limit:
            assert answer.forces_l.tolist() == full.forces_l.tolist()
            continue
        cut += 1
        assert np.abs(answer.joint_torques).max() <= max(limit, over) + 1e-9
        s = answer.thrust.sum() / full.thrust.sum()
        # None of a thousand others is nearer to the limits, or as near and larger.
        others = np.linspace(0.0, 1.0, 1001)
        slope = full.joint_torques - demand.gravity_torque
        excess = np.maximum(np.abs(demand.gravity_torque + others[:, None] * slope).max(axis=1) - limit, 0.0)
        own = max(np.abs(answer.joint_torques).max() - limit, 0.0)
        assert own <= excess.min() + 1e-9
        assert s >= others[excess <= own + 1e-12].max(initial=0.0) - 1e-9
    assert cut > 3
