"""Pins the path track: paths in its files, repeatable episodes, equal results in Python, tuned better than paper."""

import pathlib
from dataclasses import replace

import numpy as np
import pytest

from spidar_gym.benchmark import CRAWL, HOVER, TRACKS, PresetPolicy, load_scenarios
from spidar_gym.benchmark.scenario import make_env, reset_options
from spidar_gym.benchmark.scoring import play_scenario, play_scenarios
from spidar_gym.benchmark.track import flight_error
from spidar_gym.control.flight.path import Path
from spidar_gym.envs.registry import PATH
from spidar_gym.errors import InvalidValueError
from spidar_gym.policies.load import load_policy
from spidar_gym.policies.policy import defined_on
from spidar_gym.policies.rollout import rollout
from spidar_gym.so3 import exp
from spidar_gym.tasks.hover import hover_height
from spidar_gym.tasks.path import CLIMB, PATH_BEGIN, SPEEDS
from spidar_gym.tasks.start import FlightStart

TRACK = "flight-path"
LEARNED = pathlib.Path(__file__).resolve().parents[2] / "baselines" / "learned"


def preset(name, **arguments):
    """A policy that uses a preset."""
    return type("Preset", (PresetPolicy,), {"presets": {HOVER: {"preset": name, **arguments}}})()


def paths(split="test") -> list[Path]:
    return [FlightStart.parse(one.start).path for one in load_scenarios(TRACK, split)[0]]


def metrics(policy, scenario, **how):
    return play_scenario(policy, TRACK, scenario, **how)["metrics"]


@pytest.mark.parametrize("split", ["test", "validation"])
def test_every_scenario_has_a_path_from_rest_that_outlasts_the_episode_at_a_speed_of_the_task(split):
    fastest, horizon = [], TRACKS[TRACK].seconds
    for path in paths(split):
        assert path.times[0] == PATH_BEGIN
        assert path.seconds >= horizon
        pose, rate, acceleration = path.at(0.0)
        np.testing.assert_allclose(pose[:3], [0.0, 0.0, hover_height()], rtol=0, atol=1e-6)
        assert not rate.any()
        assert not acceleration.any()
        seen = [path.at(time) for time in np.arange(0.0, horizon, 0.025)]
        speeds = np.linalg.norm([rate[:3] for _, rate, _ in seen], axis=1)
        heights = np.array([pose[2] for pose, _, _ in seen]) - hover_height()
        assert -0.6 * CLIMB < heights.min() <= heights.max() < 1.6 * CLIMB
        fastest.append(speeds.max())
    assert 0.9 * SPEEDS[0] < min(fastest) < 2.0 * SPEEDS[0]
    # A spline is faster in its bends than the chord between its points.
    assert 0.9 * SPEEDS[1] < max(fastest) < 2.0 * SPEEDS[1]


@pytest.mark.parametrize("split", ["test", "validation"])
def test_there_are_paths_of_every_kind_with_either_heading_in_wind_and_without(split):
    drawn, found = load_scenarios(TRACK, split)[0], paths(split)
    rests = [sum(not rate.any() for rate in path.rate_w) for path in found]
    kinds = [
        "legs" if n > 2 else "lemniscate" if len(p.times) > 80 else "spline" for n, p in zip(rests, found, strict=True)
    ]
    along = [bool(path.rate_w[:, 3].any()) or len(set(path.pose_w[:, 3])) > 1 for path in found]
    for kind, share in (("legs", 0.25), ("lemniscate", 0.25), ("spline", 0.5)):
        assert abs(kinds.count(kind) / len(kinds) - share) < 0.2
    for one in (along, [bool(scenario.disturbances) for scenario in drawn]):
        assert 0.3 < np.mean(one) < 0.7


def test_numbers_rounded_to_six_digits_leave_the_speed_of_a_lemniscate_constant():
    curves = [path for path in paths() if len(path.times) > 80]
    assert curves
    for path in curves:
        times = np.arange(PATH_BEGIN + 3.0, TRACKS[TRACK].seconds - 3.0, 0.013)
        speeds = np.linalg.norm([path.at(time)[1][:3] for time in times], axis=1)
        assert SPEEDS[0] <= speeds.mean() <= SPEEDS[1]
        np.testing.assert_allclose(speeds, speeds.mean(), rtol=0, atol=3e-4)


def test_a_preload_in_wind_is_turned_with_the_robots_heading(monkeypatch):
    turned = [s for s in load_scenarios(TRACK)[0] if s.disturbances and abs(s.start["path"][0][4]) > 1.0]
    assert len(turned) > 5
    for scenario in turned[:3]:
        force, yaw = np.array(scenario.start["trim"][:3]), scenario.start["path"][0][4]
        unturned = [*(exp(np.array([0.0, 0.0, yaw])) @ force), *scenario.start["trim"][3:]]
        most = []
        for trim in (scenario.start["trim"], unturned):
            env = make_env(TRACKS[TRACK], scenario, {"preset": "paper"})
            options = {**reset_options(scenario), "start": {**scenario.start, "trim": trim}}
            steps = rollout(env, seed=scenario.seed, options=options, ticks=round(40 * PATH_BEGIN))
            most.append(max(np.linalg.norm(step.info["position_error"]) for step in steps))
        assert most[0] < 0.06
        assert most[1] > 2.0 * most[0]


def test_a_scenario_is_played_the_same_twice_and_side_by_side(monkeypatch):
    monkeypatch.setitem(TRACKS, TRACK, replace(TRACKS[TRACK], seconds=4.0))
    scenarios = load_scenarios(TRACK)[0][:4]
    once = [metrics(preset("tuned"), one) for one in scenarios]
    assert [metrics(preset("tuned"), one) for one in reversed(scenarios)] == once[::-1]
    assert [one["metrics"] for one in play_scenarios(preset("tuned"), TRACK, scenarios)] == once
    assert len({one["error"] for one in once}) == 4


@pytest.mark.parametrize("index", [1, 2])
def test_python_controllers_score_what_the_engine_does(index, monkeypatch):
    monkeypatch.setitem(TRACKS, TRACK, replace(TRACKS[TRACK], seconds=3.0))
    scenario = load_scenarios(TRACK)[0][index]
    native, readable = (metrics(preset("tuned"), scenario, control=control) for control in ("core", "python"))
    for name, value in native.items():
        if isinstance(value, float):
            assert readable[name] == pytest.approx(value, rel=1e-6, abs=1e-9), name
        else:
            assert readable[name] == value, name


def test_the_error_is_that_of_a_flight_from_the_deviation_off_the_path_and_papers_is_larger(monkeypatch):
    monkeypatch.setitem(TRACKS, TRACK, replace(TRACKS[TRACK], seconds=8.0))
    scenarios = load_scenarios(TRACK, "validation")[0][:6]
    paper, tuned = (
        [one["metrics"] for one in play_scenarios(preset(name), TRACK, scenarios)] for name in ("paper", "tuned")
    )
    for slow, fast in zip(paper, tuned, strict=True):
        assert not slow["failed"]
        assert fast["success"]
        assert fast["error"] < 0.25 * slow["error"]
        assert slow["error"] == flight_error(slow["position_rms_m"], slow["attitude_rms_rad"], failed=False)


def test_a_preset_of_hover_applies_to_paths_by_default_and_a_learned_hover_policy_is_not_defined_there():
    hover, own = {"preset": "tuned"}, {"preset": "paper"}
    for presets, expected in (({HOVER: hover}, hover), ({HOVER: hover, PATH: own}, own), ({CRAWL: own}, None)):
        policy = type("Preset", (PresetPolicy,), {"presets": presets})()
        assert policy.arguments(PATH) == expected
    learned = load_policy(str(LEARNED / "memory" / "seed0.npz"))
    assert defined_on(learned) == [HOVER]
    with pytest.raises(InvalidValueError, match="a track on which the policy is defined"):
        play_scenario(learned, TRACK, load_scenarios(TRACK)[0][0])


def test_a_policy_without_thrust_fails_and_costs_the_cap():
    scenario = load_scenarios(TRACK)[0][0]

    class LetsGo(PresetPolicy):
        """No thrust."""

        presets = {HOVER: {"action_mode": "direct"}}

        def act(self, observation):
            return np.full(self._size, -1.0)

    found = metrics(LetsGo(), scenario)
    assert (found["failed"], found["error"]) == (True, 5.0)
    assert found["duration_s"] < 3.0
