"""Pins Minari and d3rlpy as clients: episodes are recorded with all of `info`, and used for offline learning."""

import numpy as np
import pytest
from support.clients import STEPS, assert_judged_at_the_end, needs, run_shown

pytestmark = [*needs("minari", "d3rlpy", "h5py", "jax"), pytest.mark.train]


def test_what_the_guide_shows_records_episodes_and_learns_from_them(tmp_path, monkeypatch):
    import d3rlpy
    import minari

    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    monkeypatch.chdir(tmp_path)
    made = run_shown("minari")
    assert (made["dataset"].total_episodes, made["dataset"].total_steps) == (4, 4 * STEPS)
    again = minari.load_dataset("spidar/hover-v0")
    for episode in again.iterate_episodes():
        assert episode.observations.shape == (STEPS + 1, 207)
        assert np.isfinite(episode.rewards).all()
        assert episode.truncations.tolist() == [False] * (STEPS - 1) + [True]
        # The `info` of the reset comes first.
        assert not episode.infos["is_success"][0]
        assert_judged_at_the_end(episode.infos["is_success"][1:].tolist())
        assert {bytes(word) for word in episode.infos["failure"]} == {b""}
    assert again.recover_environment().spec.max_episode_steps == STEPS
    assert [epoch for epoch, _ in made["learned"]] == [1, 2]
    assert all(np.isfinite(losses["critic_loss"]) for _, losses in made["learned"])
    score = d3rlpy.metrics.EnvironmentEvaluator(made["own"], n_trials=1)(made["learner"], None)
    assert 0.0 < score < STEPS
