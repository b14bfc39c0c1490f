"""Pins torso axes of `direct` policies: kinematics, forces equal to the network's output, joint motion to the form."""

import gymnasium
import numpy as np
import pytest

from spidar_gym.control.flight.compensation import ramp_joints
from spidar_gym.control.flight.observation import layout
from spidar_gym.envs.vector import NativeVectorEnv
from spidar_gym.model.dynamics import Model
from spidar_gym.model.rotor import AIM_HOLD, vectoring_to_force
from spidar_gym.policies import torso
from spidar_gym.robot import ROBOT


def seen(rng, count=20):
    """Sample observations with random forms and last commands, followed by the commanded joint angles."""
    observation = rng.normal(size=(count, torso.SHOWN))
    observation[:, torso.OBSERVATION :] = rng.uniform(-1.2, 1.2, (count, 16))
    for part in ("vectoring", "vectoring_command"):
        angle = rng.uniform(-np.pi, np.pi, (count, 16))
        observation[:, torso.entries(f"{part}_sine")] = np.sin(angle)
        observation[:, torso.entries(f"{part}_cosine")] = np.cos(angle)
    observation[:, torso.entries("joint_position")] = rng.uniform(-1.2, 1.2, (count, 16))
    observation[:, torso.entries("thrust_command")] = rng.uniform(5.0, 30.0, (count, 8))
    observation[:, torso.entries("previous_action")] = rng.uniform(-0.8, 0.8, (count, 40))
    return observation


def done(action, observation):
    """Convert actions to forces in torso axes (count, 8, 3) [N] and joints (count, 16) [rad], as environments do."""
    thrust = 0.5 * ROBOT.max_thrust * (1.0 + action[:, :8])
    angles = np.pi * action[:, 8:24].reshape(-1, 2, 8).swapaxes(1, 2)
    forces_l = np.array([vectoring_to_force(t, a) for t, a in zip(thrust, angles, strict=True)])
    R = torso.links(observation[:, torso.entries("joint_position")])
    forces_b = np.einsum("nrij,nrj->nri", R, forces_l)
    np.testing.assert_allclose(torso.forces(thrust, angles, observation), forces_b, atol=1e-12)
    return forces_b, ROBOT.joint_limit * action[:, 24:]


def after(action, observation):
    """Return the observations after these actions."""
    observation = observation.copy()
    angles = np.pi * action[:, 8:24].reshape(-1, 2, 8).swapaxes(1, 2).reshape(-1, 16)
    observation[:, torso.entries("vectoring_command_sine")] = np.sin(angles)
    observation[:, torso.entries("vectoring_command_cosine")] = np.cos(angles)
    observation[:, torso.entries("previous_action")] = action
    joints, moved = observation[:, torso.OBSERVATION :].copy(), ROBOT.joint_limit * action[:, 24:]
    observation[:, torso.entries("joint_command_velocity")] = 40.0 * (moved - joints)
    observation[:, torso.entries("joint_target_error")] -= moved - joints
    observation[:, torso.OBSERVATION :] = moved
    return observation


def test_links_are_where_pinocchio_has_them():
    rng, model = np.random.default_rng(0), Model()
    for q in rng.normal(scale=0.8, size=(5, 16)):
        np.testing.assert_allclose(
            torso.links(q), model.snapshot(q, np.eye(3), rng.normal(size=(8, 2))).R_bl, atol=1e-12
        )  # fmt: skip


def test_entries_match_the_layout_and_features_match_the_observation():
    rng = np.random.default_rng(1)
    assert sum(field.size for field in layout(40)) == torso.OBSERVATION
    observation = seen(rng)
    found = torso.features(observation)
    assert found.shape == (20, torso.FEATURES)
    np.testing.assert_array_equal(found[:, :3], observation[:, torso.entries("position_error")])
    directions, forces, axes = np.split(found[:, len(torso.KEPT_ENTRIES) : -16].reshape(20, 24, 3), 3, axis=1)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=2), 1.0, atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(axes, axis=2), 1.0, atol=1e-12)
    np.testing.assert_allclose(
        np.linalg.norm(forces, axis=2), observation[:, torso.entries("thrust_command")], atol=1e-9
    )  # fmt: skip
    np.testing.assert_array_equal(found[:, -16:], observation[:, torso.OBSERVATION :])


def test_nothing_said_is_an_eighth_of_the_weight_on_every_rotor_and_joints_that_go_to_their_form():
    observation = seen(np.random.default_rng(2))
    start, form = observation[:, torso.OBSERVATION :], np.random.default_rng(9).uniform(-1.2, 1.2, (20, 16))
    observation[:, torso.entries("joint_target_error")] = form - start
    observation[:, torso.entries("joint_command_velocity")] = 0.0
    path = [start]
    for _ in range(130):
        action = torso.command(np.zeros((20, 40)), observation)
        observation = after(action, observation)
        path.append(observation[:, torso.OBSERVATION :])
    forces, joints = done(action, observation)
    np.testing.assert_allclose(forces, np.tile([0.0, 0.0, ROBOT.weight / 8], (20, 8, 1)), atol=1e-6)
    np.testing.assert_allclose(joints, form, atol=1e-9)
    # The joint with the longest path needs its time at full speed, plus acceleration and deceleration.
    ramp = torso.SPEED / torso.ACCELERATION
    late = round(40.0 * float((np.abs(form - start).max(axis=1) / torso.SPEED + ramp).max())) + 2
    np.testing.assert_allclose(path[late], form, atol=1e-6)
    velocity = 40.0 * np.diff(path, axis=0)
    assert np.abs(velocity).max() < torso.SPEED + 1e-9
    assert np.abs(np.diff(velocity, axis=0)).max() < torso.ACCELERATION / 40.0 + 1e-9


def test_joints_are_led_off_their_form_by_what_is_said():
    observation, said = seen(np.random.default_rng(10)), np.zeros((20, 40))
    form = observation[:, torso.OBSERVATION :] + observation[:, torso.entries("joint_target_error")]
    said[:, 24:] = np.random.default_rng(11).uniform(-1.0, 1.0, (20, 16))
    first = torso.command(said, observation)
    for k, row in enumerate(observation):  # each robot separately, with the controller's ramp
        velocity = row[torso.entries("joint_command_velocity")]
        speed = min(torso.SPEED, float(np.abs(velocity).max()) + torso.ACCELERATION / 40.0)
        expected = ramp_joints(
            row[torso.OBSERVATION :], velocity, form[k] + torso.OFFSET * said[k, 24:], speed=speed,
            ramp=speed / torso.ACCELERATION, dt=0.025,
        )[0]  # fmt: skip
        within = np.clip(expected, -ROBOT.joint_limit, ROBOT.joint_limit)
        np.testing.assert_allclose(done(first, observation)[1][k], within, atol=1e-12)


@pytest.mark.parametrize("limit", [0.2, 0.4, 1.0])
@pytest.mark.parametrize("sensors", [False, True])
def test_joints_go_straight_to_their_forms_at_whatever_speed_they_are_let_go(limit, sensors):
    env = gymnasium.make(
        "spidar_gym/Hover-v0", action_mode="direct", forms="independent", joint_speed=limit, sensors=sensors,
        preset="tuned", horizon_s=60.0, max_episode_steps=10**6,
    ).unwrapped  # fmt: skip
    joints = torso.Joints()
    observation, _ = env.reset(seed=3)
    start, form = (goal.joint_target for goal in env.progress.goals[:2])
    seen, path = joints(observation), []
    for _ in range(500):
        # Only commands are compared; the physics has no effect.
        action = torso.command(np.zeros(40), seen)
        observation = env.step(action.astype(np.float32))[0]
        observation[torso.entries("joint_target_error")] = form - env.controller.memory.joint_position
        seen = joints(observation)
        path.append(env.controller.memory.joint_position.copy())
        np.testing.assert_allclose(joints.position, path[-1], atol=1e-6)
    np.testing.assert_allclose(path[-1], form, atol=1e-4)
    way = np.abs(form - start).max()
    late = np.flatnonzero(np.abs(np.array(path) - form).max(axis=1) < 0.05)[0] / 40.0
    assert late < way / limit + 0.5
    past = (np.array(path) - form) * np.sign(form - start)
    assert past.max() < 0.01, "overshoot"


def test_commanded_joints_are_where_they_were_measured_first_then_asked_and_else_as_they_moved():
    rng, joints = np.random.default_rng(12), torso.Joints()
    first, second = (rng.normal(size=(3, torso.OBSERVATION)) for _ in range(2))
    second[:, torso.entries("joint_command_velocity")] *= 0.2
    joints.reset(3)
    measured = first[:, torso.entries("joint_position")]
    np.testing.assert_array_equal(joints(first), np.concatenate([first, measured], axis=1))
    velocity = second[:, torso.entries("joint_command_velocity")]
    asked = ROBOT.joint_limit * second[:, torso.entries("previous_action")][:, 24:]
    moved = np.where(np.abs(velocity) < torso.SURE, asked, measured + velocity / 40.0)
    assert 5 < (np.abs(velocity) < torso.SURE).sum() < 43
    np.testing.assert_array_equal(joints(second)[:, torso.OBSERVATION :], moved)
    shown = joints.begin(np.array([1]), second[1:2])
    np.testing.assert_array_equal(shown[:, torso.OBSERVATION :], second[1:2, torso.entries("joint_position")])
    np.testing.assert_array_equal(joints.position[[0, 2]], moved[[0, 2]])


def test_a_constant_output_is_reached_and_at_once_if_phi_need_not_turn_far():
    rng = np.random.default_rng(3)
    observation, said = seen(rng), rng.uniform(-1.0, 1.0, (20, 40))
    said[:, 24:] = 0.0
    wanted = 10.0 * said[:, :24].reshape(20, 8, 3) + [0.0, 0.0, ROBOT.weight / 8]
    found = []
    for _ in range(60):
        action = torso.command(said, observation)
        found.append(np.linalg.norm(done(action, observation)[0] - wanted, axis=2))
        observation = after(action, observation)
    assert found[-1].max() < 1e-6
    # Initially the force component perpendicular to the plane of θ is missing until φ has turned; the error is smaller
    # for a smaller force along the axis of φ.
    assert np.median(found[0] / np.linalg.norm(wanted, axis=2)) < AIM_HOLD
    assert (found[1] <= found[0] + 1e-9).all()


def test_a_force_along_the_links_axis_leaves_phi_where_it_is():
    observation = seen(np.random.default_rng(4))
    forces = 20.0 * torso.links(observation[:, torso.entries("joint_position")])[..., 0]
    action = torso.command(torso.answer(forces), observation)
    s = observation[:, torso.entries("vectoring_command_sine")][:, ::2]
    c = observation[:, torso.entries("vectoring_command_cosine")][:, ::2]
    turn = np.exp(1j * np.pi * action[:, 8:16]) / (c + 1j * s)
    np.testing.assert_allclose(np.angle(turn), 0.0, atol=1e-9)
    np.testing.assert_allclose(done(action, observation)[0], forces, atol=1e-9)


def test_phi_turns_by_no_more_than_a_quarter_and_an_answer_is_what_has_to_be_said():
    rng = np.random.default_rng(5)
    observation, said = seen(rng), rng.uniform(-1.0, 1.0, (20, 40))
    action = torso.command(said, observation)
    s, c = (observation[:, torso.entries(f"vectoring_command_{part}")][:, ::2] for part in ("sine", "cosine"))
    assert (np.cos(np.pi * action[:, 8:16]) * c + np.sin(np.pi * action[:, 8:16]) * s > -1e-9).all()
    wanted = 10.0 * said[:, :24].reshape(20, 8, 3) + [0.0, 0.0, ROBOT.weight / 8]
    np.testing.assert_allclose(torso.answer(wanted), np.concatenate([said[:, :24], np.zeros((20, 16))], axis=1))


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_each_robot_of_many_is_answered_as_it_would_be_alone(dtype):
    rng = np.random.default_rng(6)
    observation, said = seen(rng, 33).astype(dtype), rng.normal(size=(33, 40)).astype(dtype)
    many = torso.features(observation), torso.command(said, observation)
    assert np.abs(many[1]).max() <= 1.0
    for k in range(33):
        np.testing.assert_array_equal(torso.features(observation[k]), many[0][k])
        np.testing.assert_array_equal(torso.command(said[k], observation[k]), many[1][k])


def test_the_flight_of_a_robot_is_nearly_equivariant_to_a_quarter_turn():
    rng, by_leg = np.random.default_rng(7), torso.Turn.passed_on(16)
    by_axis = torso.Turn(np.array([1, 0, 2]), np.array([-1.0, 1.0, 1.0]))
    forms, offset, tilt = rng.uniform(-0.6, 0.6, (2, 16)), np.array([0.02, -0.03, 0.01]), np.array([0.05, -0.02, 0.03])
    starts = [
        {
            "goals": [[0.0, 0.0, one], [0.2, 3.0, other]],
            "position": [float(x) for x in offset], "rotation": [float(x) for x in tilt],
        }
        for one, other, offset, tilt in (
            (*forms.tolist(), offset, tilt), (*by_leg(forms).tolist(), by_axis(offset), by_axis(tilt)),
        )
    ]  # fmt: skip
    robots = NativeVectorEnv("spidar_gym/Hover-v0", 2, action_mode="direct", forms="independent", joint_speed=0.6)
    observations = robots.reset(seed=1, options={"start": starts})[0]
    joints, turn = torso.Joints(), torso.shown_turn(0)
    joints.reset(2)
    first = torso.features(joints(observations))
    np.testing.assert_allclose(turn(first[0]), first[1], atol=1e-6)
    for _ in range(8):
        seen = joints(observations)
        shown = torso.features(seen)
        said = 0.2 * rng.normal(size=40)
        observations = robots.step(torso.command(np.array([said, torso.SAID_TURN(said)]), seen).astype(np.float32))[0]
    robots.close()
    # Only approximately: the flight controller and the computer are mounted off the torso's axis.
    for name in ("velocity_error", "attitude_error", "angular_velocity_error"):
        place = torso.KEPT_ENTRIES.tolist().index(torso.entries(name)[0]) + np.arange(3)
        way = np.linalg.norm(shown[1, place] - first[1, place])
        assert way > 0.01
        assert np.linalg.norm(turn(shown[0])[place] - shown[1, place]) < 0.03 * way


def test_four_quarters_are_a_whole_turn():
    numbers = np.random.default_rng(8).normal(size=(3, torso.FEATURES + 12))
    turn = torso.shown_turn(12)
    np.testing.assert_array_equal(turn(turn(turn(turn(numbers)))), numbers)
    assert np.abs(turn(turn(numbers)) - numbers).max() > 0.1
