"""Custom tasks that return arbitrary values: a step has finite results, or is refused in one line."""

import gymnasium
import jaxtyping
import numpy as np
import pytest

from spidar_gym.control.flight.observation import Field
from spidar_gym.envs.registry import CRAWL, HOVER
from spidar_gym.errors import InvalidValueError
from spidar_gym.tasks.crawl import CrawlTask
from spidar_gym.tasks.hover import HoverTask

ROBOTS = 2


def wild(rng, robots):
    """A value instead of an array with one entry for each robot; invalid as reals, as booleans, or as both."""
    bad = rng.choice([np.nan, np.inf, -np.inf])
    return [
        np.full(robots, bad), np.zeros(robots, int), np.ones(robots, bool), np.full(robots, 1j), np.zeros(robots + 1),
        np.zeros((robots, 2)), np.array(["x"] * robots), np.array([None] * robots), None, 0.0, "x", [[0.0], [0.0, 1.0]],
        np.full(robots, -5.0), np.full(robots, 1e308), np.full(robots, 10**400, object), [0.5] * robots,
    ][rng.integers(16)]  # fmt: skip


def hostile(base, method, value):
    """A task of which one method returns a given value."""

    class Hostile(base):
        fields = (Field("own", 1, 1.0, "m", ""),)
        memory = (("drawn", "f8"),)

        def observe(self, robots):
            return {"own": np.zeros(len(robots))}

    def answer(self, robots):
        if method == "draw":
            return {"drawn": value(None)}
        known = getattr(super(Hostile, self), method)(robots) if method != "observe" else {"own": 0}
        if not isinstance(known, dict):
            return value(robots)
        return {**known, next(iter(known)): value(robots)}

    setattr(Hostile, method, answer)
    return Hostile()


@pytest.mark.parametrize("method", ["terms", "failed", "succeeded", "observe", "draw", "reference", "preview"])
@pytest.mark.parametrize(("name", "base"), [(HOVER, HoverTask), (CRAWL, CrawlTask)], ids=["hover", "crawl"])
def test_an_answer_of_any_kind_is_finite_or_refused_with_task_and_method(monkeypatch, rng, tries, name, base, method):
    monkeypatch.setattr(jaxtyping.config, "jaxtyping_disable", True)
    if base is CrawlTask and method in ("reference", "preview"):
        method = "terms"
    for _ in range(tries(100)):
        mode = str(rng.choice(["NextStep", "SameStep", "Disabled"]))
        given = wild(rng, ROBOTS if method != "draw" else 1)
        task = hostile(base, method, lambda robots, given=given: given)
        vector = gymnasium.make_vec(name, num_envs=ROBOTS, task=task, autoreset_mode=mode)
        try:
            seen, _ = vector.reset(seed=0)
            for _ in range(2):
                seen, rewards, *_ = vector.step(np.zeros(vector.action_space.shape))
                assert np.isfinite(seen).all()
                assert np.isfinite(rewards).all()
            if method in ("failed", "succeeded"):
                assert np.asarray(given).dtype == bool
        except InvalidValueError as error:
            words = str(error)
        else:
            words = f"Hostile.{method}"
        vector.close()
        assert f"Hostile.{method}" in words or "Hostile: sum of terms" in words
        assert "\n" not in words


@pytest.mark.parametrize("quaternion", [(0.0, 0.0, 0.0, 0.0), (2.0, 0.0, 0.0, 0.0), (1e-200, 0.0, 0.0, 0.0)])
def test_a_quaternion_that_is_no_rotation_names_its_robot(quaternion):
    class Turning(HoverTask):
        def reference(self, flights):
            wanted = super().reference(flights)
            wanted["quat_wb"][1] = quaternion
            return wanted

    vector = gymnasium.make_vec(HOVER, num_envs=2, task=Turning())
    with pytest.raises(InvalidValueError, match=r"^Turning.reference: quat_wb = [^\n]* a unit quaternion for robot 1$"):
        vector.reset(seed=0)
    vector.close()


@pytest.mark.parametrize("given", [5, "x", {"position": 1.0}, np.zeros(3)])
def test_a_start_that_is_none_is_refused(given):
    class Starting(HoverTask):
        def start(self, rng):
            return given

    for make in (lambda t: gymnasium.make(HOVER, task=t), lambda t: gymnasium.make_vec(HOVER, num_envs=2, task=t)):
        env = make(Starting())
        with pytest.raises(InvalidValueError, match=r"^Starting.start = [^\n]* a FlightStart, or None"):
            env.reset(seed=0)
        env.close()


def test_whole_numbers_are_no_failures_and_a_lone_nan_names_its_robot():
    numbers = hostile(HoverTask, "failed", lambda flights: np.zeros(len(flights), int))
    for make in (lambda t: gymnasium.make(HOVER, task=t), lambda t: gymnasium.make_vec(HOVER, num_envs=3, task=t)):
        env = make(numbers)
        env.reset(seed=0)
        with pytest.raises(InvalidValueError, match=r"Hostile.failed: contact = .*booleans"):
            env.step(np.zeros(env.action_space.shape or ()))
        env.close()
    lone = hostile(HoverTask, "terms", lambda flights: np.where(np.arange(len(flights)) == 2, np.nan, 0.5))
    vector = gymnasium.make_vec(HOVER, num_envs=3, task=lone)
    with pytest.raises(InvalidValueError, match=r"Hostile.terms: position .* robot 2"):
        vector.reset(seed=0)
    vector.close()


def test_an_exception_of_a_tasks_own_goes_through():
    def own(flights):
        raise KeyError("mine")

    with pytest.raises(KeyError, match="mine"):
        gymnasium.make(HOVER, task=hostile(HoverTask, "terms", own)).reset(seed=0)
