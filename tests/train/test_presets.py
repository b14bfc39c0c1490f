"""Pins the presets for rl-zoo: the committed files are up to date, and Stable-Baselines3 accepts every value."""

import subprocess
import sys
from pathlib import Path

import gymnasium
import pytest

pytestmark = pytest.mark.train
ROOT = Path(__file__).resolve().parents[2]
FILES = sorted((ROOT / "train" / "zoo").glob("*.yml"))


def entries(path):
    import yaml  # a dependency of Ray

    return yaml.safe_load(path.read_text(encoding="utf-8"))


def test_the_committed_files_are_up_to_date():
    from train import presets

    assert {path.stem: path.read_text(encoding="utf-8") for path in FILES} == presets.zoo()


def test_a_stale_file_is_refused_in_one_line_and_rewritten(tmp_path, monkeypatch):
    from spidar_gym.errors import StaleAssetError
    from train import presets

    monkeypatch.setattr(presets, "FOLDER", tmp_path)
    monkeypatch.setattr(sys, "argv", ["presets", "--check"])
    with pytest.raises(StaleAssetError, match=r"python -m train\.presets"):
        presets.main()
    assert not list(tmp_path.iterdir())
    monkeypatch.setattr(sys, "argv", ["presets"])
    presets.main()
    assert {path.stem: path.read_text(encoding="utf-8") for path in tmp_path.iterdir()} == presets.zoo()


def test_the_check_runs_as_it_is_documented():
    command = [sys.executable, "-m", "train.presets", "--check"]
    subprocess.run(command, cwd=ROOT, check=True, capture_output=True)


def test_rl_zoo_gets_an_entry_for_every_environment_that_a_recipe_learns_in():
    from train.residual import PRESETS

    assert [path.stem for path in FILES] == ["ppo", "sac"]
    assert set(entries(FILES[0])) == {preset.env.env_id for preset in PRESETS.values()}
    crawl = entries(FILES[0])["spidar_gym/Crawl-v0"]
    # A held action: values per decision are converted to values per tick.
    env, learner = PRESETS["crawl-ppo"].env, PRESETS["crawl-ppo"].learner
    assert crawl["n_steps"] == learner.ppo.n_steps * env.hold
    assert crawl["gamma"] ** env.hold == pytest.approx(learner.gamma, abs=1e-4)


@pytest.mark.parametrize(
    ("algorithm", "env_id"),
    [(path.stem, line[:-1]) for path in FILES for line in path.read_text(encoding="utf-8").splitlines()
     if line.startswith("spidar_gym/")],
)  # fmt: skip
def test_stable_baselines_accepts_every_value(algorithm, env_id):
    import stable_baselines3
    from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize
    from torch import nn

    values = entries(ROOT / "train" / "zoo" / f"{algorithm}.yml")[env_id]
    # As in rl-zoo: expressions are evaluated, `lin_` is a schedule, the rest is passed to the constructor.
    env_kwargs = values.pop("env_kwargs")
    makers = [lambda: gymnasium.make(env_id, **env_kwargs)] * values.pop("n_envs")
    envs = VecNormalize(DummyVecEnv(makers), **eval(values.pop("normalize")))
    assert values.pop("n_timesteps") > 0
    kwargs = eval(values.pop("policy_kwargs"), {"nn": nn})
    rate = values.pop("learning_rate")
    start = float(rate.removeprefix("lin_")) if isinstance(rate, str) else rate
    model = getattr(stable_baselines3, algorithm.upper())(
        env=envs, learning_rate=lambda left: left * start, policy_kwargs=kwargs, device="cpu", **values
    )
    for name, value in values.items():
        if name not in ("policy", "clip_range", "train_freq"):
            assert getattr(model, name) == value
            assert isinstance(value, (int, float))
    actor = model.policy.mlp_extractor.policy_net if algorithm == "ppo" else model.actor.latent_pi
    assert [m.out_features for m in actor if isinstance(m, nn.Linear)] == kwargs["net_arch"]["pi"]
    if algorithm == "ppo":
        assert model.policy.log_std.detach().unique().tolist() == pytest.approx([kwargs["log_std_init"]])
    envs.close()
