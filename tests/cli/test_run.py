"""Pins `spidar run`: episodes and their report, the effect of every option, and complete videos or none."""

import ctypes.util
import re
from pathlib import Path

import numpy as np
import pytest
from support.commands import LEARNED, ROOT, files, refused
from support.zips import Trap, changed, learned, packed

from spidar_gym import viz
from spidar_gym.benchmark.row import read_rows
from spidar_gym.cli.main import main
from spidar_gym.cli.run import COURSE_PACE
from spidar_gym.envs.registry import COURSE, GRASP
from spidar_gym.tasks.hover import HoverTask

drawing = pytest.mark.skipif(
    not (ctypes.util.find_library("EGL") or ctypes.util.find_library("OSMesa")), reason="no OpenGL library"
)


def test_run_reports_each_episode_and_the_number_that_stayed_in_the_air(capfd, here):
    main(["run", "--episodes", "2", "--seed", "5", "--seconds", "0.25", "--forms", "form1"])
    *lines, survivors = capfd.readouterr().out.splitlines()
    assert [line.split(",")[0] for line in lines] == ["episode 1 (seed 5): 0.2 s", "episode 2 (seed 6): 0.2 s"]
    assert survivors.startswith("2 of 2 stayed in the air")
    assert list(here.iterdir()) == []


def test_a_failed_episode_is_not_counted_as_staying_in_the_air(capfd, monkeypatch):
    failed, checked = HoverTask.failed, []

    def tilts_third(task, robots):
        checked.append(robots.ticks)
        return failed(task, robots) | {"tilt": np.array([len(checked) == 3])}

    monkeypatch.setattr(HoverTask, "failed", tilts_third)
    main(["run", "--episodes", "3", "--seconds", "0.1", "--forms", "form1"])
    *lines, survivors = capfd.readouterr().out.splitlines()
    assert [line.endswith("failure: tilt") for line in lines] == [True, False, False]
    assert survivors.startswith("2 of 3 stayed in the air")


def test_one_episode_has_no_line_of_survivors(capfd):
    main(["run", "--seconds", "0.1", "--forms", "form1"])
    assert "stayed" not in capfd.readouterr().out


@pytest.mark.parametrize("observation", ["goal", "asymmetric"])
def test_an_episode_is_the_same_with_every_observation(observation, capfd):
    flights = []
    for more in ([], ["--observation", observation]):
        main(["run", "--seconds", "0.5", "--forms", "form1", *more])
        flights.append(capfd.readouterr().out)
    assert (flights[0] == flights[1]) == (observation == "asymmetric")  # a goal has a different reward
    assert flights[0].partition("RMS")[2] == flights[1].partition("RMS")[2] != ""


def test_a_goal_in_an_environment_without_goals_is_refused(capfd):
    refused(capfd, "run", "spidar_gym/Path-v0", "--observation", "goal")


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
    for options in (["--preset", "paper"], ["--policy", "baselines.qp:QP"], ["--policy", LEARNED]):
        main(["run", "--seconds", "6", "--forms", "independent", "--joint-speed", "1.25", *options])
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


def test_on_a_course_the_rule_is_run_and_its_time_and_charge_are_printed(here, capfd):
    main(["run", COURSE, "--seed", "2", "--seconds", "4"])
    (line,) = capfd.readouterr().out.splitlines()
    assert line.startswith("episode 1 (seed 2): 4.0 s")
    assert re.search(r"goal off by .* mm, .* mrad, [34] s in the air, 0 s crawled, \d+% of the battery left", line)
    assert list(here.iterdir()) == []


@drawing
def test_a_video_of_a_course_is_faster_and_shows_phase_form_thrust_and_charge(here, monkeypatch):
    takes = []
    shoot = viz.Film.shoot
    monkeypatch.setattr(viz.Film, "shoot", lambda film, *own, **how: (takes.extend(own), shoot(film, *own, **how)))
    main(["run", COURSE, "--seed", "2", "--seconds", "3", "--camera", "chase", "--out", "course.mp4"])
    assert list(files(here)) == ["course.mp4"]
    assert b"ftyp" in (here / "course.mp4").read_bytes()[:16]
    (take,) = takes
    assert take.pace == COURSE_PACE
    assert list(take.traces) == ["height of the torso [m]", "thrust over weight", "charge [%]"]
    assert take.phase[0] == "spool"
    assert "climb" in take.phase
    assert take.traces["thrust over weight"][-1] > 0.9
    assert (np.diff(take.traces["charge [%]"]) < 0.0).all()
    assert take.ground.boxed
    assert take.time[-1] == pytest.approx(3.0)


def test_in_a_grasp_the_rule_is_run_and_where_the_object_stands_is_printed(here, capfd):
    main(["run", GRASP, "--seed", "1"])
    (line,) = capfd.readouterr().out.splitlines()
    assert re.search(
        r"object off by .* mm, .* mrad, lifted by 0\.7\d m, .* \d+ N, grasps begun: 1, success: True", line
    )


@drawing
def test_a_video_of_a_grasp_shows_the_object_and_its_height_grip_force_and_thrust(here, monkeypatch):
    takes = []
    shoot = viz.Film.shoot
    monkeypatch.setattr(viz.Film, "shoot", lambda film, *own, **how: (takes.extend(own), shoot(film, *own, **how)))
    main(["run", GRASP, "--seed", "1", "--seconds", "1", "--out", "grasp.mp4"])
    assert b"ftyp" in (here / "grasp.mp4").read_bytes()[:16]
    (take,) = takes
    assert take.thing.exists
    np.testing.assert_allclose(take.traces["height of the object [m]"], take.qpos[:, 41])
    assert take.qpos[0, 41] < 0.5 < take.qpos[0, 2]
    assert [*take.traces][1:] == ["planned grip of a foot [N]", "largest force of a foot [N]", "thrust over weight"]
    assert take.phase[-1].startswith("over, ")


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    """Return the path of a zip saved by Stable-Baselines3."""
    pytest.importorskip("stable_baselines3", reason="the extra `train` is not installed")
    return str(learned(tmp_path_factory.mktemp("zips") / "model.zip"))


@pytest.mark.train
def test_a_trusted_zip_flies_after_a_warning_of_one_line(model, capfd):
    flights = []
    for options in ([], ["--policy", model, "--trust"]):
        main(["run", "--seconds", "0.5", "--forms", "form1", *options])
        out, err = capfd.readouterr()
        flights.append(out)
        assert ("warning" in err) == bool(options)
    assert f"spidar: warning: {model} is trusted: any code in it is run\n" in err
    assert err.count("warning") == 1
    alone, flown = flights
    assert flown.startswith("episode 1 (seed 0): 0.5 s")
    assert flown != alone


@pytest.mark.train
def test_a_trusted_zip_is_ranked_by_its_path_and_verified(model, here, capfd):
    call = ["eval", "--policy", str(model), "--tracks", "flight-paper", "--scenarios", "1", "--trust", "--out", "rows"]
    for workers in ("1", "2"):
        main([*call, "--workers", workers])
    (row,) = read_rows(Path("rows")).values()
    assert (row.kind, row.policies) == ("learned", (str(model),))
    capfd.readouterr()
    check = ["leaderboard", "verify", "--rows", "rows", "--sample", "1", "--workers", "1"]
    with pytest.raises(SystemExit):
        main(check)
    assert "is code from outside" in capfd.readouterr().err
    main([*check, "--trust"])
    assert "1 equal bit for bit" in capfd.readouterr().out


@pytest.mark.train
@pytest.mark.parametrize("option", ["--policy", "--against"])
def test_without_trust_no_code_of_a_zip_runs(option, model, here, capfd):
    trap = here / "trap.zip"
    with open(model, "rb") as file:
        trap.write_bytes(changed(file.read(), observation_space=packed(Trap(here / "sprung"))))
    before = ["--policy", LEARNED] if option == "--against" else []
    line = refused(capfd, "run", *before, option, "trap.zip", "--seconds", "0.1")
    assert "trap.zip: a zip of Stable-Baselines3 can run code; valid: --trust, if you trust who made it" in line
    line = refused(capfd, "eval", "--policy", "trap.zip", "--scenarios", "1")
    assert "trap.zip: a zip of Stable-Baselines3 can run code; valid: --trust, if you trust who made it" in line
    assert list(files(here)) == ["trap.zip"]


@pytest.mark.train
@pytest.mark.parametrize(
    ("where", "sizes"),
    [(["--action-mode", "direct"], (241, 40)), (["spidar_gym/Crawl-v0"], (184, 4))],
    ids=["mode", "environment"],
)
def test_a_zip_that_learned_elsewhere_is_refused_with_both_shapes(where, sizes, model, capfd):
    with pytest.raises(SystemExit) as stop:
        main(["run", *where, "--policy", model, "--trust"])
    out, err = capfd.readouterr()
    warning, line = err.splitlines()
    assert (stop.value.code, out, "warning" in warning) == (2, "", True)
    assert "model learned on observations (207,) float32 in -400 … 400 and actions (6,) float32" in line
    assert re.findall(r" has \((\d+),\) float32 in .* and actions \((\d+),\)", line) == [tuple(map(str, sizes))]
    assert "--action-mode" in line


@pytest.mark.train
def test_a_zip_trained_in_a_foreign_environment_is_refused(model, here, capfd):
    learned(here / "pole.zip", "CartPole-v1")
    with pytest.raises(SystemExit):
        main(["run", "--policy", "pole.zip", "--trust"])
    *_, line = capfd.readouterr().err.splitlines()
    assert line.startswith("spidar: policy pole learned on observations (4,)")
    assert "actions Discrete(2)" in line


LOADED = '[[payloads]]\nbody = "link2"\nmass = 1.0\nposition = [0.4, 0.0, 0.0]\n'


def own_robot(folder, text="pitch_to_foot = 0.6138\n"):
    """Write the file of a robot."""
    path = folder / "own.toml"
    path.write_text(text, encoding="utf-8")
    return str(path)


def test_a_custom_robot_flies_and_crawls_from_its_file(capfd, here, tmp_path):
    heights = []
    for robot in ([], ["--robot", own_robot(tmp_path, LOADED)]):
        main(["run", "--seconds", "1", "--forms", "form1", *robot])
        heights.append(capfd.readouterr().out)
    assert heights[0] != heights[1]
    main(["run", "spidar_gym/Crawl-v0", "--seconds", "0.25", "--robot", own_robot(tmp_path)])
    assert "episode 1 (seed 0): 0.2 s" in capfd.readouterr().out


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("legs = 6\n", "every robot has 4 legs"),
        ("max_thrust = 5.0\n", "max_thrust = 5.0 is not valid; expected at least 24.52 N"),
        ("max_thrust\n", "cannot be read"),
    ],
)
def test_an_invalid_file_of_a_robot_is_refused_in_one_line(capfd, tmp_path, text, words):
    assert words in refused(capfd, "run", "--robot", own_robot(tmp_path, text))


def test_a_policy_trained_on_the_nominal_robot_is_refused_for_another(capfd, tmp_path):
    words = refused(capfd, "run", "--seconds", "0.1", "--policy", LEARNED, "--robot", own_robot(tmp_path))
    assert "supports only the nominal robot; valid with a custom robot: a preset" in words
    words = refused(capfd, "run", "--seconds", "0.1", "--policy", "baselines.pinv:Pinv", "--robot", own_robot(tmp_path))
    assert "supports only the nominal robot" in words
