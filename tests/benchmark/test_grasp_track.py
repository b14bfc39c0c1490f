"""Pins the grasp tracks: drawn scenes, equal results side by side and in Python, the error, who may be told what."""

from dataclasses import replace

import numpy as np
import pytest

from baselines.grasp import GraspRule, GraspTold
from spidar_gym.benchmark import GRASP, TRACKS, PresetPolicy, load_scenarios
from spidar_gym.benchmark.scenario import make_env, reset_options
from spidar_gym.benchmark.scoring import play_scenario, play_scenarios
from spidar_gym.benchmark.track import CAP, GRASPING, grasp_error
from spidar_gym.control.grasp.phases import SAFE_GRIP
from spidar_gym.control.grasp.scene import LESS_PER_KG, needed_force, parse_scene
from spidar_gym.errors import InvalidValueError
from spidar_gym.tasks.grasp import RESERVE

GRASPS = [name for name, track in TRACKS.items() if track.world == GRASPING]
SPLITS = ("test", "validation", "second")


def metrics(policy, track, scenario, **how):
    return play_scenario(policy, track, scenario, **how)["metrics"]


def test_these_are_the_tracks_of_grasps():
    assert GRASPS == ["grasp-claw", "grasp-boxes", "grasp-fragile"]
    assert all(TRACKS[name].splits == SPLITS for name in GRASPS)


@pytest.mark.parametrize("split", SPLITS)
@pytest.mark.parametrize("name", GRASPS)
def test_every_scene_is_within_its_tracks_ranges_and_can_be_held(name, split):
    task = TRACKS[name].options
    scenes = [parse_scene(one.start) for one in load_scenarios(name, split)[0]]
    for scene in scenes:
        needed = needed_force(scene.mass, scene.com, scene.half_size[0], scene.friction)
        assert RESERVE * needed <= min(scene.most_force, SAFE_GRIP - LESS_PER_KG * scene.mass) + 1e-4
        for key in ("mass", "friction", "most_force", "stand", "floor"):
            low, high = task.get(key, (0.0, 40.0))
            assert low - 1e-6 <= getattr(scene, key) <= high + 1e-6
    assert {scene.shape for scene in scenes} == ({"ball"} if name == "grasp-claw" else {"box", "cylinder"})
    assert len({scene.start.x for scene in scenes}) == 50
    windy = [one for one in load_scenarios(name, split)[0] if one.disturbances]
    assert bool(windy) == (name != "grasp-claw")
    assert len(windy) < 45


@pytest.mark.parametrize("name", GRASPS)
def test_a_scene_is_built_as_its_file_says(name):
    scenario = load_scenarios(name)[0][7]
    for control in ("core", "python"):
        env = make_env(TRACKS[name], scenario, {"control": control})
        env.reset(seed=scenario.seed, options=reset_options(scenario))
        found, wanted = env.scene, parse_scene(scenario.start)
        for key, value in vars(wanted).items():
            np.testing.assert_array_equal(getattr(found, key), value)
        assert env.plant.config.object.mass == pytest.approx(wanted.mass)
        env.close()


@pytest.mark.parametrize("name", GRASPS)
def test_a_scenario_is_played_the_same_twice_and_side_by_side(name, monkeypatch):
    monkeypatch.setitem(TRACKS, name, replace(TRACKS[name], seconds=8.0))
    scenarios = load_scenarios(name)[0][:3]
    once = [metrics(GraspRule(), name, one) for one in scenarios]
    assert [metrics(GraspRule(), name, one) for one in reversed(scenarios)] == once[::-1]
    assert [one["metrics"] for one in play_scenarios(GraspRule(), name, scenarios)] == once
    assert len({one["energy_wh"] for one in once}) == 3
    assert {(one["failed"], one["failure"], one["error"]) for one in once} == {(True, "late", CAP)}


def test_python_controllers_score_what_the_engine_does(monkeypatch):
    name = "grasp-boxes"
    monkeypatch.setitem(TRACKS, name, replace(TRACKS[name], seconds=9.0))  # until the contact
    scenario = load_scenarios(name)[0][1]
    native, readable = (metrics(GraspRule(), name, scenario, control=control) for control in ("core", "python"))
    for key, value in native.items():
        if isinstance(value, float):
            assert readable[key] == pytest.approx(value, rel=1e-5, abs=1e-6), key
        else:
            assert readable[key] == value, key


def test_an_object_is_delivered_with_the_error_of_the_formula():
    found = metrics(GraspRule(), "grasp-claw", load_scenarios("grasp-claw", "validation")[0][0])
    assert (found["success"], found["failed"], found["failure"], found["tries"]) == (True, False, "", 1)
    assert found["lifted_m"] > 0.6
    rest = found["final_error_m"] + 0.5 * found["final_yaw_rad"]
    error = grasp_error(found["duration_s"], found["energy_wh"], rest, found["force_share"], failed=False)
    assert found["error"] == pytest.approx(error, abs=1e-9)


def test_mass_and_friction_are_told_only_to_a_policy_that_says_it_is_a_ceiling():
    scenario = load_scenarios("grasp-boxes")[0][0]
    told = type("Told", (PresetPolicy,), {"presets": {GRASP: {"grip": "told"}}})()
    with pytest.raises(InvalidValueError, match="class ceiling"):
        play_scenario(told, "grasp-boxes", scenario)
    assert GraspTold.kind == "ceiling"
