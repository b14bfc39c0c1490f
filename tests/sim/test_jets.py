"""Pins the jets: their momentum, a duct's thrust in an inflow, and isolated modules in each other's jets."""

# pyright: reportAttributeAccessIssue=false

import math

import mujoco
import numpy as np
import pytest
from reference import air as reference
from scipy.optimize import brentq
from support.air import LEVEL, LINKS, NONE, RADIUS, TORSO, evaluate, evaluate_reference, posed, world

from spidar_gym.native.formulas import jet_profile, thrust_factor
from spidar_gym.robot import ROBOT
from spidar_gym.sim.air import AIR_DENSITY, DUCT_AREA
from spidar_gym.so3 import exp, rotation_x

JET_SPEED = math.sqrt(0.5 * ROBOT.hover_thrust / (AIR_DENSITY * DUCT_AREA))
"""Jet speed of a duct at hover [m/s]: 25."""
CORES = (3.25, 4.0, 6.2)
CHIS = (2.1, 2.6, 3.2)


def staged(positions, attitudes=None) -> mujoco.MjData:
    """Modules detached from the robot and placed at `positions` [m], the others 50 m apart."""
    data = posed(np.zeros(16), np.zeros(16), position=np.array([0.0, 0.0, 1000.0]))
    for i in range(8):
        body = world().body(f"gimbal{i + 1}_pitch_module").id
        data.xpos[body] = positions.get(i, np.array([50.0 * i, 500.0, 50.0]))
        data.xmat[body] = (attitudes or {}).get(i, LEVEL).reshape(-1)
    return data


def only(*modules) -> np.ndarray:
    """Hover thrust of these modules, zero of the others [N]."""
    return np.where(np.isin(np.arange(8), modules), ROBOT.hover_thrust, 0.0)


def inflow_of(factor: float) -> float:
    """Mean downward inflow speed of a duct at hover with this thrust factor [m/s]."""
    return JET_SPEED * brentq(lambda mu: thrust_factor(np.array([mu]), zero_thrust_speed=2.6)[0] - factor, -1e-6, 2.6)


def disc(rings=60, spokes=48) -> np.ndarray:
    """Points that cover a duct's disc with equal areas [m]."""
    r = RADIUS * np.sqrt((np.arange(rings) + 0.5) / rings)
    angle = 2 * math.pi * np.arange(spokes) / spokes
    return np.stack([np.outer(r, np.cos(angle)).ravel(), np.outer(r, np.sin(angle)).ravel()], axis=1)


@pytest.mark.parametrize("radius", [RADIUS, 0.2])
@pytest.mark.parametrize("core_length", CORES)
def test_the_momentum_flux_of_a_jet_is_its_thrust_at_any_distance(core_length, radius):
    thrust = 9.81
    w = math.sqrt(thrust / (AIR_DENSITY * math.pi * radius**2))
    for s in np.geomspace(0.011, 8.0, 25):
        r = np.linspace(0.0, radius + 2.0 * s, 4001)
        u = jet_profile(np.full_like(r, s), r, w, core_length=core_length, radius=radius)
        assert u[-1] < 1e-6 * w, "the integration range covers the jet"
        assert abs(np.trapezoid(AIR_DENSITY * u**2 * 2 * math.pi * r, r) / thrust - 1.0) < 1e-3, s


@pytest.mark.parametrize("core_length", CORES)
def test_nothing_moves_upstream_of_the_exit(core_length):
    s, r = np.meshgrid(np.concatenate([-np.geomspace(1e-6, 9.0, 30), [0.0]]), np.linspace(0.0, 1.0, 30))
    assert not jet_profile(s, r, 25.0, core_length=core_length).any()


@pytest.mark.parametrize("core_length", CORES)
def test_a_jet_is_as_fast_as_at_its_exit_throughout_the_core_and_slows_down_with_distance_beyond(core_length):
    core = 2 * core_length * RADIUS
    inside, beyond = np.linspace(0.011, core, 50), np.linspace(core, 20 * core, 50)
    for s, expected in ((inside, np.full(50, 25.0)), (beyond, 25.0 * core / beyond)):
        np.testing.assert_allclose(jet_profile(s, np.zeros(50), 25.0, core_length=core_length), expected, rtol=1e-12)
    for s in (0.25 * core, 0.75 * core):
        rim = RADIUS * (1 - s / core)
        u = jet_profile(np.full(2, s), np.array([0.999 * rim, 1.2 * rim]), 25.0, core_length=core_length)
        assert u[0] == 25.0 > u[1]


@pytest.mark.parametrize("core_length", CORES)
def test_a_jet_is_slower_the_farther_from_its_axis_and_nowhere_faster_than_at_its_exit(core_length):
    r = np.linspace(0.0, 1.5, 400)
    for s in np.geomspace(0.011, 8.0, 25):
        u = jet_profile(np.full_like(r, s), r, 25.0, core_length=core_length)
        assert np.all(np.diff(u) <= 0.0)
        assert np.all((u >= 0.0) & (u <= 25.0))
        assert u[-1] < u[0]


def test_a_jet_changes_smoothly_where_its_core_ends():
    core, r = 8.0 * RADIUS, np.linspace(0.0, 0.4, 100)
    before, after = (jet_profile(np.full_like(r, core + e), r, 25.0, core_length=4.0) for e in (-1e-6, 1e-6))
    np.testing.assert_allclose(before, after, rtol=0, atol=1e-3)


@pytest.mark.parametrize("chi", CHIS)
def test_a_duct_in_still_air_has_its_whole_thrust(chi):
    assert abs(thrust_factor(np.zeros(1), zero_thrust_speed=chi)[0] - 1.0) < 1e-12


@pytest.mark.parametrize("chi", CHIS)
def test_thrust_falls_with_the_inflow_and_is_zero_at_the_zero_thrust_speed(chi):
    down = np.linspace(0.0, chi, 200)
    factor = thrust_factor(down, zero_thrust_speed=chi)
    assert np.all(np.diff(factor) < 0.0)
    assert factor[0] == factor.max() < 1.0 + 1e-12
    assert np.all(factor[:-1] > 0.0)
    assert abs(factor[-1]) < 1e-12
    assert not thrust_factor(np.linspace(chi + 1e-6, 20.0, 50), zero_thrust_speed=chi).any()


@pytest.mark.parametrize("chi", CHIS)
def test_thrust_in_an_inflow_solves_blade_element_and_duct_momentum_together(chi):
    """In newtons and metres per second: T = K (V_z − V_e) and T = ρ A V_e (V_e − V), K from the duct at rest."""
    rest = 9.81
    w = math.sqrt(rest / (AIR_DENSITY * DUCT_AREA))
    blade = rest / ((chi - 1.0) * w)
    for mu in np.linspace(-0.3, 0.99 * chi, 40):

        def unbalanced(speed, V=mu * w):
            return AIR_DENSITY * DUCT_AREA * speed * (speed - V) - blade * (chi * w - speed)

        speed = brentq(unbalanced, max(mu * w, 0.0), chi * w, xtol=1e-13)
        factor = thrust_factor(np.array([mu]), zero_thrust_speed=chi)[0]
        assert abs(factor - min(blade * (chi * w - speed) / rest, 1.3)) < 1e-9


@pytest.mark.parametrize("chi", [1.1, *CHIS])
def test_thrust_grows_in_upwash_up_to_1_3_and_is_never_negative(chi):
    up = thrust_factor(-np.linspace(0.0, 30.0, 300), zero_thrust_speed=chi)
    assert np.all(np.diff(up) >= 0.0)
    assert up[-1] == up.max() == 1.3
    assert 1.0 < up[1] < 1.3
    every = thrust_factor(np.linspace(-30.0, 30.0, 601), zero_thrust_speed=chi)
    assert np.all((every >= 0.0) & (every <= 1.3))


@pytest.mark.parametrize("angles", [(0.0, 0.0), (0.0, 1.57), (0.0, -1.57), (3.14, 0.3), (1.57, 1.0)])
def test_a_modules_own_jets_act_neither_on_it_nor_on_its_link(angles):
    vectoring = np.tile(angles, (8, 1))
    data = posed(np.zeros(16), vectoring)
    for i in range(1, 8):
        data.xpos[world().body(f"gimbal{i + 1}_pitch_module").id] = (50.0 * i, 500.0, 50.0)
    off, on = evaluate(data, NONE), evaluate(data, only(0))
    # The remainder is due to the distant idle jets of the others.
    np.testing.assert_allclose(on.thrust_factor[:2], 1.0, rtol=0, atol=1e-5)
    np.testing.assert_allclose(on.forces_w[:2], 0.0, rtol=0, atol=1e-5)
    np.testing.assert_array_equal(on.forces_w[LINKS][:3], off.forces_w[LINKS][:3])


@pytest.mark.parametrize(("below", "share"), [(0.15, 0.08), (0.3, 0.025), (0.42, 0.015), (0.6, 0.003)])
@pytest.mark.parametrize("aside", [0.0, 0.03, 0.05, 0.08, 0.12])
def test_the_inflow_of_a_duct_is_the_mean_of_the_jets_over_its_disc(below, share, aside):
    """Compared with a fine integration; the error of the five points grows with the sharpness of the jet's edge."""
    data = staged({0: np.array([0.0, 0.0, 9.0]), 1: np.array([aside, 0.0, 9.0 - below])})
    air = evaluate(data, only(0, 1), ground_effect=0.0)
    s = np.full(len(disc()), below + ROBOT.duct_z[0])
    means = []
    for across in (0.0, 2 * ROBOT.duct_offset_y):
        r = np.linalg.norm(disc() + (aside, across), axis=1)
        means.append(jet_profile(s, r, JET_SPEED, core_length=4.0).mean())
    felt = [inflow_of(factor) for factor in air.thrust_factor[2:4]]
    np.testing.assert_allclose(felt, sum(means), rtol=0, atol=share * JET_SPEED)
    np.testing.assert_allclose(air.thrust_factor[:2], 1.0, rtol=0, atol=1e-12)


def test_a_jet_acts_downstream_only_and_along_its_axis():
    rng = np.random.default_rng(11)
    for _ in range(10):
        R = exp(rng.normal(0, 1, 3))
        for step, felt in ((-0.4, True), (0.4, False)):
            data = staged({0: np.full(3, 100.0), 1: np.full(3, 100.0) + step * R[:, 2]}, {0: R, 1: R})
            factor = evaluate(data, only(0, 1)).thrust_factor
            assert (factor[2] < 0.9) == felt
            np.testing.assert_allclose(factor[0 if felt else 2], 1.0, rtol=0, atol=1e-12)


def test_a_jet_from_the_side_pushes_a_duct_along_by_no_more_than_its_own_momentum():
    """The duct ingests a part of the jet; the rest is drag."""
    for R in (rotation_x(0.5 * math.pi), rotation_x(-0.5 * math.pi)):
        source = np.array([0.0, ROBOT.duct_offset_y, 9.0])
        air = evaluate(staged({0: source, 1: np.array([0.0, 0.0, 8.6])}, {1: R}), only(0, 1))
        upper = air.forces_w[2:4][air.points_w[2:4, 2].argmax()]
        assert -0.5 * ROBOT.hover_thrust < upper[2] < -3.0
        np.testing.assert_allclose(upper[:2], 0.0, rtol=0, atol=1e-9)


def test_a_jet_on_the_torso_pushes_it_by_no_more_than_its_own_momentum():
    for height in (0.1, 0.3, 0.8):
        module_at = np.array([0.0, ROBOT.duct_offset_y, 1000.0 + height])
        forces = evaluate(staged({0: module_at}), only(0)).forces_w[TORSO]
        total = forces.sum(axis=0)
        assert -0.5 * ROBOT.hover_thrust < total[2] < -1.0, height
        np.testing.assert_allclose(total[:2], 0.0, rtol=0, atol=1e-9)


def test_two_jets_on_one_line_exceed_the_faster_one_by_at_most_a_fifth():
    at = {0: np.array([0.0, 0.0, 9.4]), 1: np.array([0.0, 0.0, 9.0]), 2: np.array([0.0, 0.0, 8.7])}
    alone = [inflow_of(evaluate(staged({k: at[k], 2: at[2]}), only(k, 2)).thrust_factor[4]) for k in (0, 1)]
    both = inflow_of(evaluate(staged(at), only(0, 1, 2)).thrust_factor[4])
    assert max(alone) < both < 1.2001 * max(alone)
    assert sum(alone) > 1.3 * max(alone), "the sum of the jets would be more"


def test_a_weak_flow_adds_up_with_a_strong_one():
    at = {0: np.array([-0.15, 0.0, 9.2]), 1: np.array([0.21, 0.0, 9.1]), 2: np.array([0.0, 0.0, 8.5])}
    strong, weak = (inflow_of(evaluate(staged({k: at[k], 2: at[2]}), only(k, 2)).thrust_factor[4]) for k in (0, 1))
    both = inflow_of(evaluate(staged(at), only(0, 1, 2)).thrust_factor[4])
    assert 0.05 * strong < weak < 0.15 * strong
    np.testing.assert_allclose(both, strong + weak, rtol=1e-3)


def test_no_jet_that_is_left_out_because_of_its_distance_affects_a_duct(monkeypatch):
    rng, pairs = np.random.default_rng(12), []
    poses = [(rng.uniform(-1.2, 1.5, 16), rng.uniform(-1.5, 1.5, (8, 2))) for _ in range(40)]
    for reach in (reference.REACH, 100.0):
        monkeypatch.setattr(reference, "REACH", reach)
        pairs.append([evaluate_reference(posed(*pose)).thrust_factor for pose in poses])
    assert np.abs(np.array(pairs) - 1.0).max() > 0.1
    assert np.abs(pairs[0] - np.array(pairs[1])).max() < 1e-3
