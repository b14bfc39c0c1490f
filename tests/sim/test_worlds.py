"""Checks calibrated worlds: the file's rules, samples of each kind, engine against Python, what the environments do."""

import math
from pathlib import Path

import gymnasium
import numpy as np
import pytest

import spidar_gym  # noqa: F401 - registers the environments
from spidar_gym.envs.course_env import CourseEnv
from spidar_gym.envs.hover_env import HoverEnv
from spidar_gym.errors import InvalidValueError, SpidarError, StaleAssetError, UnknownNameError
from spidar_gym.robot import ROBOT
from spidar_gym.robot.spec import RobotSpec
from spidar_gym.sim import worlds
from spidar_gym.sim.config import PlantConfig
from spidar_gym.sim.randomize import Randomization, randomize
from spidar_gym.sim.worlds import find_world, read_world, world_names
from spidar_gym.so3 import quat_to_matrix

ROW = '[[row]]\nfield = "{}"\norigin = "chosen"\nsource = "of a test"\nlog = {}\nranges = {}\n'
HEAD = """doc = "Robots of a test."
sensors = {}
trimmed = {}
floor_steps = {}
[mixtures]
air = "eddies"
build = "unequal rotors"
[variants]
stiff = "as described"
soft = "badly damped"
"""
ROWS = (
    ROW.format("actuators.joint_kd", "true", "{ stiff = [8.0, 8.0], soft = [0.55, 1.4] }"),
    ROW.format("recirculation.flow_z", "false", "{ air = [0.03, 0.04], build = [0.0, 0.0] }"),
    ROW.format("actuators.module_gain", "false", "{ air = [1.0, 1.0], build = [0.9, 1.1] }"),
    ROW.format("body.peg_friction", "false", "{ all = [0.1, 0.3] }"),
)


@pytest.fixture
def world(tmp_path) -> Path:
    return written(tmp_path)


def written(folder: Path, *rows: str, sensors: bool = False, trimmed: bool = False, steps: float = 0.0) -> Path:
    path = folder / "robots_1.toml"
    path.write_text(HEAD.format(str(sensors).lower(), str(trimmed).lower(), steps) + "".join(rows or ROWS))
    return path


def test_every_committed_world_is_valid_and_of_the_pinned_content():
    for name in world_names():
        found = find_world(name)
        assert {row.origin for row in found.rows} <= set(worlds.ORIGINS)
        assert Randomization.parse(name).world == found
        randomize(PlantConfig(), np.random.default_rng(0), Randomization.parse(name))


def test_a_world_that_was_edited_is_refused(tmp_path, monkeypatch, world):
    monkeypatch.setattr(worlds, "FOLDER", tmp_path)
    digest = read_world(world).digest
    (tmp_path / worlds.PINS).write_text(f"{digest}  robots_1.toml\n")
    assert find_world.__wrapped__("robots_1").digest == digest
    world.write_bytes(world.read_bytes().replace(b"\n", b"\r\n"))  # another end of lines is the same content
    assert find_world.__wrapped__("robots_1").digest == digest
    world.write_text(world.read_text().replace("0.55", "0.56"))
    with pytest.raises(StaleAssetError, match="not the pinned one"):
        find_world.__wrapped__("robots_1")
    with pytest.raises(UnknownNameError, match="robots_1"):
        find_world.__wrapped__("robots_2")


def test_each_kind_has_samples_over_its_own_ranges(world):
    kinds = read_world(world).kinds
    assert kinds == ("air-stiff", "air-soft", "build-stiff", "build-soft")
    for index, kind in enumerate(kinds):
        how, rng = Randomization.parse(f"{world}:{kind}"), np.random.default_rng(1)
        robots = [randomize(PlantConfig(), rng, how)[1] for _ in range(400)]
        for row in read_world(world).rows:
            values, (low, high) = np.array([robot[row.field] for robot in robots]), row.kinds[index]
            if low == high:
                assert (values == low).all()
                continue
            places = np.log(values / low) / math.log(high / low) if row.is_log else (values - low) / (high - low)
            assert 0.0 <= places.min() < 0.05 < 0.95 < places.max() <= 1.0
            assert abs(places.mean() - 0.5) < 0.08  # six standard errors


def test_kinds_are_equally_frequent_and_share_their_samples(world):
    rng = np.random.default_rng(2)
    damping = np.array(
        [randomize(PlantConfig(), rng, Randomization.parse(world))[1]["actuators.joint_kd"] for _ in range(800)]
    )
    assert abs((damping < 8.0).mean() - 0.5) < 0.08
    drawn = [randomize(PlantConfig(), np.random.default_rng(3), Randomization.parse(f"{world}:{kind}"))[1]
             for kind in read_world(world).kinds]  # fmt: skip
    assert len({float(each["body.peg_friction"]) for each in drawn}) == 1


@pytest.mark.parametrize("name", ["Hover", "Crawl", "Course"])
def test_the_engine_samples_what_python_samples(world, name):
    env = gymnasium.make(f"spidar_gym/{name}-v0", randomization=world)
    found = set()
    for seed in range(12):
        sampled = env.reset(seed=seed)[1]["randomization"]
        kind = read_world(world).kinds[int(sampled["kind"])]
        alone = gymnasium.make(f"spidar_gym/{name}-v0", randomization=f"{world}:{kind}").reset(seed=seed)[1]
        for field, values in alone["randomization"].items():
            np.testing.assert_array_equal(values, sampled[field])
        rows = {row.field: row.kinds[int(sampled["kind"])] for row in read_world(world).rows}
        assert all(
            (low <= sampled[field]).all() and (sampled[field] <= high).all() for field, (low, high) in rows.items()
        )
        found.add(kind)
    assert len(found) == 4


def test_the_engine_applies_the_samples_in_the_order_of_python(world):
    """The generator of an episode is in the same state before the robot is sampled, whatever the ranges."""
    env = HoverEnv(randomization=world)
    env.reset(seed=5)
    config = env.plant.config
    sampled = env.sampled_parameters
    assert config.actuators.joint_kd == sampled["actuators.joint_kd"]
    np.testing.assert_array_equal(config.actuators.module_gain, sampled["actuators.module_gain"])
    assert config.recirculation.flow_z == sampled["recirculation.flow_z"]


def test_every_robot_lies_on_its_own_floor_whatever_the_number_of_robots_and_threads(tmp_path):
    tilted = ROW.format("ground.slope", "false", "{ all = [0.0, 0.2] }")
    heading = ROW.format("ground.heading", "false", "{ all = [-3.14, 3.14] }")
    for steps in (0.0, 0.002):
        path = written(tmp_path, tilted, heading, steps=steps)
        found = []
        for threads in (1, 2):
            vector = gymnasium.make_vec("spidar_gym/Crawl-v0", num_envs=5, randomization=path, num_threads=threads)
            info = vector.reset(seed=3)[1]["randomization"]
            observations = [vector.step(np.zeros(vector.action_space.shape, np.float32))[0] for _ in range(5)]
            found.append((info["ground.slope"], np.array(observations)))
            vector.close()
        assert np.array_equal(found[0][0], found[1][0])
        assert np.array_equal(found[0][1], found[1][1])
        assert len(set(found[0][0].tolist())) == 5
        for k in range(5):
            single = gymnasium.make("spidar_gym/Crawl-v0", randomization=path)
            single.reset(seed=3 + k)
            # Ends of the torso's motion within a step of the floor are a part of the tilt.
            tilt = np.arccos(quat_to_matrix(single.unwrapped.state.quat_wb)[2, 2])
            assert abs(tilt - found[0][0][k]) < (0.02 if steps else 0.002)
            for step in range(5):
                own = single.step(np.zeros(single.action_space.shape, np.float32))[0]
                assert np.array_equal(own, found[0][1][step][k])


def test_no_course_has_a_slope_of_the_floor(tmp_path):
    tilted = written(tmp_path, ROW.format("ground.slope", "false", "{ all = [0.0, 0.2] }"))
    with pytest.raises(InvalidValueError, match="the floor of a course is level"):
        CourseEnv(randomization={"ground.slope": (0.0, 0.2)})
    env = CourseEnv(randomization=tilted)
    env.reset(seed=0)
    assert env.sampled_parameters["ground.slope"] == env.plant.config.ground.slope == 0.0


def test_a_vector_has_the_robots_of_its_worlds_and_masks_for_the_others(world):
    vector = gymnasium.make_vec("spidar_gym/Hover-v0", num_envs=6, randomization=world)
    single = gymnasium.make("spidar_gym/Hover-v0", randomization=world)
    info = vector.reset(seed=7)[1]["randomization"]
    for k in range(6):
        own = single.reset(seed=7 + k)[1]["randomization"]
        assert all(np.array_equal(values, info[field][k]) for field, values in own.items())
    vector.close()


@pytest.mark.parametrize(("sensors", "trimmed"), [(True, False), (False, True)])
def test_a_world_brings_its_sensors_and_the_state_of_the_integrals(tmp_path, sensors, trimmed):
    heavy = ROW.format("body.total_mass", "false", "{ all = [16.4, 16.4] }")
    env = HoverEnv(randomization=written(tmp_path, heavy, sensors=sensors, trimmed=trimmed), perturbation=0.0)
    env.reset(seed=0)
    assert np.array_equal(env.seen.position_w, env.state.position_w) != sensors
    for _ in range(20):
        info = env.step(np.zeros(env.action_space.shape, np.float32))[-1]
    assert (abs(info["position_error"][2]) < 0.003) == trimmed


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("field", r"cannot be read: Expected"),
        (ROW.format("body.total_masses", "false", "{ all = [16, 17] }"), r"body.total_masses.*valid: body.total_mass"),
        (ROW.format("body.total_mass", "false", "{ air = [16, 17] }"), r"0 ranges of build-stiff, not one"),
        (ROW.format("body.total_mass", "false", "{ all = [16, 17], air = [16, 17] }"), r"2 ranges of air-stiff"),
        (ROW.format("body.total_mass", "false", "{ all = [17, 16] }"), r"not a range \[low, high\]"),
        (ROW.format("body.total_mass", "true", "{ all = [0, 16] }"), r"above 0"),
        (ROW.format("body.total_mass", "false", "{ all = [16, inf] }"), r"not a range"),
        (ROW.format("body.total_mass", "false", "{ all = [-3, 16] }"), r"total_mass = -3"),
        (ROW.format("body.total_mass", "false", "{ others = [16, 17] }"), r"a range of 'others'; valid: air, build"),
        (2 * ROW.format("body.total_mass", "false", "{ all = [16, 17] }"), r"two rows of body.total_mass"),
        (
            ROW.format("body.total_mass", "false", "{ all = [16, 17] }").replace("chosen", "guessed"),
            r"origin 'guessed'",
        ),
    ],
)
def test_an_invalid_world_is_refused_in_one_line(tmp_path, text, expected):
    with pytest.raises(SpidarError, match=expected) as error:
        Randomization.parse(written(tmp_path, text))
    assert "\n" not in str(error.value)


def test_names_of_worlds_and_kinds_are_checked(world):
    with pytest.raises(UnknownNameError, match="no_world"):
        Randomization.parse("no_world")
    with pytest.raises(UnknownNameError, match="air-stiff"):
        Randomization.parse(f"{world}:air-hard")


def test_a_world_is_of_the_nominal_robot_only(world):
    longer = RobotSpec(pitch_to_foot=1.05 * ROBOT.pitch_to_foot)
    with pytest.raises(SpidarError, match="robot of another spec"):
        HoverEnv(plant=PlantConfig.of(longer), randomization=world)


def test_a_saved_flight_of_a_world_goes_on_with_its_robot(world):
    env, other = (HoverEnv(randomization=world, horizon_s=5.0) for _ in range(2))
    env.reset(seed=4)
    action = np.zeros(env.action_space.shape, np.float32)
    for _ in range(5):
        env.step(action)
    other.restore_state(env.save_state())
    assert np.array_equal(env.step(action)[0], other.step(action)[0])
    assert other.sampled_parameters["kind"] == env.sampled_parameters["kind"]
    plain = HoverEnv(horizon_s=5.0)
    with pytest.raises(SpidarError, match="options"):
        plain.restore_state(env.save_state())


def test_a_world_with_ranges_beyond_its_own_samples_them_in_every_kind(world):
    given = {"world": str(world), "actuators": {"joint_kd": (0.35, 0.55)}, "recirculation.flow_z": 1.5,
             "actuators.delay": (0.08, 0.09)}  # fmt: skip
    how, plain = Randomization.parse(given), Randomization.parse(world)
    rows = {row.field: row for row in how.rows}
    assert [row.field for row in how.rows] == [*(row.field for row in plain.rows), "actuators.delay"]
    assert rows["actuators.joint_kd"].kinds == ((0.35, 0.55),) * 4
    assert rows["actuators.joint_kd"].is_log
    assert rows["recirculation.flow_z"].kinds == ((1.5 * 0.03, 1.5 * 0.04),) * 2 + ((0.0, 0.0),) * 2
    assert rows["body.peg_friction"] == plain.rows[-1]
    env = gymnasium.make("spidar_gym/Hover-v0", randomization=given)
    for seed in range(6):
        sampled = env.reset(seed=seed)[1]["randomization"]
        before = gymnasium.make("spidar_gym/Hover-v0", randomization=world).reset(seed=seed)[1]["randomization"]
        assert 0.35 <= sampled["actuators.joint_kd"] <= 0.55
        assert 0.08 <= sampled["actuators.delay"] <= 0.09
        assert sampled["recirculation.flow_z"] == pytest.approx(1.5 * before["recirculation.flow_z"])
        for field in ("kind", "actuators.module_gain", "body.peg_friction"):
            np.testing.assert_array_equal(sampled[field], before[field])
    kind = Randomization.parse({**given, "world": f"{world}:air-soft"})
    assert (kind.kind, kind.rows) == (1, how.rows)


def test_ranges_beyond_a_world_can_stand_in_a_file(tmp_path, world):
    path = tmp_path / "beyond.toml"
    path.write_text(f'world = "{world}"\n"recirculation.flow_z" = 2\n[actuators]\njoint_kd = [0.35, 0.55]\n')
    given = {"world": str(world), "recirculation.flow_z": 2.0, "actuators.joint_kd": (0.35, 0.55)}
    assert Randomization.parse(path) == Randomization.parse(given)


@pytest.mark.parametrize(
    ("own", "expected"),
    [
        ({"actuators.delay": 2.0}, "unknown randomization: row of the world 'actuators.delay'.*valid: actuators.joint"),
        ({"actuators.joint_kd": 0.0}, r"joint_kd = 0.0 .*a factor above 0"),
        ({"actuators.joint_kd": (0.0, 1.0)}, r"a range above 0"),
        ({"actuators.joint_kd": (2.0, 1.0)}, r"a range \(low, high\)"),
        ({"actuators.module_gain": -1.0}, "a factor above 0"),
        ({"body.total_mass": (-3.0, 5.0)}, "values of a robot"),
        ({"body.masses": (1.0, 2.0)}, "body.masses"),
        ({"strength": 0.5}, "strength"),
        ({"world": 1.0}, "name or file of a calibrated world"),
        ({"world": "no_world"}, "no_world"),
    ],
)
def test_invalid_ranges_beyond_a_world_are_refused_in_one_line(world, own, expected):
    with pytest.raises(SpidarError, match=expected) as error:
        Randomization.parse({"world": str(world), **own})
    assert "\n" not in str(error.value)
