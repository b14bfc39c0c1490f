"""Pins the course tracks: drawn courses, repeatable episodes, equal results in Python, errors and failures."""

from dataclasses import replace

import numpy as np
import pytest

from spidar_gym.benchmark import COURSE, HOVER, TRACKS, PresetPolicy, load_scenarios
from spidar_gym.benchmark.scenario import make_env, reset_options
from spidar_gym.benchmark.scoring import play_scenario, play_scenarios
from spidar_gym.benchmark.track import BOTH, CAP, course_error
from spidar_gym.control.course.gates import parse_course
from spidar_gym.errors import InvalidValueError
from spidar_gym.policies.course import CoursePolicy
from spidar_gym.tasks.course import SIZES

COURSES = [name for name, track in TRACKS.items() if track.world == BOTH]
KINDS = {
    "course-takeoff": {"wall"},
    "course-gates": {"wall", "slot"},
    "course-mixed": {"wall", "slot", "beam", "platform", "tiles", "slope"},
}


class Rule(CoursePolicy):
    """The rule-based policy."""

    presets = {COURSE: {"action_mode": "waypoint"}}


class Lies(CoursePolicy):
    """Stays on the floor."""

    presets = {COURSE: {"action_mode": "waypoint"}}

    def act_batch(self, observations):
        return np.full((len(observations), 8), -1.0) * [1, 0, 0, 1, 0, 1, 1, 0]

    def act(self, observation):
        return self.act_batch(observation[None])[0]


def metrics(policy, track, scenario, **how):
    return play_scenario(policy, track, scenario, **how)["metrics"]


def test_these_are_the_tracks_of_courses():
    assert list(KINDS) == COURSES


@pytest.mark.parametrize("split", ["test", "validation"])
@pytest.mark.parametrize("name", COURSES)
def test_every_scenario_is_a_course_of_its_tracks_kinds_and_they_all_occur(name, split):
    seen, sizes = set(), {}
    for one in load_scenarios(name, split)[0]:
        course = parse_course(one.start)
        assert not course.dares
        for gate in course.gates:
            seen.add(gate.kind)
            sizes.setdefault(gate.kind, []).append(gate.size)
        assert one.disturbances.keys() == TRACKS[name].disturbances.keys()
        assert one.robot
    assert seen == KINDS[name]
    for kind, drawn in sizes.items():
        low, high = SIZES[kind]
        assert low - 1e-6 <= min(drawn) <= max(drawn) <= high + 1e-6
    plain = [one for one in load_scenarios(name, split)[0] if all(g.is_passed for g in parse_course(one.start).gates)]
    assert (len(plain) == 50) == (name != "course-mixed")


@pytest.mark.parametrize("name", COURSES)
def test_a_course_is_built_as_its_file_says_and_the_battery_begins_the_same(name):
    scenario, charges = load_scenarios(name)[0][7], []
    for control in ("core", "python", "core"):
        env = make_env(TRACKS[name], scenario, {"control": control})
        env.reset(seed=scenario.seed, options=reset_options(scenario))
        assert env.course == parse_course(scenario.start)
        charges.append(env.progress.charge)
        env.close()
    assert charges[0] == charges[1] == charges[2]
    assert 0.6 <= charges[0] <= 1.0


@pytest.mark.parametrize("name", COURSES)
def test_a_scenario_is_played_the_same_twice_and_side_by_side(name, monkeypatch):
    monkeypatch.setitem(TRACKS, name, replace(TRACKS[name], seconds=8.0))
    scenarios = load_scenarios(name)[0][:3]
    once = [metrics(Rule(), name, one) for one in scenarios]
    assert [metrics(Rule(), name, one) for one in reversed(scenarios)] == once[::-1]
    assert [one["metrics"] for one in play_scenarios(Rule(), name, scenarios)] == once
    assert len({one["energy_wh"] for one in once}) == 3
    assert {(one["failed"], one["failure"], one["error"]) for one in once} == {(True, "late", CAP)}


@pytest.mark.parametrize("name", ["course-takeoff", "course-mixed"])
def test_python_controllers_score_what_the_engine_does(name, monkeypatch):
    monkeypatch.setitem(TRACKS, name, replace(TRACKS[name], seconds=6.0))
    scenario = load_scenarios(name)[0][1]
    native, readable = (metrics(Rule(), name, scenario, control=control) for control in ("core", "python"))
    assert native["flown_s"] + native["crawled_s"] > 2.0
    for key, value in native.items():
        if isinstance(value, float):
            assert readable[key] == pytest.approx(value, rel=1e-5, abs=1e-6), key
        else:
            assert readable[key] == value, key


def test_over_a_wall_the_rule_arrives_and_its_error_is_what_the_formula_says():
    name = "course-takeoff"
    scenario = load_scenarios(name, "validation")[0][0]
    found, way = metrics(Rule(), name, scenario), []
    env = make_env(TRACKS[name], scenario, {})
    env.reset(seed=scenario.seed, options=reset_options(scenario))
    way.append(env.progress.initial_distance)
    env.close()
    assert (found["success"], found["failed"], found["failure"]) == (True, False, "")
    assert found["final_error_m"] < 0.03
    assert found["hit_n"] == 0.0
    assert 0.0 <= found["duration_s"] - found["flown_s"] - found["crawled_s"] < 5.0
    rest = found["final_error_m"] + 0.5 * found["final_yaw_rad"]
    error = course_error(found["duration_s"] / way[0], found["energy_wh"] / way[0], rest, 0.0, failed=False)
    assert found["error"] == pytest.approx(error, abs=1e-9)


def test_a_robot_that_stays_on_the_floor_is_late_and_costs_the_cap(monkeypatch):
    name = "course-gates"
    monkeypatch.setitem(TRACKS, name, replace(TRACKS[name], seconds=5.0))
    found = metrics(Lies(), name, load_scenarios(name)[0][0])
    assert (found["failed"], found["failure"], found["error"], found["success"]) == (True, "late", CAP, False)
    assert found["flown_s"] == 0.0
    assert found["duration_s"] == 5.0


def test_a_hover_policy_is_not_defined_on_a_course():
    policy = type("Preset", (PresetPolicy,), {"presets": {HOVER: {"preset": "paper"}}})()
    with pytest.raises(InvalidValueError, match="a track on which the policy is defined"):
        play_scenario(policy, COURSES[0], load_scenarios(COURSES[0])[0][0])
