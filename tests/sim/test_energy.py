"""Pins the batteries: endurance of hover and crawl, parts of the power, voltage, largest thrust, a flight's energy."""

import gymnasium
import numpy as np
import pytest
from scipy.optimize import brentq

import spidar_gym  # noqa: F401 - registers the environments
from spidar_gym.native.formulas import electrical_power, max_thrust, voltage
from spidar_gym.native.plant import Plant
from spidar_gym.robot import FORMS, ROBOT
from spidar_gym.sim.actuators import ActuatorConfig
from spidar_gym.sim.config import PlantConfig
from spidar_gym.sim.energy import CAPACITY_WH, USABLE, endurance_min
from spidar_gym.state import Command

HIGH = np.array([0.0, 0.0, 30.0])
IDLE = np.zeros(16)
"""Neither torque nor motion of the joints."""
FLYABLE = USABLE * CAPACITY_WH
"""Energy from full to empty [Wh]."""
RNG_SEED = 3


def command(thrust, joints=0.0, limit=ROBOT.max_joint_torque) -> Command:
    """A command with upright rotors; a number fills all entries of its field."""
    return Command(np.full(8, float(thrust)), np.zeros((8, 2)), np.full(16, float(joints)), np.full(16, float(limit)))


def lift_power(thrust) -> float:
    """Power of eight modules with the same thrust and idle joints [W]."""
    return electrical_power(np.full(8, float(thrust)), IDLE, IDLE)


def test_eight_packs_of_three_ampere_hours_hold_533_watt_hours():
    assert abs(CAPACITY_WH - 532.8) < 0.05
    assert 0.8 <= USABLE <= 0.9


# Endurance.


def test_hovering_in_form_1_drains_the_batteries_in_9_minutes():
    plant = Plant()
    plant.reset(HIGH, joint_position=FORMS["form1"], thrust=np.full(8, ROBOT.hover_thrust))
    for _ in range(40):
        plant.step(command(ROBOT.hover_thrust))
    assert abs(endurance_min(plant.mean_power) - 9.0) < 0.3


def test_hovering_under_the_controller_drains_the_batteries_in_9_minutes():
    env = gymnasium.make("spidar_gym/Hover-v0", forms="form1", perturbation=0.0)
    env.reset(seed=0)
    plant = env.unwrapped.plant
    for _ in range(40):
        env.step(np.zeros(env.action_space.shape))
    assert abs(endurance_min(plant.mean_power) - 9.0) < 0.3
    env.close()


def test_the_papers_25_minutes_of_crawling_leave_less_than_half_the_weight_to_the_rotors():
    share = brentq(lambda share: endurance_min(lift_power(share * ROBOT.hover_thrust)) - 25.0, 0.0, 1.0)
    assert 0.4 < share < 0.5


def test_endurance_is_the_usable_energy_over_the_power_and_falls_with_it():
    powers = np.linspace(60.0, 6000.0, 50)
    minutes = np.array([endurance_min(power) for power in powers.tolist()])
    assert np.all(np.diff(minutes) < 0.0)
    np.testing.assert_allclose(powers * minutes / 60.0, FLYABLE, rtol=1e-12)


# Power.


def test_computer_and_servos_use_60_watt_at_rest_without_thrust():
    assert lift_power(0.0) == 60.0
    assert lift_power(-1e-9) == 60.0


def test_power_of_a_rotor_grows_with_the_three_halves_power_of_its_thrust():
    thrusts = np.linspace(0.5, ROBOT.max_thrust, 60)
    powers = np.array([lift_power(thrust) - 60.0 for thrust in thrusts])
    np.testing.assert_allclose(np.diff(np.log(powers)) / np.diff(np.log(thrusts)), 1.5, rtol=1e-9)
    single = [electrical_power(thrust * np.eye(8)[3], IDLE, IDLE) - 60.0 for thrust in thrusts]
    np.testing.assert_allclose(powers, 8 * np.array(single), rtol=1e-12)


def test_the_lift_of_a_hover_costs_less_the_more_evenly_it_is_shared():
    rng, even = np.random.default_rng(RNG_SEED), lift_power(ROBOT.hover_thrust)
    for _ in range(20):
        uneven = rng.uniform(0.0, 2.0, 8)
        uneven *= ROBOT.weight / uneven.sum()
        assert electrical_power(uneven, IDLE, IDLE) > even


def test_no_rotor_beats_the_ideal_duct():
    """Momentum theory: T^1.5 / (2 √(ρ A)) for a duct whose exit is as wide as its disc."""
    area = np.pi * ROBOT.propeller_radius**2
    duct = 0.5 * ROBOT.hover_thrust
    ideal = 16 * duct**1.5 / (2.0 * np.sqrt(1.225 * area))
    assert 0.55 < ideal / (lift_power(ROBOT.hover_thrust) - 60.0) < 0.75


def test_a_servo_uses_power_for_work_and_holding_and_recovers_none():
    still, thrust = np.zeros(16), np.zeros(8)
    torque, rate = np.zeros(16), np.zeros(16)
    torque[5], rate[5] = 4.0, 0.2
    holding = electrical_power(thrust, torque, still)
    lifting, lowering = electrical_power(thrust, torque, rate), electrical_power(thrust, torque, -rate)
    assert 60.0 + 8.0 <= holding <= 60.0 + 16.0, "0.5 … 1 W/Nm²"
    assert lowering == holding
    assert lifting - holding > 4.0 * 0.2
    assert electrical_power(thrust, -torque, -rate) == lifting
    assert abs(electrical_power(thrust, 2 * torque, still) - 60.0 - 4 * (holding - 60.0)) < 1e-9
    assert electrical_power(thrust, still, rate) == 60.0


# Voltage and thrust.


def test_a_resting_pack_has_25_2_volt_when_full_and_22_2_when_the_usable_charge_is_flown():
    assert abs(voltage(0.0, 0.0) - 25.2) < 1e-12
    assert abs(voltage(FLYABLE, 0.0) - 22.2) < 1e-12
    assert abs(voltage(0.5 * FLYABLE, 0.0) - 23.7) < 1e-12


def test_voltage_falls_with_the_charge_that_is_gone_and_sags_under_load():
    energies, powers = np.linspace(0.0, FLYABLE, 30).tolist(), np.linspace(0.0, 6000.0, 30).tolist()
    volts = np.array([[voltage(energy, power) for power in powers] for energy in energies])
    assert np.all(np.diff(volts, axis=0) < 0.0)
    assert np.all(np.diff(volts, axis=1) < 0.0)
    sag = voltage(0.0, 0.0) - voltage(0.0, lift_power(ROBOT.hover_thrust))
    assert 1.0 < sag < 1.4


@pytest.mark.parametrize(("volts", "thrust"), [(22.2, 31.8), (25.2, 40.5)])
def test_a_module_reaches_the_thrust_that_was_measured_at_a_voltage(volts, thrust):
    assert abs(max_thrust(volts) - thrust) < 0.01


def test_largest_thrust_rises_with_the_voltage_and_is_never_negative():
    thrusts = np.array([max_thrust(volts) for volts in np.linspace(0.0, 25.2, 100).tolist()])
    assert np.all(np.diff(thrusts) >= 0.0)
    assert thrusts[0] == 0.0
    assert np.all(np.diff(thrusts[50:]) > 0.0)


def test_an_empty_battery_under_the_load_of_a_hover_still_hovers():
    assert max_thrust(voltage(FLYABLE, lift_power(ROBOT.hover_thrust))) > 1.3 * ROBOT.hover_thrust


# In flight.


def test_the_energy_of_a_flight_is_the_integral_of_its_power():
    """Thrusts and joints are in motion; the power of every physics step is computed from the states."""
    drawn, integral = [], 0.0
    for substeps in (1, 10):
        plant, rng = Plant(PlantConfig(substeps=substeps)), np.random.default_rng(RNG_SEED)
        plant.reset(HIGH, thrust=np.full(8, 10.0))
        for _ in range(40):
            commanded = command(rng.uniform(5.0, 35.0), rng.uniform(-0.5, 0.5))
            for _ in range(10 // substeps):
                before = plant.energy_wh
                state = plant.step(commanded)
                if substeps == 1:
                    step = electrical_power(state.thrust, state.joint_torque, state.joint_velocity) * 0.0025 / 3600
                    np.testing.assert_allclose(plant.energy_wh - before, step, rtol=1e-9)
                    integral += step
        drawn.append(plant.energy_wh)
        np.testing.assert_allclose(plant.mean_power * 1.0 / 3600, plant.energy_wh, rtol=1e-9)
    np.testing.assert_allclose(drawn[0], integral, rtol=1e-9)
    np.testing.assert_allclose(drawn[1], drawn[0], rtol=0.03)


def test_energy_only_grows_and_is_zero_after_a_reset():
    plant, drawn = Plant(), [0.0]
    plant.reset(HIGH)
    for thrust in (0.0, 20.0, 0.0, 0.0, 40.0):
        plant.step(command(thrust))
        drawn.append(plant.energy_wh)
    assert np.all(np.diff(drawn) > 60.0 * plant.period / 3600 * 0.999)
    plant.reset(HIGH)
    assert plant.energy_wh == 0.0
    assert plant.mean_power == plant.power == 60.0


def full_throttle(energy, *, battery=True, ticks=60) -> Plant:
    """A plant that has used an energy [Wh], after `ticks` at the largest thrust."""
    plant = Plant(PlantConfig(actuators=ActuatorConfig(battery=battery)))
    plant.reset(HIGH)
    plant.record["energy_wh"] = float(energy)
    for _ in range(ticks):
        plant.step(command(99.0))
    return plant


def test_the_largest_thrust_falls_during_a_flight_only_with_a_simulated_battery():
    reached = [full_throttle(share * FLYABLE).state().thrust for share in (0.0, 0.5, 1.0)]
    assert np.all(np.diff(reached, axis=0) < -1.0)
    assert 25.0 < reached[2].min() <= reached[0].max() < 40.5
    np.testing.assert_allclose(full_throttle(FLYABLE, battery=False).state().thrust, ROBOT.max_thrust, rtol=1e-9)


@pytest.mark.parametrize(("spent", "volts", "thrust"), [(0.0, 25.2, 40.5), (0.5, 23.7, 36.15), (1.0, 22.2, 31.8)])
def test_a_battery_that_is_spent_at_the_reset_limits_the_first_thrust_to_that_of_its_voltage(spent, volts, thrust):
    plant = Plant(PlantConfig(actuators=ActuatorConfig(battery=True, battery_spent=spent)))
    plant.reset(HIGH)
    plant.step(command(99.0))
    # At rest 60 W lower the voltage by 10 mΩ times the current.
    expected = max_thrust(volts - 0.010 * 60.0 / volts)
    np.testing.assert_allclose(plant.data.ctrl[:8], expected, rtol=1e-9)
    assert expected == pytest.approx(thrust, abs=0.1)
    plant.reset(HIGH, spent_wh=0.0)
    assert plant.record["spent_wh"] == 0.0


@pytest.mark.parametrize(("name", "charge"), [("Hover", 0.7), ("Crawl", 0.7), ("Course", 0.35)])
def test_an_episode_begins_with_the_charge_that_is_left_of_the_tasks(name, charge):
    config = PlantConfig(actuators=ActuatorConfig(battery_spent=0.3))
    options = {"charge": 0.5} if name == "Course" else {}
    env = gymnasium.make(f"spidar_gym/{name}-v0", plant=config, **options)
    _, info = env.reset(seed=0)
    record = env.unwrapped.plant.record
    assert 1.0 - record["spent_wh"] / FLYABLE == pytest.approx(charge)
    if name == "Course":
        assert info["charge"] == pytest.approx(charge)
    env.close()


@pytest.mark.parametrize("share", [0.0, 0.5, 1.0])
def test_full_throttle_settles_at_the_thrust_of_the_voltage_under_its_own_load(share):
    plant = full_throttle(share * FLYABLE)
    energy = plant.energy_wh
    expected = brentq(lambda thrust: max_thrust(voltage(energy, lift_power(thrust))) - thrust, 1.0, 42.0)
    np.testing.assert_allclose(plant.state().thrust, expected, rtol=0, atol=0.1)


def test_a_battery_does_not_limit_a_hover():
    plant = Plant(PlantConfig(actuators=ActuatorConfig(battery=True)))
    plant.reset(HIGH, thrust=np.full(8, ROBOT.hover_thrust))
    plant.record["energy_wh"] = FLYABLE
    for _ in range(10):
        state = plant.step(command(ROBOT.hover_thrust))
    np.testing.assert_allclose(state.thrust, ROBOT.hover_thrust, rtol=1e-9)
