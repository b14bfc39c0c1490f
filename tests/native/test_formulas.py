"""Pins each of the engine's formulas to its reference in Python."""

import numpy as np
import pytest
from reference import air, energy, weather
from support.air import HIGH, evaluate, evaluate_reference, posed

from spidar_gym.native import formulas
from spidar_gym.robot import ROBOT
from spidar_gym.sim.disturbances import Disturbances
from spidar_gym.sim.recirculation import RecirculationConfig
from spidar_gym.so3 import exp

CHIS = (2.1, 2.6, 3.2)


@pytest.mark.parametrize("core_length", [3.25, 4.0, 6.2])
def test_the_jet_is_the_references_everywhere(core_length):
    rng = np.random.default_rng(0)
    s, r, w = rng.uniform(-0.1, 4.0, 4000), rng.uniform(0.0, 1.0, 4000), rng.uniform(1.0, 40.0, 4000)
    own = formulas.jet_profile(s, r, w, core_length=core_length)
    np.testing.assert_allclose(own, air.jet_profile(s, r, w, core_length=core_length), rtol=1e-12, atol=1e-12)
    assert (own == 0.0).any()
    assert own.max() > 20.0


@pytest.mark.parametrize("chi", CHIS)
def test_the_thrust_in_an_inflow_is_the_references(chi):
    inflow = np.linspace(-20.0, 20.0, 4001)
    own = formulas.thrust_factor(inflow, zero_thrust_speed=chi)
    np.testing.assert_allclose(own, air.thrust_factor(inflow, zero_thrust_speed=chi), rtol=1e-12, atol=1e-12)


def test_the_air_does_what_the_references_does_in_any_pose_motion_wind_and_near_the_floor():
    rng = np.random.default_rng(1)
    for k in range(60):
        position = HIGH if k % 2 else np.array([0.0, 0.0, rng.uniform(0.1, 0.6)])
        data = posed(
            rng.uniform(-1.2, 1.5, 16), rng.uniform(-1.5, 1.5, (8, 2)), exp(rng.uniform(-0.5, 0.5, 3)), position,
            rng.normal(0.0, 1.0, 38),
        )  # fmt: skip
        world = rng.uniform(0.0, 40.0, 8), rng.normal(0, 3, 3), rng.normal(0, 1, 8), rng.normal(0, 20, 3)
        config = {
            "wake": bool(k % 3),
            "zero_thrust_speed": rng.uniform(2.1, 3.2),
            "core_length": rng.uniform(3.25, 6.2),
            "stacking_loss": rng.uniform(0.0, 0.3) if k % 5 else 0.0,
            "recirculation": RecirculationConfig(
                *rng.uniform(0.0, 0.05, 4), *rng.normal(0.0, 0.02, (2, 3)), near=rng.uniform(0.0, 2.0)
            ),
            "eddy": rng.normal(0.0, 1.0, 6) if k % 4 else None,
        }
        own, other = evaluate(data, *world, **config), evaluate_reference(data, *world, **config)
        for name in ("generalized", "thrust_factor", "forces_w", "points_w"):
            np.testing.assert_allclose(getattr(own, name), getattr(other, name), rtol=1e-9, atol=1e-9, err_msg=name)


def test_the_weather_and_the_noise_are_drawn_as_numpy_draws_them():
    storm = Disturbances(wind=4.0, push=30.0)
    mine, theirs = np.random.default_rng(2), np.random.default_rng(2)
    own, other = formulas.Weather(storm, mine), weather.Weather.draw(storm, theirs)
    noises, eddies, pushed = (np.zeros(8), np.zeros(8)), (np.zeros(6), np.zeros(6)), 0
    slow = RecirculationConfig(flow_seconds=2.0, turn_seconds=0.3)
    for k in range(1, 2000):
        own.advance(0.025 * k, 0.025, mine)
        other.advance(storm, 0.025 * k, 0.025, theirs)
        noises = (
            formulas.thrust_noise(noises[0], 0.3, 0.025, mine),
            weather.thrust_noise(noises[1], 0.3, 0.025, theirs),
        )
        eddies = (
            formulas.advance_eddy(eddies[0], slow, 0.025, mine),
            weather.advance_eddy(eddies[1], slow, 0.025, theirs),
        )
        pushed += own.push_w.any()
        for name in ("mean_w", "gust_w", "push_w"):
            np.testing.assert_allclose(getattr(own, name), getattr(other, name), rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(*noises, rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(*eddies, rtol=1e-12, atol=1e-12)
    assert mine.random() == theirs.random()
    assert pushed > 8


def test_power_and_voltage_are_the_references():
    rng = np.random.default_rng(3)
    for _ in range(200):
        thrust, torque, rate = rng.uniform(0, ROBOT.max_thrust, 8), rng.normal(0, 3, 16), rng.normal(0, 1, 16)
        power = energy.electrical_power(thrust, torque, rate)
        assert formulas.electrical_power(thrust, torque, rate) == pytest.approx(power, rel=1e-12)
        used = rng.uniform(0, 500)
        volts = energy.voltage(used, power)
        assert formulas.voltage(used, power) == pytest.approx(volts, rel=1e-12)
        assert formulas.max_thrust(volts) == pytest.approx(energy.max_thrust(volts), rel=1e-12)
