"""Pins the studies of hidden robots: sealed parameters, robots of a former result, and the file of a true robot."""

import json

import numpy as np
import pytest

from spidar_gym.errors import SpidarError
from spidar_gym.sim.config import PlantConfig
from spidar_gym.sim.randomize import Randomization, randomize
from spidar_gym.studies.hidden import RELATIVE, robot_of, sample, score, sealed_robots, truth_of
from spidar_gym.studies.searches import true_text


def test_sealed_parameters_cannot_be_changed_unseen_and_are_sampled_once(tmp_path):
    sample(tmp_path, 3)
    first = sealed_robots(tmp_path)
    sample(tmp_path, 3)
    assert sealed_robots(tmp_path) == first
    with pytest.raises(SpidarError, match="0 reports of 3 robots"):
        score(tmp_path)
    path = tmp_path / "sealed" / "robots.json"
    path.write_text(path.read_text().replace("wake", "build"))
    with pytest.raises(SpidarError, match="is not what was sealed"):
        sealed_robots(tmp_path)


def test_the_robots_of_a_former_result_are_sampled_once_more(tmp_path):
    sample(tmp_path / "first", 3)
    robots = sealed_robots(tmp_path / "first")
    own = {"parameter": "delay", "count": 1, "told": 1, "within": 1, "worst_error": 0.0, "rms_error": 0.0}
    rows = [{"robot": k, "kind": "", "seed": row["seed"], **own, "mean_width": 0.0} for k, row in enumerate(robots)]
    path = tmp_path / "hidden.json"
    path.write_text(json.dumps({"hidden": [*rows, *rows]}))
    sample(tmp_path / "again", 2, again=path)
    assert sealed_robots(tmp_path / "again") == robots[:2]
    path.write_text(json.dumps({"hidden": [{}]}))
    with pytest.raises(SpidarError, match=r"no result of the study hidden: .* lacks robot"):
        sample(tmp_path / "none", 2, again=path)
    path.write_text(json.dumps({"hidden": rows[:1]}))
    with pytest.raises(SpidarError, match="has 1 robots; valid: --robots 1 … 1"):
        sample(tmp_path / "none", 2, again=path)
    with pytest.raises(SpidarError, match="has 3 robots; valid: --robots 3"):
        sample(tmp_path / "first", 2)
    with pytest.raises(SpidarError, match="has no sealed robots"):
        sealed_robots(tmp_path)


@pytest.mark.parametrize("kind", ["wake-described", "build-damped"])
def test_the_file_of_a_true_robot_samples_that_robot(kind, tmp_path):
    config = robot_of({"seed": 3, "robots": f"calibrated_1:{kind}"})
    path = tmp_path / "true.toml"
    path.write_text(true_text(config), encoding="utf-8")
    rng = np.random.Generator(np.random.PCG64(1))
    found, truth = truth_of(randomize(PlantConfig(), rng, Randomization.parse(str(path)))[0]), truth_of(config)
    for name, value in truth.items():
        if name == "delay":  # the file has the mean of the world's jitter
            assert found[name] == pytest.approx(value, abs=0.006)
        else:
            share = 0.02 if name in RELATIVE else 0.01
            assert np.allclose(found[name], value, rtol=share, atol=1e-9), name
