"""Pins refusals of arguments, ids, actions, options, disturbances, model files; each states what would be valid."""

import math
import pickle
import re
import shutil
from functools import partial

import gymnasium
import jaxtyping
import numpy as np
import pytest
from support.episodes import EVERY, HOVER, assert_same, flight, make, same

from spidar_gym.envs.docs import page
from spidar_gym.envs.registry import ENVIRONMENTS
from spidar_gym.errors import InvalidValueError, SpidarError, StaleAssetError, UnknownArgumentError, UnknownNameError
from spidar_gym.native import engine_binding
from spidar_gym.native.plant import Plant
from spidar_gym.robot import description
from spidar_gym.sim.config import PlantConfig
from spidar_gym.sim.sensors import SensorConfig
from spidar_gym.tasks.hover import HoverTask


@pytest.mark.parametrize(
    ("options", "kind", "valid"),
    [
        ({"forms": "form4"}, UnknownNameError, "paper, form1"),
        ({"action_mode": "torque"}, UnknownNameError, "residual_wrench, residual_joint"),
        ({"preset": "mine"}, UnknownNameError, "paper, as_flown, as_flown_quasi, tuned"),
        ({"camera": "back"}, UnknownNameError, "chase, side"),
        ({"render_mode": "rgb"}, UnknownNameError, "human, rgb_array, depth_array"),
        ({"joint_sped": 0.2}, UnknownNameError, "forms, joint_speed"),
        *(({"joint_speed": v}, InvalidValueError, r"within 1e-06 … 1000 \[rad/s\]")
          for v in (0.0, -0.2, 1001.0, math.nan, math.inf)),
        *(({"horizon_s": v}, InvalidValueError, r"within 0.001 … 86400 \[s\]")
          for v in (0.0, -1.0, 1e8, math.nan, math.inf)),
        *(({"perturbation": v}, InvalidValueError, "within 0 … 1000") for v in (-1.0, 1001.0, math.nan, math.inf)),
        *(({"idle_thrust": v}, InvalidValueError, r"0 … 42 \[N\]") for v in (-1.0, 50.0, math.nan)),
        *(({"randomization": v}, InvalidValueError, "within 0 … 1") for v in (-0.1, 1.1, math.nan, math.inf)),
        ({"max_iter": 0}, InvalidValueError, "at least 1"),
        *(({name: v}, InvalidValueError, "pixels within 1") for name in ("width", "height") for v in (0, -4, 5000)),
    ],
)  # fmt: skip
@pytest.mark.filterwarnings("ignore:.*render_mode='rgb':UserWarning")  # a warning of gymnasium before our error
def test_an_argument_that_is_not_valid_is_refused_with_what_would_be(options, kind, valid):
    with pytest.raises(kind, match=valid) as refusal:
        gymnasium.make(HOVER, **options)
    assert isinstance(refusal.value, SpidarError)
    (name, value), = options.items()  # fmt: skip
    assert repr(value) in str(refusal.value) or repr(name) in str(refusal.value)


@pytest.mark.parametrize("name", ENVIRONMENTS)
@pytest.mark.parametrize(
    ("wrong", "meant"),
    [
        ("action_mod", "action_mode"),
        ("sensor", "sensors"),
        ("randomisation", "randomization"),
        ("horizn", "horizon_s"),
    ],
)
def test_an_unknown_argument_is_refused_with_all_valid_ones_and_the_closest(name, wrong, meant):
    with pytest.raises(UnknownNameError) as refusal:
        gymnasium.make(name, **{wrong: 1.0})
    valid, guess = str(refusal.value).partition("valid: ")[2].split("; ")
    table = page(name).partition("## Arguments")[2].partition("###")[0]
    assert sorted(valid.split(", ")) == sorted(re.findall(r"^\| `(\w+)` \|", table, re.MULTILINE))
    assert guess == f"did you mean {meant}?"


@pytest.mark.parametrize("way", ["one", "native vector", "sync"])
def test_an_unknown_argument_is_a_type_error_in_pythons_words_and_a_value_error_in_one_line(way):
    options = {"plant": PlantConfig(), "frameskip": 2}
    made = {
        "one": gymnasium.make, "native vector": partial(gymnasium.make_vec, num_envs=2),
        "sync": partial(gymnasium.make_vec, num_envs=2, vectorization_mode="sync"),
    }  # fmt: skip
    with pytest.raises(UnknownArgumentError) as refusal:
        made[way](HOVER, **options)
    assert isinstance(refusal.value, TypeError)
    assert isinstance(refusal.value, ValueError)
    assert isinstance(refusal.value, UnknownNameError)
    message = str(refusal.value)
    # Clients search for these words to find supported arguments: TorchRL for `frameskip`, Gymnasium for others.
    assert message.startswith("got an unexpected keyword argument 'frameskip'; valid: ")
    assert "joint_speed" in message
    assert "\n" not in message
    assert len(message) < 800
    assert str(pickle.loads(pickle.dumps(refusal.value))) == message


@pytest.mark.parametrize("name", ["spidar_gym/Hover-v9", "spidar_gym/Hoover-v0"])
def test_an_unknown_id_is_refused(name):
    with pytest.raises(gymnasium.error.Error, match=r"v0|Hover"):
        gymnasium.make(name)


@pytest.mark.parametrize(("name", "mode"), EVERY)
def test_an_action_of_wrong_shape_or_without_a_number_is_refused_and_nothing_moves(name, mode):
    env = make(name, action_mode=mode)
    env.reset(seed=0)
    n = env.action_space.shape[0]
    before = env.plant.save()
    nan = np.zeros(n)
    nan[-1] = math.nan
    for action in (np.zeros(n + 1), np.zeros(n - 1), np.zeros((1, n)), nan, np.full(n, math.inf)):
        with pytest.raises(InvalidValueError, match=rf"\({n},\)|finite"):
            env.step(action)
    assert same(env.plant.save(), before)


def test_unknown_reset_options_and_forms_are_refused():
    env = make()
    with pytest.raises(UnknownNameError, match="form'; valid: forms, start, disturbances"):
        env.reset(options={"form": "paper"})
    with pytest.raises(UnknownNameError, match="valid: paper, form1"):
        env.reset(options={"forms": "form4"})


REFUSED = [
    {"disturbances": {"wind": 9.0}, "forms": "form3", "zzz": 1},
    {"disturbances": {"wind": 9.0}, "forms": "form4"},
    {"forms": "form3", "disturbances": {"wind": -9.0}},
    {"forms": "form3", "start": {"goals": []}},
    {"start": {"goals": [[0.0, 0.0, [0.0] * 16]], "position": [0.0] * 3, "rotation": [1e200, 1e200, 0.0]}},
    {"start": {"goals": [[0.0, 0.0, [0.0] * 16]], "position": [0.0] * 3, "rotation": [0.0] * 3, "speed": [1.0] * 3}},
    "abc", 5, [("forms", "form3")],
]  # fmt: skip


@pytest.mark.parametrize("options", REFUSED, ids=range(len(REFUSED)))
def test_a_refused_reset_leaves_the_episode_and_all_that_follow_as_they_were(options, monkeypatch):
    # Users have no type checker, which would refuse first.
    monkeypatch.setattr(jaxtyping.config, "jaxtyping_disable", True)
    zero, flights = np.zeros((3, 6)), []
    for asked in (False, True):
        env = make(forms="form1", disturbances={"push": 30.0})
        begun = flight(env, zero, seed=3)
        if asked:
            with pytest.raises(SpidarError):
                env.reset(seed=99, options=options)
        # The episode continues, and the next one draws from the unchanged generator.
        begun += [(o, r, t, i) for o, r, t, _, i in (env.step(action) for action in zero)]
        flights.append(begun + flight(env, zero) + flight(env, zero, seed=4))
    assert_same(*flights)


def test_a_start_has_no_keys_but_its_own():
    start = {"goals": [[0.0, 0.0, [0.0] * 16]], "position": [0.0] * 3, "rotation": [0.0] * 3, "speed": [1.0] * 3}
    with pytest.raises(UnknownNameError, match="key of start 'speed'; valid: goals, position, rotation, trim"):
        make().reset(options={"start": start})


STORMS = [
    ({"storm": 1.0}, UnknownNameError, "storm.*valid: wind, push, lost_rotor, fault, fault_time"),
    ({"fault": "engine"}, UnknownNameError, "engine.*valid: thrust, vectoring"),
    *(({"lost_rotor": v}, InvalidValueError, rf"lost_rotor = {v} .*1 … 8, or 0 for none") for v in (9, -1)),
    *(({"wind": v}, InvalidValueError, r"wind = .*at least 0 \[m/s\]") for v in (-1.0, math.nan, math.inf)),
    *(({"push": v}, InvalidValueError, r"push = .*at least 0 \[N\]") for v in (-1.0, math.nan)),
    *(({"fault_time": v}, InvalidValueError, r"fault_time = .*at least 0 \[s\]") for v in (-0.1, math.nan)),
]


@pytest.mark.parametrize(("disturbances", "kind", "valid"), STORMS)
def test_an_invalid_disturbance_is_refused_by_make_and_by_reset_which_keeps_the_old_ones(disturbances, kind, valid):
    with pytest.raises(kind, match=valid):
        gymnasium.make(HOVER, disturbances=disturbances)
    env = make(disturbances={"wind": 2.0})
    before = flight(env, np.zeros((3, 6)), seed=0)
    with pytest.raises(kind, match=valid):
        env.reset(seed=0, options={"disturbances": disturbances})
    assert_same(flight(env, np.zeros((3, 6)), seed=0), before)


@pytest.mark.parametrize("name", ["position_noise", "gyro_noise", "latency", "factor"])
@pytest.mark.parametrize("value", [-1e-3, math.nan])
def test_sensors_with_negative_noise_are_refused(name, value):
    with pytest.raises(InvalidValueError, match=f"{name} = .*at least 0"):
        make(plant=PlantConfig(sensors=SensorConfig(**{name: value})), sensors=True)


def test_calls_before_a_reset_are_refused():
    env = make()
    for act in (lambda: env.step(np.zeros(6)), lambda: env.state, lambda: env.reference()):
        with pytest.raises(SpidarError, match="reset"):
            act()
    with pytest.raises(gymnasium.error.ResetNeeded):
        gymnasium.make(HOVER).step(np.zeros(6))


@pytest.mark.parametrize("edit", [lambda text: text.replace("0.0025", "0.0020"), None])
def test_a_model_file_that_was_edited_or_is_missing_is_refused(edit, tmp_path, monkeypatch):
    shutil.copytree(description.assets_dir(), tmp_path / "assets")
    path = tmp_path / "assets" / "mjcf" / "spidar.xml"
    text = path.read_text(encoding="utf-8")
    path.unlink() if edit is None else path.write_text(edit(text), encoding="utf-8")
    monkeypatch.setattr(description, "assets_dir", lambda: tmp_path / "assets")
    engine_binding.scene.cache_clear()
    try:
        with pytest.raises(StaleAssetError, match="spidar assets"):
            gymnasium.make(HOVER)
        with pytest.raises(StaleAssetError, match=r"spidar\.xml"):
            Plant()
    finally:
        engine_binding.scene.cache_clear()


def test_a_table_of_terms_that_are_not_those_of_the_task_is_refused_at_the_reset():
    class Other(HoverTask):
        """A task with another table of its reward."""

        reward_terms = {**HoverTask.reward_terms, "height": (0.0, "1 where it is high")}

    for control in ("core", "python"):
        with pytest.raises(InvalidValueError, match=r"Other\.terms.*an array for each of .*action, height"):
            gymnasium.make(HOVER, task=Other, control=control).reset(seed=0)
