"""Pins the interface of policies: loading, arguments, and errors that state policy, track, scenario and tick."""

import contextlib
import hashlib
import importlib
import signal
import sys
import threading
import time

import gymnasium
import numpy as np
import pytest

from spidar_gym.benchmark import CRAWL, HOVER, Policy, PolicyError, PresetPolicy
from spidar_gym.envs.registry import ENVIRONMENTS
from spidar_gym.errors import InvalidValueError, SpidarError
from spidar_gym.policies.actor import Actor
from spidar_gym.policies.load import load_policy
from spidar_gym.policies.policy import (
    ARGUMENTS,
    KINDS,
    defined_on,
    policy_arguments,
    policy_digest,
    policy_doc,
    policy_kind,
    policy_name,
    require_spaces,
)

MODULE = '''
class Fine:
    """Does nothing.

    And says more about it.
    """

    def reset(self, seed):
        pass

    def act(self, observation):
        return [0.0] * 6


class Unready(Fine):
    def __init__(self):
        raise RuntimeError("no weights")


class Eager(Fine):
    def __init__(self, weights):
        pass


class Mute:
    def reset(self, seed):
        pass


class Unborn:
    def act(self, observation):
        pass


made = Fine()
text = "a string"
'''
PLACE = "flight-fast5, scenario 3"
ZERO = np.zeros(6)


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch):
    """Change to a folder with modules of policies; restore `sys.path` and `sys.modules` afterwards."""
    for name, text in {"mine": MODULE, "broken": "def (", "failing": "raise KeyError('data')"}.items():
        (tmp_path / f"{name}.py").write_text(text, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    importlib.invalidate_caches()
    yield tmp_path
    sys.modules.pop("mine", None)


class Does(PresetPolicy):
    """Policy whose action is the result of a function."""

    name = "does"

    def __init__(self, answer):
        self.answer = answer

    def act(self, observation):
        return self.answer()


def actor(answer, *, limit_s=60.0) -> Actor:
    return Actor(Does(answer), (6,), PLACE, limit_s=limit_s)


def forever():
    while True:
        pass


def catching():
    while True:
        with contextlib.suppress(Exception):
            forever()


def swallowing():
    try:
        forever()
    except BaseException:
        return ZERO


# Loading


def test_a_class_in_the_working_folder_is_found_and_instantiated_at_every_load():
    first, second = load_policy("mine:Fine"), load_policy("mine:Fine")
    assert isinstance(first, Policy)
    assert type(first).__name__ == "Fine"
    assert first is not second


def test_an_object_is_taken_as_it_is():
    policy = load_policy("mine:made")
    assert policy is sys.modules["mine"].made


@pytest.mark.parametrize(
    ("spec", "words"),
    [
        ("", "module:Class"), ("mine", "module:Class"), ("mine:", "module:Class"), (":Fine", "module:Class"),
        ("nowhere:Fine", "No module named 'nowhere'"), ("mine:Absent", "'Absent'"), ("mine.Fine:Fine", "mine"),
        ("broken:Fine", "SyntaxError"), ("failing:Fine", "KeyError: 'data'"), ("mine:Unready", "no weights"),
        ("mine:Eager", "weights"), ("mine:Mute", "lacks reset or act"), ("mine:Unborn", "lacks reset or act"),
        ("mine:text", "lacks reset or act"), ("nothing.npz", "nothing.npz"),
    ],
)  # fmt: skip
def test_what_is_no_policy_is_refused_in_one_line_with_valid_forms(spec, words):
    with pytest.raises(SpidarError) as refusal:
        load_policy(spec)
    message = str(refusal.value)
    assert words in message
    assert "valid" in message
    assert "\n" not in message


# Names, kinds and arguments


@pytest.mark.parametrize("name", ["mine", "mine_2", "Mine-3"])
def test_a_policy_has_its_stated_name(name):
    policy = Does(lambda: ZERO)
    policy.name = name
    assert policy_name(policy) == name


def test_a_policy_without_a_name_is_called_like_its_class_and_is_of_no_stated_kind():
    policy = load_policy("mine:Fine")
    assert policy_name(policy) == "fine"
    assert policy_kind(policy) == "unstated"
    assert policy_doc(policy) == "Does nothing."


@pytest.mark.parametrize("name", ["two words", "../up", "a/b", "a.b", "a\nb", 3])
def test_a_name_that_is_no_file_name_is_refused(name):
    policy = Does(lambda: ZERO)
    policy.name = name
    with pytest.raises(InvalidValueError, match="letters, digits, _ and -"):
        policy_name(policy)


def test_a_policy_that_names_spaces_is_refused_where_there_are_others_and_one_that_names_none_is_not():
    env, policy = gymnasium.make(HOVER), Does(lambda: ZERO)
    require_spaces(policy, HOVER, env)
    policy.observation_space, policy.action_space = env.observation_space, env.action_space
    require_spaces(policy, HOVER, env)
    # A normalising wrapper keeps the shape and changes the bounds.
    policy.observation_space = gymnasium.spaces.Box(-np.inf, np.inf, env.observation_space.shape, np.float32)
    with pytest.raises(PolicyError, match=r"policy does learned on .*-inf … inf .* has .*-400 … 400 .*; valid: "):
        require_spaces(policy, HOVER, env)


def test_a_kind_is_one_of_those_there_are_and_every_other_is_refused():
    policy = Does(lambda: ZERO)
    for kind in KINDS:
        policy.kind = kind
        assert policy_kind(policy) == kind
    policy.kind = "magic"
    with pytest.raises(InvalidValueError) as refusal:
        policy_kind(policy)
    assert all(kind in str(refusal.value) for kind in KINDS)


def test_a_policy_chooses_no_argument_some_of_those_allowed_or_not_to_be_there():
    policy = Does(lambda: ZERO)
    del policy.answer
    policy.arguments = lambda env_id: {"preset": "tuned"} if env_id == HOVER else None
    assert policy_arguments(policy, HOVER) == {"preset": "tuned"}
    assert policy_arguments(policy, CRAWL) is None
    assert defined_on(policy) == [HOVER]
    assert policy_arguments(load_policy("mine:Fine"), CRAWL) == {}
    assert defined_on(load_policy("mine:Fine")) == [*ENVIRONMENTS]
    policy.arguments = lambda env_id: dict.fromkeys(ARGUMENTS)
    assert policy_arguments(policy, HOVER) == dict.fromkeys(ARGUMENTS)


@pytest.mark.parametrize(
    "name", ["horizon_s", "sensors", "randomization", "wake", "forms", "joint_speed", "plant", "perturbation"]
)
def test_what_belongs_to_the_track_is_not_the_policys_to_choose(name):
    policy = Does(lambda: ZERO)
    policy.arguments = lambda env_id: {"preset": "paper", name: 1}
    with pytest.raises(InvalidValueError) as refusal:
        policy_arguments(policy, HOVER)
    assert name in str(refusal.value)
    assert all(argument in str(refusal.value) for argument in ARGUMENTS)


def test_arguments_that_raise_are_the_policys_error():
    policy = Does(lambda: ZERO)

    def arguments(env_id):
        raise KeyError("data")

    policy.arguments = arguments
    with pytest.raises(PolicyError, match="does"):
        policy_arguments(policy, HOVER)


def test_the_digest_is_that_of_the_policys_file_and_follows_it(here):
    policy, file = load_policy("mine:Fine"), here / "mine.py"
    first = policy_digest(policy)
    assert first == hashlib.sha256(file.read_bytes()).hexdigest()
    assert policy_digest(load_policy("mine:made")) == first
    file.write_text(MODULE + "\n# changed\n", encoding="utf-8")
    assert policy_digest(policy) == hashlib.sha256(file.read_bytes()).hexdigest() != first


def test_a_policy_with_a_path_is_that_file_and_one_without_any_file_has_no_digest(here):
    policy = Does(lambda: ZERO)
    policy.path = here / "weights"
    assert policy_digest(policy) == ""
    policy.path.write_bytes(b"weights")
    assert policy_digest(policy) == hashlib.sha256(b"weights").hexdigest()
    homeless = type("Homeless", (PresetPolicy,), {"__module__": "builtins"})()
    assert policy_digest(homeless) == ""


# Calls, with errors and time limits


@pytest.mark.parametrize(
    "answer",
    [[0.0, 0.5, -0.5, 1.0, -1.0, 0.0], tuple(ZERO), [0, 1, -1, 0, 0, 0], ZERO.astype(np.float32), ZERO.astype(np.int8)],
    ids=["list", "tuple", "whole", "float32", "int8"],
)
def test_numbers_of_the_right_shape_are_an_action(answer):
    action = actor(lambda: answer).act(ZERO)
    assert isinstance(action, np.ndarray)
    assert action.tolist() == list(answer)


@pytest.mark.parametrize(
    ("answer", "words"),
    [
        (np.full(6, np.nan), "NaN"), (np.where(np.arange(6) == 4, np.inf, 0.0), "infinity"),
        (np.where(np.arange(6) == 2, -np.inf, 0.0), "infinity"), (np.zeros(5), "shape"), (np.zeros((6, 1)), "shape"),
        (np.zeros((1, 6)), "shape"), (0.0, "shape"), ([], "shape"), (None, "object"), (["0"] * 6, "shape"),
        (np.array([None] * 6), "object"), (np.zeros(6, complex), "complex"), (np.zeros(6, bool), "bool"),
        ({"action": ZERO}, "object"), ([[0.0], [0.0, 0.0]], "act() raised ValueError"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)  # fmt: skip
def test_what_is_no_action_is_refused_with_policy_track_scenario_and_tick(answer, words):
    answers = iter([ZERO, ZERO, answer])
    careful = actor(lambda: next(answers))
    careful.act(ZERO)
    careful.act(ZERO)
    with pytest.raises(PolicyError) as refusal:
        careful.act(ZERO)
    message = str(refusal.value)
    assert f"policy does on {PLACE}, tick 2: " in message
    assert words in message


def test_a_policy_that_raises_is_named_with_what_it_raised_and_where():
    def fail():
        raise ZeroDivisionError("of my own")

    with pytest.raises(PolicyError) as refusal:
        actor(fail).act(ZERO)
    assert f"policy does on {PLACE}, tick 0: act() raised ZeroDivisionError: of my own" in str(refusal.value)
    assert isinstance(refusal.value.__cause__, ZeroDivisionError)


def test_a_policy_that_ends_the_process_is_refused_like_one_that_raises():
    with pytest.raises(PolicyError, match="SystemExit"):
        actor(lambda: sys.exit(0)).act(ZERO)


@pytest.mark.parametrize("what", ["reset", "begin"])
def test_a_policy_that_cannot_begin_is_named(what):
    policy = Does(lambda: ZERO)

    def fail(*_):
        raise ValueError("not today")

    setattr(policy, what, fail)
    with pytest.raises(PolicyError, match=f"policy does on {PLACE}.*{what}.*not today"):
        Actor(policy, (6,), PLACE, limit_s=60.0).reset(0)


def test_a_policy_learns_the_actions_length_and_the_episodes_seed():
    policy, seeds = Does(lambda: ZERO), []
    policy.reset = seeds.append
    Actor(policy, (6,), PLACE, limit_s=60.0).reset(17)
    assert seeds == [17]
    assert PresetPolicy.act(policy, ZERO).shape == (6,)


def test_ctrl_c_is_not_reported_as_an_error_of_the_policy():
    def interrupt():
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        actor(interrupt).act(ZERO)


@pytest.mark.parametrize("answer", [forever, catching, swallowing])
def test_a_policy_that_thinks_too_long_is_interrupted_whatever_it_catches(answer):
    with pytest.raises(PolicyError, match=f"{PLACE}, tick 0: took longer than 0.2 s in act"):
        actor(answer, limit_s=0.2).act(ZERO)


def test_a_reset_that_takes_too_long_is_interrupted():
    policy = Does(lambda: ZERO)
    policy.reset = lambda seed: forever()
    with pytest.raises(PolicyError, match=r"took longer than 0\.2 s in reset"):
        Actor(policy, (6,), PLACE, limit_s=0.2).reset(0)


def test_where_no_alarm_rings_a_slow_answer_is_refused_afterwards():
    raised = []

    def play():
        try:
            actor(lambda: time.sleep(0.2), limit_s=0.02).act(ZERO)
        except PolicyError as error:
            raised.append(str(error))

    thread = threading.Thread(target=play)
    thread.start()
    thread.join()
    (message,) = raised
    assert "took longer than 0.02 s" in message


@pytest.mark.parametrize("answer", [lambda: ZERO, lambda: 1 / 0, forever, swallowing], ids=range(4))
def test_the_alarm_is_as_before_after_every_answer(answer):
    def mine(*_):
        raise AssertionError

    before = signal.signal(signal.SIGALRM, mine)
    try:
        with contextlib.suppress(PolicyError):
            actor(answer, limit_s=0.2).act(ZERO)
        assert signal.getsignal(signal.SIGALRM) is mine
        assert signal.getitimer(signal.ITIMER_REAL) == (0.0, 0.0)
    finally:
        signal.signal(signal.SIGALRM, before)
