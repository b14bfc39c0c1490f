"""Pins `spidar paper flight` with --speeds and --ablation, and `spidar tune`."""

import functools
import json

import pytest
from support.commands import files, refused_after_a_bar

from spidar_gym import viz
from spidar_gym.benchmark import statistics
from spidar_gym.cli.main import main
from spidar_gym.errors import MissingDependencyError
from spidar_gym.paper import flight_studies as studies
from spidar_gym.paper.trial import Outcome
from spidar_gym.tune import search


@pytest.fixture
def quick(monkeypatch):
    """Replace the flights of the studies by instant ones; returns the list of requested flights."""
    requested = []

    def fly_all(jobs, *, workers=1, folder=None, on_done=lambda: None):
        jobs = list(jobs)
        requested.extend(jobs)
        outcomes = []
        for k, (_, scenario) in enumerate(jobs):
            on_done()
            outcomes.append(Outcome(0.001 * (1 + k % 7), 0.002 * scenario.joint_speed, 0, 3.0, 0, ""))
        return outcomes

    monkeypatch.setattr(studies, "fly_all", fly_all)
    fewer = functools.partial(statistics.stratified_bootstrap, draws=20)
    monkeypatch.setattr(statistics, "stratified_bootstrap", fewer)
    return requested


@pytest.mark.parametrize("name", ["speeds", "ablation"])
def test_the_studies_of_speed_fly_every_cell_and_write_what_they_print(name, quick, here, capfd, monkeypatch):
    monkeypatch.setattr(viz, "speed_figure", lambda rows, path: path.write_bytes(b"drawn"))
    main(["paper", "flight", f"--{name}", "--scenarios", "3", "--workers", "1", "--json", "--out", "o"])
    rows = json.loads(capfd.readouterr().out)[name]
    assert sorted(files(here)) == (["o/speeds.json", "o/speeds.png"] if name == "speeds" else ["o/ablation.json"])
    assert json.loads((here / f"o/{name}.json").read_text(encoding="utf-8")) == {name: rows}
    assert len(quick) == 3 * len(rows) == sum(row["flights"] for row in rows)
    speeds = {row["joint_speed"] for row in rows}
    assert {0.2, 0.6, 1.0} <= speeds
    assert (len(speeds) > 3) == (name == "speeds")
    controllers = {row["controller"] for row in rows}
    assert {"paper", "tuned"} <= controllers
    assert (len(controllers) > 2) == (name == "ablation")
    assert {row["condition"] for row in rows} == {"nominal", "randomised"}


def test_the_study_of_speed_prints_a_line_for_every_controller_and_cell(quick, here, capfd, monkeypatch):
    def missing(*_, **__):
        raise MissingDependencyError("a library", "pip install something")

    monkeypatch.setattr(viz, "speed_figure", missing)
    main(["paper", "flight", "--speeds", "--scenarios", "1"])
    out, err = capfd.readouterr()
    rows = json.loads((here / "out/flight/speeds.json").read_text(encoding="utf-8"))["speeds"]
    lines = [line for line in out.splitlines() if line.startswith(("nominal", "randomised"))]
    assert len(lines) == len(rows)
    assert "pip install something" in err


def test_tune_searches_writes_its_state_and_resumes(monkeypatch, here, capfd):
    pytest.importorskip("cma")
    played = []

    def finish(call, jobs, *, on_done, **_):
        played.extend(jobs)
        for k, _ in enumerate(jobs):
            on_done(k, None)
        rise = [sum((job.values or {"none": 1.0}).values()) for job in jobs]
        found = [{"errors": [0.1 + 1e-5 * own], "ticks": 3} for own in rise]
        return [each if job.track else {"shortfall": 0.0} for job, each in zip(jobs, found, strict=True)]

    monkeypatch.setattr(search, "finish", finish)
    monkeypatch.setattr(search, "draw_scenarios", lambda *_: {"flight-wind": (), "flight-fast5": ()})
    arguments = ["tune", "flight", "--population", "4", "--scenarios", "1", "--seed", "3"]
    main([*arguments, "--generations", "1"])
    out = capfd.readouterr().out
    assert "errors of tuned_v1 over those of the result" in out
    # Four candidates, the mean of the distribution and the reference, on two tracks each, and their margins.
    assert len(played) == 6 * 3
    main([*arguments, "--generations", "2"])
    assert len(played) == 2 * 6 * 3
    out = capfd.readouterr().out
    assert "after 2 generations" in out
    assert "gain margin" in out
    log = json.loads((here / "out/tune/flight.json").read_text(encoding="utf-8"))["log"]
    assert [line["generation"] for line in log] == [0, 1]
    assert set(files(here)) == {"out/tune/flight.json"}
    before = files(here)
    assert "valid: the same settings, or another folder" in refused_after_a_bar(
        capfd, "tune", "flight", "--population", "5", "--scenarios", "1", "--seed", "3"
    )
    assert files(here) == before
