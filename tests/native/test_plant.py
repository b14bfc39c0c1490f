"""Compares the simulated robot of the library with the Python reference, tick by tick, under all disturbances."""

import copy
from dataclasses import astuple

import mujoco
import numpy as np
import pytest
import reference.plant
from support.plants import ASKEW, HIGH, ODDITIES, VACUUM, command

from spidar_gym.errors import InvalidValueError
from spidar_gym.native.plant import Plant
from spidar_gym.robot import FORMS, ROBOT
from spidar_gym.sim.config import PlantConfig
from spidar_gym.sim.disturbances import Disturbances
from spidar_gym.sim.ground import TILES, GroundConfig

FLOORS = {
    "slope": GroundConfig(slope=0.15, heading=0.7),
    "tiles": GroundConfig(tiles=np.random.default_rng(3).uniform(0.0, 0.03, (TILES, TILES))),
}


def flat(values) -> np.ndarray:
    """Return all numbers of a dataclass."""
    return np.concatenate([np.ravel(value).astype(float) for value in astuple(values)])


def pair(config: PlantConfig) -> tuple[Plant, reference.plant.Plant]:
    """Return the library's plant and the reference plant."""
    return Plant(config), reference.plant.Plant(config)


def begun(plants, height: float, disturbances=None) -> None:
    """Reset both above the floor, askew, with generators of the same seed."""
    for plant in plants:
        rng = np.random.default_rng(5)
        plant.reset(np.array([0.0, 0.0, height]), ASKEW, FORMS["form1"], disturbances=disturbances, rng=rng)


def assert_like(native: Plant, readable: reference.plant.Plant, tolerance: float) -> None:
    """Compare all outputs."""
    # The tolerance is also relative, as torques reach 7 Nm and powers 1 kW.
    assert flat(native.state()) == pytest.approx(flat(readable.state()), rel=tolerance, abs=tolerance)
    assert native.in_contact == readable.in_contact
    for name in ("thrust_factor", "air_force", "mean_power"):
        a, b = getattr(native, name), getattr(readable, name)
        np.testing.assert_allclose(a, b, rtol=tolerance, atol=tolerance, err_msg=name)
    assert native.power == pytest.approx(readable.memory.power, rel=tolerance)
    assert native.energy_wh == pytest.approx(readable.memory.energy_wh, rel=tolerance)


@pytest.mark.parametrize("case", ODDITIES)
def test_the_plant_matches_the_reference_in_the_air_and_in_a_fall_to_the_floor(case):
    config, disturbances = ODDITIES[case]
    native, readable = plants = pair(config)
    begun(plants, 0.6, disturbances)
    if disturbances.push:
        native.record["weather"]["next_push"] = readable.memory.weather.next_push = 0.1
    rng, touched = np.random.default_rng(7), False
    for _ in range(24):
        sent = command(rng.uniform(0, 25, 8), rng.uniform(-1, 1, 16), rng.uniform(-1, 1, (8, 2)))
        native.step(sent)
        readable.step(sent)
        touched |= native.in_contact
        # Contacts amplify a difference in the last bit by up to a hundred per tick.
        assert_like(native, readable, 1e-6 if touched else 1e-9)
        if config.sense:
            a, b = flat(native.measure()), flat(readable.measure())
            np.testing.assert_allclose(a, b, rtol=0, atol=1e-6 if touched else 1e-9)


@pytest.mark.parametrize("name", FLOORS)
def test_both_touch_an_uneven_floor_in_the_same_places(name):
    native, readable = plants = pair(PlantConfig(ground=FLOORS[name]))
    begun(plants, 0.35)
    seen = set()
    for _ in range(20):
        for plant in plants:
            plant.step(command(joints=0.1))
        a, b = native.touch(), readable.touch()
        assert (a.feet == b.feet).all()
        assert (a.pegs == b.pegs).all()
        assert a.ducts == b.ducts
        np.testing.assert_allclose(a.foot_slip, b.foot_slip, rtol=0, atol=1e-5)
        assert a.duct_clearance == pytest.approx(b.duct_clearance, abs=1e-7)
        np.testing.assert_allclose(native.contact_forces(), readable.contact_forces(), rtol=1e-4, atol=1e-3)
        seen.add(len(native.contact_forces()) > 0)
    assert seen == {False, True}


def test_values_written_into_the_data_move_the_robot():
    native, readable = plants = pair(PlantConfig())
    begun(plants, 2.0)
    for plant in plants:
        plant.step(command(10.0))
        plant.data.qvel[:3] = 1.0, -2.0, 0.5
        plant.step(command(10.0))
    assert native.state().velocity_w[0] > 0.9
    assert_like(native, readable, 1e-9)


def test_a_randomised_robot_is_the_one_that_is_read_back():
    given = ODDITIES["everything"][0]
    plant = Plant(given)
    plant.reread()
    for a, b in zip(astuple(plant.config), astuple(given), strict=True):
        assert flat_of(a) == pytest.approx(flat_of(b))


def flat_of(value) -> list:
    """Return the numbers of nested tuples, one after another."""
    return [x for each in value for x in flat_of(each)] if isinstance(value, tuple) else np.ravel(value).tolist()


def hanging(disturbances=None) -> Plant:
    """Return a plant without gravity and air, high up, with a generator."""
    plant = Plant(PlantConfig(aero=VACUUM))
    plant.model.opt.gravity[:] = 0.0
    plant.reset(HIGH, disturbances=disturbances, rng=np.random.default_rng(2))
    return plant


def momentum(plant: Plant) -> np.ndarray:
    """Return the momentum of the whole robot, world [Ns]."""
    data = copy.copy(plant.data)
    mujoco.mj_forward(plant.model, data)
    mujoco.mj_subtreeVel(plant.model, data)
    return ROBOT.total_mass * data.subtree_linvel[plant.model.body("torso").id]


def test_wind_blows_in_the_given_direction_and_ends():
    plant = hanging()
    plant.disturb(Disturbances(wind=6.0), towards=np.pi / 2)
    for _ in range(40):
        state = plant.step(command())
    assert state.velocity_w[1] > 5.0 * abs(state.velocity_w[0]) > 0.0
    assert np.linalg.norm(plant.record["weather"]["mean_w"] - [0.0, 6.0, 0.0]) < 1e-12
    plant.disturb(Disturbances())
    drift = plant.step(command()).velocity_w
    assert not plant.record["weather"]["gust_w"].any()
    # The air is still now, and its drag has slowed the robot a second later.
    for _ in range(40):
        state = plant.step(command())
    assert 0.0 < state.velocity_w[1] < drift[1]


def test_pushes_begin_with_one_at_once_and_end_in_the_middle_of_one():
    plant = hanging()
    plant.disturb(Disturbances(push=30.0))
    plant.step(command())
    assert np.linalg.norm(plant.record["weather"]["push_w"]) == pytest.approx(30.0)
    plant.disturb(Disturbances())
    plant.step(command())
    gained = momentum(plant)
    assert 0.5 < np.linalg.norm(gained) < 2.0  # of the 6 Ns of a whole push
    plant.step(command())
    assert momentum(plant) == pytest.approx(gained, abs=1e-3)


def test_a_change_of_pushes_keeps_the_time_of_the_next_one():
    plant = hanging(Disturbances(push=30.0))
    due = float(plant.record["weather"]["next_push"])
    plant.disturb(Disturbances(push=10.0))
    assert plant.record["weather"]["next_push"] == due


@pytest.mark.parametrize("disturbances", [Disturbances(), Disturbances(wind=1.0)])
def test_a_shove_gives_the_robot_its_force_times_a_fifth_of_a_second_once(disturbances):
    shoved, left = hanging(), hanging()
    for plant in (shoved, left):
        plant.disturb(disturbances)
    shoved.shove(np.array([0.0, 30.0, 0.0]))
    for _ in range(16):
        shoved.step(command())
        left.step(command())
    # In wind a faster robot has another relative wind.
    assert momentum(shoved) - momentum(left) == pytest.approx([0.0, 6.0, 0.0], abs=0.1 if disturbances.wind else 1e-3)
    assert not shoved.record["weather"]["push_w"].any()


@pytest.mark.parametrize("fault", ["thrust", "vectoring"])
def test_a_rotor_is_lost_at_once_and_comes_back(fault):
    plant = hanging()
    sent = command(thrust=10.0, vectoring=0.3)
    plant.disturb(Disturbances(lost_rotor=3, fault=fault, fault_time=0.0))
    for _ in range(40):
        state = plant.step(sent)
    others = np.arange(8) != 2
    assert state.thrust[others] == pytest.approx(10.0, rel=0.05)
    assert state.thrust[2] == pytest.approx(0.0 if fault == "thrust" else 10.0, abs=0.5)
    assert state.vectoring[others] == pytest.approx(0.3, abs=0.05)
    assert state.vectoring[2] == pytest.approx(0.3 if fault == "thrust" else 0.0, abs=0.05)
    plant.disturb(Disturbances())
    for _ in range(40):
        state = plant.step(sent)
    assert state.thrust == pytest.approx(10.0, rel=0.05)
    assert state.vectoring == pytest.approx(0.3, abs=0.05)
    assert state.joint_position == pytest.approx(0.0, abs=0.02)  # no other servo was held


def test_wind_without_a_generator_is_refused():
    plant = Plant()
    plant.reset(HIGH)
    with pytest.raises(InvalidValueError, match=r"rng = None .* a generator at the reset"):
        plant.disturb(Disturbances(wind=1.0))
    plant.disturb(Disturbances(lost_rotor=1))
