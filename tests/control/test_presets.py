"""Pins the presets: the paper's gains, the tuned controller's margins, its torques in flight and its first ticks."""

from dataclasses import replace

import gymnasium
import numpy as np
import pytest
from support.states import model, random_pose, resting, staying

import spidar_gym  # noqa: F401 - registers the environments
from spidar_gym.control.flight.centroidal import CentroidalConfig
from spidar_gym.control.flight.compensation import CompensationConfig
from spidar_gym.control.flight.controller import ControllerConfig, FlightController
from spidar_gym.control.presets import (
    CRAWL_PRESETS,
    FORMER_CRAWL_PRESETS,
    FORMER_PRESETS,
    PRESETS,
    controller_config,
    crawler_config,
)
from spidar_gym.errors import UnknownNameError
from spidar_gym.robot import FORMS, ROBOT
from spidar_gym.so3 import exp, matrix_to_quat
from spidar_gym.tune.flight import loops, shortfall

TRIM = np.array([1.0, -2.0, 3.0, 0.4, -0.3, 0.2])


def test_the_paper_flies_the_default_gains_without_compensation():
    assert controller_config("paper") == ControllerConfig()
    assert controller_config("paper").centroidal == CentroidalConfig()
    assert controller_config("as_flown") == ControllerConfig(allocation="as_flown")
    assert controller_config("as_flown").compensation == CompensationConfig()
    assert controller_config("as_flown_quasi") == replace(controller_config("as_flown"), motion="quasi_static")
    assert [name for name, config in PRESETS.items() if config.motion == "quasi_static"] == ["as_flown_quasi"]


def test_tuned_changes_gains_and_compensation_and_nothing_else_of_the_paper():
    tuned = controller_config("tuned")
    plain = replace(tuned, centroidal=CentroidalConfig(), compensation=CompensationConfig())
    assert plain == controller_config("paper")
    for gains in (tuned.centroidal.position_gains, tuned.centroidal.attitude_gains):
        assert gains[0] == gains[1]
        assert np.min(gains) > 0.0


@pytest.mark.parametrize("preset", [name for name in (*PRESETS, *FORMER_PRESETS) if name != "steady"])
def test_every_preset_of_a_rigid_robot_keeps_the_margins_of_gain_delay_and_sensitivity(preset):
    assert shortfall(loops(controller_config(preset))) == 0.0


def test_the_first_flight_has_less_bandwidth_and_larger_margins_than_the_paper_on_every_axis():
    first, paper = loops(controller_config("first_flight")), loops(controller_config("paper"))
    assert [round(m.crossover, 1) for m in first] == [2.6, 2.5, 3.9, 3.6]  # docs/onboard/first_flight.md
    assert [round(m.crossover, 1) for m in paper] == [4.1, 2.8, 5.6, 5.3]
    for one, other in zip(first, paper, strict=True):
        assert one.crossover < other.crossover
        assert (one.gain > other.gain, one.phase > other.phase, one.delay > other.delay) == (True, True, True)
    assert controller_config("first_flight").joint_speed == 0.5 * ROBOT.joint_speed


def test_fields_of_a_preset_can_be_changed_and_the_preset_stays():
    assert replace(controller_config("tuned"), joint_speed=0.7).joint_speed == 0.7
    assert controller_config("tuned") == PRESETS["tuned"]
    assert controller_config("tuned").joint_speed == ROBOT.joint_speed


def test_former_presets_are_accepted_by_name_and_not_listed():
    for former, listed, find in (
        (FORMER_PRESETS, PRESETS, controller_config), (FORMER_CRAWL_PRESETS, CRAWL_PRESETS, crawler_config)
    ):  # fmt: skip
        assert not former.keys() & listed.keys()
        for name, config in former.items():
            assert find(name) == config
            with pytest.raises(UnknownNameError, match="unknown preset") as refusal:
                find(f"{name}x")
            assert name not in str(refusal.value).partition("valid:")[2]


def test_an_unknown_preset_is_refused_with_the_valid_ones():
    with pytest.raises(UnknownNameError, match="unknown preset 'papr'; valid: paper, as_flown, as_flown_quasi, tuned"):
        controller_config("papr")


@pytest.mark.parametrize("preset", PRESETS)
def test_a_known_trim_is_in_the_demand_from_the_first_tick_on(preset):
    """The demand of a level robot at rest contains the trim, stored in integrals or observer, besides the weight."""
    state = resting(FORMS["form2"])
    controller = FlightController(controller_config(preset), model())
    controller.reset(state, trim=TRIM)
    demands = []
    for _ in range(2):
        controller.step(state, staying(state))
        demands.append(controller.last_step.wrench_desired)
    np.testing.assert_allclose(demands[0], np.array([0.0, 0.0, ROBOT.weight, 0.0, 0.0, 0.0]) + TRIM, atol=1e-6)
    np.testing.assert_allclose(demands[1], demands[0], atol=0.5)


def test_a_trim_of_a_tilted_robot_is_in_torso_axes():
    R_wb = exp(np.array([0.2, -0.1, 0.9]))
    state = resting(FORMS["form1"], R_wb)
    for preset in PRESETS:
        demands = []
        for trim in (np.zeros(6), TRIM):
            controller = FlightController(controller_config(preset), model())
            controller.reset(state, trim=trim)
            controller.step(state, staying(state, quat_wb=matrix_to_quat(R_wb)))
            demands.append(controller.last_step.wrench_desired)
        np.testing.assert_allclose(demands[1] - demands[0], TRIM, atol=1e-6)


@pytest.mark.parametrize("preset", PRESETS)
def test_a_tick_in_any_pose_answers_with_a_command_that_the_robot_can_follow(preset):
    rng = np.random.default_rng(1)
    for _ in range(10):
        q, R_wb = random_pose(rng)
        state = resting(q, R_wb, omega_b=rng.normal(scale=0.3, size=3), joint_velocity=rng.normal(scale=0.3, size=16))
        controller = FlightController(controller_config(preset), model())
        controller.reset(state)
        for _ in range(3):
            command = controller.step(state, staying(state, joint_target=FORMS["form2"]))
        assert np.isfinite(np.concatenate([command.vectoring.ravel(), command.joint_position])).all()
        assert np.isfinite(controller.last_step.wrench_desired).all()
        assert 0.0 <= command.thrust.min() <= command.thrust.max() <= ROBOT.max_thrust + 1e-9


@pytest.mark.parametrize("preset", ["paper", "tuned"])
def test_a_flight_through_random_forms_demands_no_joint_torque_above_the_limit(preset):
    env = gymnasium.make("spidar_gym/Hover-v0", forms="independent", preset=preset, joint_speed=1.0, perturbation=0.0)
    env.reset(seed=11)
    for _ in range(160):
        _, _, terminated, _, info = env.step(np.zeros(env.action_space.shape))
        assert not terminated
        assert np.abs(info["joint_torque_allocated"]).max() <= ROBOT.max_joint_torque + 1e-3
    env.close()
