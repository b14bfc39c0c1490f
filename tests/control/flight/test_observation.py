"""Pins the observation: contents and bounds of every named slice, and no quantity that the robot cannot measure."""

import math
from dataclasses import replace

import gymnasium
import mujoco
import numpy as np
import pytest
from support.states import model, resting, staying

from spidar_gym.control.flight.centroidal import Integrals
from spidar_gym.control.flight.compensation import fresh_compensation
from spidar_gym.control.flight.controller import FlightController, FlightMemory
from spidar_gym.control.flight.motion import fresh_motion
from spidar_gym.control.flight.observation import FlightObservables, layout, observe
from spidar_gym.envs.actions import ACTION_MODES
from spidar_gym.model.interference import no_interference
from spidar_gym.model.rotor import Lock
from spidar_gym.robot import FORMS, JOINT_NAMES, ROBOT
from spidar_gym.so3 import exp, matrix_to_quat, quat_to_matrix

HOVER = "spidar_gym/Hover-v0"
N_ACTION = 6
BOUND = np.concatenate([np.full(field.size, field.bound) for field in layout(N_ACTION)])
NONE = np.zeros(8, bool)


def split(observation) -> dict[str, np.ndarray]:
    """Name → slice."""
    fields = layout(N_ACTION)
    assert len(observation) == sum(field.size for field in fields)
    pieces = np.split(observation, np.cumsum([field.size for field in fields])[:-1])
    return dict(zip([field.name for field in fields], pieces, strict=True))


@pytest.fixture(scope="module")
def controller() -> FlightController:
    return FlightController(model=model())


def seen(controller, state, reference=None, **parts) -> dict[str, np.ndarray]:
    """Observation of a state; arguments that are not given are zero or at rest."""
    memory = FlightMemory(
        Lock(NONE, NONE, np.zeros(8)), no_interference(), np.zeros((8, 2)), np.zeros((8, 3)),
        Integrals(np.zeros(3), np.zeros(3)), np.zeros(16), np.zeros(3), np.zeros(3), np.zeros(16),
        fresh_compensation(np.zeros(16), np.zeros(6)), fresh_motion(),
    )  # fmt: skip
    memory = replace(memory, **parts.pop("memory", {}))
    zero = {
        "thrust_command": np.zeros(8), "joint_command_velocity": np.zeros(16), "leg_momentum": np.zeros(3),
        "leg_momentum_rate": np.zeros(3), "joint_target": np.zeros(16), "next_form": np.zeros(16),
        "time_to_next_form": 60.0, "previous_action": np.zeros(N_ACTION),
    }  # fmt: skip
    control_state = controller.compute_state(state, staying(state) if reference is None else reference)
    observation = observe(FlightObservables(state, control_state, **{**zero, **parts}), memory, bound=BOUND)
    assert observation.dtype == np.float32
    return split(observation)


def hovering(**changes):
    return resting(FORMS["form1"], **changes)


@pytest.mark.parametrize("mode", ACTION_MODES)
def test_the_layout_is_as_long_as_the_space_and_has_its_bounds(mode):
    env = gymnasium.make(HOVER, action_mode=mode)
    fields = layout(env.action_space.shape[0])
    assert env.observation_space.shape == (sum(field.size for field in fields),)
    high = np.concatenate([np.full(field.size, field.bound) for field in fields]).astype(np.float32)
    assert np.array_equal(env.observation_space.high, high)
    assert np.array_equal(env.observation_space.low, -high)
    assert np.isfinite(high).all()
    assert len({field.name for field in fields}) == len(fields)
    assert all(field.doc for field in fields)


def test_a_robot_on_its_reference_observes_no_error(controller):
    view = seen(controller, hovering())
    for name in view:
        if name.endswith(("_error", "_velocity", "_integral", "_rate", "_momentum")):
            np.testing.assert_allclose(view[name], 0.0, rtol=0, atol=1e-6)


def test_position_and_velocity_errors_are_desired_minus_actual_in_torso_axes(controller):
    yawed = exp(np.array([0.0, 0.0, math.pi / 2]))
    state = resting(FORMS["form1"], yawed)
    reference = staying(state, quat_wb=matrix_to_quat(yawed))
    # The torso's x axis points along the world's y: an error along y is straight ahead.
    ahead = replace(reference, position_w=reference.position_w + (0.0, 0.3, 0.1), velocity_w=np.array([0.0, 0.2, -0.1]))
    view = seen(controller, state, ahead)
    np.testing.assert_allclose(view["position_error"], [0.3, 0.0, 0.1], rtol=0, atol=1e-6)
    np.testing.assert_allclose(view["velocity_error"], [0.2, 0.0, -0.1], rtol=0, atol=1e-6)
    moving = replace(state, velocity_w=np.array([0.0, 0.2, 0.0]))
    np.testing.assert_allclose(seen(controller, moving, reference)["velocity_error"], [-0.2, 0, 0], rtol=0, atol=1e-6)


def test_attitude_errors_are_about_the_torsos_own_axes_however_it_is_yawed(controller):
    yawed = exp(np.array([0.0, 0.0, math.pi / 2]))
    for k in range(3):
        off = np.zeros(3)
        off[k] = 0.1
        state = resting(FORMS["form1"], yawed @ exp(off), omega_b=10 * off)
        view = seen(controller, state, staying(state, quat_wb=matrix_to_quat(yawed)))
        np.testing.assert_allclose(view["attitude_error"], -math.sin(0.1) * off / 0.1, rtol=0, atol=1e-6)
        np.testing.assert_allclose(view["angular_velocity_error"], -10 * off, rtol=0, atol=1e-6)


def test_measured_angles_and_rates_are_in_the_order_of_joints_and_rotors(controller):
    rng = np.random.default_rng(0)
    q, dq, angles, rates = (
        rng.uniform(-1, 1, 16),
        rng.normal(size=16),
        rng.uniform(-3, 3, (8, 2)),
        rng.normal(size=(8, 2)),
    )
    view = seen(controller, resting(q, None, angles, joint_velocity=dq, vectoring_velocity=rates))
    for name, value in (("joint_position", q), ("joint_velocity", dq), ("vectoring_velocity", rates.reshape(-1))):
        np.testing.assert_allclose(view[name], value, rtol=0, atol=1e-6)
    sine, cosine = view["vectoring_sine"], view["vectoring_cosine"]
    np.testing.assert_allclose(np.arctan2(sine, cosine).reshape(8, 2), angles, rtol=0, atol=1e-6)


def test_whole_turns_of_the_rotors_are_not_seen(controller):
    angles = np.random.default_rng(1).uniform(-3, 3, (8, 2))
    turns = 2 * math.pi * np.arange(-8, 8).reshape(8, 2)
    plain, turned = (seen(controller, hovering(vectoring=a), memory={"vectoring": a}) for a in (angles, angles + turns))
    for name in plain:
        np.testing.assert_allclose(turned[name], plain[name], rtol=0, atol=1e-5)


def test_commands_integrals_plan_and_last_action_appear_under_their_names(controller):
    rng = np.random.default_rng(2)
    thrust, angles = rng.uniform(0, 42, 8), rng.uniform(-3, 3, (8, 2))
    commanded, target, following, speed = (rng.uniform(-1, 1, 16) for _ in range(4))
    restricted = np.arange(8) % 3 == 0
    integrals = Integrals(np.array([1.0, 2.0, 3.0]), np.array([4.0, 5.0, 6.0]))
    view = seen(
        controller,
        hovering(),
        memory={
            "vectoring": angles, "joint_position": commanded, "integrals": integrals,
            "interference": replace(no_interference(), restricted=restricted),
        },
        thrust_command=thrust,
        joint_command_velocity=speed,
        leg_momentum=np.array([0.1, 0.2, 0.3]),
        leg_momentum_rate=np.array([7.0, 8.0, 9.0]),
        joint_target=target,
        next_form=following,
        time_to_next_form=3.5,
        previous_action=np.arange(6) / 10,
    )  # fmt: skip
    expected = {
        "thrust_command": thrust,
        "joint_target_error": target - commanded,
        "joint_command_velocity": speed,
        "leg_momentum": [0.1, 0.2, 0.3],
        "leg_momentum_rate": [7, 8, 9],
        "position_integral": [1, 2, 3],
        "attitude_integral": [4, 5, 6],
        "restricted_rotors": restricted,
        "next_form": following,
        "time_to_next_form": [3.5],
        "previous_action": np.arange(6) / 10,
    }
    for name, value in expected.items():
        np.testing.assert_allclose(view[name], value, rtol=1e-6, atol=1e-6, err_msg=name)
    angle = np.arctan2(view["vectoring_command_sine"], view["vectoring_command_cosine"])
    np.testing.assert_allclose(angle.reshape(8, 2), angles, rtol=0, atol=1e-6)


def test_nothing_is_seen_that_the_robot_does_not_measure(controller):
    """The true thrust, the servos' torques and the time are known to the simulator only."""
    state = resting(FORMS["form3"])
    other = replace(state, time=9.0, thrust=np.arange(8.0), joint_torque=np.arange(16.0))
    views = [np.concatenate(list(seen(controller, s, staying(state)).values())) for s in (state, other)]
    assert np.array_equal(*views)


def test_numbers_beyond_their_bound_are_seen_at_the_bound(controller):
    fast = hovering(joint_velocity=np.full(16, -99.0), vectoring_velocity=np.full((8, 2), 99.0))
    view = seen(controller, fast, thrust_command=np.full(8, 99.0), time_to_next_form=99.0)
    assert np.all(view["joint_velocity"] == -5.0)
    assert np.all(view["vectoring_velocity"] == 20.0)
    assert np.all(view["thrust_command"] == ROBOT.max_thrust)
    assert view["time_to_next_form"] == 60.0


# In the environment


def test_leg_momentum_is_what_the_commanded_joints_make_on_a_torso_that_holds_still():
    env = gymnasium.make(HOVER, forms="independent", joint_speed=1.0).unwrapped
    env.reset(seed=35)
    views = [split(env.step(np.zeros(6))[0]) for _ in range(50)]
    plant, R_wb = env.plant, quat_to_matrix(env.state.quat_wb)
    data = mujoco.MjData(plant.model)
    data.qpos[:] = plant.data.qpos
    for name, speed in zip(JOINT_NAMES, views[-1]["joint_command_velocity"], strict=True):
        data.joint(name).qvel[0] = speed
    mujoco.mj_forward(plant.model, data)
    mujoco.mj_subtreeVel(plant.model, data)
    momentum_b = R_wb.T @ data.subtree_angmom[plant.model.body("torso").id]
    assert np.linalg.norm(momentum_b) > 0.05
    np.testing.assert_allclose(views[-1]["leg_momentum"], momentum_b, rtol=0, atol=1e-6)
    rate = 40.0 * (views[-1]["leg_momentum"] - views[-2]["leg_momentum"])
    np.testing.assert_allclose(views[-1]["leg_momentum_rate"], rate, rtol=0, atol=1e-4)


def test_encoders_and_motion_capture_are_seen_where_there_are_sensors_and_the_truth_where_there_are_none():
    for sensors in (False, True):
        env = gymnasium.make(HOVER, forms="form1", perturbation=0.0, sensors=sensors).unwrapped
        env.reset(seed=0)
        offs = []
        for _ in range(20):
            view, state = split(env.step(np.zeros(6))[0]), env.state
            angles = np.arctan2(view["vectoring_sine"], view["vectoring_cosine"]).reshape(8, 2)
            turn = np.angle(np.exp(1j * (angles - state.vectoring)))
            offs.append(np.concatenate([view["joint_position"] - state.joint_position, turn.reshape(-1)]))
        if sensors:
            # Half a count of noise and the rounding to a count of 0.8 … 1.5 mrad.
            assert 2e-4 < np.std(offs) < 2e-3
            assert np.abs(offs).max() < 0.01
        else:
            np.testing.assert_allclose(offs, 0.0, rtol=0, atol=1e-6)


@pytest.mark.parametrize("part", ["air_force", "thrust", "power_w"])
def test_what_only_the_simulator_knows_is_in_the_info_and_not_in_the_observation(part):
    assert part not in {field.name for field in layout(N_ACTION)}
    assert part in gymnasium.make(HOVER).reset(seed=0)[1]


def test_the_plan_counts_down_to_the_next_form_and_then_it_is_the_target():
    env = gymnasium.make(HOVER, forms="paper", perturbation=0.0).unwrapped
    view = split(env.reset(seed=0)[0])
    assert view["time_to_next_form"] == 4.0
    np.testing.assert_allclose(view["next_form"], FORMS["form2"], rtol=0, atol=1e-6)
    for k in range(1, 162):
        view = split(env.step(np.zeros(6))[0])
        if k < 160:
            np.testing.assert_allclose(view["time_to_next_form"], 4.0 - k / 40, rtol=0, atol=1e-5)
            np.testing.assert_allclose(view["joint_target_error"], 0.0, rtol=0, atol=1e-6)
    np.testing.assert_allclose(view["next_form"], FORMS["form3"], rtol=0, atol=1e-6)
    command = env.controller.memory.joint_position
    np.testing.assert_allclose(view["joint_target_error"], FORMS["form2"] - command, rtol=0, atol=1e-6)
    np.testing.assert_allclose(np.abs(view["joint_command_velocity"]).max(), 0.2, rtol=1e-6)
