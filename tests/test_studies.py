"""Pins the comparison of controllers: interquartile means, paired changes, ablations, one row a cell."""

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import trim_mean

from spidar_gym import studies
from spidar_gym.control.presets import controller_config
from spidar_gym.scenario import Outcome


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
    after = before - rng.uniform(0.0, 2.0, 24)
    noisy, again, other = (studies.compare(before, after, np.random.default_rng(seed)) for seed in (0, 0, 1))
    assert noisy.low < noisy.relative < noisy.high < 0.0
    assert noisy == again
    assert noisy != other


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
