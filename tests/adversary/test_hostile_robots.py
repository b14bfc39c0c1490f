"""Robots with arbitrary numbers, from mappings and TOML files: simulated with finite numbers, or refused."""

from dataclasses import fields

import gymnasium
import numpy as np
import pytest
from support.tries import tried

from spidar_gym.envs.registry import CRAWL, HOVER
from spidar_gym.errors import SpidarError
from spidar_gym.robot import ROBOT, RobotSpec
from spidar_gym.robot.payload import CARRIERS
from spidar_gym.robot.spec import PARTS
from spidar_gym.sim.randomize import OPTIONAL_ROWS, TABLE

pytestmark = pytest.mark.usefixtures("unchecked")

SPECIAL = (0.0, -0.0, 5e-324, -1.0, 1e300, float("nan"), float("inf"), float("-inf"))
WORDS = ("", "strong", True, None, [], [[]], {}, {"x": 1.0}, 10**400, 1j, "0.1", b"1")
FIELDS = [f.name for f in fields(RobotSpec) if f.name not in ("part_masses", "payloads")]


def near(rng, value):
    """A number near another one; sometimes an arbitrary value."""
    kind = rng.random()
    if kind < 0.1:
        return SPECIAL[rng.integers(len(SPECIAL))]
    if kind < 0.15:
        return WORDS[rng.integers(len(WORDS))]
    spread = 0.3 if kind < 0.6 else 4.0
    return float((value or 1e-3) * 10.0 ** rng.normal(0.0, spread) * rng.choice([1.0, 1.0, 1.0, -1.0]))


def several(rng, values):
    """Several numbers, sometimes too many or too few."""
    found = [near(rng, value) for value in values]
    return found if rng.random() < 0.95 else found * 2 if rng.random() < 0.5 else found[:-1]


def payload(rng):
    """A payload, with some fields missing."""
    mass, size = 10.0 ** rng.uniform(-4.0, 1.0), rng.uniform(0.02, 0.2, 3)
    found = {
        "body": CARRIERS[rng.integers(len(CARRIERS))] if rng.random() < 0.9 else "tail",
        "mass": near(rng, mass),
        "position": several(rng, rng.normal(0.0, 0.1, 3).tolist()),
        "size": several(rng, size.tolist()),
        "inertia": several(rng, [*(mass * size**2 / 6).tolist(), 0.0, 0.0, 0.0]),
    }
    return {name: found[name] for name in found if rng.random() < 0.9}


def robot(rng):
    """Fields of a robot by name."""
    found = {}
    for name in rng.choice(FIELDS, rng.integers(0, 4), replace=False).tolist():
        value = getattr(ROBOT, name)
        found[name] = several(rng, value) if isinstance(value, tuple) else near(rng, value)
    if rng.random() < 0.4:
        chosen = rng.choice(list(PARTS), rng.integers(1, 3), replace=False).tolist()
        found["part_masses"] = {name: near(rng, PARTS[name].mass) for name in chosen}
    if rng.random() < 0.4:
        found["payloads"] = [payload(rng) for _ in range(rng.integers(1, 3))]
    return found


def toml(value):
    """A value as TOML; types that TOML lacks become text."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, dict):
        return "{" + ", ".join(f"{name} = {toml(own)}" for name, own in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(toml, value)) + "]"
    return repr(value) if isinstance(value, int | float) else f'"{value}"'


def ranges(rng):
    """Ranges of some fields of the randomisation, sometimes with a strength."""
    found, rows = {}, (*TABLE, *OPTIONAL_ROWS)
    for k in rng.choice(len(rows), rng.integers(1, 4), replace=False).tolist():
        ends = [near(rng, 1.0), near(rng, 1.0)]
        is_sorted = rng.random() < 0.8 and all(isinstance(end, float) for end in ends)
        found[rows[k].field] = sorted(ends) if is_sorted else several(rng, [1.0, 1.0])
    return found | ({"strength": near(rng, 0.1)} if rng.random() < 0.3 else {})


def flown(env_id, seed, **given):
    """Step a robot ten times, or until termination, and assert finite numbers."""
    env = gymnasium.make(env_id, **given)
    try:
        seen, _ = env.reset(seed=seed)
        env.action_space.seed(seed)
        for _ in range(10):
            assert env.observation_space.contains(seen), given
            seen, reward, terminated, _, _ = env.step(env.action_space.sample())
            assert np.isfinite(seen).all(), given
            assert np.isfinite(reward), given
            if terminated:
                break
    finally:
        env.close()


@pytest.mark.parametrize("form", ["mapping", "file"])
@pytest.mark.parametrize("env_id", [HOVER, CRAWL])
def test_a_robot_of_any_numbers_is_simulated_finitely_or_refused_in_one_line(env_id, form, rng, tries, tmp_path):
    accepted = []
    for k in range(tries(400)):
        given = robot(rng)
        if form == "file":
            path = tmp_path / f"{k}.toml"
            path.write_text("".join(f"{name} = {toml(value)}\n" for name, value in given.items()), encoding="utf-8")
            given = str(path)
        accepted.append(tried(lambda given=given, k=k: flown(env_id, k, robot=given))[0])
    assert 0.1 < np.mean(accepted) < 0.9


@pytest.mark.parametrize("env_id", [HOVER, CRAWL])
def test_ranges_of_any_numbers_draw_robots_that_are_simulated_finitely_or_are_refused(env_id, rng, tries):
    accepted = []
    for k in range(tries(800)):
        given = ranges(rng)
        accepted.append(tried(lambda given=given, k=k: flown(env_id, k, randomization=given))[0])
    assert 0.05 < np.mean(accepted) < 0.9


def test_a_file_of_brackets_is_refused_at_any_depth(tmp_path):
    path = tmp_path / "deep.toml"
    for depth in (1_000, 20_000, 32_000):
        path.write_text(f"max_thrust = {'[' * depth}{']' * depth}", encoding="utf-8")
        with pytest.raises(SpidarError, match=r"^robot: [^\n]*deep.toml cannot be read: [^\n]*; valid: [^\n]*$"):
            RobotSpec.parse(path)
