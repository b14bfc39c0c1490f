"""Pins `spidar paper`: only JSON on stdout with --json, figures where libraries allow, no partial files."""

import json
import math

import pytest
from support.commands import files, refused

from spidar_gym import viz
from spidar_gym.cli.main import main
from spidar_gym.errors import MissingDependencyError
from spidar_gym.paper import flight as experiments


@pytest.fixture(autouse=True)
def few(monkeypatch):
    """One calibrated robot without figures, in place of 24."""
    found = {"preset": "as_flown_quasi", "world": "calibrated_1", "robots": 1, "failed": 1, "figures": {}, "lines": {}}
    monkeypatch.setattr("spidar_gym.cli.paper.calibrated_figures", lambda *_, **__: found)


def test_the_flight_prints_exactly_one_json_object_on_stdout_and_writes_it_with_the_figure(still, here, capfd):
    main(["paper", "flight", "--json", "--no-video", "--out", "a/b"])
    result = json.loads(capfd.readouterr().out)
    assert set(result) == {"flight", "noisy", "calibrated", "paper"}
    assert set(result["paper"]) == {"flight"}
    assert result["flight"]["thrust_form1_n"] == pytest.approx([19.62] * 8)
    assert sorted(files(here)) == ["a/b/flight.json", "a/b/flight.png"]
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
        *(f"out/crawl/crawl.{kind}" for kind in ("json", "png")), "out/flight/flight.json",
    ]  # fmt: skip


def test_the_crawl_prints_exactly_one_json_object_with_every_figure(short_crawl, here, capfd):
    main(["paper", "crawl", "--json", "--no-video", "--out", "a"])
    result = json.loads(capfd.readouterr().out)
    assert set(result) == {"crawl", "noisy", "calibrated", "paper"}
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


@pytest.mark.parametrize("what", ["film_take", "flight_figure"])
def test_without_opengl_or_matplotlib_the_flight_finishes_and_names_what_to_install(
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


def test_a_flight_without_opengl_prints_what_to_install(still, here, capfd, monkeypatch):
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
    assert sorted(files(here)) == [f"out/flight/flight.{kind}" for kind in ("json", "png")]


def test_the_flight_with_noise_is_labelled_and_printed_beside_the_papers_rmse(still, here, capfd):
    outputs = []
    for options in ([], ["--noise", "--seed", "3"]):
        main(["paper", "flight", "--no-video", *options])
        outputs.append(capfd.readouterr().out)
    assert ["flight, preset as_flown, with noise" in out for out in outputs] == [False, True]
    assert ["nominal" in out for out in outputs] == [True, False]
    assert all("0.038  0.037  0.043" in out for out in outputs)
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
