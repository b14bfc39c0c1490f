"""Tests results on the suite: the long table, merged runs, statistics of several seeds, and the tables of the guide."""

import numpy as np
import pytest

from spidar_gym.benchmark.statistics import iqm
from spidar_gym.benchmark.suite_results import (
    RESULTS,
    Result,
    curves,
    interval,
    merged,
    profile,
    read_results,
    results_text,
    returns_of,
    suite_lines,
    variant_lines,
)
from spidar_gym.envs.suite import SUITE
from spidar_gym.errors import SpidarError


def run(task, seed, *values, algorithm="ppo", metric="return", step=1000):
    return [
        Result(algorithm, task, seed, step * (k + 1), 10.0 * (k + 1), metric, float(value))
        for k, value in enumerate(values)
    ]


def of_scale(task, share):
    zero, one = SUITE[task].anchors
    return zero + share * (one - zero)


def test_a_table_is_read_as_it_was_written(tmp_path):
    rows = [*run("Hover", 0, 1.5, 2.25), *run("Crawl-direct-narrow", 3, -0.125, metric="success")]
    path = tmp_path / "results.csv"
    path.write_text(results_text(rows))
    assert read_results(path) == rows
    assert path.read_text().splitlines()[0] == "algorithm,task,seed,step,seconds,metric,value"


@pytest.mark.parametrize(
    "line", ["ppo,Hover,0,10,1.0,return", "ppo,Hover,x,10,1.0,return,1", "ppo,Swim,0,10,1.0,return,1",
             "ppo,Hover,0,10,1.0,speed,1", "ppo,Hover,0,10,1.0,return,nan"],
)  # fmt: skip
def test_a_line_that_is_no_result_is_named(tmp_path, line):
    path = tmp_path / "results.csv"
    path.write_text(results_text(run("Hover", 0, 1.0)) + line + "\n")
    with pytest.raises(SpidarError, match="line 3"):
        read_results(path)
    path.write_text(line)
    with pytest.raises(SpidarError, match="columns algorithm"):
        read_results(path)


def test_a_run_replaces_the_run_of_the_same_task_algorithm_and_seed_alone():
    old = [*run("Hover", 0, 1.0), *run("Hover", 1, 2.0), *run("Hover", 0, 3.0, algorithm="sac"), *run("Path", 0, 4.0)]
    found = merged(old, run("Hover", 0, 5.0, 6.0))
    values = {(row.task, row.algorithm, row.seed, row.step): row.value for row in found}
    assert values == {
        ("Hover", "ppo", 0, 1000): 5.0, ("Hover", "ppo", 0, 2000): 6.0, ("Hover", "ppo", 1, 1000): 2.0,
        ("Hover", "sac", 0, 1000): 3.0, ("Path", "ppo", 0, 1000): 4.0,
    }  # fmt: skip
    assert merged(run("Hover", 0, 5.0, 6.0), old[1:]) == merged(found, [])


def test_curves_are_those_of_whole_runs():
    rows = [*run("Hover", 0, 1.0, 2.0), *run("Hover", 1, 3.0, 4.0), *run("Hover", 2, 9.0)]
    found = curves(rows, "Hover", "ppo", "return")
    assert found.values.tolist() == [[1.0, 2.0], [3.0, 4.0]]
    assert found.steps.tolist() == [1000, 2000]
    assert found.seconds.tolist() == [[10.0, 20.0]] * 2
    assert found.last == [2.0, 4.0]
    assert curves(rows, "Path", "ppo", "return") is None


def test_intervals_and_profiles_weigh_tasks_alike_and_contain_the_mean_of_all_seeds():
    rng = np.random.default_rng(2)
    values = {"a": rng.normal(0.5, 0.1, 5).tolist(), "b": rng.normal(0.9, 0.02, 5).tolist()}
    found = interval(values, np.random.default_rng(3))
    assert found.value == pytest.approx(float(iqm(np.concatenate([*values.values()]))))
    assert found.low < found.value < found.high
    assert interval(values, np.random.default_rng(3)) == found
    # Draws within each task only: two tasks without spread have no interval, however far apart they are.
    still = interval({"a": [0.0] * 5, "b": [1.0] * 5}, np.random.default_rng(3))
    assert still.low == still.high == still.value == 0.5
    at = np.array([-1.0, 0.7, 2.0])
    assert profile({"a": [0.0, 1.0], "b": [1.0] * 8}, at).tolist() == [1.0, 0.75, 0.0]


def test_the_table_has_a_command_in_each_cell_without_runs_and_a_line_over_all_tasks():
    rows = [row for seed in range(3) for task in ("Hover", "Crawl")
            for row in (*run(task, seed, of_scale(task, 0.5)), *run(task, seed, 0.25, metric="success"))]  # fmt: skip
    lines = {(line[0], line[1]): line[2:] for line in suite_lines(rows)[1:]}
    assert lines["Hover", "ppo"][1:3] == ["0.50 [0.50, 0.50]", "25 [25, 25] %"]
    assert lines["Hover", "sac"][0] == "`python -m train.standard Hover sac --seed 0`"
    assert lines["the 2 with runs", "ppo"][1] == "0.50 [0.50, 0.50]"
    assert ("the 2 with runs", "sac") not in lines
    assert [line[0] for line in suite_lines(rows, only_runs=True)[1:]] == ["Hover", "Crawl", "the 2 with runs"]
    assert returns_of(rows, "ppo") == {name: pytest.approx([0.5] * 3) for name in ("Hover", "Crawl")}


def test_the_table_of_variants_has_each_pair_of_mode_and_reward():
    rows = []
    for share, mode in ((0.9, "torso_forces"), (0.2, "direct")):
        for part, reward in ((1.0, "sloped"), (0.5, "narrow")):
            name, value = f"Hover-{mode}-{reward}", share * part
            rows += run(name, 0, of_scale("Hover", value)) + run(name, 0, value, metric="success")
    assert variant_lines(rows[:-2], "Hover") == [
        ["action mode", "reward `sloped`", "reward `narrow`"],
        ["`torso_forces`", "0.90 (0.90), 90 % after 0.0 M", "0.45 (0.45), 45 % after 0.0 M"],
        ["`direct`", "0.20 (0.20), 20 % after 0.0 M",
         "`python -m train.standard Hover ppo --mode direct --reward narrow`"],
    ]  # fmt: skip


def test_committed_results_are_whole():
    rows = read_results(RESULTS)
    assert merged(rows, []) == rows, "in order"
    for row in rows:
        assert 0.0 <= row.value <= 1.0 or row.metric in ("return", "duration_s")
