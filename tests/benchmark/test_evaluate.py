"""Pins evaluation: choice of scenarios, equal metrics in one process, in two and on Ray, resuming."""

import hashlib
import importlib
import json
import os
import pickle
import sys
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from spidar_gym.benchmark import HOVER, TRACKS, PolicyError, PresetPolicy, Score, evaluate, load_scenarios
from spidar_gym.benchmark.evaluate import Shard
from spidar_gym.benchmark.metrics import told_in
from spidar_gym.benchmark.resume import code_digest
from spidar_gym.benchmark.scenario import make_env, reset_options
from spidar_gym.benchmark.track import CAP, SCENARIOS
from spidar_gym.errors import (
    InvalidValueError,
    MissingDependencyError,
    SpidarError,
    StaleAssetError,
    UnknownNameError,
)

ROOT = Path(__file__).resolve().parents[2]
# `spidar_gym.benchmark.evaluate` is also the name of the function.
module = importlib.import_module("spidar_gym.benchmark.evaluate")
QP, HOLD, TRACK = "baselines.qp:QP", "baselines.hold:Hold", "flight-fast5"
MODULE = '''
class Zero:
    """Adds nothing."""

    def reset(self, seed):
        pass

    def act(self, observation):
        return [0.0] * 6


class Fails(Zero):
    def act(self, observation):
        if list(observation[:3]) == {first}:
            raise RuntimeError("not this one")
        return [0.0] * 6


class Nonsense(Zero):
    def arguments(self, env_id):
        return {{"action_mode": "nonsense"}}
'''


class Zero(PresetPolicy):
    """Adds nothing."""

    presets = {HOVER: {}}


@cache
def first_seen():
    """Beginning of a scenario's first observation, by which a policy can distinguish the scenario from others."""
    scenario = load_scenarios(TRACK)[0][2]
    env = make_env(TRACKS[TRACK], scenario, {"control": "core"})
    return env.reset(seed=scenario.seed, options=reset_options(scenario))[0][:3].tolist()


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch):
    """A working folder with a module of policies; the baselines are importable."""
    folder = tmp_path / "here"
    folder.mkdir()
    (folder / "mine.py").write_text(MODULE.format(first=first_seen()), encoding="utf-8")
    monkeypatch.chdir(folder)
    monkeypatch.setattr(sys, "path", [str(ROOT), *sys.path])
    importlib.invalidate_caches()
    yield folder
    sys.modules.pop("mine", None)


@pytest.fixture
def short(monkeypatch):
    """A flight of a quarter of a second."""
    monkeypatch.setitem(TRACKS, TRACK, replace(TRACKS[TRACK], seconds=0.25))


@pytest.fixture
def played(monkeypatch):
    """Indices of the scenarios that are really evaluated, in order."""
    indices, play_shards = [], module.play_shards

    def spy(shards):
        indices.extend(shard.scenario.index for shard in shards)
        return play_shards(shards)

    monkeypatch.setattr(module, "play_shards", spy)
    return indices


@cache
def whole(spec=QP) -> Score:
    """The first two scenarios, not shortened, one after the other in this process."""
    return evaluate(spec, TRACK, 2)


def kept(folder: Path) -> list[Path]:
    return sorted(path for path in folder.rglob("*") if path.is_file())


def refused(error, *arguments, **options) -> str:
    with pytest.raises(error) as refusal:
        evaluate(*arguments, **options)
    assert isinstance(refusal.value, SpidarError)
    assert "\n" not in str(refusal.value)
    return str(refusal.value)


# Which scenarios


def test_a_number_selects_the_first_scenarios_and_a_list_exactly_these_in_its_order(short):
    first, chosen = evaluate("mine:Zero", TRACK, 3), evaluate("mine:Zero", TRACK, [2, 0])
    assert first.indices == (0, 1, 2)
    assert chosen.indices == (2, 0)
    for name, values in first.metrics.items():
        assert chosen.metrics[name] == [values[2], values[0]]
    assert len(set(first.errors)) == 3
    assert evaluate("mine:Zero", TRACK, np.array([1]).tolist()).errors == first.errors[1]


def test_without_a_number_every_scenario_is_played(monkeypatch):
    monkeypatch.setitem(TRACKS, TRACK, replace(TRACKS[TRACK], seconds=0.05))
    score = evaluate("mine:Zero", TRACK)
    assert score.indices == tuple(range(SCENARIOS))
    assert len(score.errors) == len(score.timing) == SCENARIOS


def test_a_score_says_what_it_is_of(short):
    score = evaluate("mine:Zero", TRACK, [4], split="validation")
    assert (score.track, score.split, score.indices) == (TRACK, "validation", (4,))
    assert score.scenarios_sha256 == load_scenarios(TRACK, "validation")[1]
    assert list(score.metrics) == list(told_in(TRACKS[TRACK].world))
    assert score.errors.tolist() == score.metrics["error"]
    assert score.errors != evaluate("mine:Zero", TRACK, [4]).errors
    assert score.success == float(score.metrics["success"][0])


@pytest.mark.parametrize("scenarios", [0, -1, SCENARIOS + 1, [SCENARIOS], [-1], [0, 99]])
def test_scenarios_out_of_range_are_refused_before_any_evaluation(scenarios, played):
    message = refused(InvalidValueError, "mine:Zero", TRACK, scenarios)
    assert f"1 … {SCENARIOS}" in message or f"0 … {SCENARIOS - 1}" in message
    assert played == []


def test_unknown_tracks_splits_and_policies_are_refused():
    assert TRACK in refused(UnknownNameError, "mine:Zero", "flight")
    assert "validation" in refused(UnknownNameError, "mine:Zero", TRACK, 1, split="train")
    assert "valid" in refused(PolicyError, "mine:Missing", TRACK, 1)
    assert "ground-paper" in refused(InvalidValueError, HOLD, "ground-paper", 1)


def test_zero_processes_are_refused():
    assert "workers" in refused(InvalidValueError, "mine:Zero", TRACK, 1, workers=0)


# Where it is played


@pytest.mark.parametrize("spec", [HOLD, pytest.param(QP, marks=pytest.mark.slow)])
def test_two_processes_give_what_one_gives_bit_for_bit(spec):
    done = []
    score = evaluate(spec, TRACK, 2, workers=2, on_scenario=lambda: done.append(1))
    assert score.metrics == whole(spec).metrics
    assert len(done) == 2
    assert (score.errors < CAP).all() == (spec == QP)


def test_a_policy_object_scores_the_same_as_its_specification(short):
    done = []
    score = evaluate(Zero(), TRACK, [1, 3], on_scenario=lambda: done.append(1))
    assert score.metrics == evaluate("mine:Zero", TRACK, [1, 3]).metrics
    assert len(done) == 2


def test_a_policy_receives_the_number_of_the_run_and_nothing_of_the_scenario(short):
    """With the scenario's seed a policy could compute the randomised robot and the future wind."""
    told = []

    class Alone(Zero):
        def reset(self, seed):
            told.append(seed)

        def act(self, observation):
            return np.zeros(6)

    class Many(Zero):
        def reset(self, seed):  # called for a scenario that is evaluated alone
            told.append(seed)

        def reset_batch(self, seeds):
            told.extend(seeds)

        def act_batch(self, observations):
            return np.zeros((len(observations), 6))

    for policy in (Alone(), Many()):
        evaluate(policy, TRACK, [4, 7], run=3)
        evaluate(policy, TRACK, [9])
        assert told == [3, 3, 0]
        told.clear()


@pytest.mark.parametrize("options", [{"workers": 2}, {"folder": Path("kept")}, {"ray": "local"}], ids=str)
def test_an_object_plays_in_this_process_only(options, here):
    assert "module:Class" in refused(InvalidValueError, Zero(), TRACK, 1, **options)
    assert not (here / "kept").exists()


@pytest.mark.parametrize("workers", [1, 2])
def test_an_error_of_a_policy_has_the_same_message_in_every_process(workers):
    message = refused(UnknownNameError, "mine:Nonsense", TRACK, 2, workers=workers)
    assert "residual_wrench" in message


@pytest.mark.parametrize(
    "error",
    [SpidarError("words"), PolicyError("words"), UnknownNameError("form", "x", ["y"]), StaleAssetError("file"),
     InvalidValueError("name", 1, "2"), MissingDependencyError("Ray", "pip")],
    ids=lambda error: type(error).__name__,
)  # fmt: skip
def test_every_refusal_comes_through_from_another_process(error):
    again = pickle.loads(pickle.dumps(error))
    assert type(again) is type(error)
    assert str(again) == str(error)


@pytest.mark.parametrize("workers", [1, 2])
def test_a_policy_that_fails_in_a_scenario_ends_the_evaluation_and_leaves_whole_files_only(workers, short, here):
    folder = here / "kept"
    message = refused(PolicyError, "mine:Fails", TRACK, [0, 2], workers=workers, folder=folder)
    assert f"policy fails on {TRACK}, scenario 2, tick 0: act() raised RuntimeError: not this one" in message
    assert len(kept(folder)) <= 1
    for path in kept(folder):
        assert path.suffix == ".json"
        assert set(json.loads(path.read_text(encoding="utf-8"))) == {"result", "sha256"}


# What is kept


def test_what_has_been_played_is_not_played_again(short, here, monkeypatch):
    done = []
    first = evaluate("mine:Zero", TRACK, 3, folder=here / "kept")
    assert len(kept(here / "kept")) == 3

    def never(shards):
        raise AssertionError

    monkeypatch.setattr(module, "play_shards", never)
    again = evaluate("mine:Zero", TRACK, 3, folder=here / "kept", on_scenario=lambda: done.append(1))
    assert again == first
    assert len(done) == 3
    assert evaluate("mine:Zero", TRACK, [2], folder=here / "kept").errors == first.errors[2]


def test_keeping_changes_no_number(short, here):
    assert evaluate("mine:Zero", TRACK, 2, folder=here / "kept").metrics == evaluate("mine:Zero", TRACK, 2).metrics


def test_an_interrupted_evaluation_resumes_where_it_stopped(short, here, played, monkeypatch):
    folder, spied = here / "kept", module.play_shards

    def interrupted(shards):
        if len(played) == 2:
            raise KeyboardInterrupt
        return spied(shards)

    monkeypatch.setattr(module, "play_shards", interrupted)
    with pytest.raises(KeyboardInterrupt):
        evaluate("mine:Zero", TRACK, 4, folder=folder)
    assert len(kept(folder)) == 2
    assert all(path.suffix == ".json" for path in kept(folder))
    monkeypatch.setattr(module, "play_shards", spied)
    score = evaluate("mine:Zero", TRACK, 4, folder=folder)
    assert played == [0, 1, 2, 3]
    assert score.metrics == evaluate("mine:Zero", TRACK, 4).metrics


@pytest.mark.parametrize(
    "text",
    ["", "{", "null", "[]", "{}", '{"metrics": {}}', '{"metrics": {}, "timing": {}, "more": 1}', "\xff\xfe",
     '{"metrics": {}, "timing": {}}', '{"result": {}}'],
)  # fmt: skip
def test_a_kept_file_that_is_no_result_is_played_again(text, short, here, played):
    folder = here / "kept"
    first = evaluate("mine:Zero", TRACK, 2, folder=folder)
    path = kept(folder)[0]
    whole_text = json.loads(path.read_text(encoding="utf-8"))
    path.write_bytes(text.encode("latin-1"))
    again = evaluate("mine:Zero", TRACK, 2, folder=folder)
    assert again.metrics == first.metrics
    assert len(played) == 3
    assert json.loads(path.read_text(encoding="utf-8"))["result"]["metrics"] == whole_text["result"]["metrics"]


@pytest.mark.parametrize(
    "change",
    [
        lambda found: found["result"]["metrics"].update(error=0.001),
        lambda found: found["result"]["timing"].update(wall_s=1e-9),
        lambda found: found.pop("sha256"),
        lambda found: found.update(kept_file_digest(found, success=7.0)),
        lambda found: found.update(kept_file_digest(found, energy_wh=-1.0)),
        lambda found: found.update(kept_file_digest(found, slip_m=1.0)),
    ],
)
def test_a_kept_file_that_was_edited_by_hand_is_played_again(change, short, here, played):
    """The digest is stale, or valid for metrics that no episode can have."""
    folder = here / "kept"
    first = evaluate("mine:Zero", TRACK, 1, folder=folder)
    (path,) = kept(folder)
    found = {**json.loads(path.read_text(encoding="utf-8")), "stem": path.stem}
    change(found)
    path.write_text(json.dumps({key: value for key, value in found.items() if key != "stem"}), encoding="utf-8")
    assert evaluate("mine:Zero", TRACK, 1, folder=folder).metrics == first.metrics
    assert played == [0, 0]


def kept_file_digest(found, **metrics):
    """Edited content with its valid digest."""
    result = {**found["result"], "metrics": found["result"]["metrics"] | metrics}
    text = json.dumps([found["stem"], result], sort_keys=True)
    return {"result": result, "sha256": hashlib.sha256(text.encode()).hexdigest()}


def test_a_kept_file_under_another_ones_name_is_played_again(short, here, played):
    folder = here / "kept"
    first = evaluate("mine:Zero", TRACK, 2, folder=folder)
    a, b = kept(folder)
    b.write_bytes(a.read_bytes())
    assert evaluate("mine:Zero", TRACK, 2, folder=folder).metrics == first.metrics
    assert len(played) == 3


def test_what_is_kept_is_of_this_policy_file_scenario_split_and_code():
    scenarios = load_scenarios(TRACK)[0]
    shard = Shard("mine:Zero", TRACK, "test", scenarios[0])
    keys = [
        shard.key("digest"), shard.key("other"), replace(shard, policy="mine:Fails").key("digest"),
        replace(shard, track="flight-fast3").key("digest"), replace(shard, split="validation").key("digest"),
        replace(shard, scenario=scenarios[1]).key("digest"), replace(shard, run=1).key("digest"),
    ]  # fmt: skip
    assert len(set(keys)) == len(keys)
    assert shard.key("digest") == keys[0]
    assert replace(shard, act_limit_s=99.0).key("digest") == keys[0]


def test_another_code_keeps_its_own_results(short, here, played, monkeypatch):
    evaluate("mine:Zero", TRACK, 1, folder=here / "kept")
    assert len(code_digest(*module.BEHAVIOUR)) == 64
    monkeypatch.setattr(module, "code_digest", lambda *names: "another")
    evaluate("mine:Zero", TRACK, 1, folder=here / "kept")
    assert played == [0, 0]


def test_a_folder_that_cannot_be_written_is_refused(short, here):
    (here / "kept").write_text("mine")
    assert "writable folder" in refused(SpidarError, "mine:Zero", TRACK, 1, folder=here / "kept")
    assert (here / "kept").read_text() == "mine"


# Ray


@pytest.mark.slow
@pytest.mark.filterwarnings("default")
def test_a_ray_cluster_gives_what_one_process_gives_bit_for_bit_and_errors_name_the_policy(monkeypatch):
    ray = pytest.importorskip("ray")
    monkeypatch.chdir(ROOT)
    done = []
    score = evaluate(QP, TRACK, 2, ray="local", workers=2, on_scenario=lambda: done.append(1))
    assert score.metrics == whole().metrics
    assert len(done) == 2
    assert not ray.is_initialized()
    with pytest.raises(PolicyError, match=f"policy hold on {TRACK}, scenario 0, tick 0: took longer") as refusal:
        evaluate(HOLD, TRACK, 1, ray="local", workers=2, act_limit_s=1e-9)
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize("error", [ConnectionError, RuntimeError, ValueError])
def test_a_cluster_that_is_not_there_is_one_line(error, monkeypatch, here):
    ray = pytest.importorskip("ray")

    def unreachable(**options):
        raise error("no answer")

    monkeypatch.setattr(ray, "init", unreachable)
    message = refused(SpidarError, "mine:Zero", TRACK, 1, ray="auto", folder=here / "kept")
    assert "no Ray cluster at 'auto'" in message
    assert "no answer" in message
    assert "valid: local" in message


def test_an_address_without_a_server_is_refused_before_ray_tries_for_minutes(monkeypatch, here):
    ray = pytest.importorskip("ray")
    monkeypatch.setattr(ray, "init", lambda **options: pytest.fail("Ray was asked"))
    message = refused(SpidarError, "mine:Zero", TRACK, 1, ray="127.0.0.1:9")
    assert "no Ray cluster at '127.0.0.1:9'" in message


def test_rays_workers_import_from_the_working_folder_and_from_where_the_caller_does(monkeypatch, here):
    ray, given = pytest.importorskip("ray"), {}

    def init(**options):
        given.update(options)
        raise ConnectionError

    monkeypatch.setenv("PYTHONPATH", "/of/the/caller")
    monkeypatch.setattr(ray, "init", init)
    refused(SpidarError, "mine:Zero", TRACK, 1, ray="local")
    assert given["runtime_env"]["env_vars"]["PYTHONPATH"].split(os.pathsep) == [str(here), "/of/the/caller"]


def test_without_ray_the_message_states_how_to_install_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "ray", None)
    assert "pip install 'spidar-gym[ray]'" in refused(MissingDependencyError, "mine:Zero", TRACK, 1, ray="local")
