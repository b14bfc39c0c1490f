"""Pins custom tasks in single environments and vectors: the guide's examples, starts, fields, loads, refusals."""

import json
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import gymnasium
import jaxtyping
import mujoco
import numpy as np
import pytest
from support.copies import actions_for, assert_side_by_side, copied, pickled
from support.episodes import same
from support.vectors import speed_share

from spidar_gym.control.flight.observation import Field
from spidar_gym.envs.registry import COURSE, CRAWL, HOVER, PATH, register_task
from spidar_gym.errors import InvalidValueError, SpidarError, UnknownNameError
from spidar_gym.sim.scene import scene
from spidar_gym.so3 import exp, log, matrix_to_quat
from spidar_gym.tasks.crawl import CrawlTask
from spidar_gym.tasks.hover import HoverTask
from spidar_gym.tasks.start import draw_start

EXAMPLES = Path(__file__).parents[2] / "docs" / "examples"
IDS = {"figure_of_eight": "FigureOfEight", "least_energy": "LeastEnergy", "payload": "Fetch"}


@pytest.fixture(scope="module", autouse=True)
def examples():
    """Import the guide's examples as a user does."""
    sys.path.insert(0, str(EXAMPLES))
    found = {name: __import__(name) for name in IDS}
    yield found
    sys.path.remove(str(EXAMPLES))


def example(name: str, **options) -> Any:
    return gymnasium.make(f"examples/{IDS[name]}-v0", **options)


def test_every_example_is_shorter_than_60_lines_and_tested():
    texts = {path.stem: path.read_text(encoding="utf-8") for path in EXAMPLES.glob("*.py")}
    files = {name: text for name, text in texts.items() if "register_task(" in text}
    assert files.keys() == IDS.keys()
    assert all(text.count("\n") < 60 for text in files.values())


@pytest.mark.parametrize(
    ("name", "millimetres"), [("figure_of_eight", 30.0), ("least_energy", 10.0), ("payload", 40.0)]
)
def test_the_paper_controller_solves_the_examples(name, millimetres):
    env = example(name, forms="form2")
    env.reset(seed=0)
    errors, over, info = [], False, {}
    while not over:
        *_, terminated, truncated, info = env.step(np.zeros(env.action_space.shape))
        errors.append(info["position_error"])
        over = terminated or truncated
    assert info["is_success"]
    assert 1000.0 * np.sqrt(np.square(errors).sum(axis=1).mean()) < millimetres
    assert np.linalg.norm(info["attitude_error"]) < 0.05


@pytest.mark.parametrize("mode", ["NextStep", "SameStep", "Disabled"])
@pytest.mark.parametrize("name", IDS)
def test_a_robot_of_a_vector_does_what_a_single_one_of_its_seed_does_bit_for_bit(name, mode):
    options: dict[str, Any] = {"max_episode_steps": 90, "sensors": True}
    vector: Any = gymnasium.make_vec(f"examples/{IDS[name]}-v0", num_envs=3, autoreset_mode=mode, **options)
    singles = [example(name, **options) for _ in range(3)]
    seen, info = vector.reset(seed=4)
    for k, single in enumerate(singles):
        observation, told = single.reset(seed=4 + k)
        assert np.array_equal(observation, seen[k])
        assert observation in single.observation_space
    actions = actions_for(singles[0], 200)
    over = np.zeros(3, bool)
    for action in actions:
        begins = over.copy()
        if mode == "Disabled" and over.any():
            seen, info = vector.reset(options={"reset_mask": over})
            for k in np.flatnonzero(over):
                assert np.array_equal(singles[k].reset()[0], seen[k])
            begins[:] = False
        seen, rewards, terminated, truncated, info = vector.step(np.tile(action, (3, 1)))
        over = terminated | truncated
        for k, single in enumerate(singles):
            if begins[k] and mode == "NextStep":
                expected, reward, ends, told = single.reset()[0], 0.0, False, None
            else:
                expected, reward, stops, cut, told = single.step(action)
                ends = stops or cut
            now = info["final_obs"][k] if ends and mode == "SameStep" else seen[k]
            assert np.array_equal(expected, now)
            assert (reward, ends) == (rewards[k], over[k])
            if told is not None:
                known = info["final_info"] if ends and mode == "SameStep" else info
                terms = [told[f"reward_{term}"] for term in single.unwrapped.reward_terms]
                assert terms == known["term"][k].tolist()
                assert told["is_success"] == known["is_success"][k]
            if ends and mode == "SameStep":
                assert np.array_equal(single.reset()[0], seen[k])
    vector.close()


@pytest.mark.parametrize("clone", [copied, pickled])
@pytest.mark.parametrize("name", IDS)
def test_copies_and_saved_states_continue_bit_for_bit(name, clone):
    env, other = (example(name, max_episode_steps=150, sensors=True) for _ in range(2))
    env.reset(seed=1)
    actions = actions_for(env, 240)
    for action in actions[:100]:
        env.step(action)
    other.reset(seed=9)
    shown = other.unwrapped.restore_state(env.unwrapped.save_state())
    assert same(shown, env.unwrapped._shown())
    copy = clone(env)
    assert copy.unwrapped.fleet is not env.unwrapped.fleet
    assert_side_by_side([env, copy], actions[100:])


def test_a_saved_state_can_be_restored_with_the_same_task_only(examples):
    env, plain = example("payload"), gymnasium.make(HOVER, forms="form2", preset="tuned")
    env.reset(seed=0)
    plain.reset(seed=0)
    for one, other in ((env, plain), (plain, env)):
        with pytest.raises(SpidarError, match="another"):
            one.unwrapped.restore_state(other.unwrapped.save_state())
    wide = gymnasium.make(HOVER, task=examples["figure_of_eight"].FigureOfEight(lean=0.2))
    wide.reset(seed=0)
    narrow = gymnasium.make(HOVER, task=examples["figure_of_eight"].FigureOfEight(lean=0.1))
    narrow.reset(seed=0)
    with pytest.raises(SpidarError, match="set of options"):
        narrow.unwrapped.restore_state(wide.unwrapped.save_state())


def test_the_options_of_a_task_are_options_of_reset(examples):
    kind = examples["figure_of_eight"].FigureOfEight
    env = gymnasium.make(HOVER, task=kind(), forms="form1")
    asked = gymnasium.make(HOVER, task=kind(lean=0.2, seconds=12.0), forms="form1")
    seen, _ = env.reset(seed=3, options={"lean": 0.2, "seconds": 12.0})
    assert np.array_equal(seen, asked.reset(seed=3)[0])
    for _ in range(40):
        assert np.array_equal(env.step(np.zeros(6))[0], asked.step(np.zeros(6))[0])
    assert env.unwrapped.task == kind(lean=0.2, seconds=12.0, forms="form1")
    seen, _ = env.reset(seed=3, options={"task": kind()})
    assert np.array_equal(seen, gymnasium.make(HOVER, task=kind(), forms="form1").reset(seed=3)[0])
    with pytest.raises(UnknownNameError, match=r"lean.*seconds|seconds.*lean"):
        env.reset(options={"leen": 0.2})
    vector: Any = gymnasium.make_vec(HOVER, num_envs=2, task=kind(), forms="form1")
    buffer = vector.unwrapped.buffers["observations"]
    assert np.array_equal(vector.reset(seed=3, options={"lean": 0.2, "seconds": 12.0})[0][0], asked.reset(seed=3)[0])
    assert vector.unwrapped.buffers["observations"] is buffer
    with pytest.raises(InvalidValueError, match="one value for all robots with a custom task"):
        vector.reset(options={"lean": [0.1, 0.2]})
    env.close()
    vector.close()


def test_a_task_without_a_start_leaves_its_sampling_to_the_environment():
    env, own = gymnasium.make(HOVER), gymnasium.make(HOVER, task=HoverTask())
    for seed in (0, 1, None):
        assert np.array_equal(env.reset(seed=seed)[0], own.reset(seed=seed)[0])
        for action in actions_for(env, 30):
            (seen, reward, *ends, info), (known, due, *others, told) = env.step(action), own.step(action)
            assert np.array_equal(seen, known)
            assert reward == pytest.approx(due, abs=1e-15)
            assert ends == others
            assert info.keys() == told.keys()


class Given(HoverTask):
    """An episode that begins 30 cm too high and in motion."""

    def start(self, rng):
        drawn = draw_start(self, rng)
        return replace(drawn, position=drawn.position + [0.0, 0.0, 0.3], velocity=np.full(3, 0.1))


def test_a_start_given_at_reset_replaces_that_of_the_task():
    env = gymnasium.make(HOVER, task=Given(), forms="form1")
    drawn = [env.reset(seed=0)[1]["position_error"][2], env.reset()[1]["position_error"][2]]
    assert np.ptp(drawn) > 1e-4
    np.testing.assert_allclose(drawn, -0.3, atol=0.04)
    assert env.unwrapped.state.velocity_w == pytest.approx([0.1] * 3, abs=0.02)
    given = {"goals": [[0.0, 0.0, [0.0] * 16]], "position": [0.0, 0.0, -0.1], "rotation": [0.0] * 3}
    for options in ({"start": given}, {}):
        assert env.reset(options=options)[1]["position_error"][2] == pytest.approx(0.1, abs=1e-9)
    assert env.reset(options={"start": None})[1]["position_error"][2] == pytest.approx(-0.3, abs=0.04)
    vector: Any = gymnasium.make_vec(HOVER, num_envs=2, task=Given(), forms="form1")
    _, info = vector.reset(seed=0, options={"start": [given, None]})
    np.testing.assert_allclose(info["position_error"][:, 2], [0.1, -0.3], atol=0.04)
    vector.close()


def turned(rotation: np.ndarray) -> type[HoverTask]:
    """A task whose reference attitude is rotated."""

    class Turned(HoverTask):
        def reference(self, flights):
            wanted = super().reference(flights)
            wanted["quat_wb"][:] = matrix_to_quat(exp(rotation))
            return wanted

    return Turned


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_the_attitude_error_is_that_of_the_reference_about_whichever_axis_it_turns(axis):
    """A rolled or pitched reference without a heading was once treated as level."""
    rotation = 0.1 * np.eye(3)[axis]
    for control in ("core", "python"):
        env = gymnasium.make(HOVER, task=turned(rotation)(), forms="form1", control=control)
        _, info = env.reset(seed=0)
        for _ in range(100):
            *_, info = env.step(np.zeros(6))
            R_wb = exp(rotation) @ exp(-info["attitude_error"])
            np.testing.assert_allclose(matrix_to_quat(R_wb), env.unwrapped.state.quat_wb, atol=1e-6)
        assert np.linalg.norm(info["attitude_error"]) < 0.02
        assert np.linalg.norm(log(R_wb) - rotation) < 0.02


@pytest.mark.slow
@pytest.mark.parametrize("name", IDS)
def test_an_example_runs_at_four_fifths_of_the_hovers_speed(name):
    own = gymnasium.spec(f"examples/{IDS[name]}-v0").kwargs
    options = {key: value for key, value in own.items() if key != "task"}
    built_in, task = (
        gymnasium.make_vec(HOVER, num_envs=64, **options, **asked) for asked in ({}, {"task": own["task"]})
    )
    share = speed_share(built_in, task)
    print(f"{name}: {share:.2f} of the hover's speed")
    assert share >= 0.8


# ---- loads ----


@dataclass(frozen=True)
class Loaded(HoverTask):
    """A load is picked up after 0.5 s and put down after 1.5 s."""

    mass: float = 1.0
    """Mass of the load [kg]."""
    place: tuple[float, float, float] = (0.1, -0.05, -0.2)
    """Position of the load, torso axes [m]."""
    loads = True

    def advance(self, flights):
        super().advance(flights)
        flights.load(flights.ticks == 20, self.mass, self.place)
        flights.load(np.flatnonzero(flights.ticks == 60), 0.0)


def test_a_load_is_a_point_mass_that_falls_with_the_robot():
    """Weight and moment of the load, from the bias forces with and without it."""
    env = gymnasium.make(HOVER, task=Loaded(), forms="form1")
    env.reset(seed=0)
    plant = env.unwrapped.plant
    for _ in range(20):
        env.step(np.zeros(6))
    mujoco.mj_forward(plant.model, plant.data)
    own = plant.data.qfrc_bias[:6].copy()
    heavier = plant.model.body_mass.sum()
    weight = heavier - 16.0
    assert weight == pytest.approx(1.0, abs=1e-9)
    light = scene(visual=False)
    data = mujoco.MjData(light)
    data.qpos[:], data.qvel[:] = plant.data.qpos, plant.data.qvel
    mujoco.mj_forward(light, data)
    R_wb = np.zeros(9)
    mujoco.mju_quat2Mat(R_wb, plant.data.qpos[3:7])
    R_wb = R_wb.reshape(3, 3)
    omega, arm = plant.data.qvel[3:6], np.array(Loaded().place)
    force_w = np.array([0.0, 0.0, 9.81]) + R_wb @ np.cross(omega, np.cross(omega, arm))
    np.testing.assert_allclose(own[:3] - data.qfrc_bias[:3], force_w, rtol=0, atol=1e-9)
    np.testing.assert_allclose(own[3:] - data.qfrc_bias[3:6], np.cross(arm, R_wb.T @ force_w), rtol=0, atol=1e-9)


def test_a_load_is_put_down_by_the_task_and_at_the_end_of_an_episode():
    env = gymnasium.make(HOVER, task=Loaded(), forms="form1")
    model = env.unwrapped.plant.model
    nominal = {name: getattr(model, name).copy() for name in ("body_mass", "body_inertia", "body_ipos", "body_iquat")}

    def is_nominal():
        return all(np.array_equal(getattr(model, name), value) for name, value in nominal.items())

    env.reset(seed=0)
    for tick in range(1, 80):
        env.step(np.zeros(6))
        assert is_nominal() == (not 20 <= tick < 60), tick
    first = [env.reset(seed=5), *(env.step(np.zeros(6)) for _ in range(30))]
    assert not is_nominal()
    assert same(first, [env.reset(seed=5), *(env.step(np.zeros(6)) for _ in range(30))])
    vector: Any = gymnasium.make_vec(HOVER, num_envs=2, task=Loaded(), forms="form1", max_episode_steps=30)
    vector.reset(seed=5)
    for tick in range(75):
        vector.step(np.zeros((2, 6)))
        carried = vector.unwrapped.robots["plant"]["config"]["body"]["payload_mass"]
        assert (carried > 0.0).all() == (tick % 31 >= 19 and tick % 31 < 30)
    vector.close()


def test_invalid_loads_are_refused_in_one_line():
    for task, words in (
        (Loaded(mass=-1.0), r"load = .*masses ≥ 0 kg"),
        (Loaded(mass=np.nan), r"masses ≥ 0 kg"),
        (Loaded(place=(0.0, np.inf, 0.0)), r"finite positions in m"),
    ):
        env = gymnasium.make(HOVER, task=task, max_episode_steps=30)
        with pytest.raises(InvalidValueError, match=words) as error:
            env.reset(seed=0), [env.step(np.zeros(6)) for _ in range(20)]
        assert "\n" not in str(error.value)

    class Shares(Loaded):
        loads = False

    env = gymnasium.make(HOVER, task=Shares())
    env.reset(seed=0)
    with pytest.raises(SpidarError, match="share one model; valid: a task with loads = True"):
        [env.step(np.zeros(6)) for _ in range(20)]


# ---- ids, names, refusals ----


def test_a_task_by_its_name_is_that_task_and_its_specification_survives_json():
    register_task("mine/Eight-v0", HOVER, "figure_of_eight:FigureOfEight", forms="form1")
    env = gymnasium.make("mine/Eight-v0")
    seen, _ = env.reset(seed=2)
    assert np.array_equal(
        seen, gymnasium.make(HOVER, task="figure_of_eight:FigureOfEight", forms="form1").reset(seed=2)[0]
    )
    again = gymnasium.make(gymnasium.envs.registration.EnvSpec.from_json(json.dumps(json.loads(env.spec.to_json()))))
    assert np.array_equal(again.reset(seed=2)[0], seen)
    many = gymnasium.make_vec("mine/Eight-v0", num_envs=2)
    assert np.array_equal(many.reset(seed=2)[0][0], seen)
    seen, _ = env.reset(seed=2, options={"lean": 0.2})
    assert env.unwrapped.task.lean == 0.2
    del gymnasium.registry["mine/Eight-v0"]


class Heavy(HoverTask):
    reward_terms = {"position": (0.7, "")}


class Endless(HoverTask):
    failures = {"contact": ""}


@dataclass(frozen=True)
class Named(HoverTask):
    preset: str = "paper"


@pytest.mark.parametrize(
    ("name", "options", "words"),
    [
        (HOVER, {"task": CrawlTask()}, "an object of a class derived from HoverTask"),
        (PATH, {"task": 3}, "an object of a class derived from PathTask"),
        (PATH, {"task": HoverTask()}, "an object of a class derived from PathTask"),
        (CRAWL, {"task": HoverTask()}, "an object of a class derived from CrawlTask"),
        (COURSE, {"task": HoverTask()}, "an object of a class derived from CourseTask"),
        (HOVER, {"task": Heavy()}, "weights that add up to 1"),
        (HOVER, {"task": Endless}, "failures with diverged"),
        (HOVER, {"task": Named()}, "a task without options named preset"),
        (HOVER, {"task": "nowhere:Task"}, r"module:Class of an importable task \(No module named 'nowhere'\)"),
        (HOVER, {"task": "payload:Missing"}, "module:Class of an importable task"),
        (HOVER, {"task": "payload"}, "module:Class of an importable task"),
    ],
    ids=lambda value: "" if isinstance(value, dict) else str(value)[:20],
)  # fmt: skip
def test_invalid_tasks_are_refused_in_one_line(monkeypatch, name, options, words):
    # Users have no type checker, which would refuse first.
    monkeypatch.setattr(jaxtyping.config, "jaxtyping_disable", True)
    makers = [gymnasium.make] + ([gymnasium.make_vec] if not {"law", "control"} & options.keys() else [])
    for make in makers:
        with pytest.raises(InvalidValueError, match=words) as error:
            make(name, **options)
        assert "\n" not in str(error.value)


class Watched(HoverTask):
    fields = (Field("height", 1, 2.0, "m", ""), Field("way", 2, 1.0, "m", ""))

    def observe(self, flights):
        state = flights.state
        return {"height": state["position_w"][:, 2], "way": 100.0 * state["position_w"][:, :2]}


def test_custom_fields_are_appended_to_the_observation_within_their_bounds():
    env, plain = gymnasium.make(HOVER, task=Watched()), gymnasium.make(HOVER)
    seen, _ = env.reset(seed=0)
    size = plain.observation_space.shape[0]
    assert env.observation_space.shape == (size + 3,)
    assert np.array_equal(seen[:size], plain.reset(seed=0)[0])
    for action in actions_for(env, 20):
        seen, *_ = env.step(action)
        x, y, z = env.unwrapped.state.position_w
        expected = np.float32([z, *np.clip([100.0 * x, 100.0 * y], -1.0, 1.0)])
        assert np.array_equal(seen[size:], expected)
        assert np.array_equal(seen[:size], plain.step(action)[0])
    assert [f.name for f in env.unwrapped.layout[-2:]] == ["height", "way"]
    with pytest.raises(InvalidValueError, match="a task with the same fields"):
        env.reset(options={"task": HoverTask()})
    assert np.array_equal(env.step(np.zeros(6))[0][:size], plain.step(np.zeros(6))[0])


@pytest.mark.parametrize(
    ("shown", "words"),
    [
        (None, "a dictionary with an array for each of height, way"),
        ({"height": np.zeros(1)}, "a dictionary with an array for each of height, way"),
        ({"height": np.zeros(1), "way": np.zeros(1)}, r"observe: way = \(1,\).*an array of shape \(1, 2\)"),
        ({"height": np.zeros((1, 3)), "way": np.zeros((1, 2))}, r"observe: height = \(1, 3\).*shape \(1, 1\)"),
    ],
    ids=["nothing", "too few", "one number", "too many"],
)
def test_fields_of_another_shape_are_refused_in_one_line(monkeypatch, shown, words):
    monkeypatch.setattr(Watched, "observe", lambda self, flights: shown)
    with pytest.raises(InvalidValueError, match=words) as error:
        gymnasium.make(HOVER, task=Watched()).reset(seed=0)
    assert "\n" not in str(error.value)


def test_custom_tasks_of_crawls_work_too():
    class Far(CrawlTask):
        fields = (Field("height", 1, 2.0, "m", "of the torso"),)

        def observe(self, walks):
            return {"height": walks.state["position_w"][:, 2]}

        def failed(self, walks):
            return {**super().failed(walks), "tilt": walks.ticks >= 25}

    env, vector = gymnasium.make(CRAWL, task=Far()), gymnasium.make_vec(CRAWL, num_envs=2, task=Far())
    seen, _ = env.reset(seed=3)
    assert np.array_equal(vector.reset(seed=3)[0][0], seen)
    actions = actions_for(env, 25)
    for tick, action in enumerate(actions, 1):
        seen, reward, terminated, _, info = env.step(action)
        many, rewards, over, *_ = vector.step(np.tile(action, (2, 1)))
        assert np.array_equal(seen, many[0])
        assert (reward, terminated) == (rewards[0], over[0])
        assert terminated == (tick == 25)
        assert (info["failure"] == "tilt") == terminated
        assert seen[-1] == np.float32(env.unwrapped.state.position_w[2])
    vector.close()
