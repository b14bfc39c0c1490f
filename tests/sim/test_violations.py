"""Pins the costs of violated constraints: the same keys in every environment, and 1 for each violation."""

import gymnasium
import numpy as np
import pytest

from spidar_gym.envs.registry import COURSE, CRAWL, ENVIRONMENTS, HOVER
from spidar_gym.sim.violations import AT_LIMIT, BLOWN_FACTOR, COSTS, VIOLATIONS, costs
from spidar_gym.tasks.course import CourseTask

KEYS = ("cost", *(f"cost_{name}" for name in COSTS))
DIRECT = {"action_mode": "direct"}


def played(name, ticks, control="core", amplitude=1.0, seed=0, **options):
    """`info` of every step of an episode with random actions."""
    env = gymnasium.make(name, control=control, **options)
    infos, rng = [env.reset(seed=seed)[1]], np.random.default_rng(seed)
    for _ in range(ticks):
        *_, terminated, truncated, info = env.step(rng.uniform(-amplitude, amplitude, env.action_space.shape))
        infos.append(info)
        if terminated or truncated:
            break
    return infos


@pytest.mark.parametrize("control", ["core", "python"])
@pytest.mark.parametrize("name", ENVIRONMENTS)
def test_costs_are_0_at_the_reset_and_the_sum_of_their_parts_after_it(name, control):
    infos = played(name, 6, control, **DIRECT)
    assert [infos[0][key] for key in KEYS] == [0.0] * 5
    for info in infos:
        assert [key for key in info if key.startswith("cost") and key != "cost_of_transport"] == list(KEYS)
        assert {type(info[key]) for key in KEYS} == {float}
        assert {info[key] for key in KEYS[1:]} <= {0.0, 1.0}
        assert info["cost"] == sum(info[key] for key in KEYS[1:])


@pytest.mark.parametrize(
    ("name", "options"), [(HOVER, {}), (CRAWL, {"steps": 0.03, "distance": 0.3}), (COURSE, {"hold": 3})]
)
def test_python_controllers_and_the_vector_have_the_costs_of_the_engine(name, options):
    given = {**DIRECT, **options, "max_episode_steps": 60}
    one, other = (played(name, 60, control, **given) for control in ("core", "python"))
    assert len(one) == len(other)
    vector = gymnasium.make_vec(name, 2, autoreset_mode="Disabled", **given)
    _, batch = vector.reset(seed=[0, 1])
    rng, total = np.random.default_rng(0), 0.0
    for a, b in zip(one, other, strict=True):
        for key in KEYS:
            assert a[key] == b[key] == batch[key][0]
        total += a["cost"]
        action = rng.uniform(-1.0, 1.0, vector.single_action_space.shape)
        *_, batch = vector.step(np.stack([action, action]))
    assert total > 0.0


def test_a_flight_that_ends_on_the_floor_has_touched_it():
    ended = 0
    for seed in range(6):
        infos = played(HOVER, 200, seed=seed, **DIRECT)
        touched = [info["cost_contact"] for info in infos]
        assert touched == [0.0] * (len(infos) - 1) + [float(infos[-1]["failure"] == "contact")]
        ended += infos[-1]["failure"] == "contact"
    assert ended > 0


def test_in_a_crawl_feet_and_pegs_may_touch_and_a_duct_costs_twice():
    calm = played(CRAWL, 80, amplitude=0.0)
    assert {info["cost"] for info in calm} == {0.0}
    assert any(info["foot_contact"].all() for info in calm)
    over = next(infos for infos in (played(CRAWL, 400, seed=s, **DIRECT) for s in range(20)) if infos[-1]["failure"])
    for info in over:
        assert info["cost_duct"] == info["cost_contact"] == float(info["failure"] == "duct")
    assert over[-1]["cost_duct"] == 1.0


@pytest.mark.parametrize("name", [HOVER, CRAWL])
def test_a_servo_at_its_limit_and_a_rotor_in_a_jet_cost(name):
    limited = blown = 0
    for info in played(name, 60, seed=3, **DIRECT)[1:]:
        most, least = np.abs(info["joint_torque"]).max(), info["thrust_factor"].min()
        limited += info["cost_torque"] == 1.0
        blown += info["cost_blown"] == 1.0
        assert info["cost_torque"] == float(most >= 7.0 - AT_LIMIT)
        assert info["cost_blown"] == float(least < BLOWN_FACTOR)
    assert limited > 0


def test_avoiding_interference_reduces_the_cost_of_rotors_in_jets():
    found = []
    for avoids in (True, False):
        vector = gymnasium.make_vec(HOVER, 16, forms="mixed", avoid_interference=avoids, wake=True)
        vector.reset(seed=0)
        found.append(np.mean([vector.step(np.zeros((16, 6)))[-1]["cost_blown"] for _ in range(200)]))
    assert 20.0 * found[0] < found[1]
    assert found[1] > 0.01


def test_the_cost_of_a_step_of_several_periods_is_the_worst_of_them():
    held = played(COURSE, 3, hold=20, **DIRECT)
    env = gymnasium.make(COURSE, hold=1, **DIRECT)
    env.reset(seed=0)
    rng, worst = np.random.default_rng(0), []
    for _ in held[1:]:
        action = rng.uniform(-1.0, 1.0, env.action_space.shape)
        periods = [env.step(action)[4] for _ in range(20)]
        worst.append([max(info[key] for info in periods) for key in KEYS[1:]])
        if periods[-1]["failure"] in CourseTask.failures:
            break
    assert [[info[key] for key in KEYS[1:]] for info in held[1 : 1 + len(worst)]] == worst
    assert np.max(worst) == 1.0


def test_bits_are_converted_to_costs():
    bits = {name: 1 << k for k, name in enumerate(VIOLATIONS)}
    assert costs(bits["foot"], ("duct", "part"))["cost"] == 0.0
    assert costs(bits["foot"], ("foot", "duct", "part"))["cost_contact"] == 1.0
    assert costs(sum(bits.values()), ("duct", "part")) == {"cost": 4.0, **{f"cost_{name}": 1.0 for name in COSTS}}
