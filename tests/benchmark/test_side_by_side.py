"""Pins scenarios in parallel in the engine: same bits as one by one for any number, only for batch policies."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from spidar_gym.benchmark import COURSE, CRAWL, GRASP, HOVER, TRACKS, PolicyError, PresetPolicy, load_scenarios
from spidar_gym.benchmark.evaluate import play
from spidar_gym.benchmark.scoring import play_scenario, play_scenarios
from spidar_gym.envs.hover_env import HoverEnv
from spidar_gym.native.engine_binding import Engine
from spidar_gym.policies.load import load_policy
from spidar_gym.policies.policy import BatchPolicy, acts_in_batches

LEARNED = Path(__file__).resolve().parents[2] / "baselines" / "learned"


class Tuned(PresetPolicy):
    """The tuned controllers."""

    presets = {
        HOVER: {"preset": "tuned"},
        CRAWL: {"preset": "overlapped"},
        COURSE: {"action_mode": "residual"},
        GRASP: {},
    }


class Pushes(Tuned):
    """Adds a constant push; one robot at a time."""

    def act(self, observation):
        return np.full(self._size, 0.1)


class PushesAll(Pushes):
    """Adds the same push to a batch of robots."""

    def act_batch(self, observations):
        return np.full((len(observations), self._size), 0.1)


def shorten(monkeypatch, track, seconds):
    monkeypatch.setitem(TRACKS, track, replace(TRACKS[track], seconds=seconds))


def metrics(results):
    return [result["metrics"] for result in results]


@pytest.mark.parametrize("track", TRACKS)
def test_scenarios_give_the_same_bits_side_by_side_as_one_by_one(track, monkeypatch):
    shorten(monkeypatch, track, 0.5)
    scenarios = load_scenarios(track)[0][:3]
    together = play_scenarios(Tuned(), track, scenarios)
    assert metrics(together) == [play_scenario(Tuned(), track, one)["metrics"] for one in scenarios]
    assert len({str(one) for one in metrics(together)}) == 3
    assert all(set(one["timing"]) == {"act_s", "step_s", "wall_s"} for one in together)


@pytest.mark.parametrize(
    ("artifact", "track"),
    [("ppo_tuned/seed0.npz", "flight-fast5"), ("supervised_paper/seed1.npz", "flight-randomised"),
     ("ppo_direct/seed0.npz", "flight-paper"), ("learned_gait/seed2.npz", "ground-randomised")],
)  # fmt: skip
def test_a_network_acts_for_each_robot_independently_of_the_others(artifact, track, monkeypatch):
    shorten(monkeypatch, track, 0.3)
    scenarios = load_scenarios(track)[0]
    policy = load_policy(str(LEARNED / artifact))
    assert acts_in_batches(policy)
    fifty = metrics(play_scenarios(policy, track, scenarios))
    assert metrics(play_scenarios(policy, track, scenarios[20:27])) == fifty[20:27]
    assert play_scenario(policy, track, scenarios[20])["metrics"] == fifty[20]


def test_episodes_that_end_early_change_no_other_episode(monkeypatch):
    class Falls(Tuned):
        """Turns off the rotors of the robots with odd seeds."""

        presets = {HOVER: {"action_mode": "direct"}}

        def reset(self, seed):
            self.falls = np.array([seed % 2])

        def reset_batch(self, seeds):
            self.falls = np.array(seeds) % 2

        def act(self, observation):
            return self.act_batch(observation[None])[0]

        def act_batch(self, observations):
            return np.where(self.falls[:, None], -1.0, 0.2) * np.ones((1, self._size))

    shorten(monkeypatch, "flight-fast3", 2.0)
    scenarios = load_scenarios("flight-fast3")[0][:6]
    together = metrics(play_scenarios(Falls(), "flight-fast3", scenarios))
    assert together == [play_scenario(Falls(), "flight-fast3", one)["metrics"] for one in scenarios]
    assert len({one["duration_s"] for one in together}) > 2


def test_a_policy_that_overrides_act_needs_act_batch_for_batches(monkeypatch):
    shorten(monkeypatch, "flight-fast5", 0.5)
    assert acts_in_batches(Tuned())
    assert isinstance(Tuned(), BatchPolicy)
    assert not acts_in_batches(Pushes())
    assert acts_in_batches(PushesAll())
    changed = Tuned()
    changed.act = lambda observation: np.zeros(6)
    assert not acts_in_batches(changed)
    scenarios = load_scenarios("flight-fast5")[0][:2]
    pushed = metrics(play(Pushes(), "flight-fast5", scenarios))
    assert pushed == metrics(play(PushesAll(), "flight-fast5", scenarios))
    assert pushed != metrics(play(Tuned(), "flight-fast5", scenarios))


def test_the_robots_of_a_track_are_in_one_engine(monkeypatch):
    made, make = [], Engine.__init__
    monkeypatch.setattr(Engine, "__init__", lambda *given, **named: made.append(given[3]) or make(*given, **named))
    shorten(monkeypatch, "flight-wind", 0.1)
    play(Tuned(), "flight-wind", load_scenarios("flight-wind")[0])
    assert made == [1, 50]


def test_a_batch_of_actions_of_another_shape_is_refused_with_its_place(monkeypatch):
    shorten(monkeypatch, "flight-fast5", 0.1)
    policy = PushesAll()
    policy.act_batch = lambda observations: np.zeros(6)
    with pytest.raises(PolicyError, match=r"scenarios 0 … 2, tick 0: gave float64 of shape \(6,\); valid: .*\(3, 6\)"):
        play_scenarios(policy, "flight-fast5", load_scenarios("flight-fast5")[0][:3])


@pytest.mark.parametrize("track", ["flight-fast5", "flight-narrow"])
def test_the_engine_counts_the_same_violations_as_python(track, monkeypatch):
    class Unrestricted(PresetPolicy):
        """Allocates without the interference constraint."""

        presets = {HOVER: {"preset": "paper", "avoid_interference": False}}

    shorten(monkeypatch, track, 6.0)
    scenario = load_scenarios(track)[0][9]
    readable, native = (
        play_scenario(Unrestricted(), track, scenario, control=control)["metrics"] for control in ("python", "core")
    )
    assert readable["violations"] == native["violations"]
    assert native["violations"] > 0.05


def test_a_controller_in_python_is_played_one_by_one(monkeypatch):
    shorten(monkeypatch, "flight-fast5", 0.1)
    asked, step = [], HoverEnv.step
    monkeypatch.setattr(HoverEnv, "step", lambda env, action: asked.append(len(env.fleet.rewards)) or step(env, action))
    scenarios = load_scenarios("flight-fast5")[0][:2]
    readable = metrics(play_scenarios(Tuned(), "flight-fast5", scenarios, control="python"))
    assert asked == [1] * 8
    for one, other in zip(readable, metrics(play_scenarios(Tuned(), "flight-fast5", scenarios)), strict=True):
        assert one["error"] == pytest.approx(other["error"], rel=1e-6)
        assert one["violations"] == other["violations"]
