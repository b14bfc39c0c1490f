"""Pins the domain randomisation: reproducible samples over their ranges, the blend by strength, the robot."""

import math
from dataclasses import fields, is_dataclass

import gymnasium
import numpy as np
import pytest

import spidar_gym  # noqa: F401 - registers the environments
from spidar_gym.errors import InvalidValueError, SpidarError
from spidar_gym.native.plant import Plant
from spidar_gym.robot import ROBOT
from spidar_gym.sim.actuators import ActuatorConfig
from spidar_gym.sim.air import AeroConfig
from spidar_gym.sim.body import BodyConfig
from spidar_gym.sim.config import PlantConfig
from spidar_gym.sim.randomize import Randomization, check_strength, randomize
from spidar_gym.sim.rows import OPTIONAL_ROWS, TABLE, Row

NOMINAL = PlantConfig()
N_DRAWS = 2000
OPERATIONS = ("set", "scale", "add")
ODD = PlantConfig(
    substeps=8,
    joint_speed=0.5,
    idle_thrust=1.2,
    sense=True,
    body=BodyConfig(total_mass=15.9, link_mass=np.linspace(0.9, 1.1, 8), torso_com=np.array([0.01, 0.0, 0.0])),
    actuators=ActuatorConfig(battery=True, thrust_gain=1.05, module_gain=np.linspace(0.8, 1.0, 8), joint_kp=150.0),
    aero=AeroConfig(wake=False, core_length=5.0),
)
"""A nominal robot that is not the default one."""


def drawn(seed: int, strength: float = 1.0, nominal: PlantConfig = NOMINAL):
    return randomize(nominal, np.random.default_rng(seed), strength)


def value(config: PlantConfig, row: Row):
    """Value of a row's field in a configuration."""
    part, name = row.field.split(".")
    return getattr(getattr(config, part), name)


def applied(row: Row, base, draw):
    """The nominal value with a draw applied to it."""
    return {"set": draw, "scale": base * draw, "add": base + draw}[row.operation]


def neutral(row: Row, nominal: PlantConfig = NOMINAL) -> float:
    """The draw for which the value stays nominal."""
    return float(value(nominal, row)) if row.operation == "set" else {"scale": 1.0, "add": 0.0}[row.operation]


def same(a, b) -> bool:
    """Whether two configurations are the same, bit for bit."""
    if is_dataclass(a):
        return type(a) is type(b) and all(same(getattr(a, f.name), getattr(b, f.name)) for f in fields(a))
    if isinstance(a, np.ndarray):
        return np.array_equal(a, b)
    return a == b


@pytest.fixture(scope="module")
def many() -> dict[str, np.ndarray]:
    """All draws of many robots at strength 1, from one generator."""
    rng, draws = np.random.default_rng(11), {row.field: [] for row in TABLE}
    for _ in range(N_DRAWS):
        for name, draw in randomize(NOMINAL, rng, 1.0)[1].items():
            draws[name].append(draw)
    return {name: np.array(values) for name, values in draws.items()}


by_row = pytest.mark.parametrize("row", TABLE, ids=lambda row: row.field)
by_any_row = pytest.mark.parametrize("row", [*TABLE, *OPTIONAL_ROWS], ids=lambda row: row.field)


@by_any_row
def test_a_row_has_an_operation_a_range_a_unit_and_a_source(row):
    nominal = np.asarray(value(NOMINAL, row), float)
    assert row.operation in OPERATIONS
    assert math.isfinite(row.low)
    assert row.low < row.high
    assert row.unit
    assert row.source
    assert nominal.shape == row.shape or (row.shape == () and nominal.shape == ())
    assert f"{row.low:.4g}" in row.distribution
    assert f"{row.high:.4g}" in row.distribution
    if row.shape:
        assert row.distribution.endswith(f"{math.prod(row.shape)}")


def test_no_field_has_two_rows():
    assert len({row.field for row in (*TABLE, *OPTIONAL_ROWS)}) == len(TABLE) + len(OPTIONAL_ROWS)


def test_the_nominal_robot_is_within_every_range_except_for_the_delay():
    outside = {row.field for row in TABLE if not row.low <= neutral(row) <= row.high}
    assert outside == {"actuators.delay"}


@by_any_row
def test_the_ends_of_a_range_are_valid(row):
    part, name = row.field.split(".")
    for end in (row.low, row.high):
        changed = applied(row, value(NOMINAL, row), end)
        changed = np.full(row.shape, changed) if row.shape else float(changed)
        type(getattr(NOMINAL, part))(**{name: changed})


def test_the_same_seed_draws_the_same_robot():
    one, other = drawn(3), drawn(3)
    assert same(one[0], other[0])
    assert all(np.array_equal(one[1][row.field], other[1][row.field]) for row in TABLE)


def test_another_seed_draws_another_value_of_everything():
    one, other = drawn(3)[1], drawn(4)[1]
    for row in TABLE:
        assert np.all(one[row.field] != other[row.field]), row.field


def test_no_two_fields_and_no_two_numbers_of_a_field_share_a_draw():
    draws = drawn(5)[1]
    places = np.concatenate([((draws[row.field] - row.low) / (row.high - row.low)).reshape(-1) for row in TABLE])
    assert len(set(np.round(places, 9))) == len(places)


@pytest.mark.parametrize("nominal", [NOMINAL, ODD], ids=["default", "odd"])
def test_strength_0_is_the_nominal_robot_bit_for_bit(nominal):
    config, draws = drawn(1, 0.0, nominal)
    assert same(config, nominal)
    for row in TABLE:
        assert np.all(draws[row.field] == neutral(row, nominal)), row.field


def test_the_draws_have_every_row_in_its_shape_and_nothing_else():
    for strength in (0.0, 0.5, 1.0):
        draws = drawn(2, strength)[1]
        assert list(draws) == [row.field for row in TABLE]
        for row in TABLE:
            assert isinstance(draws[row.field], np.ndarray)
            assert draws[row.field].shape == row.shape


@by_row
def test_the_draws_fill_their_range_evenly(many, row):
    places = (many[row.field].reshape(N_DRAWS, -1) - row.low) / (row.high - row.low)
    assert places.min() >= 0.0
    assert places.max() <= 1.0
    # With 2000 uniform draws, the chance of none in the last 5 % is 10⁻⁴⁵; 3 % are five standard errors of the mean.
    assert np.all(places.min(axis=0) < 0.05)
    assert np.all(places.max(axis=0) > 0.95)
    assert np.all(np.abs(places.mean(axis=0) - 0.5) < 0.03)
    assert np.all(np.abs(places.std(axis=0) - math.sqrt(1.0 / 12.0)) < 0.02)


@pytest.mark.parametrize("strength", [0.25, 0.7])
def test_at_a_lower_strength_the_range_shrinks_towards_the_neutral_draw(strength):
    rng = np.random.default_rng(8)
    robots = [randomize(NOMINAL, rng, strength)[1] for _ in range(300)]
    for row in TABLE:
        values, centre = np.array([draws[row.field] for draws in robots]), neutral(row)
        low, high = (centre + strength * (end - centre) for end in (row.low, row.high))
        slack = 1e-12 * max(1.0, abs(low), abs(high))
        assert low - slack <= values.min(), row.field
        assert values.max() <= high + slack, row.field
        assert values.max() - values.min() > 0.9 * (high - low), row.field


@pytest.mark.parametrize("nominal", [NOMINAL, ODD], ids=["default", "odd"])
def test_strengths_share_the_draw_and_blend_it_linearly(nominal):
    full = drawn(6, 1.0, nominal)[1]
    for strength in (0.1, 0.5, 0.9):
        part = drawn(6, strength, nominal)[1]
        for row in TABLE:
            centre = neutral(row, nominal)
            blend = (1.0 - strength) * centre + strength * full[row.field]
            np.testing.assert_allclose(part[row.field], blend, rtol=1e-12, atol=1e-15, err_msg=row.field)


@pytest.mark.parametrize("strength", [0.0, 0.3, 1.0])
def test_every_strength_takes_as_many_numbers_from_the_generator(strength):
    rng, other = np.random.default_rng(7), np.random.default_rng(7)
    randomize(NOMINAL, rng, strength)
    randomize(NOMINAL, other, 1.0)
    assert rng.random() == other.random()


@by_row
def test_the_robot_is_the_nominal_one_with_the_draws_in_it(row):
    for nominal in (NOMINAL, ODD):
        config, draws = drawn(9, 0.8, nominal)
        before, after = value(nominal, row), value(config, row)
        np.testing.assert_allclose(after, applied(row, before, draws[row.field]), rtol=1e-14)
        assert np.shape(after) == np.shape(before)
        assert isinstance(after, np.ndarray if row.shape else float)


def test_what_has_no_row_stays_and_the_nominal_robot_is_not_written():
    before, varied = drawn(1, 0.0, ODD)[0], {row.field for row in TABLE}
    config, _ = drawn(10, 1.0, ODD)
    assert same(ODD, before)
    for f in fields(PlantConfig):
        part = getattr(ODD, f.name)
        if not is_dataclass(part):
            assert getattr(config, f.name) == part
            continue
        for g in fields(part):
            unchanged = same(getattr(getattr(config, f.name), g.name), getattr(part, g.name))
            assert unchanged == (f"{f.name}.{g.name}" not in varied), f"{f.name}.{g.name}"


def test_every_randomised_robot_can_be_built_and_has_the_sampled_mass():
    plant = Plant()
    for seed in range(10):
        config, draws = drawn(seed)
        plant.configure(config)
        np.testing.assert_allclose(plant.model.body_mass.sum(), draws["body.total_mass"], rtol=1e-12)
        state = plant.reset(np.array([0.0, 0.0, 5.0]), rng=np.random.default_rng(seed))
        assert np.array_equal(state.joint_position, draws["actuators.joint_offset"])


@pytest.mark.parametrize("strength", [-0.1, 1.1, math.nan, math.inf])
def test_a_strength_outside_0_to_1_is_refused(strength):
    for refuse in (
        lambda: drawn(0, strength),
        lambda: check_strength(strength),
        lambda: gymnasium.make("spidar_gym/Hover-v0", randomization=strength),
    ):
        with pytest.raises(InvalidValueError, match=r"randomization = .*0 … 1"):
            refuse()


def test_a_strength_that_is_a_string_is_refused():
    # The tests' type checks would raise first, so the unwrapped function is called.
    unchecked = getattr(check_strength, "__wrapped__", check_strength)
    with pytest.raises(InvalidValueError, match=r"randomization = '1' .*0 … 1"):
        unchecked("1")


# The environment ----------------------------------------------------------------------------------------------------


def made(**options):
    return gymnasium.make("spidar_gym/Hover-v0", **options)


def draws_of(env, seed=None) -> dict[str, np.ndarray]:
    return env.reset(seed=seed)[1]["randomization"]


def test_an_environment_samples_the_same_robot_for_the_same_seed_and_others_for_other_seeds():
    env, other = made(randomization=1.0), made(randomization=1.0)
    first, again, elsewhere, different = draws_of(env, 7), draws_of(env, 7), draws_of(other, 7), draws_of(env, 8)
    following = draws_of(env)
    assert set(first) == {row.field for row in TABLE}
    for name in first:
        assert np.array_equal(first[name], again[name])
        assert np.array_equal(first[name], elsewhere[name])
        assert np.all(first[name] != different[name])
        assert np.all(different[name] != following[name]), "every episode has its own robot"


def test_the_robot_of_an_episode_is_the_one_in_info_until_the_next_reset():
    env = made(randomization=0.6)
    draws = draws_of(env, 3)
    plant = env.unwrapped.plant
    for _ in range(3):
        info = env.step(np.zeros(env.action_space.shape, np.float32))[-1]
        assert all(np.array_equal(info["randomization"][name], draws[name]) for name in draws)
    np.testing.assert_allclose(plant.model.body_mass.sum(), draws["body.total_mass"], rtol=1e-12)
    assert plant.config.actuators.thrust_lag == draws["actuators.thrust_lag"]
    draws["body.total_mass"][...] = 0.0
    info = env.step(np.zeros(env.action_space.shape, np.float32))[-1]
    assert info["randomization"]["body.total_mass"] > 15.0


def test_without_randomisation_there_are_no_draws_and_the_robot_is_nominal():
    env = made()
    assert draws_of(env, 1) == {}
    np.testing.assert_allclose(env.unwrapped.plant.model.body_mass.sum(), ROBOT.total_mass, rtol=1e-12)


def test_environments_of_different_strength_fly_the_same_schedule_from_the_same_offset():
    flights = []
    for strength in (0.0, 0.3, 1.0):
        env = made(randomization=strength, forms="mixed")
        env.reset(seed=5)
        flights.append(env.unwrapped)
    for other in flights[1:]:
        goals, others = flights[0].progress.goals, other.progress.goals
        assert len(goals) == len(others) > 1
        for one, two in zip(goals, others, strict=True):
            assert (one.start, one.deadline) == (two.start, two.deadline)
            assert np.array_equal(one.joint_target, two.joint_target)
        np.testing.assert_array_equal(flights[0].state.position_w, other.state.position_w)
        np.testing.assert_array_equal(flights[0].state.quat_wb, other.state.quat_wb)


def test_environments_of_different_strength_share_the_draw():
    half, full = draws_of(made(randomization=0.5), 5), draws_of(made(randomization=1.0), 5)
    for row in TABLE:
        blend = 0.5 * (neutral(row) + full[row.field])
        np.testing.assert_allclose(half[row.field], blend, rtol=1e-12, atol=1e-15)


def test_the_controller_uses_the_nominal_mass_for_any_sampled_mass():
    env = made(randomization=1.0, forms="form1")
    drawn_mass = draws_of(env, 2)["body.total_mass"]
    assert abs(drawn_mass - ROBOT.total_mass) > 0.1
    pose = np.zeros(16), np.eye(3), np.zeros((8, 2))
    for one in (env, made()):
        assert abs(one.unwrapped.controller.model.snapshot(*pose).mass - ROBOT.total_mass) < 1e-9
    maps = [one.unwrapped.controller.model.snapshot(*pose).momentum_map for one in (env, made())]
    assert np.array_equal(*maps)


@pytest.fixture(scope="module")
def sensed():
    env = made(randomization=1.0, sensors=True)
    yield env
    env.close()


@pytest.mark.parametrize("seed", range(20))
def test_a_second_of_flight_of_a_randomised_robot_with_sensors_is_finite(sensed, seed):
    env = sensed
    observation, info = env.reset(seed=seed)
    for _ in range(40):
        assert np.isfinite(observation).all()
        assert env.observation_space.contains(observation)
        for name, entry in info.items():
            if isinstance(entry, dict):
                assert all(np.isfinite(part).all() for part in entry.values()), name
            elif not isinstance(entry, str):
                assert np.isfinite(entry).all(), name
        observation, reward, terminated, _, info = env.step(np.zeros(env.action_space.shape, np.float32))
        assert 0.0 <= reward <= 1.0
        if terminated:
            assert info["failure"] != "diverged"
            break


def test_a_custom_range_is_covered_and_every_other_field_stays_nominal():
    how, rng = (
        Randomization.parse({"body.total_mass": (16.5, 17.0), "actuators.module_gain": (0.5, 0.6)}),
        np.random.default_rng(0),
    )
    masses, gains = [], []
    for _ in range(400):
        config, draws = randomize(NOMINAL, rng, how)
        masses.append(config.body.total_mass)
        gains.append(config.actuators.module_gain / NOMINAL.actuators.module_gain)
        for row in TABLE:
            if row.field not in ("body.total_mass", "actuators.module_gain"):
                assert same(value(config, row), value(NOMINAL, row)), row.field
                assert np.all(draws[row.field] == neutral(row))
    assert 16.5 <= min(masses) < 16.51 < 16.99 < max(masses) <= 17.0
    assert 0.5 <= np.min(gains) < 0.505 < 0.595 < np.max(gains) <= 0.6


def test_with_a_strength_the_other_fields_are_sampled_from_the_same_random_numbers():
    own = {"body.total_mass": (16.5, 17.0)}
    ways = Randomization.parse(0.5), Randomization.parse({**own, "strength": 0.5})
    alone, both = (randomize(NOMINAL, np.random.default_rng(3), how)[1] for how in ways)
    for row in TABLE:
        if row.field != "body.total_mass":
            np.testing.assert_allclose(both[row.field], alone[row.field], rtol=1e-12, atol=1e-15)
    assert 16.5 <= both["body.total_mass"] <= 17.0
    assert Randomization.parse(0.5) == Randomization(0.5)
    assert [Randomization.parse(how).draws for how in (0.0, 0.1, {}, own)] == [False, True, False, True]


RANGES = {row.field: (row.low, row.high) for row in OPTIONAL_ROWS}


def test_optional_rows_are_sampled_with_a_range_only_in_their_order_after_the_table_which_stays():
    rng = np.random.default_rng
    full, plain = Randomization.parse({"strength": 0.7, **RANGES}), Randomization.parse(0.7)
    config, draws = randomize(NOMINAL, rng(3), full)
    _, usual = randomize(NOMINAL, rng(3), plain)
    assert list(draws) == [row.field for row in (*TABLE, *OPTIONAL_ROWS)]
    assert list(usual) == [row.field for row in TABLE]
    for name, draw in usual.items():
        np.testing.assert_allclose(draws[name], draw, rtol=1e-12, atol=1e-15, err_msg=name)
    for row in OPTIONAL_ROWS:
        assert np.all((draws[row.field] >= row.low) & (draws[row.field] <= row.high))
        np.testing.assert_array_equal(value(config, row), applied(row, value(NOMINAL, row), draws[row.field]))
    few = dict(reversed(list(RANGES.items())[1:3]))
    assert [row.field for row in Randomization.parse(few).rows[len(TABLE) :]] == list(RANGES)[1:3]


def test_the_engine_draws_the_robot_that_python_draws_with_every_optional_row():
    given = {"strength": 0.5, **RANGES}
    env = made(randomization=given, forms="form1", perturbation=0.0)
    info, rng = env.reset(seed=3)[1], np.random.default_rng(3)
    rng.uniform(size=6)  # the initial offset
    config, draws = randomize(PlantConfig(), rng, Randomization.parse(given))
    assert list(info["randomization"]) == list(draws)
    for name, draw in draws.items():
        assert np.array_equal(info["randomization"][name], draw), name
        assert np.array_equal(env.unwrapped.sampled_parameters[name], draw), name
    assert same(env.unwrapped.plant.config.actuators, config.actuators)
    assert env.np_random.random() == rng.random()
    env.close()


def test_a_vector_with_different_ranges_reports_the_values_of_each_robot():
    env = gymnasium.make_vec("spidar_gym/Hover-v0", 3)
    env.reset(seed=0)
    speed, loss = "actuators.servo_speed", "actuators.loss"
    each = [{"strength": 1.0, speed: (0.9, 0.95)}, {loss: (0.1, 0.2), speed: (1.1, 1.2)}, {"body.total_mass": (17, 18)}]
    info = env.reset(options={"randomization": each})[1]["randomization"]
    assert list(info) == [*(row.field for row in TABLE), speed, loss]
    config = env.unwrapped.robots["plant"]["config"]
    for name in ("actuators.joint_kp", "body.total_mass", loss):
        part, own = name.split(".")
        assert np.array_equal(info[name], config[part][own])
    assert np.array_equal(info[speed], config["actuators"]["servo_speed"])
    for factors, (low, high) in zip(info[speed], ((0.9, 0.95), (1.1, 1.2), (1.0, 1.0)), strict=True):
        assert low <= factors.min() <= factors.max() <= high
    assert info[loss].tolist() == [0.0, pytest.approx(0.15, abs=0.05), 0.0]
    env.close()


TOML = """
strength = 0.25
"body.total_mass" = [16.5, 17.0]
[actuators]
delay = [0.0, 0.01]
"""


def test_ranges_are_read_from_a_file_and_an_invalid_file_is_refused_in_one_line(tmp_path):
    path = tmp_path / "ranges.toml"
    path.write_text(TOML, encoding="utf-8")
    own = {"strength": 0.25, "body.total_mass": (16.5, 17.0), "actuators.delay": (0.0, 0.01)}
    assert Randomization.parse(path) == Randomization.parse(str(path)) == Randomization.parse(own)
    env = gymnasium.make("spidar_gym/Hover-v0", randomization=str(path)).unwrapped
    env.reset(seed=0)
    assert 16.5 <= env.sampled_parameters["body.total_mass"] <= 17.0
    for text in ("strength =", "a" * 2**17, "[body]\nmass = [1.0, 2.0]", "strength = 3.0"):
        path.write_text(text, encoding="utf-8")
        with pytest.raises(SpidarError) as refusal:
            Randomization.parse(path)
        assert "\n" not in str(refusal.value)
        assert "valid" in str(refusal.value)
