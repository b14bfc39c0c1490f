"""Tests the share of a residual's authority: a scaled action, in the engine, with Python's controllers and exported."""

import gymnasium
import numpy as np
import pytest

from spidar_gym.envs.registry import COURSE, CRAWL, HOVER

SHARE = 0.25


@pytest.mark.parametrize("control", ["core", "python"])
@pytest.mark.parametrize(
    ("name", "mode"),
    [(HOVER, "residual_wrench"), (HOVER, "residual"), (HOVER, "residual_force"), (CRAWL, "residual_gait"),
     (CRAWL, "residual_gait_force"), (COURSE, "residual")],
)  # fmt: skip
def test_an_action_has_the_effect_of_the_smaller_one(name, mode, control):
    whole, part = (
        gymnasium.make(name, action_mode=mode, action_scale=scale, control=control)
        for scale in (None, {"share": SHARE})
    )
    for env in (whole, part):
        env.reset(seed=2)
    rng, n = np.random.default_rng(0), whole.action_space.shape[0]
    for _ in range(12):
        action = rng.uniform(-1.0, 1.0, n)
        # A power of two, so that the products are the same.
        one, other = whole.step(SHARE * action)[0], part.step(action)[0]
        own = one[:-n]
        np.testing.assert_array_equal(other[:-n], own)
        np.testing.assert_array_equal(other[-n:], action.astype(np.float32))
    np.testing.assert_array_equal(whole.unwrapped.plant.data.qpos, part.unwrapped.plant.data.qpos)


def test_the_page_of_the_mode_has_the_share():
    env = gymnasium.make(HOVER, action_mode="residual_wrench", action_scale={"share": 0.2}).unwrapped
    assert env.action_mode.channels[0].authority.startswith("0.2 × (± 23.5 N")
