"""Pins the comparison of controllers: ablations, one row per cell, and resuming."""

import json
from dataclasses import replace
from functools import partial

import pytest

from spidar_gym.benchmark import statistics
from spidar_gym.benchmark.statistics import stratified_bootstrap
from spidar_gym.control.presets import controller_config
from spidar_gym.paper import flight_studies as studies
from spidar_gym.paper.trial import Outcome


def test_an_ablation_switches_off_one_option_of_tuned_at_a_time():
    tuned = controller_config("tuned")
    for name, change in studies.OFF.items():
        ((option, value),) = change.items()
        assert value == 0.0
        assert getattr(tuned.compensation, option) > 0.0
        changed = studies.controllers(ablation=True)[name]
        assert changed == replace(tuned, compensation=replace(tuned.compensation, **change))


def test_a_study_has_a_row_for_every_controller_and_cell(monkeypatch):
    def flown(jobs, *, workers, folder, on_done):
        del workers, folder
        return [on_done() or Outcome(0.01 + 1e-4 * s.seed % 7, 0.02, 0, 1.0, 0, "") for _, s in jobs]

    monkeypatch.setattr(studies, "fly_all", flown)
    rows = studies.speed_study(speeds=(0.2, 1.0), count=3)
    assert len(rows) == 2 * 2 * 2
    assert {(r["condition"], r["joint_speed"], r["controller"]) for r in rows} >= {("randomised", 1.0, "tuned")}
    json.dumps(rows)
    lines = studies.speed_lines(rows)
    assert [line[2] for line in lines].count("tuned") == 4
    assert "0/3" in lines[1]


def test_a_study_of_speeds_resumes(tmp_path, monkeypatch):
    flown, stops = [], [KeyboardInterrupt()]

    def fly(config, trial):
        if len(flown) == 5 and stops:
            raise stops.pop()
        flown.append(trial)
        return Outcome(0.01 + trial.seed % 3 * 1e-3, 0.02, 0, 1.0, 0, "")

    monkeypatch.setattr("spidar_gym.paper.trial.fly", fly)
    monkeypatch.setattr(statistics, "stratified_bootstrap", partial(stratified_bootstrap, draws=20))
    with pytest.raises(KeyboardInterrupt):
        studies.speed_study(speeds=(0.2, 1.0), count=1, folder=tmp_path)
    rows = studies.speed_study(speeds=(0.2, 1.0), count=1, folder=tmp_path)
    assert len(flown) == len(rows) == 8
