"""Pins the recirculating wake: its statistics, its force and torque, what they are in proportion to, refusals."""

import math

import numpy as np
import pytest
from support.air import HIGH, HOVER, evaluate, posed
from support.plants import EDDY, command
from support.states import upright

from spidar_gym.errors import InvalidValueError
from spidar_gym.native.formulas import advance_eddy
from spidar_gym.native.mujoco import Simulation
from spidar_gym.native.plant import Plant
from spidar_gym.robot import FORMS, ROBOT
from spidar_gym.sim.air import AIR_DENSITY, DUCT_AREA
from spidar_gym.sim.config import PlantConfig
from spidar_gym.sim.recirculation import RecirculationConfig
from spidar_gym.sim.scene import scene
from spidar_gym.so3 import exp

SPEED = math.sqrt(0.5 * ROBOT.hover_thrust / (AIR_DENSITY * DUCT_AREA))
"""Speed of the jets at hover [m/s]."""
STEADY = np.zeros(6)
"""An eddy whose flow is its mean."""


def hovering(form="form1", position=HIGH):
    """Simulation data of a level hover."""
    return posed(FORMS[form], upright(FORMS[form], np.eye(3)), position=position)


def added(data, config, thrust=HOVER, eddy=STEADY, **more) -> np.ndarray:
    """Force and torque on the whole robot that the recirculation adds to those of still air [N, Nm]."""
    alone = evaluate(data, thrust, **more).generalized
    return (evaluate(data, thrust, recirculation=config, eddy=eddy, **more).generalized - alone)[:6]


def test_an_eddy_is_stationary_with_its_variance_and_correlation_times():
    config, rng = RecirculationConfig(flow_seconds=2.0, turn_seconds=0.5), np.random.default_rng(0)
    runs = [rng.standard_normal(6)]
    for _ in range(40_000):
        runs.append(advance_eddy(runs[-1], config, 0.1, rng))
    x = np.array(runs)
    np.testing.assert_allclose(x.mean(axis=0), 0.0, atol=0.13)
    np.testing.assert_allclose(x.std(axis=0), 1.0, atol=0.08)
    for seconds, columns in ((2.0, x[:, :3]), (0.5, x[:, 3:])):
        lag = round(10 * seconds)
        correlation = (columns[:-lag] * columns[lag:]).mean(axis=0)
        np.testing.assert_allclose(correlation, math.exp(-1.0), atol=0.08)


def test_a_flow_is_a_wind_of_that_speed():
    data, U = hovering(), np.array([0.02, -0.01, 0.03])
    flow = added(data, RecirculationConfig(mean_flow=U))
    wind = (evaluate(data, wind=SPEED * U).generalized - evaluate(data).generalized)[:6]
    np.testing.assert_allclose(flow, wind, rtol=1e-9, atol=1e-9)


def test_the_force_of_a_horizontal_flow_is_the_ram_drag_and_doubles_with_the_thrust():
    config = RecirculationConfig(mean_flow=np.array([0.01, 0.0, 0.0]))
    forces = [added(hovering(), config, share * HOVER)[0] for share in (1.0, 2.0)]
    # Σ ρ A w V over sixteen ducts, with V = 0.01 w and ρ A w² = T: a hundredth of the weight. Drag adds a little.
    assert forces[0] == pytest.approx(0.01 * ROBOT.weight, rel=0.01)
    assert forces[1] == pytest.approx(2.0 * forces[0], rel=0.01)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_an_eddy_turns_the_robot_with_it_and_hardly_moves_it(axis):
    turn = np.zeros(3)
    turn[axis] = 0.05
    found = added(hovering(), RecirculationConfig(mean_turn=turn))
    # MuJoCo's torque is about the torso's origin; form 1 has its CoG on the torso's axis, 3 cm below the origin.
    torque = found[3:][axis]
    assert torque > 0.3
    assert np.abs(np.delete(found[3:], axis)).max() < 0.05 * torque
    # The rotors are a few centimetres above the CoG, where the turning air moves sideways.
    assert np.abs(found[:3]).max() < SPEED * 0.05 * 6.3 * 0.05


def test_floor_and_boxes_near_the_robot_amplify_the_flow():
    config = RecirculationConfig(mean_flow=np.array([0.01, 0.0, 0.0]), near=2.0)
    far = added(hovering(), RecirculationConfig(mean_flow=config.mean_flow))[0]
    for z in (1.0, 2.0):
        data = hovering(position=np.array([0.0, 0.0, z]))
        d = data.subtree_com[1, 2]
        assert added(data, config, ground_effect=0.0)[0] == pytest.approx(far * (1.0 + 2.0 * math.exp(-d)), rel=1e-2)
    beside = Simulation(scene(visual=False, boxed=True))
    box = beside.model.geom("box0").id
    for distance in (0.3, 1.0):
        data = hovering(position=np.array([0.0, 0.0, 3.0]))
        com = data.subtree_com[1]
        # A wall beside the robot, leaning to it: the nearest face is `distance` from the CoG.
        beside.model.geom_size[box] = 0.2, 5.0, 5.0
        lean = exp(np.array([0.0, 0.3, 0.0]))
        beside.model.geom_quat[box] = math.cos(0.15), 0.0, math.sin(0.15), 0.0
        beside.model.geom_pos[box] = com + lean @ (distance + 0.2, 0.0, 0.0)
        found = added(data, config, simulation=beside)[0]
        assert found == pytest.approx(far * (1.0 + 2.0 * math.exp(-distance)), rel=1e-2)


def test_a_robot_without_motors_feels_hardly_any_recirculation():
    config = RecirculationConfig(mean_flow=np.array([0.02, 0.0, 0.0]))
    assert added(hovering(), config, 1e-3 * HOVER)[0] < 3e-3 * added(hovering(), config)[0]


def test_recirculation_needs_a_generator_and_is_the_same_for_the_same_seed():
    plant = Plant(PlantConfig(recirculation=EDDY))
    with pytest.raises(InvalidValueError, match="recirculation"):
        plant.reset(HIGH)
    ends = []
    for seed in (1, 1, 2):
        plant.reset(HIGH, thrust=HOVER, rng=np.random.default_rng(seed))
        for _ in range(20):
            plant.step(command(ROBOT.hover_thrust))
        ends.append(plant.state().position_w)
    np.testing.assert_array_equal(ends[0], ends[1])
    assert np.linalg.norm(ends[0] - ends[2]) > 1e-3


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("flow_xy", -0.1),
        ("flow_z", 2.0),
        ("turn_z", math.nan),
        ("mean_turn", -2.0),
        ("near", -1.0),
        ("flow_seconds", 0.0),
    ],
)
def test_bad_parameters_are_refused_with_the_valid_ones(name, value):
    given = np.full(3, value) if name.startswith("mean") else value
    with pytest.raises(InvalidValueError, match=name):
        RecirculationConfig(**{name: given})
