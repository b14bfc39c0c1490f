"""Flies and crawls custom robots: core and Python alike, single and in vectors, beside the nominal one; refusals."""

import copy
import importlib.util
import pickle
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from support.robots import LOADED, LONG, OTHER, ROBOTS

import spidar_gym  # noqa: F401 - registers the environments
from spidar_gym.control.presets import controller_config, crawler_config
from spidar_gym.envs.registry import COURSE, CRAWL, ENVIRONMENTS, HOVER, PATH
from spidar_gym.errors import InvalidValueError, SpidarError, UnknownArgumentError, UnknownNameError
from spidar_gym.robot import ROBOT, RobotSpec
from spidar_gym.sim.actuators import ActuatorConfig
from spidar_gym.sim.config import PlantConfig
from spidar_gym.tasks.hover import hover_height

FLIGHT = {"forms": "independent", "joint_speed": 0.6}


def played(name, ticks, *, action=None, seed=3, **arguments):
    """Observations (ticks + 1, n), and the last `info`."""
    env = gymnasium.make(name, **arguments)
    observation, info = env.reset(seed=seed)
    rng, rows = np.random.default_rng(0), [observation]
    for _ in range(ticks):
        a = (
            np.zeros(env.action_space.shape)
            if action is None
            else action * rng.uniform(-1.0, 1.0, env.action_space.shape)
        )
        observation, _, terminated, _, info = env.step(a)
        assert not terminated, info["failure"]
        rows.append(observation)
    env.close()
    return np.array(rows), info


@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize("env_id", [HOVER, PATH, CRAWL])
def test_core_and_python_command_a_custom_robot_alike(env_id, name):
    arguments = FLIGHT if env_id != CRAWL else {"distance": 0.3}
    one, two = (
        played(env_id, 80, action=0.5, robot=ROBOTS[name], sensors=True, control=control, **arguments)[0]
        for control in ("core", "python")
    )
    np.testing.assert_allclose(one, two, rtol=0, atol=2e-6)
    assert np.abs(one[-1] - played(env_id, 80, action=0.5, sensors=True, **arguments)[0][-1]).max() > 1e-3


@pytest.mark.parametrize("control", ["core", "python"])
@pytest.mark.parametrize("action_mode", ["direct", "residual", "residual_force"])
def test_every_kind_of_action_reaches_the_robots_own_limits(action_mode, control):
    env = gymnasium.make(HOVER, robot=OTHER, action_mode=action_mode, control=control).unwrapped
    env.reset(seed=0)
    env.step(np.ones(env.action_space.shape))
    thrust = env.command.thrust
    assert thrust.max() <= OTHER.max_thrust + 1e-9
    assert action_mode != "direct" or np.all(thrust == OTHER.max_thrust)
    np.testing.assert_array_equal(env.command.joint_torque_limit, OTHER.max_joint_torque)


@pytest.mark.parametrize("name", ROBOTS)
def test_a_custom_robot_hovers_where_its_feet_clear_the_floor(name):
    robot = ROBOTS[name]
    env = gymnasium.make(HOVER, forms="form3", perturbation=0.0, horizon_s=2.0, robot=robot).unwrapped
    env.reset(seed=0)
    for _ in range(80):
        *_, terminated, _, info = env.step(np.zeros(6))
        assert not terminated
    assert env.reference().position_w[2] == hover_height(robot) != hover_height()
    assert np.linalg.norm(info["position_error"]) < 0.02
    assert info["thrust_command"].sum() == pytest.approx(robot.weight, rel=0.15)  # jets reduce some of it
    assert env.plant.model.body_mass.sum() == pytest.approx(robot.total_mass)
    assert env.controller.model.robot is robot


def test_the_nominal_robot_by_another_name_flies_bit_for_bit():
    np.testing.assert_array_equal(played(HOVER, 40)[0], played(HOVER, 40, robot=RobotSpec())[0])
    np.testing.assert_array_equal(played(CRAWL, 40)[0], played(CRAWL, 40, robot={})[0])


@pytest.mark.parametrize("env_id", ENVIRONMENTS)
@pytest.mark.parametrize("strength", [0.0, 0.7])
def test_vectors_equal_single_environments_bit_for_bit(env_id, strength):
    arguments = {"robot": LONG, "randomization": strength, "wake": True}
    vector = gymnasium.make_vec(env_id, 3, **arguments)
    rows = [vector.reset(seed=[5, 6, 7])[0]]
    for _ in range(8):
        rows.append(vector.step(np.zeros(vector.action_space.shape))[0])
    vector.close()
    for k, seed in enumerate((5, 6, 7)):
        single, _ = played(env_id, 8, seed=seed, **arguments)
        np.testing.assert_array_equal(np.array(rows)[:, k], single)


def test_two_robots_fly_in_turn_in_one_process_as_each_would_alone():
    alone = {robot: played(HOVER, 20, robot=robot, **FLIGHT)[0] for robot in (ROBOT, LONG)}
    envs = {robot: gymnasium.make(HOVER, robot=robot, **FLIGHT) for robot in (LONG, ROBOT)}
    rows = {robot: [env.reset(seed=3)[0]] for robot, env in envs.items()}
    for _ in range(20):
        for robot, env in envs.items():
            rows[robot].append(env.step(np.zeros(6))[0])
    for robot, found in rows.items():
        np.testing.assert_array_equal(found, alone[robot])


def test_a_robot_comes_from_a_file_too_and_stays_when_that_changes(tmp_path):
    path = tmp_path / "long.toml"
    path.write_text(f"pitch_to_foot = {LONG.pitch_to_foot!r}\n", encoding="utf-8")
    env = gymnasium.make(HOVER, robot=str(path))
    path.write_text("max_thrust = 60.0\n", encoding="utf-8")
    assert env.unwrapped.robot == LONG
    env.reset(seed=0, options={"randomization": 0.5})  # rebuilds the environment
    assert env.unwrapped.robot == LONG
    assert gymnasium.make_vec(HOVER, 2, robot=str(path))._single.robot == RobotSpec(max_thrust=60.0)


def test_the_randomisation_is_as_wide_about_a_custom_robot():
    strong = RobotSpec(described_mass=20.0, max_thrust=84.0)
    masses, thrusts = [], []
    for seed in range(40):
        env = gymnasium.make(HOVER, robot=strong, randomization=1.0)
        env.reset(seed=seed)
        drawn = env.unwrapped.sampled_parameters
        masses.append(float(drawn["body.total_mass"]))
        thrusts.append(float(drawn["actuators.max_thrust"]))
    assert 1.25 * 15.2 <= min(masses) < max(masses) <= 1.25 * 16.4
    assert 2.0 * 31.8 <= min(thrusts) < max(thrusts) <= 2.0 * 42.0


def test_a_custom_plant_has_the_robot_of_its_configuration():
    slow = PlantConfig.of(LONG)
    slow = PlantConfig(
        joint_speed=slow.joint_speed, body=slow.body, actuators=ActuatorConfig(thrust_lag=0.06), robot=LONG
    )
    for arguments in ({"plant": slow}, {"plant": slow, "robot": LONG}):
        env = gymnasium.make(HOVER, **arguments).unwrapped
        assert env.robot == LONG == env.plant.config.robot
        assert env.plant.config.actuators.thrust_lag == 0.06
        assert env.plant.config.body.total_mass == LONG.total_mass


def test_a_custom_controller_configuration_gets_the_robots_limits_and_legs():
    flight = gymnasium.make(HOVER, robot=OTHER, controller=controller_config("tuned")).unwrapped.controller.config
    assert flight.joint_torque_limit == OTHER.max_joint_torque
    assert flight.interference.torso_radius == OTHER.torso_radius
    assert flight.centroidal == controller_config("tuned").centroidal
    crawl = gymnasium.make(CRAWL, robot=OTHER, controller=crawler_config("robust")).unwrapped.controller.config
    assert crawl.gait.robot == OTHER
    assert crawl.foot_friction == crawler_config("robust").foot_friction
    feet = crawl.gait.home_b
    np.testing.assert_allclose(feet[:, 2], OTHER.foot_radius - OTHER.peg_depth)


@pytest.mark.parametrize("control", ["core", "python"])
def test_copies_and_saved_states_are_of_the_same_robot(control):
    env = gymnasium.make(HOVER, robot=LOADED, control=control, sensors=True).unwrapped
    env.reset(seed=1)
    env.step(np.zeros(6))
    others = copy.deepcopy(env), pickle.loads(pickle.dumps(env))
    again = gymnasium.make(HOVER, robot=LOADED, control=control, sensors=True).unwrapped
    again.restore_state(env.save_state())
    for _ in range(5):
        expected = env.step(np.zeros(6))[0]
        for other in (*others, again):
            np.testing.assert_array_equal(other.step(np.zeros(6))[0], expected)
            assert other.robot == LOADED
    nominal = gymnasium.make(HOVER, control=control, sensors=True).unwrapped
    with pytest.raises(SpidarError, match="the saved state is of another set of options"):
        nominal.restore_state(env.save_state())


def test_saved_robots_of_a_vector_are_restored_as_the_same_robot_only():
    long, nominal = (gymnasium.make_vec(HOVER, 2, robot=robot) for robot in (LONG, ROBOT))
    long.reset(seed=0)
    nominal.reset(seed=0)
    with pytest.raises(SpidarError, match="the saved robots are of another robot"):
        nominal.restore(long.save())


@pytest.mark.parametrize(
    ("arguments", "kind", "words"),
    [
        ({"robot": {"max_thrust": 10.0}}, InvalidValueError, "at least 24.52 N: a robot of 16 kg"),
        ({"robot": {"legs": 6}}, InvalidValueError, "every robot has 4 legs"),
        ({"robot": {"arms": 2}}, UnknownNameError, "unknown number of the robot 'arms'"),
        ({"robot": "nowhere.toml"}, SpidarError, "robot: nowhere.toml cannot be read"),
        ({"robot": 3.0}, InvalidValueError, "robot = 3.0 .* a dictionary"),
        ({"robot": LONG, "plant": PlantConfig()}, InvalidValueError, r"of 16 kg.* PlantConfig\.of\(robot\)"),
        ({"robots": LONG}, UnknownArgumentError, "did you mean robot"),
        ({"robot": LONG, "idle_thrust": 50.0}, InvalidValueError, "within 0 … 42"),
    ],
)
@pytest.mark.parametrize("make", [gymnasium.make, lambda name, **options: gymnasium.make_vec(name, 2, **options)])
def test_invalid_robots_are_refused_in_one_line(make, arguments, kind, words):
    with pytest.raises(kind, match=words) as refusal:
        make(HOVER, **arguments)
    assert "\n" not in str(refusal.value)


def test_legs_too_short_for_a_preset_are_refused_by_the_crawl_alone():
    short = RobotSpec(pitch_to_foot=0.12, roll_axis_x=0.08, outer_battery=(0.1, 0.0, -0.039))
    gymnasium.make(HOVER, robot=short)
    with pytest.raises(InvalidValueError, match="a pose whose feet reach the floor"):
        gymnasium.make(CRAWL, robot=short)


def test_a_robot_is_no_option_of_reset():
    env = gymnasium.make(HOVER)
    with pytest.raises(UnknownNameError, match="unknown reset option 'robot'"):
        env.reset(options={"robot": LONG})


def test_the_guides_example_compares_both():
    path = Path(__file__).parents[2] / "docs" / "examples" / "longer_legs.py"
    found = importlib.util.spec_from_file_location("longer_legs", path)
    example = importlib.util.module_from_spec(found)
    found.loader.exec_module(example)
    assert example.LONG == LONG
    position, attitude, flown = example.hover(LONG, 1, horizon_s=2.0)
    assert 0.0 < position < 50.0
    assert 0.0 < attitude < 50.0
    assert flown in (0, 1)
    assert example.crawl(LONG, 1)[0] == 1


@pytest.mark.slow
@pytest.mark.parametrize("name", ROBOTS)
def test_a_custom_robot_flies_and_crawls_to_the_end(name):
    _, info = played(HOVER, 800, robot=ROBOTS[name], preset="tuned")
    assert info["is_success"]
    env = gymnasium.make(CRAWL, robot=ROBOTS[name])
    env.reset(seed=0)
    over = False
    while not over:
        *_, terminated, truncated, info = env.step(np.zeros(env.action_space.shape))
        over = terminated or truncated
    assert info["is_success"], info["shortfalls"]


@pytest.mark.slow
def test_the_longer_robot_goes_a_course():
    env = gymnasium.make(
        COURSE, robot=LONG, action_mode="residual", hold=20, count=(1, 1), gates=("wall",), floors=("plain",)
    )
    env.reset(seed=2)
    over = False
    while not over:
        *_, terminated, truncated, info = env.step(np.zeros(env.action_space.shape))
        over = terminated or truncated
    assert info["is_success"], info["failure"]
