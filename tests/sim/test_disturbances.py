"""Pins the disturbances: refusals, the statistics of wind and pushes, seeds, a lost rotor in the simulation."""

import copy
import math

import mujoco
import numpy as np
import pytest

from spidar_gym.errors import InvalidValueError, UnknownNameError
from spidar_gym.native.engine_structs import AIR_STEPS
from spidar_gym.native.formulas import Weather
from spidar_gym.native.plant import Plant
from spidar_gym.robot import FORMS, GIMBAL_NAMES, ROBOT
from spidar_gym.sim.air import AeroConfig
from spidar_gym.sim.config import PlantConfig
from spidar_gym.sim.disturbances import Disturbances
from spidar_gym.sim.scene import TIMESTEP
from spidar_gym.state import Command

HIGH = np.array([0.0, 0.0, 30.0])
VACUUM = PlantConfig(aero=AeroConfig(wake=False))
DT = AIR_STEPS * TIMESTEP
"""Interval between two updates of the weather in the simulation [s]."""
FOOT = 0.3048
TERM = 0.177 + 0.000823 * 10.0
DEVIATION = np.array([0.1 / TERM**0.4, 0.1 / TERM**0.4, 0.1])
LENGTH = np.array([10.0 / TERM**1.2, 10.0 / TERM**1.2, 10.0]) * FOOT
"""MIL-F-8785C, low altitude, at 10 ft: σ over the wind speed, and the lengths of the turbulence [m]."""


def command(thrust=0.0, vectoring=0.0) -> Command:
    """A command with straight legs; a number fills all entries of its field."""
    angles = np.broadcast_to(np.asarray(vectoring, float), (8, 2)).copy()
    return Command(np.full(8, float(thrust)), angles, np.zeros(16), np.full(16, ROBOT.max_joint_torque))


def weathers(disturbances, seconds, *, dt=DT, seed=0):
    """Times of the updates, and mean wind, gust and push after each of them (T, 3, 3)."""
    rng = np.random.default_rng(seed)
    weather = Weather(disturbances, rng)
    times = dt * np.arange(1, round(seconds / dt) + 1)
    seen = np.empty((len(times), 3, 3))
    for k, time in enumerate(times.tolist()):
        weather.advance(time, dt, rng)
        seen[k] = weather.mean_w, weather.gust_w, weather.push_w
    return times, seen


def intervals(times, pushes) -> tuple[np.ndarray, np.ndarray]:
    """Begins and ends of the pushes, without one that has not ended."""
    change = np.diff(pushes.any(axis=1).astype(int), prepend=0)
    starts, ends = times[change == 1], times[change == -1]
    return starts[: len(ends)], ends


# Refusals.


@pytest.mark.parametrize("value", [-1.0, -1e-9, math.nan, math.inf])
@pytest.mark.parametrize("name", ["wind", "push", "fault_time"])
def test_a_strength_or_time_below_zero_is_refused(name, value):
    with pytest.raises(InvalidValueError, match=f"{name} = .*expected a number of at least 0"):
        Disturbances(**{name: value})
    with pytest.raises(InvalidValueError, match=f"{name} = .*expected a number of at least 0"):
        Disturbances.parse({name: value})


@pytest.mark.parametrize("rotor", [9, -1, 100])
def test_a_rotor_that_does_not_exist_cannot_be_lost(rotor):
    with pytest.raises(InvalidValueError, match=rf"lost_rotor = {rotor} .*1 … 8, or 0 for none"):
        Disturbances(lost_rotor=rotor)


@pytest.mark.parametrize("rotor", range(9))
def test_any_of_the_eight_rotors_can_be_lost_or_none(rotor):
    assert Disturbances(lost_rotor=rotor).lost_rotor == rotor


@pytest.mark.parametrize("fault", ["", "Thrust", "leg"])
def test_an_unknown_fault_is_refused(fault):
    with pytest.raises(UnknownNameError, match=f"fault '{fault}'; valid: thrust, vectoring"):
        Disturbances(lost_rotor=1, fault=fault)


@pytest.mark.parametrize("name", ["winds", "Wind", "rain", ""])
def test_an_unknown_disturbance_is_refused(name):
    with pytest.raises(
        UnknownNameError, match=f"disturbance '{name}'; valid: wind, push, lost_rotor, fault, fault_time"
    ):
        Disturbances.parse({"wind": 1.0, name: 1.0})


def test_disturbances_are_parsed_from_a_dictionary_from_none_or_from_themselves():
    assert Disturbances.parse({"wind": 2.0, "lost_rotor": 3, "fault": "vectoring"}) == Disturbances(
        wind=2.0, lost_rotor=3, fault="vectoring"
    )
    assert Disturbances.parse(None) == Disturbances.parse({}) == Disturbances()
    storm = Disturbances(wind=9.0)
    assert Disturbances.parse(storm) is storm


# Wind.


@pytest.mark.parametrize(("wind", "dt"), [(20.0, 0.1), (20.0, 0.02), (6.0, 0.4)])
def test_turbulence_has_the_strength_and_the_length_of_drydens_at_10_feet(wind, dt):
    times, seen = weathers(Disturbances(wind=wind), 40000 * dt, dt=dt, seed=1)
    gust = seen[:, 1]
    # Number of independent samples, and four standard errors.
    samples = times[-1] * wind / (2.0 * LENGTH)
    error = 4.0 * np.sqrt(1.0 / (2.0 * samples))
    assert np.all(np.abs(gust.std(axis=0) / (wind * DEVIATION) - 1.0) < error)
    assert np.all(np.abs(gust.mean(axis=0)) < 4.0 * wind * DEVIATION / np.sqrt(samples))
    for share in (0.3, 1.0):
        for axis in range(3):
            lag = max(1, round(share * LENGTH[axis] / (wind * dt)))
            product = (gust[lag:, axis] * gust[:-lag, axis]).mean() / gust[:, axis].var()
            assert abs(product - math.exp(-lag * dt * wind / LENGTH[axis])) < error[axis]
    mixed = np.corrcoef(gust.T)[np.triu_indices(3, 1)]
    assert np.abs(mixed).max() < error.max()


def test_the_bounds_of_the_statistics_are_narrow():
    for wind, dt in ((20.0, 0.1), (20.0, 0.02), (6.0, 0.4)):
        assert 4.0 * np.sqrt(LENGTH.max() / (40000 * dt * wind)) < 0.16


def test_turbulence_is_as_strong_at_the_start_as_later():
    storm, rng = Disturbances(wind=5.0), np.random.default_rng(2)
    gusts = np.array([Weather(storm, rng).gust_w for _ in range(4000)])
    np.testing.assert_allclose(gusts.std(axis=0), 5.0 * DEVIATION, rtol=0.05)
    assert np.abs(gusts.mean(axis=0)).max() < 0.08


def test_in_less_than_1_metre_a_second_of_wind_gusts_last_as_long_as_in_1():
    """Taylor's frozen turbulence would last for ever without wind."""
    lag = round(LENGTH[2] / 0.2)
    _, seen = weathers(Disturbances(wind=0.3), 40000 * 0.2, dt=0.2, seed=3)
    gust = seen[:, 1, 2]
    assert abs((gust[lag:] * gust[:-lag]).mean() / gust.var() - math.exp(-1.0)) < 0.1
    assert abs(gust.std() / (0.3 * DEVIATION[2]) - 1.0) < 0.1


def test_the_mean_wind_is_level_of_the_given_strength_from_anywhere_and_stays():
    storm, rng = Disturbances(wind=4.0), np.random.default_rng(4)
    means = np.array([Weather(storm, rng).mean_w for _ in range(2000)])
    np.testing.assert_allclose(np.linalg.norm(means, axis=1), 4.0, rtol=1e-12)
    assert not means[:, 2].any()
    quadrants = np.histogram(np.arctan2(means[:, 1], means[:, 0]), 8, (-math.pi, math.pi))[0]
    assert np.all(np.abs(quadrants - 250) < 4 * math.sqrt(250))
    _, seen = weathers(storm, 10.0)
    np.testing.assert_array_equal(seen[:, 0], np.broadcast_to(seen[0, 0], (len(seen), 3)))


def test_no_wind_and_no_pushes_is_no_weather_at_all():
    _, seen = weathers(Disturbances(), 60.0)
    assert not seen.any()


def test_wind_moves_no_pushes_and_pushes_no_wind():
    _, windy = weathers(Disturbances(wind=3.0), 60.0)
    assert not windy[:, 2].any()
    _, pushed = weathers(Disturbances(push=3.0), 60.0)
    assert not pushed[:, :2].any()
    assert pushed[:, 2].any()


# Pushes.


@pytest.mark.parametrize("dt", [DT, 0.005])
def test_every_push_lasts_a_fifth_of_a_second(dt):
    lengths = []
    for seed in range(3):
        times, seen = weathers(Disturbances(push=30.0), 12000 * dt, dt=dt, seed=seed)
        starts, ends = intervals(times, seen[:, 2])
        lengths.append(ends - starts)
    np.testing.assert_allclose(np.concatenate(lengths), 0.2, rtol=0, atol=0.1 * dt)


def test_a_push_lasts_at_least_a_fifth_of_a_second_and_at_most_until_the_next_update():
    times, seen = weathers(Disturbances(push=30.0), 600.0, seed=5)
    starts, ends = intervals(times, seen[:, 2])
    assert np.all((ends - starts > 0.2 - 1e-9) & (ends - starts < 0.2 + DT + 1e-9))


def test_pushes_come_every_5_to_15_seconds_the_first_within_15():
    gaps, firsts = [], []
    for seed in range(60):
        times, seen = weathers(Disturbances(push=30.0), 60.0, dt=0.05, seed=seed)
        starts = intervals(times, seen[:, 2])[0]
        gaps.extend(np.diff(starts))
        firsts.append(starts[0])
    gaps = np.array(gaps)
    assert np.all((gaps > 5.0 - 1e-9) & (gaps < 15.06))
    assert gaps.min() < 5.5
    assert gaps.max() > 14.5
    assert abs(gaps.mean() - 10.0) < 4 * 10.0 / math.sqrt(12 * len(gaps))
    assert 0.0 <= min(firsts) < 3.0
    assert 12.0 < max(firsts) < 15.06


def test_a_push_has_the_given_force_and_a_constant_random_direction():
    directions = []
    for seed in range(30):
        times, seen = weathers(Disturbances(push=30.0), 100.0, dt=0.05, seed=seed)
        pushes = seen[:, 2]
        on = pushes.any(axis=1)
        np.testing.assert_allclose(np.linalg.norm(pushes[on], axis=1), 30.0, rtol=1e-12)
        assert len(np.unique(pushes[on], axis=0)) == len(intervals(times, pushes)[0]) + pushes[-1].any()
        directions.extend(np.unique(pushes[on], axis=0) / 30.0)
    directions = np.array(directions)
    n = len(directions)
    assert np.abs(directions.mean(axis=0)).max() < 4 / math.sqrt(3 * n)
    np.testing.assert_allclose(directions.T @ directions / n, np.eye(3) / 3, rtol=0, atol=4 * 0.3 / math.sqrt(n))


@pytest.mark.parametrize("begin", [0.1, 3.3, 7.7])
def test_the_momentum_of_a_push_in_mid_air_is_its_force_times_a_fifth_of_a_second(begin):
    plant = Plant(VACUUM)
    plant.model.opt.gravity[:] = 0.0
    plant.reset(HIGH, disturbances=Disturbances(push=30.0), rng=np.random.default_rng(6))
    plant.record["weather"]["next_push"] = begin
    force = np.zeros(3)
    while plant.data.time < begin + 0.3:
        plant.step(command())
        if plant.record["weather"]["push_w"].any():
            force = plant.record["weather"]["push_w"].copy()
    data = copy.copy(plant.data)
    mujoco.mj_forward(plant.model, data)
    mujoco.mj_subtreeVel(plant.model, data)
    momentum = ROBOT.total_mass * data.subtree_linvel[plant.model.body("torso").id]
    assert np.linalg.norm(force) > 29.99
    np.testing.assert_allclose(momentum, 0.2 * force, rtol=0, atol=1e-3)


# Seeds.


@pytest.mark.parametrize("disturbances", [Disturbances(wind=5.0), Disturbances(push=20.0), Disturbances(5.0, 20.0)])
def test_the_same_seed_gives_the_same_weather_and_another_seed_another(disturbances):
    first, again, other = (weathers(disturbances, 40.0, seed=seed)[1] for seed in (7, 7, 8))
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, other)


def test_the_same_seed_gives_the_same_flight_in_a_storm_and_another_seed_another():
    ends = []
    for seed in (7, 7, 8):
        plant = Plant()
        storm = Disturbances(wind=5.0, push=20.0)
        plant.reset(HIGH, thrust=np.full(8, ROBOT.hover_thrust), disturbances=storm, rng=np.random.default_rng(seed))
        plant.record["weather"]["next_push"] = 0.1
        for _ in range(20):
            state = plant.step(command(ROBOT.hover_thrust))
        ends.append(np.concatenate([state.position_w, state.velocity_w]))
    np.testing.assert_array_equal(ends[0], ends[1])
    assert np.abs(ends[0] - ends[2]).max() > 0.01


@pytest.mark.parametrize("wake", [True, False])
def test_wind_blows_the_robot_along(wake):
    plant = Plant(PlantConfig(aero=AeroConfig(wake=wake)))
    thrust = np.full(8, ROBOT.hover_thrust)
    plant.reset(HIGH, thrust=thrust, disturbances=Disturbances(wind=5.0), rng=np.random.default_rng(9))
    mean = plant.record["weather"]["mean_w"].copy()
    for _ in range(10):
        state = plant.step(command(ROBOT.hover_thrust))
        np.testing.assert_array_equal(plant.record["weather"]["mean_w"], mean)
    # Ram drag of 31 N and other drag accelerate 16 kg for a quarter of a second; the gusts vary it.
    assert 0.25 < state.velocity_w @ mean / 5.0 < 0.9


# A lost rotor.


@pytest.mark.parametrize("idle", [0.0, 1.2])
@pytest.mark.parametrize("rotor", [1, 4, 8])
def test_a_lost_rotor_thrusts_as_commanded_until_the_fault_and_then_decays_to_nothing(rotor, idle):
    plant = Plant(PlantConfig(idle_thrust=idle))
    plant.reset(
        HIGH, thrust=np.full(8, ROBOT.hover_thrust), disturbances=Disturbances(lost_rotor=rotor, fault_time=0.1)
    )
    for _ in range(16):
        state = plant.step(command(ROBOT.hover_thrust))
        since = max(0.0, state.time - 0.1)
        expected = np.full(8, ROBOT.hover_thrust)
        expected[rotor - 1] *= math.exp(-since / ROBOT.thrust_lag)
        np.testing.assert_allclose(state.thrust, expected, rtol=0, atol=1e-6)
    assert state.thrust[rotor - 1] < 1e-3
    state = plant.step(command(40.0))
    assert state.thrust[rotor - 1] < 1e-3, "the thrust stays zero"


def test_nothing_is_lost_before_its_time_or_where_no_rotor_is_named():
    states = []
    for disturbances in (Disturbances(), Disturbances(lost_rotor=3), Disturbances(fault="vectoring", fault_time=0.0)):
        plant = Plant()
        plant.reset(HIGH, disturbances=disturbances)
        for _ in range(20):
            state = plant.step(command(15.0, (0.4, -0.3)))
        states.append(np.concatenate([state.position_w, state.thrust, state.vectoring.ravel()]))
    np.testing.assert_array_equal(states[0], states[1])
    np.testing.assert_array_equal(states[0], states[2])


@pytest.mark.parametrize("rotor", [2, 7])
def test_a_stuck_module_stays_where_it_is_while_the_others_obey_and_it_still_thrusts(rotor):
    plant = Plant()
    start = np.tile([0.3, -0.2], (8, 1))
    lost = Disturbances(lost_rotor=rotor, fault="vectoring", fault_time=0.1)
    plant.reset(HIGH, joint_position=FORMS["form1"], vectoring=start, thrust=np.full(8, 15.0), disturbances=lost)
    others, moved = np.arange(8) != rotor - 1, []
    for k in range(40):
        state = plant.step(command(20.0, (0.3, -0.2) if k < 4 else (-0.9, 1.1)))
        moved.append(np.abs(state.vectoring - start))
    assert np.max(moved, axis=0)[rotor - 1].max() < 0.02
    np.testing.assert_allclose(state.vectoring[others], np.broadcast_to((-0.9, 1.1), (7, 2)), rtol=0, atol=0.05)
    np.testing.assert_allclose(state.thrust, 20.0, rtol=0, atol=1e-3)


def test_a_module_that_fails_in_motion_stops_there():
    plant = Plant()
    plant.reset(HIGH, disturbances=Disturbances(lost_rotor=5, fault="vectoring", fault_time=0.1))
    for k in range(30):
        state = plant.step(command(0.0, (3.0, -3.0)))
        if k == 3:
            here = state.vectoring[4].copy()
    assert np.all((np.abs(here) > 0.3) & (np.abs(here) < 2.0))
    names = [name for name in GIMBAL_NAMES if name.startswith("gimbal5")]
    angles = np.array([plant.data.joint(name).qpos[0] for name in names])
    np.testing.assert_allclose(angles, here, rtol=0, atol=0.3)
    assert np.abs(state.vectoring_velocity[4]).max() < 0.1
