"""Pins the estimated external force: effects of wind, weight and commands, and independence of a vector's robots."""

import gymnasium
import numpy as np
import pytest

from spidar_gym.errors import InvalidValueError
from spidar_gym.policies.external import PLACES, SIZE, ExternalForce
from spidar_gym.robot import GRAVITY, ROBOT


def felt(seconds=6.0, action=None, **options):
    """Simulate a hover; return the external force's entries (ticks, SIZE) and the true air force (ticks, 3)."""
    env = gymnasium.make("spidar_gym/Hover-v0", forms="form1", perturbation=0.0, preset="tuned", **options)
    observation, _ = env.reset(seed=1)
    force, shown, air = ExternalForce(0.05), [], []
    for _ in range(round(40 * seconds)):
        shown.append(force(observation)[-SIZE:])
        observation, _, terminated, _, info = env.step(np.zeros(6) if action is None else action)
        assert not terminated
        air.append(info["air_force"])
    env.close()
    return np.array(shown), np.array(air)


def test_in_calm_air_nothing_pulls_but_the_drag_of_the_jets():
    shown, _ = felt(wake=False)
    assert np.abs(shown[0]).max() == 0.0, "there is no force before the second observation"
    assert np.abs(shown[40:, :3].mean(axis=0)).max() < 0.02


def test_wind_is_felt_as_the_force_of_the_air():
    shown, air = felt(wake=False, disturbances={"wind": 3.0})
    pulls, true = shown[80:, :3].mean(axis=0), air[80:].mean(axis=0)
    assert np.linalg.norm(true) > 1.0
    np.testing.assert_allclose(pulls, true, atol=0.06 * np.linalg.norm(true) + 0.02)


def test_a_residual_is_no_wind():
    shown, _ = felt(wake=False, action=np.array([0.2, -0.1, 0.0, 0.0, 0.0, 0.0]))
    assert np.abs(shown[120:, :3].mean(axis=0)).max() < 0.1


def test_it_is_a_force_its_size_and_the_first_integral():
    rng, force = np.random.default_rng(0), ExternalForce(0.05)
    seen = rng.normal(size=(3, 200))
    first = force(seen)
    assert first.shape == (3, 200 + SIZE)
    later = force(rng.normal(size=(3, 200)))
    np.testing.assert_array_equal(later[:, -6:-3], np.abs(later[:, -9:-6]))
    np.testing.assert_array_equal(later[:, -3:], np.abs(seen[:, PLACES["position_integral"]]))
    assert np.abs(later[:, -9:-6]).min() > 0.0


def test_a_change_of_velocity_is_a_force_of_mass_times_acceleration():
    seen = np.zeros(200)
    seen[PLACES["joint_position"]] = 0.0
    seen[PLACES["thrust_command"]] = ROBOT.weight / 8
    seen[PLACES["vectoring_command_cosine"]] = 1.0
    force = ExternalForce(0.05)
    force(seen)
    np.testing.assert_allclose(force(seen)[-9:-6], 0.0, atol=1e-9)  # thrust balances the weight
    seen[PLACES["velocity_error"]] = [-0.01, 0.0, 0.0]  # forward velocity
    np.testing.assert_allclose(force(seen)[-9:-6], [0.01 * 40.0 * ROBOT.weight / GRAVITY, 0.0, 0.0], atol=1e-9)
    seen[PLACES["attitude_error"]] = [0.0, 0.01, 0.0]  # tilted torso
    np.testing.assert_allclose(force(seen)[-9:-6], [0.01 * ROBOT.weight, 0.0, 0.0], atol=1e-9)


def test_each_robot_of_many_feels_what_it_would_feel_alone():
    rng = np.random.default_rng(1)
    seen = rng.normal(size=(5, 4, 200)).astype(np.float32)
    many, alone = ExternalForce(0.05), [ExternalForce(0.05) for _ in range(4)]
    many.reset(4)
    for tick in seen:
        together = many(tick)
        for k in range(4):
            np.testing.assert_array_equal(together[k], alone[k](tick[k]))


@pytest.mark.parametrize("lag", [0.0, -1.0, np.nan])
def test_rotors_have_a_time_constant(lag):
    with pytest.raises(InvalidValueError):
        ExternalForce(lag)
