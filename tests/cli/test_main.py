"""Pins the command line: help with units, one line for every error and nothing written, JSON alone on stdout."""

import ctypes.util
import dataclasses
import functools
import json
import math
import os
import platform
import re
import shutil
import subprocess
import sys
from importlib import metadata
from pathlib import Path

import numpy as np
import pytest

import spidar_gym
from spidar_gym import viz
from spidar_gym.cli import main as cli
from spidar_gym.cli.main import main
from spidar_gym.envs.actions import ACTION_MODES, CRAWL_MODES
from spidar_gym.envs.docs import page, pages
from spidar_gym.envs.hover.task import SEQUENCES, HoverTask
from spidar_gym.envs.registry import ENVIRONMENTS, import_id
from spidar_gym.errors import MissingDependencyError
from spidar_gym.paper import crawl as crawl_experiment
from spidar_gym.paper import flight as experiments
from spidar_gym.paper import flight_studies as studies
from spidar_gym.paper import tune
from spidar_gym.paper.flight import FlightLog
from spidar_gym.paper.trial import Outcome
from spidar_gym.robot import FORMS, description
from spidar_gym.robot.description import CAMERAS, generated_files

NAMES = (
    "paper",
    "run",
    "eval",
    "leaderboard",
    "scenarios",
    "export",
    "docs",
    "sitl",
    "lost",
    "tune",
    "view",
    "assets",
    "bench",
    "list",
)
ROOT = Path(__file__).resolve().parents[2]
LEARNED = str(ROOT / "baselines" / "learned" / "supervised_paper" / "seed0.npz")
COMMANDS = [["paper"], ["paper", "flight"], ["paper", "crawl"], *([name] for name in NAMES[1:])]
drawing = pytest.mark.skipif(
    not (ctypes.util.find_library("EGL") or ctypes.util.find_library("OSMesa")), reason="no OpenGL library"
)


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch) -> Path:
    """An empty working folder without a display."""
    folder = tmp_path / "here"
    folder.mkdir()
    monkeypatch.chdir(folder)
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    return folder


@pytest.fixture
def short_crawl(monkeypatch):
    """A crawl experiment of one quick cycle."""
    crawl = crawl_experiment.crawl_paper

    def short(preset, on_tick=None, **options):
        return crawl(preset, **options | {"distance": 0.1, "joint_speed": 0.6})

    monkeypatch.setattr(crawl_experiment, "crawl_paper", short)


@pytest.fixture
def still(monkeypatch):
    """A flight experiment that takes no time: 40 s in which nothing moves."""
    n = 1600
    log = FlightLog(
        "as_flown", np.arange(1, n + 1) / 40, np.zeros((n, 3)), np.zeros((n, 3)), np.zeros((n, 16)), np.zeros((n, 16)),
        np.zeros((n, 8, 2)), np.full((n, 8), 19.62), np.full(n, 1e-4), np.full(n, "solved"),
        np.zeros((n, 3)), np.full(n, 3e3), np.zeros((n, 39)),
    )  # fmt: skip
    monkeypatch.setattr(
        experiments,
        "fly_paper",
        lambda preset, noise=False, seed=0, on_tick=None: dataclasses.replace(log, preset=preset, noise=noise),
    )


@pytest.fixture
def assets(tmp_path, monkeypatch) -> Path:
    """A copy of the assets that the command line works on, beside one of the guide's generated pages."""
    folder = tmp_path / "checkout" / "assets"
    shutil.copytree(description.assets_dir(), folder)
    shutil.copytree(ROOT / "docs" / "environments", folder.parent / "docs" / "environments")
    shutil.copy(ROOT / "docs" / "conf.py", folder.parent / "docs")
    for module in (cli, description):
        monkeypatch.setattr(module, "assets_dir", lambda: folder)
    return folder


def refused(capfd, *arguments) -> str:
    """The one line on stderr with which a command is refused."""
    with pytest.raises(SystemExit) as stop:
        main(list(arguments))
    out, err = capfd.readouterr()
    assert stop.value.code == 2
    assert out == ""
    assert err.endswith("\n")
    (line,) = err.splitlines()
    assert line.startswith("spidar: ")
    return line


def files(folder: Path) -> dict[str, bytes]:
    return {p.relative_to(folder).as_posix(): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


@pytest.mark.parametrize("command", [[], *COMMANDS], ids=" ".join)
def test_every_command_has_help_and_every_quantity_a_unit(command, capfd):
    with pytest.raises(SystemExit) as stop:
        main([*command, "--help"])
    out, err = capfd.readouterr()
    assert stop.value.code in (0, None)
    assert err == ""
    assert f"usage: spidar {' '.join(command)}".strip() in out
    text = " ".join(out.replace("│", " ").split())
    options = re.split(r" (?=--\w)", text)
    quantities = [option for option in options if re.match(r"--\S+ (\{None\}\|)?FLOAT", option)]
    assert len(quantities) == {"run": 11, "paper crawl": 4, "bench": 1, "eval": 1, "export": 1}.get(
        " ".join(command), 0
    )
    # A strength has no unit, but a range; friction has neither. Degrees exist on the command line only, and it says so.
    unit = r"\[(s|1/s|rad/s|m/s|N|m|degrees; radians in gymnasium\.make)\]|0 … 1\b|Sliding friction|like the next two"
    assert all(re.search(unit, option) for option in quantities)


def test_the_help_names_every_command(capfd):
    with pytest.raises(SystemExit):
        main(["--help"])
    out = capfd.readouterr().out
    assert all(f"• {name} " in out for name in NAMES)


def test_list_names_everything_there_is_and_prints_a_page_by_id(capfd):
    main(["list"])
    out = capfd.readouterr().out
    assert {import_id(name) for name in ENVIRONMENTS} <= set(re.split(r"[\s,]+", out))
    words = re.split(r"[\s,:]+", out)
    assert set(ENVIRONMENTS) | set(SEQUENCES) | set(CAMERAS) | {"as_flown", "tuned", "residual_force"} <= set(words)
    for name in ENVIRONMENTS:
        main(["list", name])
        assert capfd.readouterr().out == page(name) + "\n"


def test_the_version_is_that_of_the_package_and_of_everything_that_it_rests_on(capfd):
    main(["--version"])
    found = dict(line.split() for line in capfd.readouterr().out.splitlines())
    assert found["spidar-gym"] == spidar_gym.__version__
    assert found["python"] == platform.python_version()
    for package in ("mujoco", "gymnasium", "numpy", "osqp", "pin", "scipy", "torch", "stable-baselines3"):
        assert found[package] == metadata.version(package)


def run(*arguments, **environment):
    """The command line in a process of its own."""
    code = "import sys; from spidar_gym.cli.main import main; main(sys.argv[1:])"
    return subprocess.run(
        [sys.executable, "-c", code, *arguments], env=os.environ | environment, capture_output=True, text=True,
        check=False,
    )  # fmt: skip


@pytest.mark.parametrize("named", ["foo", "disable", "osmesa"])
def test_a_library_for_drawing_that_is_none_stops_nothing_but_drawing(named, here):
    listed = run("list", MUJOCO_GL=named)
    assert listed.returncode == 0, listed.stderr
    assert "spidar_gym/Hover-v0" in listed.stdout
    if named == "osmesa" and ctypes.util.find_library("OSMesa"):
        return
    drawn = run("run", "--seconds", "0.1", "--out", "film.mp4", MUJOCO_GL=named)
    assert drawn.returncode == 2
    (line,) = drawn.stderr.splitlines()
    assert f"MUJOCO_GL='{named}'" in line
    assert "egl" in line
    assert list(here.iterdir()) == []


@pytest.mark.parametrize("unbuffered", ["", "1"])
def test_a_reader_that_goes_is_answered_without_a_word(unbuffered):
    code = "import sys; from spidar_gym.cli.main import main; main(['list', 'spidar_gym/Hover-v0'])"
    reader, writer = os.pipe()
    os.close(reader)
    told = subprocess.run(
        [sys.executable, "-c", code], stdout=writer, stderr=subprocess.PIPE, text=True, check=False,
        env=os.environ | {"PYTHONUNBUFFERED": unbuffered},
    )  # fmt: skip
    os.close(writer)
    assert told.stderr == ""
    assert told.returncode == 141


def test_a_pipe_that_breaks_elsewhere_is_not_taken_for_the_readers_leave(monkeypatch):
    monkeypatch.setattr(cli, "versions", lambda *_: (_ for _ in ()).throw(BrokenPipeError("a worker's")))
    with pytest.raises(BrokenPipeError, match="a worker's"):
        main(["--version"])


@pytest.mark.parametrize(
    ("arguments", "valid"),
    [
        ([], ", ".join(NAMES)),
        (["fly"], ", ".join(NAMES)),
        (["paper", "walk"], "crawl"),
        (["paper", "crawl", "--preset", "paper"], "published, overlapped, robust"),
        *((["paper", "crawl", "--distance", v], "within 0 … 10 [m]") for v in ("-1", "nan", "50")),
        *((["paper", "crawl", "--speed", v], "[rad/s]") for v in ("0", "nan", "9")),
        (["paper", "crawl", "--distance", "0"], "a way or a turn above 0"),
        (["paper", "crawl", "--direction", "inf"], "finite numbers [degrees]"),
        (["paper", "crawl", "--turn", "359.8"], "within -237.296 … 237.296 [degrees]"),
        (["paper", "crawl", "--turn", "235"], "the arc leads 0.56 m away from the goal"),
        (["paper", "crawl", "--distance", "9"], "a way of at most 300 s; this one takes 504 s by plan"),
        (["paper", "crawl", "--study", "--seeds", "0"], "at least 1"),
        (["paper", "crawl", "--draws", "-1"], "at least 0"),
        (["run", "spidar_gym/Crawl-v0", "--schedule", "trot"], "sequential, overlapped"),
        (["run", "spidar_gym/Crawl-v0", "--friction", "-1"], "within 0.001"),
        (["run", "spidar_gym/Crawl-v0", "--forms", "paper"], "distance, direction, turn"),
        (["run", "--slope", "3"], "forms, joint_speed"),
        (["paper", "flight", "--preset", "mine"], "paper, as_flown, tuned"),
        *((["paper", "flight", what, "--scenarios", "0"], "at least 1") for what in ("--speeds", "--ablation")),
        (["paper", "flight", "--speeds", "--workers", "0"], "at least 1"),
        (["paper", "flight", "--noise", "--seed", "-1"], "at least 0"),
        (["lost", "--preset", "mine"], "paper, as_flown, tuned"),
        *(
            (["tune", f"--{name}", "0"], "at least 1") for name in ("generations", "flights", "workers")
        ),
        (["tune", "--population", "1", "--flights", "1", "--generations", "1"], "at least 2"),
        (["paper", "flight", "--camera", "back"], "fixed, chase, side, front, top"),
        (["run", "spidar_gym/Walk-v0"], "spidar_gym/Hover-v0"),
        (["run", "--forms", "form4"], ", ".join(SEQUENCES)),
        (["run", "--preset", "mine"], "paper, as_flown, tuned"),
        (["run", "--action-mode", "mine"], ", ".join(ACTION_MODES)),
        (["run", "--action-mode", "residual_gait"], ", ".join(ACTION_MODES)),
        (["run", "spidar_gym/Crawl-v0", "--action-mode", "mine"], ", ".join(CRAWL_MODES)),
        (["run", "--policy", LEARNED, "--action-mode", "residual"], "which chooses residual_wrench"),
        *((["run", "--randomization", v], "within 0 … 1") for v in ("-0.1", "1.5", "nan")),
        *((["run", "--wind", v], "at least 0 [m/s]") for v in ("-1", "nan", "inf")),
        *((["run", "--push", v], "at least 0 [N]") for v in ("-1", "nan")),
        *((["run", "--lost-rotor", v], "1 … 8, or 0 for none") for v in ("9", "-1")),
        (["run", "--lost-rotor", "2.5"], "--lost-rotor = '2.5' is not valid; expected a whole number: Module"),
        (["run", "--lost-rotor", "3", "--fault", "engine"], "thrust, vectoring"),
        (["run", "--seconds", "0.1", "--seed", "-1"], "at least 0"),
        (["run", "--policy", "nobody"], "module:Class, or the path of an artifact"),
        (["run", "--policy", "none.npz"], "none.npz"),
        (["run", "spidar_gym/Crawl-v0", "--policy", LEARNED], "this one is for spidar_gym/Hover-v0"),
        (["run", "--policy", LEARNED, "--preset", "tuned"], "nothing beside this policy, which chooses paper"),
        (["run", "--camera", "back", "--seconds", "0.1"], "fixed, chase, side, front, top"),
        (["run", "--camera", "back", "--seconds", "0.1", "--out", "films/x.mp4"], "fixed, chase, side, front, top"),
        *(
            (["run", "--seconds", "0.1", "--joint-speed", v], "within 1e-06 … 1000 [rad/s]")
            for v in ("0", "-0.2", "nan", "inf")
        ),
        (["run", "--joint-speed", "fast"], "--joint-speed = 'fast' is not valid; expected a number: Joint"),
        (["paper", "crawl", "--distance", "far"], "--distance = 'far' is not valid; expected a number: How far [m]"),
        (["run", "--episodes", "1.5"], "expected a whole number: How many episodes"),
        (["eval", "--scenarios", "x"], "--scenarios = 'x' is not valid; expected a whole number: How many"),
        (["run", "--seed"], "Missing value for argument '--seed'"),
        (["run", "--episodes", "0"], "at least 1"),
        *((["run", "--seconds", v], "at least one tick, 0.025 s") for v in ("0", "-1", "nan", "inf", "0.01")),
        (["run", "--seconds", "0.1", "--out", "film.gif"], ".mp4"),
        (["run", "--speed", "1"], "spidar --help"),
        (["run", "--seconds", "0.1", "--show"], "--out FILE.mp4"),
        (["view", "--form", "form4"], ", ".join(FORMS)),
        (["view"], "--out FILE.mp4"),
        (["list", "spidar_gym/Walk-v0"], "spidar_gym/Hover-v0"),
        (["bench", "--seconds", "0"], "above 0 [s]"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)  # fmt: skip
def test_bad_input_is_refused_in_one_line_that_names_what_is_valid_and_nothing_is_written(
    arguments, valid, capfd, here
):
    assert valid in refused(capfd, *arguments)
    assert list(here.iterdir()) == []


# Assets


def test_the_committed_assets_are_fresh(capfd):
    main(["assets", "--check"])
    assert f"{len(generated_files()) + len(pages())} generated files" in capfd.readouterr().out


@pytest.mark.parametrize("name", [*(f"assets/{n}" for n in generated_files()), *(f"docs/{n}" for n in pages())])
@pytest.mark.parametrize("missing", [False, True])
def test_a_stale_asset_is_named_by_the_check_which_writes_nothing(name, missing, assets, capfd):
    path = assets.parent / name
    path.unlink() if missing else path.write_text(path.read_text(encoding="utf-8") + " ", encoding="utf-8")
    before = files(assets.parent)
    line = refused(capfd, "assets", "--check")
    assert str(path) in line
    assert "spidar assets" in line
    assert files(assets.parent) == before


def test_assets_are_written_whole_and_only_where_they_are_stale(assets, capfd):
    fresh = files(assets.parent)
    (assets / "mjcf" / "spidar.xml").write_text("<mujoco/>", encoding="utf-8")
    for name in pages():
        (assets.parent / "docs" / name).unlink()
    main(["assets"])
    assert capfd.readouterr().out.startswith(f"{1 + len(ENVIRONMENTS)} of ")
    assert files(assets.parent) == fresh
    main(["assets"])
    assert capfd.readouterr().out.startswith("0 of ")
    assert files(assets.parent) == fresh


def test_an_installed_package_has_no_guide_to_write(assets, capfd):
    shutil.rmtree(assets.parent / "docs")
    main(["assets", "--check"])
    assert capfd.readouterr().out.startswith(f"{len(generated_files())} generated files")
    main(["assets"])
    assert not (assets.parent / "docs").exists()


def test_an_asset_that_cannot_be_written_is_one_line_and_leaves_no_half_of_it(assets, capfd):
    (assets / "README.md").unlink()
    (assets / "README.md").mkdir()
    before = files(assets)
    assert "README.md" in refused(capfd, "assets")
    assert files(assets) == before


# The paper's flight


def test_the_flight_prints_exactly_one_json_object_on_stdout_and_writes_it_with_the_figure(still, here, capfd):
    main(["paper", "flight", "--json", "--no-video", "--out", "a/b"])
    result = json.loads(capfd.readouterr().out)
    assert set(result) == {"flight", "paper"}
    assert set(result["paper"]) == {"flight"}
    assert result["flight"]["thrust_form1_n"] == pytest.approx([19.62] * 8)
    assert sorted(files(here)) == ["a/b/flight.json", "a/b/flight.pdf", "a/b/flight.png"]
    assert json.loads((here / "a/b/flight.json").read_text(encoding="utf-8")) == result
    assert (here / "a/b/flight.png").read_bytes().startswith(b"\x89PNG")


def test_paper_alone_flies_and_crawls_and_prints_both_tables(still, short_crawl, here, capfd, monkeypatch):
    def missing(*_, **__):
        raise MissingDependencyError("a library", "apt-get install libsomething")

    monkeypatch.setattr(viz, "flight_figure", missing)
    for module in (viz.film, viz.stills):
        monkeypatch.setattr(module, "Stage", missing)
    main(["paper"])
    out = capfd.readouterr().out
    assert "RMSE position" in out
    assert "final position error" in out
    assert sorted(files(here)) == [
        *(f"out/crawl/crawl.{kind}" for kind in ("json", "pdf", "png")), "out/flight/flight.json",
    ]  # fmt: skip


def test_the_crawl_prints_exactly_one_json_object_with_every_figure_that_is_asked_for(short_crawl, here, capfd):
    main(["paper", "crawl", "--json", "--no-video", "--out", "a"])
    result = json.loads(capfd.readouterr().out)
    assert set(result) == {"crawl", "paper"}
    wanted = {
        "preset", "final_position_error_m", "yaw_final_rad", "yaw_peak_to_peak_rad", "roll_pitch_legs_up_rad",
        "roll_pitch_torso_rad", "duration_s", "duration_overlapped_s", "thrust_fraction_mean", "thrust_fraction_peak",
        "foot_slip_m", "airborne_share", "duct_clearance_m", "saturation_share", "qp",
    }  # fmt: skip
    assert wanted <= set(result["crawl"])
    assert len(result["crawl"]["final_position_error_m"]) == 3
    assert result["crawl"]["is_success"]
    assert set(result["paper"]) == {"crawl"}
    assert json.loads((here / "a/crawl.json").read_text(encoding="utf-8")) == result


def test_a_crawl_is_run_until_it_is_finished(here, capfd):
    main(["run", "spidar_gym/Crawl-v0", "--distance", "0.1", "--direction", "90", "--turn", "0",
          "--schedule", "overlapped", "--joint-speed", "0.4"])  # fmt: skip
    out = capfd.readouterr().out
    assert "success: True" in out
    assert "goal off by" in out


@pytest.mark.parametrize("what", ["film_take", "flight_figure"])
def test_without_opengl_or_matplotlib_the_flight_finishes_and_says_what_to_install(
    what, still, here, capfd, monkeypatch
):
    def missing(*_, **__):
        raise MissingDependencyError("a library", "apt-get install libsomething")

    monkeypatch.setattr(viz, "flight_figure", lambda log, path: path.write_bytes(b""))
    monkeypatch.setattr(viz, what, missing)
    main(["paper", "flight", "--json", *(["--no-video"] if what == "flight_figure" else [])])
    out, err = capfd.readouterr()
    assert "flight" in json.loads(out)
    (remark,) = [line for line in err.splitlines() if "install" in line]
    assert "apt-get install libsomething" in remark
    drawn = ["out/flight/flight.png"] if what == "film_take" else []
    assert sorted(files(here)) == ["out/flight/flight.json", *drawn]


def test_where_the_renderer_finds_no_opengl_the_flight_says_so(still, here, capfd, monkeypatch):
    import mujoco

    def broken(*_, **__):
        raise AttributeError("'NoneType' object has no attribute 'eglQueryString'")

    monkeypatch.setattr(mujoco, "MjrContext", broken)
    monkeypatch.setattr(viz, "flight_figure", lambda log, path: None)
    main(["paper", "flight"])
    out, err = capfd.readouterr()
    assert "RMSE position" in out
    (remark,) = [line for line in err.splitlines() if "OpenGL" in line]
    assert "apt-get install" in remark


@pytest.mark.parametrize(
    "arguments",
    [["paper", "flight", "--no-video", "--out", "file"], ["paper", "flight", "--no-video", "--out", "file/sub"],
     ["run", "--seconds", "0.1", "--out", "file/film.mp4"]],
    ids=" ".join,
)  # fmt: skip
def test_an_output_with_a_file_in_its_way_is_refused_before_anything_flies(arguments, still, here, capfd):
    (here / "file").write_text("mine")
    assert "writable folder" in refused(capfd, *arguments)
    assert files(here) == {"file": b"mine"}


@pytest.mark.parametrize("name", ["flight.json", "flight.png", "flight.pdf"])
def test_an_output_file_that_is_a_folder_is_one_line_and_leaves_no_half_of_it(name, still, here, capfd):
    (here / "out" / name).mkdir(parents=True)
    with pytest.raises(SystemExit) as stop:
        main(["paper", "flight", "--no-video", "--out", "out"])
    assert stop.value.code == 2
    assert [line for line in capfd.readouterr().err.splitlines() if line.startswith("spidar: ") and name in line]
    assert set(files(here)) <= {"out/flight.json", "out/flight.pdf", "out/flight.png"}


@pytest.mark.slow
def test_the_real_flight_prints_exactly_one_json_object_on_stdout(here, capfd):
    main(["paper", "flight", "--json", "--no-video"])
    flight = json.loads(capfd.readouterr().out)["flight"]
    assert flight["preset"] == "as_flown"
    assert len(flight["thrust_form3_n"]) == 8
    assert all(math.isfinite(x) for x in (*flight["rmse_position_m"], *flight["rmse_attitude_rad"]))
    assert sorted(files(here)) == [f"out/flight/flight.{kind}" for kind in ("json", "pdf", "png")]


def test_the_flight_with_noise_says_so_and_stands_beside_the_papers_rmse(still, here, capfd):
    outputs = []
    for options in ([], ["--noise", "--seed", "3"]):
        main(["paper", "flight", "--no-video", *options])
        outputs.append(capfd.readouterr().out)
    assert ["with noise" in out for out in outputs] == [False, True]
    assert ["0.038  0.037  0.043" in out for out in outputs] == [False, True]
    assert json.loads((here / "out/flight/flight.json").read_text(encoding="utf-8"))["flight"]["noise"] is True


def test_noise_and_seed_reach_the_flight(here, monkeypatch):
    given = {}

    def stop(preset, **options):
        given.update(options, preset=preset)
        raise KeyboardInterrupt

    monkeypatch.setattr(experiments, "fly_paper", stop)
    with pytest.raises(SystemExit):
        main(["paper", "flight", "--noise", "--seed", "7", "--preset", "tuned"])
    assert (given["preset"], given["noise"], given["seed"]) == ("tuned", True, 7)


# Studies


@pytest.fixture
def quick(monkeypatch):
    """Flights of the studies that take no time; gives the list of the flights asked for."""
    asked = []

    def fly_all(jobs, *, workers=1, folder=None, on_done=lambda: None):
        jobs = list(jobs)
        asked.extend(jobs)
        outcomes = []
        for k, (_, scenario) in enumerate(jobs):
            on_done()
            outcomes.append(Outcome(0.001 * (1 + k % 7), 0.002 * scenario.joint_speed, 0, 3.0, 0, ""))
        return outcomes

    for module in (studies, tune):
        monkeypatch.setattr(module, "fly_all", fly_all)
    monkeypatch.setattr(studies, "compare", functools.partial(studies.compare, draws=20))
    return asked


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


def test_lost_reports_every_rotor_in_every_form_and_fault(here, capfd, monkeypatch):
    flight = {
        "position_m": 0.01, "attitude_rad": 0.02, "commands_in_bounds": True, "failure": "", "seconds": 12.0,
    }  # fmt: skip
    monkeypatch.setattr(studies, "_fly_lost", lambda preset, form, disturbances: flight)
    main(["lost", "--json", "--out", "o"])
    rows = json.loads(capfd.readouterr().out)["lost_rotors"]
    assert sorted(files(here)) == ["o/lost.json"]
    assert {(row["fault"], row["form"], row["rotor"]) for row in rows} == {
        (fault, form, rotor) for fault in ("thrust", "vectoring") for form in FORMS for rotor in range(1, 9)
    }
    assert len(rows) == 2 * 8 * len(FORMS)
    # What statics allows of form ②: seven rotors carry the robot whichever is lost.
    assert all(row["feasible"] for row in rows if row["form"] == "form2")
    main(["lost"])
    assert sum(line.startswith(("thrust", "vectoring")) for line in capfd.readouterr().out.splitlines()) == len(rows)


def test_tune_searches_writes_its_state_and_goes_on_where_it_stopped(quick, here, capfd):
    pytest.importorskip("cma")
    arguments = ["tune", "--population", "4", "--flights", "2", "--seed", "3"]
    main([*arguments, "--generations", "1"])
    assert "cost" in capfd.readouterr().out
    # Four candidates and the mean of the distribution.
    assert len(quick) == 5 * 2
    main([*arguments, "--generations", "2"])
    assert len(quick) == 2 * 5 * 2
    out = capfd.readouterr().out
    assert "after 2 generations" in out
    assert "gain margin" in out
    log = json.loads((here / "out/tune/tune.json").read_text(encoding="utf-8"))["log"]
    assert [line["generation"] for line in log] == [0, 1]
    assert set(files(here)) == {"out/tune/tune.json"}
    before = files(here)
    assert "valid: the same settings, or another folder" in refused_after_a_bar(
        capfd, "tune", "--population", "5", "--flights", "2", "--seed", "3"
    )
    assert files(here) == before


def refused_after_a_bar(capfd, *arguments) -> str:
    """The last line on stderr of a command that is refused when its progress bar is there already."""
    with pytest.raises(SystemExit) as stop:
        main(list(arguments))
    out, err = capfd.readouterr()
    assert stop.value.code == 2
    assert out == ""
    line = err.splitlines()[-1]
    assert line.startswith("spidar: ")
    return line


# Episodes


def test_run_flies_the_episodes_it_was_asked_for_and_reports_each_and_who_stayed_in_the_air(capfd, here):
    main(["run", "--episodes", "2", "--seed", "5", "--seconds", "0.25", "--forms", "form1"])
    *lines, survivors = capfd.readouterr().out.splitlines()
    assert [line.split(",")[0] for line in lines] == ["episode 1 (seed 5): 0.2 s", "episode 2 (seed 6): 0.2 s"]
    assert survivors.startswith("2 of 2 stayed in the air")
    assert list(here.iterdir()) == []


def test_who_fell_is_not_among_those_who_stayed_in_the_air(capfd, monkeypatch):
    words = iter(["", "", "tilt", *[""] * 10])
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
