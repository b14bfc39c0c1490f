"""Pins the search for the rule's parameters on courses: zeros are the rule, trials share courses, runs resume."""

import json
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("stable_baselines3", reason="the extra `train` is not installed")

from spidar_gym.benchmark.evaluate import play
from spidar_gym.benchmark.scenario import load_scenarios
from spidar_gym.benchmark.track import TRACKS
from spidar_gym.errors import InvalidValueError, UnknownNameError
from spidar_gym.policies.artifact import LearnedPolicy, read_artifact
from spidar_gym.policies.course import RANGES, rule_numbers
from train import course
from train.course import PRESETS, Rule, artifact, go, learn
from train.lib import evaluate
from train.lib.config import override
from train.lib.run import State
from train.lib.trials import draw_scenarios

pytestmark = pytest.mark.train
TRACK = "course-gates"
TINY = override(PRESETS["rule"], tracks=(TRACK,), courses=2, scenarios=2, workers=1)


def test_only_learned_parameters_differ_from_the_rule():
    args = override(TINY, learned=("speed", "near"))
    (layer,) = artifact(args, np.array([0.5, -0.5]), State()).biases
    found, present = rule_numbers(layer), rule_numbers(np.zeros(len(RANGES)))
    assert found == replace(present, speed=found.speed, near=found.near)
    assert found.speed > present.speed
    assert found.near < present.near


def test_each_generation_has_its_own_courses_and_none_of_the_validation():
    first, again, second, other = (
        [one.seed for _, own in draw_scenarios(override(TINY, seed=s), g, 3) for one in own]
        for s, g in ((0, 0), (0, 0), (0, 1), (1, 0))
    )
    assert first == again
    assert len({*first, *second, *other}) == 9
    assert not {*first, *second, *other} & {one.seed for one in load_scenarios(TRACK, "validation")[0]}


@pytest.fixture
def plain(monkeypatch):
    """Replace the courses by ones without obstacles: take-off, flight and landing."""
    options = {"count": (0, 0), "floors": ("plain",)}
    monkeypatch.setitem(TRACKS, TRACK, replace(TRACKS[TRACK], options=options))


def test_a_course_costs_its_tracks_error_and_zeros_go_as_the_rule(plain):
    ((track, scenarios),) = draw_scenarios(TINY, 0, 2)
    zeros = np.zeros(len(TINY.learned))
    own, alone = (play(LearnedPolicy(artifact(TINY, zeros, State())), track, scenarios[k:]) for k in (0, 1))
    metrics = [each["metrics"] for each in own]
    assert metrics == [each["metrics"] for each in play(Rule(), track, scenarios)]
    assert metrics[1:] == [each["metrics"] for each in alone]
    assert all(each["success"] for each in metrics)
    cost, ticks = go(TINY, (zeros, track, scenarios))
    assert cost == pytest.approx(np.mean([each["error"] for each in metrics]))
    assert ticks == pytest.approx(80.0 * np.mean([each["duration_s"] for each in metrics]))
    assert TINY.cost({**metrics[0], "failed": True}) == 2.5


def numbers_of(policy):
    """Return the parameters of an artifact's policy, or zeros for the rule."""
    return policy.artifact.biases[0] if isinstance(policy, LearnedPolicy) else np.zeros(len(RANGES))


def test_a_run_depends_on_its_seed_alone_and_resumes_where_it_was_interrupted(tmp_path, monkeypatch):
    calls, stop = [], 0

    def bowl(policy, _name, scenarios, **_how):
        """Replace courses by errors with their minimum at parameters of ½."""
        calls.append(len(scenarios))
        if len(calls) == stop:
            raise KeyboardInterrupt
        error = 1.0 + float(np.mean((numbers_of(policy) - 0.5) ** 2))
        names = ("error", "energy_wh")
        own = {**dict.fromkeys(names, error), "duration_s": 2.5, "success": True, "failed": False, "hit_n": 0.0}
        return [{"metrics": dict(own)} for _ in scenarios]

    monkeypatch.setattr(course, "play", bowl)
    monkeypatch.setattr(evaluate, "play", bowl)
    args = override(TINY, generations=4, validations=2, population=6)
    whole = learn(override(args, out=tmp_path / "whole")).read_bytes()
    assert len(calls) == 2 + 4 * 6 + 2  # base, zeros compared with the base, trials, validations

    calls, stop = [], 2 + 15
    with pytest.raises(KeyboardInterrupt):
        learn(override(args, out=tmp_path / "cut"))
    stop = 0
    path = learn(override(args, out=tmp_path / "cut"))
    assert path.read_bytes() == whole
    curve = json.loads((path.parent / "curve.json").read_text())
    assert [line["steps"] for line in curve["curve"]] == [2400, 4800]
    assert curve["chosen"]["score"] < 0.0
    agent = read_artifact(path)
    assert (agent.kind, agent.output, dict(agent.arguments)) == ("learned", "rule", {"action_mode": "waypoint"})


def test_bad_settings_are_refused_in_one_line():
    with pytest.raises(UnknownNameError, match=r"unknown learned 'height'; valid: .*wall_over"):
        override(TINY, learned=("height",))
    with pytest.raises(InvalidValueError, match=r"tracks = 'flight-fast3'.*Course-v0"):
        override(TINY, tracks=("flight-fast3",))
    with pytest.raises(InvalidValueError, match="courses"):
        override(TINY, courses=0)
    with pytest.raises(InvalidValueError, match="failure"):
        override(TINY, failure=0.0)
