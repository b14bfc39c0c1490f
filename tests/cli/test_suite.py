"""Tests `spidar suite`: tables, a policy on a task, the scale played again, merged runs, one line for refusals."""

import json

import pytest

from spidar_gym.benchmark import suite as playing
from spidar_gym.benchmark.suite_results import Result, read_results, results_text
from spidar_gym.cli import suite as module
from spidar_gym.cli.main import main
from spidar_gym.envs import suite as tasks
from spidar_gym.envs.suite import SUITE

STEADY = "baselines.qp_steady:QPSteady"


@pytest.fixture
def own(tmp_path, monkeypatch):
    """Evaluate two episodes, and keep results and scale in a folder."""
    for part in (playing, module):
        monkeypatch.setattr(part, "EPISODES", 2)
    monkeypatch.setattr(playing.play, "__defaults__", (2,))
    monkeypatch.setattr(module, "RESULTS", tmp_path / "suite.csv")
    for part in (tasks, module):
        monkeypatch.setattr(part, "ANCHORS", tmp_path / "anchors.json")
    tasks.read_anchors.cache_clear()
    yield tmp_path
    tasks.read_anchors.cache_clear()


def test_the_tasks_and_their_results_are_printed(capfd):
    main(["suite"])
    shown = capfd.readouterr().out
    for task in SUITE.values():
        assert task.id in shown
    main(["suite", "Hover", "--json"])
    told = json.loads(capfd.readouterr().out)
    assert [*told] == ["Hover"]
    assert told["Hover"]["options"] == SUITE["Hover"].options
    assert told["Hover"]["anchors"] == pytest.approx(SUITE["Hover"].anchors)


def test_a_policy_is_evaluated_on_a_task_by_name_or_id(capfd):
    main(["suite", "Hover", "--policy", STEADY, "--episodes", "2", "--json"])
    found = json.loads(capfd.readouterr().out)
    assert found["success"] == 1.0
    assert found["scaled"] == pytest.approx(1.0, abs=0.02)
    assert sum(found["terms"].values()) == pytest.approx(found["return"])
    main(["suite", SUITE["Hover"].id, "--policy", STEADY, "--episodes", "2"])
    assert "of the scale" in capfd.readouterr().out


def test_the_scale_is_written_and_compared(own, capfd):
    main(["suite", "Hover", "--anchors"])
    path = own / "anchors.json"
    content = path.read_text()
    main(["suite", "Hover", "--check"])
    assert "as committed" in capfd.readouterr().out
    assert path.read_text() == content
    changed = json.loads(content)
    changed["tasks"]["Hover"]["random"]["return"] += 30.0
    path.write_text(json.dumps(changed))
    tasks.read_anchors.cache_clear()
    with pytest.raises(SystemExit):
        main(["suite", "Hover", "--check"])
    assert "for random on Hover" in capfd.readouterr().err


def test_runs_are_merged_into_the_table(own, capfd):
    for seed, value in ((0, 1.0), (1, 2.0)):
        path = own / "runs" / "Hover" / f"ppo-{seed}" / "results.csv"
        path.parent.mkdir(parents=True)
        path.write_text(results_text([Result("ppo", "Hover", seed, 1000, 1.0, "return", value)]))
    main(["suite", "--runs", str(own / "runs")])
    main(["suite", "--runs", str(own / "runs")])
    assert [row.value for row in read_results(own / "suite.csv")] == [1.0, 2.0]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["Swim"], "HoverResidual, Hover"),
        (["--policy", STEADY], "one of HoverResidual"),
        (["Hover", "--policy", STEADY, "--check"], "one of them"),
        (["Hover", "--policy", STEADY, "--episodes", "0"], "episodes = 0"),
        (["Course", "--policy", STEADY], "defined on spidar_gym/Course-v0"),
        (["Hover", "--policy", "nothing:Here"], "nothing"),
        (["--runs", "nowhere"], "results.csv"),
    ],
)
def test_other_arguments_are_refused_in_one_line(arguments, words, capfd):
    with pytest.raises(SystemExit):
        main(["suite", *arguments])
    (line,) = [line for line in capfd.readouterr().err.splitlines() if line.startswith("spidar:")]
    assert words in line
