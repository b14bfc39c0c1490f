"""Pins the rivals: each is the method that it is called after, by an implementation of its own or an invariant."""

import importlib
import sys
from pathlib import Path

import numpy as np
import osqp
import pytest
from scipy import sparse
from scipy.linalg import solve_discrete_are
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


# Prediction

DT = 0.025


def axis(horizon=24, speed=0.05, change=1e-3, lag=0.05):
    return rival("mpc").prediction(horizon, speed, change, lag, DT)


def follow(x, w, v, lag=0.05):
    """The states of an axis, step by step, from x₀ with known accelerations w and changes v."""
    states, share = [np.array(x, float)], 1.0 - np.exp(-DT / lag)
    for known, change in zip(w, v, strict=True):
        e, rate, given, asked = states[-1]
        lacks = known - given
        states.append(
            np.array(
                [
                    e + DT * rate + 0.5 * DT**2 * lacks,
                    rate + DT * lacks,
                    given + share * (asked - given),
                    asked + change,
                ]
            )
        )
    return np.array(states)


def best_plan(x, w, horizon=24, speed=0.05, change=1e-3, lag=0.05):
    """The best plan by least squares on whole trajectories: nothing is condensed."""
    share = 1.0 - np.exp(-DT / lag)
    A = np.array([[1, DT, -0.5 * DT**2, 0], [0, 1, -DT, 0], [0, 0, 1 - share, share], [0, 0, 0, 1]])
    P = solve_discrete_are(
        A, np.array([[0.0], [0], [0], [1]]), np.diag([1, speed, 0, 0]) + 1e-9 * np.eye(4), [[change]]
    )
    root = np.linalg.cholesky(P).T

    def residuals(v):
        states = follow(x, w[:-1], v, lag)[1:]
        end = states[-1] - (0.0, 0.0, w[-1], w[-1])
        return np.concatenate((states[:-1, 0], np.sqrt(speed) * states[:-1, 1], np.sqrt(change) * v, root @ end))

    zero = residuals(np.zeros(horizon))
    J = np.stack([residuals(unit) - zero for unit in np.eye(horizon)], axis=1)
    return -np.linalg.lstsq(J, zero, rcond=None)[0]


def test_the_condensed_plan_is_the_one_of_least_squares_over_whole_trajectories():
    rng, own = np.random.default_rng(13), axis()
    for _ in range(5):
        x, w = rng.normal(size=4), np.cumsum(rng.normal(size=25))
        plan = -np.linalg.solve(own.H, own.from_state @ x + own.from_known @ w)
        assert plan == pytest.approx(best_plan(x, w), abs=1e-6)


def test_with_nothing_to_come_its_first_step_is_the_linear_quadratic_regulators():
    share = 1.0 - np.exp(-DT / 0.05)
    A = np.array([[1, DT, -0.5 * DT**2, 0], [0, 1, -DT, 0], [0, 0, 1 - share, share], [0, 0, 0, 1]])
    B = np.array([[0.0], [0], [0], [1]])
    P = solve_discrete_are(A, B, np.diag([1, 0.05, 0, 0]) + 1e-9 * np.eye(4), [[1e-3]])
    K = np.linalg.solve(B.T @ P @ B + 1e-3, B.T @ P @ A)
    for horizon in (8, 24):
        own = axis(horizon)
        first = -np.linalg.solve(own.H, own.from_state)[0]
        assert first == pytest.approx(-K[0], rel=1e-5)


def test_a_plan_at_its_bounds_is_the_best_within_them():
    module, rng = rival("mpc"), np.random.default_rng(14)
    law = module.arguments(module.FOUND)
    controller = law["law"](law["controller"])
    horizon, at_bound = module.HORIZON, 0
    sums = sparse.csc_matrix(np.kron(np.eye(6), np.tril(np.ones((horizon, horizon)))))
    H = sparse.block_diag([own.H for own in controller._axes], format="csc")
    for size in (0.02, 0.5, 3.0):
        controller._asked = 0.3 * rng.normal(size=6)
        x, w = size * rng.normal(size=(6, 4)), size * np.cumsum(rng.normal(size=(6, horizon + 1)), axis=1)
        g = np.concatenate([o.from_state @ x[k] + o.from_known @ w[k] for k, o in enumerate(controller._axes)])
        first = controller._solve(g)
        bound = np.repeat(controller._bound, horizon)
        asked = np.repeat(controller._asked, horizon)
        solver = osqp.OSQP()
        solver.setup(
            sparse.triu(H, format="csc"), g, sums, -bound - asked, bound - asked,
            verbose=False, eps_abs=1e-9, eps_rel=1e-9, max_iter=100_000, polishing=True,
        )  # fmt: skip
        exactly = solver.solve(raise_error=False).x
        assert first == pytest.approx(exactly.reshape(6, horizon)[:, 0], abs=2e-2 * max(1.0, size))
        at_bound += (np.abs(asked + sums @ exactly) > bound - 1e-6).any()
    assert 0 < at_bound < 3


def test_disturbances_that_are_known_leave_no_error_behind():
    """A step of an external force that the observer has found: the plan comes to rest on the mark."""
    own, x, w = axis(), np.array([0.05, 0.0, 0.0, 0.0]), np.full(25, -0.8)
    for _ in range(400):
        v = -np.linalg.solve(own.H, own.from_state @ x + own.from_known @ w)[0]
        x = follow(x, [-0.8], [v])[-1]
    assert np.abs(x - (0.0, 0.0, -0.8, -0.8)).max() < 1e-6
