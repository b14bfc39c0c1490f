"""Pins skrl as a client: PPO over the engine's vector, in tensors."""

import pytest
from support.clients import STEPS, assert_judged_at_the_end, needs, run_shown

pytestmark = [*needs("skrl", "torch"), pytest.mark.train]


def test_what_the_guide_shows_learns_and_its_episodes_report_success_at_their_end(tmp_path, monkeypatch):
    import torch

    monkeypatch.chdir(tmp_path)  # skrl writes its logs to the working folder
    made = run_shown("skrl")
    agent, env = made["agent"], made["env"]
    before = {name: value.clone() for name, value in agent.policy.state_dict().items()}
    made["trainer"].train()
    assert any(not torch.equal(value, before[name]) for name, value in agent.policy.state_dict().items())
    rewards = made["memory"].get_tensor_by_name("rewards")
    assert rewards.shape == (64, 2, 1)
    assert bool(((rewards >= 0.0) & (rewards < 1.0)).all())
    envs = env.unwrapped
    envs.reset(seed=0)
    env._reset_once = False  # keeps the wrapper from resetting again
    steps = [env.step(torch.zeros(2, 6)) for _ in range(STEPS)]
    assert steps[-1][3].all()
    for k in range(2):
        assert_judged_at_the_end([bool(info["is_success"][k]) for *_, info in steps])
    env.close()
