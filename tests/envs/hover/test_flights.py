"""Pins whole flights of Hover-v0: air, sensors, other robots, disturbances, windows without avoidance."""

import math
from dataclasses import replace

import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from support.episodes import EARLY, PUSHED, ROUGH, actions_of, assert_same, direct, flight, make, same

from spidar_gym.control.flight.centroidal import CentroidalConfig
from spidar_gym.control.flight.controller import ControllerConfig
from spidar_gym.control.presets import PRESETS
from spidar_gym.errors import InvalidValueError
from spidar_gym.robot import ROBOT
from spidar_gym.sim.actuators import ActuatorConfig
from spidar_gym.sim.air import AeroConfig
from spidar_gym.sim.body import BodyConfig
from spidar_gym.sim.config import PlantConfig
from spidar_gym.sim.randomize import TABLE
from spidar_gym.so3 import quat_to_matrix

CONDITIONS = {
    "sensors": {"sensors": True},
    "randomization": {"randomization": 1.0},
    "wind": {"disturbances": {"wind": 2.0}},
    "push": {"disturbances": {"push": 30.0}},
    "lost rotor": {"disturbances": {"lost_rotor": 4, "fault_time": 0.3}},
    "stuck rotor": {"disturbances": {"lost_rotor": 4, "fault": "vectoring", "fault_time": 0.3}},
    "no wake": {"wake": False},
    "all at once": {**ROUGH, "disturbances": {**ROUGH["disturbances"], "lost_rotor": 4, "fault_time": 0.3}},
}
"""Conditions that can be switched on or off, by name."""


USABLE_WH = 0.85 * 8 * 22.2 * 3.0
"""Usable energy of eight packs of 22.2 V and 3 Ah [Wh]."""


@pytest.mark.parametrize(("forms", "speed", "ticks"), [("form2", 0.2, 240), ("paper", 0.8, 260)])
def test_no_locked_phi_turns_by_more_than_the_slew_while_the_errors_stay_small(forms, speed, ticks):
    env = make(forms=forms, joint_speed=speed, perturbation=0.0, control="python")
    env.reset(seed=0)
    before, locked = env.controller.memory.vectoring[:, 0], np.zeros(8, bool)
    for _ in range(ticks):
        *_, info = env.step(np.zeros(6))
        memory = env.controller.memory
        step = np.abs(memory.vectoring[:, 0] - before)
        assert step[memory.lock.active].max(initial=0.0) <= 0.04 + 1e-12
        before, locked = memory.vectoring[:, 0], locked | memory.lock.active
        assert np.linalg.norm(info["position_error"]) < 0.05
        assert np.linalg.norm(info["attitude_error"]) < 0.05
    assert locked[1::2].all()


@pytest.mark.parametrize("condition", CONDITIONS)
def test_in_every_condition_the_same_seed_gives_the_same_flight_after_other_episodes_and_in_another_instance(condition):
    env = make(joint_speed=1.0, **CONDITIONS[condition])
    actions = actions_of(env, 20)
    first = flight(env, actions, seed=PUSHED)
    other = flight(env, actions, seed=EARLY)
    assert not np.array_equal(first[-1][0], other[-1][0])
    assert_same(first, flight(env, actions, seed=PUSHED))
    assert_same(first, flight(make(joint_speed=1.0, **CONDITIONS[condition]), actions, seed=PUSHED))


@pytest.mark.parametrize("condition", CONDITIONS)
def test_every_condition_makes_a_difference_to_the_flight_but_not_to_where_it_starts_and_goes(condition):
    plain, other = make(), make(**CONDITIONS[condition])
    actions = np.zeros((20, 6))
    a, b = flight(plain, actions, seed=PUSHED), flight(other, actions, seed=PUSHED)
    assert not np.array_equal(a[-1][3]["position_error"], b[-1][3]["position_error"])
    if condition not in ("randomization", "all at once"):  # these draw random numbers between the forms and the offset
        assert np.array_equal(a[0][3]["position_error"], b[0][3]["position_error"])
    for first, second in zip(plain.progress.goals, other.progress.goals, strict=True):
        assert (first.start, first.deadline) == (second.start, second.deadline)
        assert np.array_equal(first.joint_target, second.joint_target)


@pytest.mark.parametrize("condition", ["sensors", "wind", "push", "lost rotor"])
def test_random_numbers_of_weather_and_sensors_change_no_later_episode(condition):
    plain, other = make(), make(**CONDITIONS[condition])
    for env, ticks in ((plain, 3), (other, 20)):
        flight(env, np.zeros((ticks, 6)), seed=PUSHED)
    starts = [env.reset()[1]["position_error"] for env in (plain, other)]
    assert np.array_equal(*starts)


def test_disturbances_of_a_reset_last_until_the_next_ones_and_leave_nothing_behind():
    env, actions = make(), np.zeros((20, 6))
    calm, storm = flight(env, actions, seed=1), {"wind": 3.0, "lost_rotor": 2, "fault_time": 0.1}
    stormy = flight(env, actions, seed=1, options={"disturbances": storm})
    assert_same(stormy, flight(make(disturbances=storm), actions, seed=1))
    assert_same(stormy, flight(env, actions, seed=1))
    assert_same(calm, flight(env, actions, seed=1, options={"disturbances": {}}))
    assert_same(calm, flight(env, actions, seed=1))
    assert not np.array_equal(calm[-1][0], stormy[-1][0])


def test_gymnasiums_checker_gives_no_warning_in_the_roughest_conditions():
    check_env(make(**ROUGH), skip_render_check=True)


def test_observations_stay_within_their_bounds_in_the_roughest_conditions():
    env = make(**CONDITIONS["all at once"], joint_speed=1.0)
    for seed in range(3):
        steps = flight(env, actions_of(env, 40, seed), seed)
        assert all(observation in env.observation_space for observation, *_ in steps)


def test_there_is_air_by_default_and_none_where_it_is_switched_off():
    still = PlantConfig(aero=AeroConfig(wake=False))
    for options, airy in (({}, True), ({"wake": False}, False), ({"plant": still}, False)):
        info = flight(make(forms="form3", **options), np.zeros((5, 6)), seed=0)[-1][3]
        assert info["air_force"].any() == airy
        assert (info["thrust_factor"] != 1.0).any() == airy
        assert np.abs(info["thrust_factor"] - 1.0).max() < 0.1


def seen_and_true_errors(**options) -> np.ndarray:
    """Observed and true position errors in torso axes over a second, (2, 41, 3)."""
    env, rows = make(forms="form1", perturbation=0.0, **options), []
    observation, info = env.reset(seed=0)
    for k in range(41):
        rows.append((observation[:3], quat_to_matrix(env.state.quat_wb).T @ info["position_error"]))
        if k < 40:
            observation, _, _, _, info = env.step(np.zeros(6))
    return np.array(rows).swapaxes(0, 1)


def test_with_sensors_the_observation_is_off_the_truth_by_their_noise_and_without_them_by_nothing():
    seen, true = seen_and_true_errors(sensors=True)
    off = np.sqrt(((seen - true) ** 2).mean())
    assert 2e-4 < off < 5e-3
    # The true error, which begins at zero, excludes the noise of the motion capture.
    assert np.linalg.norm(true[0]) < 1e-5
    assert np.linalg.norm(seen[0]) > 2e-4
    seen, true = seen_and_true_errors()
    np.testing.assert_allclose(seen, true, rtol=0, atol=1e-6)


def test_errors_in_info_are_as_smooth_as_the_flight_while_the_observed_ones_are_not():
    seen, true = seen_and_true_errors(sensors=True)
    rough, smooth = (np.abs(np.diff(values, n=2, axis=0)).max() for values in (seen, true))
    # An acceleration of 2 m/s² times the square of a tick is 1.25 mm.
    assert smooth < 1.25e-3
    assert rough > 2.0 * smooth


def test_the_controller_flies_on_what_is_observed_and_not_on_the_truth():
    env = make(forms="form1", perturbation=0.0, sensors=True)
    observation, _ = env.reset(seed=0)
    for _ in range(5):
        following, *_ = env.step(np.zeros(6))
        used = env.controller.last_step.control_state
        np.testing.assert_allclose(used.R_wb.T @ used.error.position_w, observation[:3], rtol=0, atol=1e-6)
        observation = following


def test_energy_is_the_sum_of_the_power_and_restarts_with_every_episode():
    env = make(forms="independent", joint_speed=1.0)
    for seed in (EARLY, None):
        steps = flight(env, actions_of(env, 40), seed)
        power = np.array([info["power_w"] for *_, info in steps])
        energy = np.array([info["energy_wh"] for *_, info in steps])
        assert energy[0] == 0.0
        np.testing.assert_allclose(np.diff(energy), power[1:] * 0.025 / 3600.0, rtol=1e-9)
        assert np.ptp(power) > 10.0
        for k in (1, 40):
            minutes = 60.0 * USABLE_WH / power[1 : k + 1].mean()
            np.testing.assert_allclose(steps[k][3]["endurance_min"], minutes, rtol=1e-9)
        np.testing.assert_allclose(steps[0][3]["endurance_min"], 60.0 * USABLE_WH / power[0], rtol=1e-9)


def test_a_full_battery_gives_less_thrust_at_full_load_than_the_modules_can():
    ideal, real = (
        flight(make(action_mode="direct", forms="form1", perturbation=0.0, battery=battery), [direct(42.0)] * 6, seed=0)
        for battery in (False, True)
    )
    assert ideal[-1][3]["thrust"].min() > 41.5
    # 40.5 N without a load; at 8 × 42 N the packs sag.
    assert 25.0 < real[-1][3]["thrust"].max() < 40.0


@pytest.mark.parametrize("rotor", [1, 4, 8])
def test_a_lost_rotor_is_commanded_nothing_from_the_fault_on_and_the_others_hold_the_robot(rotor):
    env = make(forms="form2", perturbation=0.0, disturbances={"lost_rotor": rotor, "fault_time": 0.5})
    steps, i = flight(env, np.zeros((60, 6)), seed=0), rotor - 1
    commands, thrusts = (np.array([info[key] for *_, info in steps]) for key in ("thrust_command", "thrust"))
    # The 21st command is given at 0.5 s.
    assert commands[1:21, i].min() > 10.0
    assert commands[21:, i].max() < 1e-9
    assert np.delete(commands, i, axis=1).min() > 5.0
    assert thrusts[20, i] > 10.0
    assert np.all(np.diff(thrusts[20:, i]) <= 0.0)
    assert thrusts[-1, i] < 1e-6
    errors = [np.linalg.norm(info["position_error"]) for *_, info in steps]
    assert max(errors) < 0.05
    assert abs(thrusts[-1].sum() - ROBOT.weight) < 0.1 * ROBOT.weight


@pytest.mark.parametrize("rotor", [1, 4, 8])
def test_a_stuck_rotor_keeps_its_angles_and_its_thrust_while_the_others_turn(rotor):
    disturbances = {"lost_rotor": rotor, "fault": "vectoring", "fault_time": 0.5}
    env = make(forms="form2", perturbation=0.0, disturbances=disturbances)
    actions = np.zeros((60, 6))
    actions[20:, :2] = 0.3
    infos, i = [info for *_, info in flight(env, actions, seed=0)], rotor - 1
    angles = np.array([info["vectoring"] for info in infos])[21:]
    turned = np.ptp(angles, axis=0).max(axis=1)
    assert turned[i] < 0.005
    assert np.delete(turned, i).min() > 4.0 * turned[i]
    assert np.delete(turned, i).max() > 0.05
    assert all(info["thrust_command"][i] > 5.0 for info in infos[21:])


def test_the_reference_reports_the_lost_rotor_and_no_other_from_the_fault_on():
    env = make(forms="form1", disturbances={"lost_rotor": 3, "fault_time": 0.1})
    env.reset(seed=0)
    told = []
    for _ in range(8):
        reference = env.reference()
        told.append(reference.lost_thrust.tolist())
        assert not reference.lost_vectoring.any()
        env.step(np.zeros(6))
    third = [False, False, True] + [False] * 5
    assert told == [[False] * 8] * 4 + [third] * 4
    env.reset(seed=0, options={"disturbances": {"lost_rotor": 3, "fault": "vectoring", "fault_time": 0.0}})
    assert env.reference().lost_vectoring.tolist() == third
    assert not env.reference().lost_thrust.any()


@pytest.mark.parametrize("mode", ["residual_wrench", "residual_force", "residual"])
def test_no_action_makes_a_lost_rotor_thrust(mode):
    env = make(action_mode=mode, forms="form2", disturbances={"lost_rotor": 4, "fault_time": 0.0})
    steps = flight(env, actions_of(env, 30), seed=0)
    assert len(steps) > 20
    assert all(info["thrust_command"][3] < 1e-9 for *_, info in steps[1:])


def test_a_custom_controller_configuration_replaces_the_preset():
    no_gains = CentroidalConfig(position_gains=((0.0, 0.0, 0.0),) * 3, attitude_gains=((0.0, 0.0, 0.0),) * 3)
    own = replace(PRESETS["as_flown"], centroidal=no_gains, joint_speed=0.9)
    env = make(controller=own, preset="paper", joint_speed=0.3)
    info = flight(env, np.zeros((1, 6)), seed=0)[-1][3]
    assert np.linalg.norm(info["position_error"]) > 0.01
    # Without gains an offset leads to a demand of the weight alone.
    assert abs(np.linalg.norm(info["wrench_desired"][:3]) - ROBOT.weight) < 1e-9
    np.testing.assert_allclose(info["wrench_desired"][3:], 0.0, rtol=0, atol=1e-9)
    assert env.controller.config.allocation == "as_flown"
    assert env.controller.config.joint_speed == 0.3
    same_preset = make(controller=ControllerConfig(), preset="as_flown", joint_speed=0.3)
    plain = make(preset="paper", joint_speed=0.3)
    assert_same(flight(same_preset, np.zeros((5, 6)), seed=0), flight(plain, np.zeros((5, 6)), seed=0))


def test_a_custom_plant_is_simulated_with_the_arguments_of_the_environment_on_top():
    own = PlantConfig(
        body=BodyConfig(total_mass=17.0), actuators=ActuatorConfig(max_thrust=30.0), idle_thrust=1.0, joint_speed=0.9
    )
    env = make(plant=own, action_mode="direct", forms="form1", perturbation=0.0, joint_speed=0.3)
    assert abs(env.plant.model.body_subtreemass[0] - 17.0) < 1e-9
    assert env.plant.config.joint_speed == 0.3
    for wish, thrust in ((42.0, 30.0), (0.0, 1.0)):
        info = flight(env, [direct(wish)] * 15, seed=0)[-1][3]
        np.testing.assert_allclose(info["thrust"], thrust, rtol=0, atol=0.05)
    both = make(plant=own, wake=False, sensors=True, battery=True, idle_thrust=2.0).plant.config
    assert (both.sense, both.aero.wake, both.actuators.battery, both.idle_thrust) == (True, False, True, 2.0)
    assert both.body.total_mass == 17.0
    noisy = make(plant=PlantConfig(sense=True), forms="form1", perturbation=0.0)
    assert np.linalg.norm(noisy.reset(seed=0)[0][:3]) > 2e-4


def test_a_robot_that_is_heavier_than_described_starts_with_the_thrust_that_carries_it():
    env = make(plant=PlantConfig(body=BodyConfig(total_mass=17.0)), forms="form1", perturbation=0.0)
    infos = [info for *_, info in flight(env, np.zeros((40, 6)), seed=0)]
    assert abs(infos[1]["wrench_desired"][2] - 17.0 * 9.81) < 0.1
    assert max(np.linalg.norm(info["position_error"]) for info in infos) < 0.01


def test_randomised_robots_hover_from_the_start_of_the_episode():
    env = make(randomization=1.0, forms="form1", perturbation=0.0)
    for seed in range(6):
        infos = [info for *_, info in flight(env, np.zeros((40, 6)), seed=seed)]
        assert max(np.linalg.norm(info["position_error"]) for info in infos) < 0.05


def test_info_has_the_randomised_values_of_the_episode_within_their_ranges():
    env = make(randomization=1.0)
    first, second = (flight(env, np.zeros((2, 6)), seed=seed) for seed in (0, 1))
    for steps in (first, second):
        assert all(same(info["randomization"], steps[0][3]["randomization"]) for *_, info in steps)
    a, b = (steps[0][3]["randomization"] for steps in (first, second))
    assert set(a) == {row.field for row in TABLE}
    for row in TABLE:
        assert a[row.field].shape == row.shape
        assert np.all((a[row.field] >= row.low) & (a[row.field] <= row.high))
        assert not np.array_equal(a[row.field], b[row.field])
    assert abs(env.plant.model.body_subtreemass[0] - float(b["body.total_mass"])) < 1e-6


WINDOWS = ((0.1, 0.2), (0.4, 0.55))
"""Times in which no rotor is restricted [s]."""


@pytest.mark.parametrize("windows", [WINDOWS, [list(window) for window in WINDOWS]], ids=["tuples", "lists"])
def test_rotors_are_free_within_the_windows_and_nowhere_else(windows):
    env = make(forms="form3", perturbation=0.0, unrestricted=windows)
    assert env.task.unrestricted == WINDOWS
    env.reset(seed=0)
    modes, expected = [], []
    for k in range(30):
        expected.append("flight_unrestricted" if 4 <= k < 8 or 16 <= k < 22 else "flight")
        modes.append(env.reference().mode)
        env.step(np.zeros(6))
    assert modes == expected


def test_a_window_changes_the_flight_from_its_first_tick_on():
    plain, opened = (
        flight(make(forms="form3", perturbation=0.0, unrestricted=windows), np.zeros((10, 6)), seed=0)
        for windows in ((), WINDOWS)
    )
    assert_same(plain[:5], opened[:5])
    assert not np.array_equal(plain[5][3]["vectoring_command"], opened[5][3]["vectoring_command"])
    whole = flight(make(forms="form3", perturbation=0.0, avoid_interference=False), np.zeros((10, 6)), seed=0)
    always = flight(make(forms="form3", perturbation=0.0, unrestricted=((0.0, 1.0),)), np.zeros((10, 6)), seed=0)
    assert_same(whole, always)


@pytest.mark.parametrize(
    "windows", [((1.0, 1.0),), ((-1.0, 1.0),), ((0.0, math.inf),), ((0.0, math.nan),), ((1.0,),), ((0.0, 1.0), (2.0,))]
)
def test_invalid_windows_are_refused(windows):
    with pytest.raises(InvalidValueError, match="unrestricted"):
        make(forms="form3", unrestricted=windows)
