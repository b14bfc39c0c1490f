"""Pins scenarios, their statistics and the search: paired flights, interquartile means, bounds, resuming."""

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import trim_mean

from spidar_gym import studies, tune
from spidar_gym.control.presets import controller_config
from spidar_gym.errors import InvalidValueError, MissingDependencyError, SpidarError
from spidar_gym.scenario import Outcome, Scenario, fly, fly_all
from spidar_gym.tune import PARAMETERS, configuration, cost, decode, scenarios

PAPER = controller_config("paper")
SHORT = [Scenario("nominal", 1.0, 1, 1.5), Scenario("randomised", 1.0, 1, 1.5), Scenario("nominal", 1.0, 2, 1.5)]


def test_a_scenario_has_one_outcome_whatever_flew_before_and_in_however_many_processes():
    alone = [fly(PAPER, scenario) for scenario in SHORT]
    assert [fly(PAPER, scenario) for scenario in reversed(SHORT)] == alone[::-1]
    assert fly_all([(PAPER, scenario) for scenario in SHORT], workers=2) == alone
    assert len({outcome.attitude for outcome in alone}) == len(alone)


def test_controllers_meet_the_same_forms_and_the_better_one_errs_less():
    scenario = Scenario("nominal", 1.0, 3, 5.0)
    paper, tuned = fly(PAPER, scenario), fly(controller_config("tuned"), scenario)
    assert tuned.attitude < 0.5 * paper.attitude
    assert tuned.joint_torque < 7.0 + 1e-3
    assert paper.failure == tuned.failure == ""


def test_the_interquartile_mean_is_the_mean_of_the_middle_half():
    x = np.random.default_rng(0).normal(size=24)
    assert studies.iqm(x) == pytest.approx(trim_mean(x, 0.25))
    assert studies.iqm(np.array([5.0])) == 5.0
    # Six values: one and a half are cut at each end.
    assert studies.iqm(np.array([0, 1, 2, 3, 4, 100.0])) == pytest.approx((0.5 * 1 + 2 + 3 + 0.5 * 4) / 3)


def test_a_comparison_is_paired_seeded_and_zero_for_equals():
    rng = np.random.default_rng(1)
    before = rng.uniform(5.0, 20.0, 24)
    same = studies.compare(before, before, np.random.default_rng(0))
    assert (same.relative, same.low, same.high) == (0.0, 0.0, 0.0)
    half = studies.compare(before, 0.5 * before, np.random.default_rng(0))
    assert half.relative == pytest.approx(-0.5, abs=1e-9)
    noisy = studies.compare(before, before - rng.uniform(0.0, 2.0, 24), np.random.default_rng(0))
    assert noisy.low < noisy.relative < noisy.high < 0.0
    assert noisy == studies.compare(before, *[np.array(before)], np.random.default_rng(0)) or noisy.relative < 0.0


def test_an_ablation_switches_off_one_option_of_tuned_at_a_time():
    tuned = controller_config("tuned")
    for name, change in studies.OFF.items():
        ((option, value),) = change.items()
        assert value == 0.0
        assert getattr(tuned.compensation, option) > 0.0
        changed = studies.controllers(ablation=True)[name]
        assert changed == replace(tuned, compensation=replace(tuned.compensation, **change))


def test_a_study_has_a_row_for_every_controller_and_cell(monkeypatch):
    def flown(jobs, *, workers, on_done):
        del workers
        return [on_done() or Outcome(0.01 + 1e-4 * s.seed % 7, 0.02, 0, 1.0, 0, "") for _, s in jobs]

    monkeypatch.setattr(studies, "fly_all", flown)
    rows = studies.speed_study(speeds=(0.2, 1.0), count=3)
    assert len(rows) == 2 * 2 * 2
    assert {(r["condition"], r["joint_speed"], r["controller"]) for r in rows} >= {("randomised", 1.0, "tuned")}
    json.dumps(rows)
    table = studies.speed_table(rows)
    assert table.count("tuned") == 4
    assert "0/3" in table


def test_parameters_start_in_the_middle_and_never_leave_their_bounds():
    n = len(PARAMETERS)
    assert decode(np.zeros(n)) == {p.name: p.start for p in PARAMETERS}
    for sign, name in ((1.0, "high"), (-1.0, "low")):
        at_bound = decode(np.full(n, sign))
        assert at_bound == pytest.approx({p.name: getattr(p, name) for p in PARAMETERS})
    for x in np.random.default_rng(2).normal(0.0, 3.0, (200, n)):
        values = decode(x)
        assert all(p.low * (1 - 1e-12) <= values[p.name] <= p.high * (1 + 1e-12) for p in PARAMETERS)
        near = decode(x + 1e-9)
        assert all(abs(values[k] / near[k] - 1.0) < 1e-6 for k in values)


def test_every_parameter_reaches_the_controller():
    start = decode(np.zeros(len(PARAMETERS)))
    for parameter in PARAMETERS:
        assert configuration({**start, parameter.name: parameter.high}) != configuration(start), parameter.name


def test_tuning_flies_seeds_that_nothing_else_flies_and_never_twice():
    seeds = [s.seed for g in range(50) for s in scenarios(g, 6)]
    assert len(set(seeds)) == len(seeds)
    assert min(seeds) >= tune.FIRST_SEED > studies.FIRST_SEED + 10_000
    assert cost(Outcome(0.01, 0.01, 0, 1.0, 0, "")) < cost(Outcome(0.01, 0.01, 0, 1.0, 0, "tilt"))


def search(folder, generations, seed=1):
    return tune.tune(folder, generations=generations, population=3, flights=1, seed=seed, workers=1)


def test_a_search_that_was_stopped_goes_on_as_if_it_had_not_been(tmp_path, monkeypatch):
    monkeypatch.setattr(tune, "SECONDS", 0.5)
    for name in ("whole", "parts"):
        (tmp_path / name).mkdir()
    search(tmp_path / "whole", 3)
    search(tmp_path / "parts", 1)
    search(tmp_path / "parts", 3)
    logs = [json.loads((tmp_path / name / "tune.json").read_text()) for name in ("whole", "parts")]
    assert logs[0] == logs[1]
    assert len(logs[0]["log"]) == 3
    with pytest.raises(SpidarError, match="same settings"):
        search(tmp_path / "whole", 4, seed=2)


def test_a_search_without_its_library_or_without_candidates_is_refused(tmp_path, monkeypatch):
    with pytest.raises(InvalidValueError, match="population"):
        tune.tune(tmp_path, generations=1, population=1, flights=1, seed=0, workers=1)
    monkeypatch.setattr(tune.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(MissingDependencyError, match="cma"):
        search(tmp_path, 1)
    assert not list(tmp_path.iterdir())


def test_the_margins_of_a_controller_are_a_table_of_four_loops():
    assert len(tune.margin_table(PAPER).splitlines()) == 5
