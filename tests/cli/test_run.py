"""Pins `spidar run`: episodes and their report, what every option changes, and videos whole or not at all."""

import ctypes.util
import re

import pytest
from support.commands import LEARNED, ROOT, files

from spidar_gym import viz
from spidar_gym.cli.main import main
from spidar_gym.envs import env
from spidar_gym.envs.hover.task import HoverTask

drawing = pytest.mark.skipif(
    not (ctypes.util.find_library("EGL") or ctypes.util.find_library("OSMesa")), reason="no OpenGL library"
)


def test_run_flies_the_episodes_it_was_asked_for_and_reports_each_and_who_stayed_in_the_air(capfd, here):
    main(["run", "--episodes", "2", "--seed", "5", "--seconds", "0.25", "--forms", "form1"])
    *lines, survivors = capfd.readouterr().out.splitlines()
    assert [line.split(",")[0] for line in lines] == ["episode 1 (seed 5): 0.2 s", "episode 2 (seed 6): 0.2 s"]
    assert survivors.startswith("2 of 2 stayed in the air")
    assert list(here.iterdir()) == []


def test_who_fell_is_not_among_those_who_stayed_in_the_air(capfd, monkeypatch):
    words = iter(["", "", "tilt", *[""] * 10])
    monkeypatch.setattr(env, "is_compiled", lambda control: False)  # the task in Python judges
    monkeypatch.setattr(HoverTask, "failed", lambda *_: next(words))
    main(["run", "--episodes", "3", "--seconds", "0.1", "--forms", "form1"])
    *lines, survivors = capfd.readouterr().out.splitlines()
    assert [line.endswith("failure: tilt") for line in lines] == [True, False, False]
    assert survivors.startswith("2 of 3 stayed in the air")


def test_one_episode_has_no_line_of_survivors(capfd):
    main(["run", "--seconds", "0.1", "--forms", "form1"])
    assert "stayed" not in capfd.readouterr().out


@pytest.mark.parametrize(
    "options",
    [["--no-wake"], ["--sensors"], ["--randomization", "1"], ["--wind", "3"], ["--lost-rotor", "4"],
     ["--lost-rotor", "4", "--fault", "vectoring"], ["--preset", "tuned"], ["--action-mode", "direct"]],
    ids=" ".join,
)  # fmt: skip
def test_every_option_of_run_changes_the_flight(options, capfd):
    flights = []
    for more in ([], options, options):
        main(["run", "--seconds", "2.5", "--forms", "equal", "--joint-speed", "1", "--preset", "paper", *more])
        flights.append(capfd.readouterr().out)
    assert flights[0] != flights[1]
    assert flights[1] == flights[2]


def test_a_learned_policy_flies_on_the_controller_that_it_learned_on_and_does_better(capfd, monkeypatch):
    monkeypatch.syspath_prepend(ROOT)
    off = []
    for who in (["--preset", "paper"], ["--policy", "baselines.qp:QP"], ["--policy", LEARNED]):
        main(["run", "--seconds", "6", "--forms", "independent", "--joint-speed", "1.25", *who])
        off.append(float(re.findall(r"attitude ([\d.]+) mrad", capfd.readouterr().out)[0]))
    alone, baseline, learned = off
    assert baseline == alone
    assert learned < 0.9 * alone


def test_a_short_hover_that_stays_on_its_reference_is_reported_as_a_success(capfd):
    main(["run", "--seconds", "1", "--forms", "form1"])
    (line,) = capfd.readouterr().out.splitlines()
    position = float(re.findall(r"position ([\d.]+) mm", line)[0])
    attitude = float(re.findall(r"attitude ([\d.]+) mrad", line)[0])
    assert position < 50.0
    assert attitude < 50.0
    assert line.endswith("success: True")


@drawing
def test_run_records_a_video_and_nothing_else(here, caplog):
    main(["run", "--seconds", "0.1", "--out", "films/hover.mp4"])
    assert list(files(here)) == ["films/hover.mp4"]
    assert b"ftyp" in (here / "films/hover.mp4").read_bytes()[:16]
    assert caplog.records == []


@drawing
def test_a_video_is_as_readable_as_any_other_new_file(here):
    main(["run", "--seconds", "0.1", "--out", "film.mp4"])
    (here / "plain").write_text("")
    assert (here / "film.mp4").stat().st_mode == (here / "plain").stat().st_mode


@drawing
def test_a_video_that_cannot_take_its_place_leaves_no_half_of_it(here, capfd):
    (here / "film.mp4").mkdir()
    with pytest.raises(SystemExit) as stop:
        main(["run", "--seconds", "0.1", "--out", "film.mp4"])
    assert stop.value.code == 2
    assert files(here) == {}


@drawing
def test_an_interrupted_recording_leaves_nothing(here, monkeypatch):
    def interrupt(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(viz.film.Stage, "render", interrupt)
    with pytest.raises(SystemExit) as stop:
        main(["run", "--seconds", "0.1", "--out", "film.mp4"])
    assert stop.value.code == 130
    assert files(here) == {}


def test_a_crawl_is_run_until_it_is_finished(here, capfd):
    main(["run", "spidar_gym/Crawl-v0", "--distance", "0.1", "--direction", "90", "--turn", "0",
          "--schedule", "overlapped", "--joint-speed", "0.4"])  # fmt: skip
    out = capfd.readouterr().out
    assert "success: True" in out
    assert "goal off by" in out
