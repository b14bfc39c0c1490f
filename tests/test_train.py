"""Pins training: the agent starts as its base, a seed is a run, interruptions and bad input change nothing."""

import errno
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("stable_baselines3", reason="the extra `train` is not installed")
import torch

from spidar_gym.benchmark.artifact import read_artifact
from spidar_gym.benchmark.scenario import load_scenarios
from spidar_gym.benchmark.track import SPLITS, TRACKS
from spidar_gym.control.core import core_path
from spidar_gym.envs.env import SpidarEnv
from spidar_gym.errors import InvalidValueError, SpidarError, UnknownNameError
from train import kinds, presets, referee, residual
from train.kinds import FIRST_SEED, Goal, Scaling, baseline_scaling, make_training_env, scaling_of, training_seed
from train.learner import actor_layers, build
from train.referee import Base, Referee
from train.residual import Args, artifact, hidden, learn, make_envs, still, washout
from train.run import CheckpointError, State

pytestmark = pytest.mark.train
CONTROL = "core" if core_path().is_file() else "python"
TINY = Args(**presets.RESIDUAL["hover-paper-ppo"])
TINY = replace(
    TINY, tracks=("flight-fast3",), steps=192, segment=96, envs=3, n_steps=16, batch_size=24, epochs=2, hidden=8,
    critic_hidden=8, scenarios=1, scaling_ticks=40, critic_first=0, control=CONTROL, select=False, sees=(), hold=1,
)  # fmt: skip


@pytest.fixture(scope="module", autouse=True)
def short():
    """Flights of two seconds: what is pinned here does not need longer ones."""
    track = TRACKS["flight-fast3"]
    TRACKS["flight-fast3"] = replace(track, seconds=2.0)
    yield
    TRACKS["flight-fast3"] = track


@pytest.fixture(scope="module")
def done(short, tmp_path_factory):
    """A finished run: its folder."""
    out = tmp_path_factory.mktemp("runs")
    return learn(replace(TINY, out=out)).parent


def parameters(folder):
    content = torch.load(folder / "checkpoint.pt", weights_only=False)
    return content["state"]["learner"]["parameters"]["policy"]


def test_no_seed_of_training_is_one_of_a_scenario():
    known = {s.seed for track in TRACKS for split in SPLITS for s in load_scenarios(track, split)[0]}
    assert max(known) < FIRST_SEED
    drawn = {training_seed(run, *words) for run in range(20) for words in ((0, 3), (1, 7), (2, 1, 5), (3,))}
    assert len(drawn) == 80
    assert min(drawn) >= FIRST_SEED
    assert max(drawn) < 2**32 - 1000  # numpy's seeds, with room for one an environment


def test_training_resets_with_its_own_seeds_and_looks_at_validation_scenarios_only(tmp_path, monkeypatch):
    seeds, splits = [], []
    reset, load = SpidarEnv.reset, load_scenarios

    def spy(self, *, seed=None, options=None):
        if seed is not None:
            seeds.append((seed, "start" in (options or {})))
        return reset(self, seed=seed, options=options)

    def look(name, split="test"):
        splits.append(split)
        return load(name, split)

    monkeypatch.setattr(SpidarEnv, "reset", spy)
    monkeypatch.setattr(referee, "load_scenarios", look)
    learn(replace(TINY, steps=96, out=tmp_path))
    assert set(splits) == {"validation"}
    assert {scenario for _, scenario in seeds} == {True, False}
    allowed = {s.seed for s in load("flight-fast3", "validation")[0]}
    assert {seed for seed, scenario in seeds if scenario} <= allowed
    assert min(seed for seed, scenario in seeds if not scenario) >= FIRST_SEED


def test_before_training_the_agent_is_its_base_bit_for_bit_and_an_agent_that_is_not_is_refused():
    judge = Referee(TINY.tracks, Base(TINY.arguments), 1, control=CONTROL)
    kind = residual.make_env(TINY, "flight-fast3")
    scaling = scaling_of(np.array([kind.reset(seed=1)[0], kind.reset(seed=2)[0]]), kind.observation_space.high)
    layers = actor_layers(build(TINY, make_envs(TINY, scaling), None, hidden(TINY), still(TINY)))
    judge.require_equal(artifact(TINY, layers, scaling, State()))
    *rest, (w, b) = layers
    with pytest.raises(SpidarError, match=r"differs from its base on flight-fast3 in attitude_rms_rad"):
        judge.require_equal(artifact(TINY, (*rest, (w, b + 1e-3)), scaling, State()))


def test_a_learner_from_nothing_is_not_blind_in_the_flights_that_it_explores():
    env = make_training_env("flight-paper", {"action_mode": "direct"}, Goal(), washout=np.zeros(0), control=CONTROL)
    rng, spread, seen = np.random.default_rng(1), 0.135, []
    observation, _ = env.reset(seed=5)
    for _ in range(300):
        action = np.clip(spread * rng.standard_normal(env.action_space.shape), -1.0, 1.0)
        observation, _, terminated, truncated, _ = env.step(action)
        seen.append(observation)
        if terminated or truncated:
            observation, _ = env.reset()
    # Scaled by a fall without actions, which never turns, half of all rates would lie beyond the clip.
    for tried, blind in ((spread, False), (0.0, True)):
        scaling = baseline_scaling([env], 3, 400, tried)
        beyond = np.abs(np.array(seen) - scaling.mean) >= scaling.clip * np.sqrt(scaling.variance)
        assert (beyond.mean() > 0.1) == blind
        assert (beyond.mean() < 0.001) != blind
    env.close()


def test_a_run_is_scaled_by_its_base_and_without_one_by_its_own_first_exploration(done, tmp_path, monkeypatch):
    monkeypatch.setitem(TRACKS, "flight-paper", replace(TRACKS["flight-paper"], seconds=2.0))
    alone = replace(
        Args(**presets.RESIDUAL["hover-direct-ppo"]), steps=32, segment=32, envs=1, n_steps=16, batch_size=16, epochs=1,
        hidden=8, critic_hidden=8, scenarios=1, scaling_ticks=100, control=CONTROL, out=tmp_path,
    )  # fmt: skip
    for args, folder, spread in ((TINY, done, 0.0), (alone, learn(alone).parent, np.exp(alone.log_std))):
        envs = [residual.make_env(args, track) for track in args.tracks]
        scaling = baseline_scaling(envs, args.seed, args.scaling_ticks // args.hold, spread)
        found = read_artifact(folder / "policy.npz")
        np.testing.assert_allclose(found.mean, scaling.mean, rtol=1e-6)
        np.testing.assert_allclose(found.variance, scaling.variance, rtol=1e-6)


@pytest.mark.parametrize("name", presets.RESIDUAL)
def test_every_preset_starts_with_a_mean_action_of_zero_and_small_exploration(name):
    args = replace(Args(**presets.RESIDUAL[name]), control=CONTROL, envs=1, n_steps=8, batch_size=8, buffer=100)
    size = len(residual.make_env(args, args.tracks[0]).observation_space.high)
    envs = make_envs(args, Scaling(np.zeros(size), np.ones(size)))
    model, observation = build(args, envs, None, hidden(args), still(args)), envs.reset()[0]
    np.testing.assert_array_equal(model.predict(observation, deterministic=True)[0], 0.0)
    drawn = np.array([model.predict(observation)[0] for _ in range(200)])
    assert drawn.std() == pytest.approx(np.exp(args.log_std), rel=0.2)


def test_the_same_seed_gives_the_same_checkpoint_and_another_one_another(done, tmp_path):
    again = learn(replace(TINY, out=tmp_path / "again")).parent
    mine, theirs = parameters(done), parameters(again)
    assert all(torch.equal(mine[name], theirs[name]) for name in mine)
    assert (again / "policy.npz").read_bytes() == (done / "policy.npz").read_bytes()
    other = learn(replace(TINY, seed=1, out=tmp_path / "other")).parent
    assert not torch.equal(parameters(other)["action_net.weight"], mine["action_net.weight"])


@pytest.mark.parametrize("algorithm", ["ppo", "sac"])
def test_an_interrupted_run_goes_on_as_if_it_had_not_been(done, tmp_path, algorithm):
    args = replace(TINY, out=tmp_path / "cut")
    if algorithm == "sac":
        args = replace(args, algorithm="sac", buffer=500, warmup=24, updates=2, tracks=("flight-fast3",))
        done = learn(replace(args, out=tmp_path / "whole")).parent

    def stop(line):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        learn(args, on_segment=stop)
    folder = tmp_path / "cut" / args.name / "seed0"
    assert not (folder / "policy.npz").exists()
    assert learn(args) == folder / "policy.npz"
    mine, theirs = parameters(done), parameters(folder)
    assert all(torch.equal(mine[name], theirs[name]) for name in mine)
    assert (folder / "policy.npz").read_bytes() == (done / "policy.npz").read_bytes()


def test_what_was_learned_is_in_the_artifact(done):
    learned = read_artifact(done / "policy.npz")
    assert (learned.name, learned.kind, learned.env_id) == ("ppo_paper", "residual", "spidar_gym/Hover-v0")
    assert learned.arguments == {"action_mode": "residual_wrench", "preset": "paper"}
    assert np.abs(learned.weights[-1]).max() > 0.0
    np.testing.assert_array_equal(learned.washout, washout(TINY))
    assert learned.training["steps"] == 192
    assert [steps for steps, _ in learned.training["curve"]] == [96, 192]
    curve = json.loads((done / "curve.json").read_text())
    assert curve["seconds"] > 0.0
    assert set(curve["curve"][0]["cells"]["flight-fast3"]) == {"position_rms_m", "attitude_rms_rad"}


def test_an_agent_that_is_worse_than_its_base_is_not_chosen(tmp_path):
    wild = replace(TINY, lr=1.0, lr_end=1.0, average=0.0, select=True, out=tmp_path)
    learned = read_artifact(learn(wild))
    curve = json.loads((tmp_path / "ppo_paper" / "seed0" / "curve.json").read_text())
    assert all(line["worst"] > 0.1 for line in curve["curve"])
    np.testing.assert_array_equal(learned.weights[-1], 0.0)  # the base itself
    assert curve["chosen"] == {"steps": 0, "score": 0.0}


def test_a_checkpoint_of_another_run_is_refused_and_left_alone(done):
    before = (done / "checkpoint.pt").read_bytes()
    words = rf"another run: lr = {TINY.lr:g} instead of 0\.1; valid: the same settings"
    with pytest.raises(CheckpointError, match=words):
        learn(replace(TINY, lr=0.1, out=done.parent.parent))
    assert (done / "checkpoint.pt").read_bytes() == before


@pytest.fixture
def spoilt(done, tmp_path):
    """A run's folder with a checkpoint that was changed."""

    def make(change):
        content = torch.load(done / "checkpoint.pt", weights_only=False)
        change(content)
        folder = tmp_path / TINY.name / "seed0"
        folder.mkdir(parents=True)
        torch.save(content, folder / "checkpoint.pt")
        return replace(TINY, out=tmp_path)

    return make


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"interface": {"observation": [], "action": 6}}, r"another run: observation = \[\] instead of"),
        ({"env_id": "spidar_gym/Hover-v9"}, "another run: env_id = spidar_gym/Hover-v9 instead of spidar_gym/Hover-v0"),
        ({"versions": {"spidar-gym": "0.0.1"}}, r"another run: \w+ = None instead of"),
    ],
)
def test_a_checkpoint_of_another_environment_version_is_refused(spoilt, change, words):
    args = spoilt(lambda content: content["identity"].update(change))
    with pytest.raises(CheckpointError, match=words):
        learn(args)


def test_a_checkpoint_without_its_normaliser_is_refused(spoilt):
    args = spoilt(lambda c: c["state"]["scaling"].pop("variance"))
    with pytest.raises(CheckpointError, match="lacks its normaliser"):
        learn(args)


@pytest.mark.parametrize("keep", [0, 10, 1000])
def test_half_a_checkpoint_is_refused_in_words(done, tmp_path, keep):
    folder = tmp_path / TINY.name / "seed0"
    folder.mkdir(parents=True)
    (folder / "checkpoint.pt").write_bytes((done / "checkpoint.pt").read_bytes()[:keep])
    with pytest.raises(CheckpointError, match=r"is no checkpoint .*valid: one that this script wrote"):
        learn(replace(TINY, out=tmp_path))


def test_a_full_disk_leaves_the_last_checkpoint_whole(tmp_path, monkeypatch):
    args, write = replace(TINY, out=tmp_path), Path.write_bytes
    folder = tmp_path / TINY.name / "seed0"

    def full(path, data):
        if "checkpoint" in path.name and (folder / "checkpoint.pt").exists():
            write(path, data[:100])
            raise OSError(errno.ENOSPC, "No space left on device")
        return write(path, data)

    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(SpidarError, match=r"cannot write .*checkpoint\.pt: No space left on device"):
        learn(args)
    assert [p.name for p in folder.glob("*.pt*")] == ["checkpoint.pt"]
    monkeypatch.undo()
    assert learn(args).exists()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"algorithm": "trpo"}, "unknown algorithm 'trpo'; valid: ppo, sac"),
        ({"average": 1.0}, "average = 1.0 is not valid"),
        ({"gamma": 1.5}, "gamma = 1.5 is not valid"),
        ({"steps": 0}, "steps = 0 is not valid"),
        ({"tracks": ()}, "at least one track"),
        ({"reward": "joy"}, "unknown reward 'joy'; valid: environment, pose, economy"),
        ({"tracks": ("flight-to-mars",)}, "unknown track 'flight-to-mars'"),
        ({"base": "best"}, "unknown preset 'best'"),
    ],
)
def test_settings_that_cannot_be_learned_with_are_refused(tmp_path, change, words):
    with pytest.raises((InvalidValueError, UnknownNameError), match=words):
        learn(replace(TINY, out=tmp_path, **change))


def test_an_actor_learns_neither_from_what_it_does_not_see_nor_about_what_stays_still(tmp_path):
    args = replace(TINY, sees=("joint_position",), still=(2, 5), lr=0.01, out=tmp_path)
    learned = read_artifact(learn(args))
    blind = hidden(args)
    assert blind.sum() == len(blind) - 16
    np.testing.assert_array_equal(learned.weights[0][:, blind], 0.0)
    assert np.abs(learned.weights[0][:, ~blind]).min() > 0.0
    moved = np.abs(learned.weights[-1]).max(axis=1) > 0.0
    np.testing.assert_array_equal(moved, [True, True, False, True, True, False])
    np.testing.assert_array_equal(learned.biases[-1][[2, 5]], 0.0)
    with pytest.raises(UnknownNameError, match="unknown piece of the observation 'mood'; valid: position_error"):
        hidden(replace(args, sees=("mood",)))
    with pytest.raises(InvalidValueError, match=r"still = 6 is not valid; expected entries within 0 … 5"):
        still(replace(args, still=(6,)))


def test_a_held_action_adds_up_the_rewards_of_its_ticks():
    single, held = (
        make_training_env("flight-fast3", TINY.arguments, Goal("pose"), washout=np.zeros(0), hold=hold, control=CONTROL)
        for hold in (1, 5)
    )
    action = np.full(6, 0.1)
    single.reset(seed=3)
    held.reset(seed=3)
    total = sum(single.step(action)[1] for _ in range(5))
    assert held.step(action)[1] == pytest.approx(total, rel=1e-12)


def test_the_washout_of_training_is_the_artifacts(done):
    env = make_training_env("flight-fast3", TINY.arguments, Goal(), washout=np.full(6, 0.5), control=CONTROL)
    env.reset(seed=0)
    for _ in range(200):
        env.step(np.full(6, 0.4))
    given = env.unwrapped._action
    assert np.abs(given).max() < 1e-4


def test_a_crawl_is_over_when_it_is_finished_and_its_reward_prefers_the_shorter_way_to_it():
    assert set(kinds.REWARDS) == {"environment", "pose", "economy"}
    info = {"failure": "", "energy_wh": 1.0, "foot_slip_m": 0.0, "way": 0.5, "is_success": False, "finished": False}
    env = type("Env", (), {"progress": type("P", (), {"whole": 0.5})})
    goal = Goal("economy", penalty=0.0)

    def reward(**after):
        return kinds.REWARDS["economy"](goal, kinds.Tick(0.0, {**info, **after}, info, env, np.zeros(4)))

    assert reward(way=0.4) == pytest.approx(0.2)  # a fifth of the way
    assert reward(energy_wh=2.0) == pytest.approx(-0.1)  # a tenth of what 20 Wh/m are
    assert reward(foot_slip_m=0.05) == pytest.approx(-0.5)
    assert reward(failure="tilt") == -1.0


@pytest.mark.parametrize(("limit", "expected"), [(1.0, 1.0), (0.6, 0.5), (0.0, 0.3)])
def test_of_what_makes_something_worse_the_largest_share_that_does_not_is_taken(limit, expected, monkeypatch):
    judged = []

    def judge(self, share, on_scenario=lambda: None):
        judged.append(share)
        return referee.Verdict({"flight-fast3": {"error": share - limit}}, 0.0, failed=False)

    monkeypatch.setattr(Referee, "judge", judge)
    verdict, share = Referee.strongest(object.__new__(Referee), lambda share: share)
    assert (share, verdict.admissible) == (expected, limit > 0.0)
    assert tuple(judged) == referee.SHARES[: len(judged)]


def test_errors_are_measured_by_the_base_s_own_kind_by_kind():
    judge = object.__new__(Referee)
    judge._tracks = ("flight-fast3", "flight-fast5")
    judge.means = {"flight-fast3": {"p": 1.0, "a": 0.02}, "flight-fast5": {"p": 3.0, "a": 0.02}}
    shares = judge.shares()
    assert shares == pytest.approx({"flight-fast3": 0.75, "flight-fast5": 1.25})
    goal = residual.make_env(TINY, "flight-fast3", share=0.75)._goal
    assert goal.position_m == pytest.approx(0.75 * TINY.position)
    assert goal.rate == pytest.approx(0.75 * TINY.rate)
