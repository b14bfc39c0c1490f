"""Pins TorchRL as a client: one robot by id, its own vectors, and the engine's with all of `info` as tensors."""

import pytest
from support.clients import STEPS, assert_judged_at_the_end, needs, run_shown

from spidar_gym.envs.registry import ENVIRONMENTS

pytestmark = [*needs("torchrl", "torch"), pytest.mark.train]


def test_what_the_guide_shows_collects_episodes_with_the_right_ends():
    import torch

    made = run_shown("torchrl")
    data, episodes = made["data"], made["episodes"]
    assert data.shape == (240,)
    assert data["next", "observation"].shape == (240, 207)
    assert bool(data["next", "reward"].isfinite().all())
    assert data["next", "done"].sum() >= 4
    assert episodes.shape == (3, 2 * STEPS)
    assert episodes["next", "truncated"].sum(1).flatten().tolist() == [2] * 3
    assert data["next", "is_success"].shape == (240, 1)
    for name in ("is_success", "failure_code", "position_error", "thrust"):
        assert episodes["next", name].isfinite().all()

    def still(tensordict):
        return tensordict.set("action", torch.zeros(*tensordict.shape, 6))

    for env in (made["make"](), made["several"], made["many"]):
        flown = env.rollout(STEPS, still, auto_cast_to_device=True)
        for successes in flown["next", "is_success"].reshape(-1, STEPS).tolist():
            assert_judged_at_the_end(successes)


def test_torchrl_itself_rejects_texts_of_gymnasiums_own_vectors():
    """The reason for the exception in the guide's table: if this test fails, TorchRL supports it."""
    import gymnasium
    from torchrl.envs import GymWrapper

    envs = gymnasium.make_vec("spidar_gym/Hover-v0", 2, "sync", vector_kwargs={"autoreset_mode": "SameStep"})
    with pytest.raises(RuntimeError, match="expand_specs"):
        GymWrapper(envs)


@pytest.mark.parametrize("mode", ["SameStep", "Disabled"])
@pytest.mark.parametrize("env_id", ENVIRONMENTS)
def test_specs_are_those_of_what_comes(env_id, mode):
    import gymnasium
    from torchrl.envs import GymEnv, GymWrapper, check_env_specs

    check_env_specs(GymEnv(env_id, max_episode_steps=4))
    check_env_specs(GymWrapper(gymnasium.make_vec(env_id, 2, max_episode_steps=4, autoreset_mode=mode)))
