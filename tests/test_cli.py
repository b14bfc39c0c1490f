"""Pins the command line: help with units, one line for every error and nothing written, JSON alone on stdout."""

import ctypes.util
import json
import math
import re
import shutil
from pathlib import Path

import numpy as np
import pytest

from spidar_gym import cli, description, experiments, viz
from spidar_gym.cli import main
from spidar_gym.description import CAMERAS, generated_files
from spidar_gym.envs.page import page, pages
from spidar_gym.envs.registry import ENVIRONMENTS
from spidar_gym.envs.tasks import SEQUENCES
from spidar_gym.errors import MissingDependencyError
from spidar_gym.experiments import FlightLog
from spidar_gym.robot import FORMS

COMMANDS = [["paper"], ["paper", "flight"], ["run"], ["view"], ["assets"], ["bench"], ["list"]]
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
def still(monkeypatch):
    """A flight experiment that takes no time: 40 s in which nothing moves."""
    n = 1600
    log = FlightLog(
        "as_flown", np.arange(1, n + 1) / 40, np.zeros((n, 3)), np.zeros((n, 3)), np.zeros((n, 16)), np.zeros((n, 16)),
        np.zeros((n, 8, 2)), np.full((n, 8), 19.62), np.full(n, 1e-4), np.full(n, "solved"),
        np.zeros((n, 39)),
    )  # fmt: skip
    monkeypatch.setattr(experiments, "fly_paper", lambda preset, on_tick=None: log)


@pytest.fixture
def assets(tmp_path, monkeypatch) -> Path:
    """A copy of the assets that the command line works on."""
    folder = tmp_path / "assets"
    shutil.copytree(description.assets_dir(), folder)
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
    assert len(quantities) == {"run": 2, "bench": 1}.get(" ".join(command), 0)
    assert all(re.search(r"\[(s|rad/s)\]", option) for option in quantities)


def test_the_help_names_every_command(capfd):
    with pytest.raises(SystemExit):
        main(["--help"])
    out = capfd.readouterr().out
    assert all(f"• {name} " in out for name in ("paper", "run", "view", "assets", "bench", "list"))


def test_list_names_everything_there_is_and_prints_a_page_by_id(capfd):
    main(["list"])
    words = re.split(r"[\s,:]+", capfd.readouterr().out.replace("spidar_gym/Hover-v0:", "spidar_gym/Hover-v0 "))
    assert set(ENVIRONMENTS) | set(SEQUENCES) | set(CAMERAS) | {"as_flown", "residual_force"} <= set(words)
    for name in ENVIRONMENTS:
        main(["list", name])
        assert capfd.readouterr().out == page(name) + "\n"


@pytest.mark.parametrize(
    ("arguments", "valid"),
    [
        ([], "paper, run, view, assets, bench, list"),
        (["fly"], "paper, run, view, assets, bench, list"),
        (["paper", "crawl"], "flight"),
        (["paper", "flight", "--preset", "mine"], "paper, as_flown"),
        (["paper", "flight", "--camera", "back"], "chase, side, front, top"),
        (["run", "spidar_gym/Walk-v0"], "spidar_gym/Hover-v0"),
        (["run", "--forms", "form4"], ", ".join(SEQUENCES)),
        (["run", "--preset", "mine"], "paper, as_flown"),
        (["run", "--camera", "back", "--seconds", "0.1"], "chase, side, front, top"),
        (["run", "--camera", "back", "--seconds", "0.1", "--out", "films/x.mp4"], "chase, side, front, top"),
        *((["run", "--seconds", "0.1", "--joint-speed", v], "above 0 [rad/s]") for v in ("0", "-0.2", "nan", "inf")),
        (["run", "--joint-speed", "fast"], "FLOAT"),
        (["run", "--episodes", "1.5"], "INT"),
        (["run", "--episodes", "0"], "at least 1"),
        *((["run", "--seconds", v], "at least one tick, 0.025 s") for v in ("0", "-1", "nan", "inf", "0.01")),
        (["run", "--seconds", "0.1", "--out", "film.gif"], ".mp4"),
        (["run", "--speed", "1"], "spidar --help"),
        (["run", "--seconds", "0.1", "--show"], "rgb_array"),
        (["view", "--form", "form4"], ", ".join(FORMS)),
        (["view"], "rgb_array"),
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


@pytest.mark.parametrize("name", [*generated_files(), *pages()])
@pytest.mark.parametrize("missing", [False, True])
def test_a_stale_asset_is_named_by_the_check_which_writes_nothing(name, missing, assets, capfd):
    path = assets / name
    path.unlink() if missing else path.write_text(path.read_text(encoding="utf-8") + " ", encoding="utf-8")
    before = files(assets)
    line = refused(capfd, "assets", "--check")
    assert str(path) in line
    assert "spidar assets" in line
    assert files(assets) == before


def test_assets_are_written_whole_and_only_where_they_are_stale(assets, capfd):
    fresh = files(assets)
    (assets / "mjcf" / "spidar.xml").write_text("<mujoco/>", encoding="utf-8")
    shutil.rmtree(assets / "environments")
    main(["assets"])
    assert capfd.readouterr().out.startswith("2 of ")
    assert files(assets) == fresh
    main(["assets"])
    assert capfd.readouterr().out.startswith("0 of ")
    assert files(assets) == fresh


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
    assert sorted(files(here)) == ["a/b/flight.json", "a/b/flight.png"]
    assert json.loads((here / "a/b/flight.json").read_text(encoding="utf-8")) == result
    assert (here / "a/b/flight.png").read_bytes().startswith(b"\x89PNG")


def test_the_flight_is_the_default_of_paper_and_prints_the_table(still, here, capfd, monkeypatch):
    def missing(*_, **__):
        raise MissingDependencyError("a library", "apt-get install libsomething")

    monkeypatch.setattr(viz, "flight_figure", missing)
    monkeypatch.setattr(viz, "FlightVideo", missing)
    main(["paper"])
    out = capfd.readouterr().out
    assert "simulated" in out
    assert "RMSE position" in out
    assert "out/flight" in out
    assert sorted(files(here)) == ["out/flight/flight.json"]


@pytest.mark.parametrize("what", ["FlightVideo", "flight_figure"])
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
    drawn = ["out/flight/flight.png"] if what == "FlightVideo" else []
    assert sorted(files(here)) == ["out/flight/flight.json", *drawn]


def test_where_the_renderer_finds_no_opengl_the_flight_says_so(still, here, capfd, monkeypatch):
    import mujoco

    def broken(*_, **__):
        raise AttributeError("'NoneType' object has no attribute 'eglQueryString'")

    monkeypatch.setattr(mujoco, "Renderer", broken)
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


@pytest.mark.parametrize("name", ["flight.json", "flight.png"])
def test_an_output_file_that_is_a_folder_is_one_line_and_leaves_no_half_of_it(name, still, here, capfd):
    (here / "out" / name).mkdir(parents=True)
    with pytest.raises(SystemExit) as stop:
        main(["paper", "flight", "--no-video", "--out", "out"])
    assert stop.value.code == 2
    assert [line for line in capfd.readouterr().err.splitlines() if line.startswith("spidar: ") and name in line]
    assert set(files(here)) <= {"out/flight.json", "out/flight.png"}


@pytest.mark.slow
def test_the_real_flight_prints_exactly_one_json_object_on_stdout(here, capfd):
    main(["paper", "flight", "--json", "--no-video"])
    flight = json.loads(capfd.readouterr().out)["flight"]
    assert flight["preset"] == "as_flown"
    assert len(flight["thrust_form3_n"]) == 8
    assert all(math.isfinite(x) for x in (*flight["rmse_position_m"], *flight["rmse_attitude_rad"]))
    assert sorted(files(here)) == ["out/flight/flight.json", "out/flight/flight.png"]


# Episodes


def test_run_flies_the_episodes_it_was_asked_for_and_reports_each(capfd, here):
    main(["run", "--episodes", "2", "--seed", "5", "--seconds", "0.25", "--forms", "form1"])
    lines = capfd.readouterr().out.splitlines()
    assert [line.split(",")[0] for line in lines] == ["episode 1 (seed 5): 0.2 s", "episode 2 (seed 6): 0.2 s"]
    assert list(here.iterdir()) == []


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

    monkeypatch.setattr(viz.FlightVideo, "film", interrupt)
    with pytest.raises(SystemExit) as stop:
        main(["run", "--seconds", "0.1", "--out", "film.mp4"])
    assert stop.value.code == 130
    assert files(here) == {}
