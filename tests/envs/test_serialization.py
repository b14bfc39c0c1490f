"""Pins copies and saved states of an environment: each continues bit for bit, alone, or is refused in one line."""

import copy
import hashlib
import pickle
import subprocess
import sys
from pathlib import Path

import gymnasium
import jaxtyping
import numpy as np
import pytest
from support.copies import (
    CONTROLS,
    HARDEST,
    ROUGH,
    WEATHER,
    Braced,
    ClimbEnv,
    Filtered,
    Hurrying,
    Reluctant,
    Restless,
    actions_for,
    assert_side_by_side,
    copied,
    hardest,
    pickled,
    taken,
    went,
)
from support.episodes import same

from spidar_gym.control.course.gates import Course, Gate
from spidar_gym.control.crawl.pose2 import Pose2
from spidar_gym.envs.hover_env import HoverEnv
from spidar_gym.envs.registry import COURSE, CRAWL, HORIZON, HOVER
from spidar_gym.envs.serialization import checks, environments
from spidar_gym.envs.vector import NativeVectorEnv
from spidar_gym.errors import SpidarError
from spidar_gym.native import library
from spidar_gym.robot import FORMS
from spidar_gym.sim.body import BodyConfig
from spidar_gym.sim.config import PlantConfig

CLIMB = "test_moments/Climb-v0"
gymnasium.register(CLIMB, entry_point=ClimbEnv, max_episode_steps=100, additional_wrappers=(HORIZON,))
EVERY = [(name, control) for name in HARDEST for control in CONTROLS]
LONG = [pytest.param(*case, marks=pytest.mark.slow if case[1] == "python" else []) for case in EVERY]
WAYS = [copied, pickled]
START = {
    "goals": [[0.0, 0.0, FORMS["form2"].tolist()], [0.5, 0.75, FORMS["form1"].tolist()],
              [2.0, 9.0, FORMS["form3"].tolist()]],
    "position": [0.02, -0.01, 0.03], "rotation": [0.03, -0.02, 0.01], "trim": None,
}  # fmt: skip


def begun(env, ticks=40, seed=3, options=None):
    """An environment in the middle of an episode."""
    env.reset(seed=seed, options=options)
    for action in actions_for(env, ticks, seed=1):
        taken(env, action)
    return env


def restored(env, make):
    """Another instance, in another state, which restores this state."""
    other = begun(make(), ticks=3, seed=8)
    observation, info = other.unwrapped.restore_state(env.unwrapped.save_state())
    assert other.observation_space.contains(observation)
    assert info.keys() == env.unwrapped._shown()[1].keys()
    return other


# ---- continuation ----


@pytest.mark.parametrize(("name", "control"), LONG)
def test_a_copy_a_pickle_and_a_saved_state_continue_like_the_original_for_200_steps_bit_for_bit(name, control):
    def make():
        return hardest(name, control)

    env = begun(make())
    others = [copied(env), pickled(env), restored(env, make)]
    assert_side_by_side([env, *others], actions_for(env, 200, seed=2))


@pytest.mark.parametrize(("name", "control"), EVERY)
def test_a_copy_of_an_environment_that_was_never_reset_begins_the_same_episodes(name, control):
    env = hardest(name, control)
    envs = [env, copied(env), pickled(env)]
    for seed in (4, None):
        first, *others = [each.reset(seed=seed) for each in envs]
        assert [same(first, other) for other in others] == [True, True]
        assert_side_by_side(envs, actions_for(env, 5))


@pytest.mark.parametrize(("name", "control"), EVERY)
def test_a_copy_does_not_affect_the_original_and_closing_one_leaves_the_other_usable(name, control):
    env = begun(hardest(name, control), ticks=10)
    actions = actions_for(env, 12, seed=2)
    expected = went(pickled(env), actions)
    for way in WAYS:
        wild = way(env)
        went(wild, actions_for(env, 5, seed=7))
        wild.reset(seed=9)
        wild.close()
    left = copied(env)
    assert same(went(env, actions), expected)
    env.close()
    assert same(went(left, actions), expected)


@pytest.mark.parametrize("control", CONTROLS)
def test_a_bare_environment_is_copied_saved_and_restored_too_even_into_one_that_was_never_reset(control):
    options = {"control": control, **ROUGH, **HARDEST[HOVER]}
    env = begun(HoverEnv(**options), ticks=5)
    fresh = HoverEnv(**options)
    fresh.restore_state(env.save_state())
    assert_side_by_side([env, copied(env), pickled(env), fresh], actions_for(env, 30))


@pytest.mark.parametrize("control", CONTROLS)
def test_gymnasiums_wrappers_require_a_reset_before_a_restored_environment_is_stepped(control):
    env = begun(hardest(HOVER, control), ticks=5)
    other = hardest(HOVER, control)
    other.unwrapped.restore_state(env.unwrapped.save_state())
    with pytest.raises(gymnasium.error.ResetNeeded, match=r"before calling env\.reset"):
        other.step(np.zeros(env.action_space.shape))


IN_ANOTHER_PROCESS = """
import hashlib, pickle, sys
import gymnasium, numpy as np, spidar_gym
from pathlib import Path
env = pickle.loads(Path(sys.argv[1]).read_bytes())
other = gymnasium.make(env.spec)
other.reset(seed=0)
other.unwrapped.restore_state(Path(sys.argv[2]).read_bytes())
for each in (env, other):
    shown = b"".join(each.step(np.full(each.action_space.shape, 0.02 * (k % 5)))[0].tobytes() for k in range(20))
    print(hashlib.sha256(shown).hexdigest())
"""


@pytest.mark.parametrize(("name", "control"), [(HOVER, "core"), (CRAWL, "python"), (COURSE, "python")])
def test_a_pickle_and_a_saved_state_continue_in_another_process(name, control, tmp_path: Path):
    env = begun(hardest(name, control), ticks=12)
    files = [tmp_path / "pickle", tmp_path / "state"]
    files[0].write_bytes(pickle.dumps(env))
    files[1].write_bytes(env.unwrapped.save_state())
    told = subprocess.run(
        [sys.executable, "-c", IN_ANOTHER_PROCESS, *map(str, files)], capture_output=True, text=True, check=True
    ).stdout.split()
    shape = env.action_space.shape
    shown = b"".join(env.step(np.full(shape, 0.02 * (k % 5)))[0].tobytes() for k in range(20))
    assert told[-2:] == [hashlib.sha256(shown).hexdigest()] * 2


@pytest.mark.parametrize("control", CONTROLS)
@pytest.mark.parametrize(
    ("name", "options"),
    [
        (HOVER, {"start": START, "disturbances": {"lost_rotor": 2, "fault_time": 0.6}}),
        (HOVER, {"forms": "equal", "disturbances": WEATHER}),
        (COURSE, {"course": Course((Gate("beam", 3.0, 3.4, 0.8),), Pose2(6.0))}),
    ],
    ids=["start", "forms", "course"],
)
def test_options_of_reset_are_copied_for_this_episode_and_later_ones(name, options, control):
    def make():
        return gymnasium.make(name, control=control, max_episode_steps=40, **({"hold": 1} if name == COURSE else {}))

    env = begun(make(), ticks=15, options=options)
    others = [copied(env), pickled(env), restored(env, make)]
    assert_side_by_side([env, *others], actions_for(env, 70, seed=2))


@pytest.mark.parametrize(
    ("name", "options"),
    [
        (HOVER, {"law": Braced}), (HOVER, {"law": Restless}), (HOVER, {"allocator": Reluctant}),
        (CRAWL, {"law": Hurrying}), (CLIMB, {"control": "core"}), (CLIMB, {"control": "python"}),
    ],
    ids=["Braced", "Restless", "Reluctant", "Hurrying", "Climb of the core", "Climb in Python"],
)  # fmt: skip
def test_the_state_of_custom_control_laws_allocators_and_environments_is_copied(name, options):
    def make():
        return gymnasium.make(name, max_episode_steps=30, **ROUGH, disturbances=WEATHER, **options)

    env = begun(make(), ticks=15)
    others = [copied(env), pickled(env), restored(env, make)]
    assert_side_by_side([env, *others], actions_for(env, 30, seed=2))
    # Saved before the subclass has stored anything, restored into an instance which has.
    env.reset(seed=1)
    later = restored(env, make)
    assert_side_by_side([env, later], actions_for(env, 10, seed=3))


def test_a_control_law_with_unsupported_state_is_copied_but_not_saved():
    env = begun(gymnasium.make(HOVER, law=Filtered), ticks=5)
    with pytest.raises(
        SpidarError, match=r"^controller\.weigh is a builtins\.function, which cannot be saved; valid:"
    ) as error:
        env.unwrapped.save_state()
    assert "\n" not in str(error.value)
    assert_side_by_side([env, copied(env)], actions_for(env, 10))


# ---- the robot's state ----


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("control", CONTROLS)
def test_changes_to_mujocos_data_and_model_are_copied(control, way):
    env = begun(gymnasium.make(HOVER, control=control), ticks=3)
    env.unwrapped.plant.data.qpos[2] += 0.1
    env.unwrapped.plant.model.opt.gravity[2] = -3.7
    other = way(env)
    assert other.unwrapped.plant.data.qpos[2] == env.unwrapped.plant.data.qpos[2]
    assert_side_by_side([env, other], actions_for(env, 20))
    assert (
        env.unwrapped.state.position_w[2]
        > begun(gymnasium.make(HOVER, control=control), 23).unwrapped.state.position_w[2]
    )


@pytest.mark.parametrize("control", CONTROLS)
def test_a_diverged_robot_is_copied_and_saved_and_can_be_reset(control):
    def make():
        return gymnasium.make(HOVER, control=control)

    env = begun(make(), ticks=3)
    env.unwrapped.plant.data.qvel[:] = 1e30
    observation, reward, terminated, _, info = env.step(np.zeros(6))
    assert (reward, terminated, info["failure"]) == (0.0, True, "diverged")
    others = [copied(env), pickled(env), restored(env, make)]
    for other in others:
        shown = other.unwrapped._shown()
        assert np.array_equal(shown[0], observation)
        assert shown[1]["failure"] == "diverged"
    for each in (env, *others):
        each.reset()
    assert_side_by_side([env, *others], actions_for(env, 10))


@pytest.mark.parametrize("control", CONTROLS)
def test_restore_returns_the_results_of_the_last_step(control):
    env = begun(hardest(CRAWL, control), ticks=20)
    observation, *_, info = env.step(actions_for(env, 1)[0])
    other = begun(hardest(CRAWL, control), ticks=0, seed=1)
    assert same(other.unwrapped.restore_state(env.unwrapped.save_state()), (observation, info))


@pytest.mark.parametrize("control", CONTROLS)
def test_a_copy_renders_with_a_separate_context(control):
    env = begun(gymnasium.make(CRAWL, control=control, steps=0.03, render_mode="rgb_array", width=160, height=120), 3)
    env.render()
    other = copied(env)
    assert other.unwrapped.view._renderer is None
    picture = other.render()
    assert np.array_equal(picture, env.render())
    env.close()
    assert np.array_equal(other.render(), picture)
    other.close()


# ---- refusals ----


@pytest.mark.parametrize(("name", "control"), EVERY)
def test_every_attribute_that_is_saved_of_our_own_classes_has_a_kind(name, control):
    env = begun(hardest(name, control), ticks=3).unwrapped
    for path, part in env._parts():
        if not isinstance(part, environments.IN_BYTES):
            kinds = checks.KEPT_BY_ENVIRONMENTS if part is env else checks.KEPT[type(part)]
            assert {*environments._names(part)} <= {*kinds, "task"}, path


def test_what_does_not_fit_is_refused_in_one_line_and_nothing_has_changed(monkeypatch):
    options = {"forms": "form1", "control": "python"}
    env = HoverEnv(**options)
    with pytest.raises(SpidarError, match="call reset"):
        env.save_state()
    begun(env, ticks=5)
    saved = env.save_state()
    begun(env, ticks=9, seed=4)
    expected, actions = copied(env), actions_for(env, 20)
    vector = NativeVectorEnv(HOVER, 1)
    vector.reset(seed=0)
    foreign = {
        "another environment: 'CrawlEnv'; valid here: HoverEnv": begun(gymnasium.make(CRAWL), 0),
        "another controller: 'core'; valid here: python, FlightController, Allocator": begun(HoverEnv(), 0),
        "another controller: 'python, support.copies.Braced, Allocator'": begun(HoverEnv(law=Braced, forms="form1"), 0),
        "another set of options": begun(HoverEnv(joint_speed=0.5, **options), 0),
        "another set of options: ": begun(HoverEnv(sensors=True, **options), 0),
        "another set of options: .* valid": begun(HoverEnv(preset="tuned", **options), 0),
        "another set of options: '[0-9a-f]{16}'": begun(
            HoverEnv(plant=PlantConfig(body=BodyConfig(total_mass=17.0)), **options), 0
        ),
        "another length of an episode: 60; valid here: 800": begun(
            gymnasium.make(HOVER, max_episode_steps=60, **options), 0
        ),
    }
    with monkeypatch.context() as patch:
        patch.setattr(library.mujoco, "__version__", "5.0.0")
        newer = env.save_state()
    tries = [(each.unwrapped.save_state(), words) for words, each in foreign.items()]
    tries += [(newer, r"another version: .* MuJoCo 5\.0\.0'; valid here")]
    for given in (b"", b"nothing of ours", saved[:-1], saved + b"0", vector.save()):
        tries.append((given, "no saved state, or a damaged one"))
    for place in range(100, len(saved), len(saved) // 20):
        damaged = bytearray(saved)
        damaged[place] ^= 1
        tries.append((bytes(damaged), "damaged"))
    tries += [(given, "is no saved state; valid: the bytes") for given in (None, "saved", 3, bytearray(saved))]
    # Users have no type checker, which would refuse first.
    monkeypatch.setattr(jaxtyping.config, "jaxtyping_disable", True)
    for given, words in tries:
        with pytest.raises(SpidarError, match=words) as error:
            env.restore_state(given)
        assert "\n" not in str(error.value)
    assert_side_by_side([env, expected], actions)
    env.restore_state(saved)
    with pytest.raises(SpidarError, match="no saved robots"):
        vector.restore(saved)


@pytest.mark.parametrize("name", HARDEST)
def test_a_closed_environment_of_the_engine_is_not_copied(name):
    env = begun(gymnasium.make(name, control="core"), 0)
    env.close()
    for way in WAYS:
        with pytest.raises(SpidarError, match="is closed; valid: a new one"):
            way(env)


def test_a_copy_that_would_share_the_robot_is_refused():
    with pytest.raises(SpidarError, match=r"share one robot; valid: copy\.deepcopy"):
        copy.copy(HoverEnv())


def test_a_pickle_of_another_version_is_refused(monkeypatch):
    packed = pickle.dumps(HoverEnv())
    monkeypatch.setattr(library.mujoco, "__version__", "5.0.0")
    with pytest.raises(SpidarError, match=r"another version: .*; valid here: .*5\.0\.0"):
        pickle.loads(packed)


def test_the_preview_of_a_copied_control_law_is_that_of_its_environment():
    env = begun(gymnasium.make(HOVER, law=Restless), 0)
    for other in (copied(env), pickled(env), copy.deepcopy(copied(env))):
        assert other.unwrapped.controller.preview.__self__ is other.unwrapped
