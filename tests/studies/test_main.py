"""Pins the studies' command line, `python -m spidar_gym.studies NAME`."""

import json

import pytest
from support.commands import files, refused

from spidar_gym import viz
from spidar_gym.robot import FORMS
from spidar_gym.studies import ablations, gates, lost, steps
from spidar_gym.studies.__main__ import main


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch):
    """Return an empty working folder."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize(
    "name",
    [
        [],
        *(
            [name]
            for name in (
                "lost",
                "hops",
                "gates",
                "steps",
                "ablations",
                "margins",
                "frontier",
                "flights",
                "sagging",
                "hidden",
            )
        ),
    ],
    ids=" ".join,
)
def test_every_study_has_help(name, capfd):
    with pytest.raises(SystemExit) as stop:
        main([*name, "--help"])
    out, err = capfd.readouterr()
    assert stop.value.code in (0, None)
    assert err == ""
    assert f"usage: python -m spidar_gym.studies {' '.join(name)}".strip() in out


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["lost", "--preset", "mine"], "paper, as_flown, as_flown_quasi, tuned, retuned"),
        *((["ablations", "--scenarios", v], "1 … 50") for v in ("0", "51")),
        (["ablations", "--workers", "0"], "at least 1"),
        *((["steps", f"--{name}", "0"], "at least 1") for name in ("seeds", "workers")),
        (["steps", "--gaits", "trot"], "published, overlapped, robust"),
        (["steps", "--gaits", "baselines.indi:Indi"], "module:CLASS of a policy that only selects a controller"),
        *((["hops", f"--{name}", "0"], "at least 1") for name in ("robots", "workers")),
        *((["hops", "--strength", v], "within 0 … 1") for v in ("-0.1", "1.5", "nan")),
        *((["hops", "--wind", v], "at least 0 [m/s]") for v in ("-1", "nan")),
        *((["drift", "--scenarios", v], "expected 1 … 50") for v in ("0", "51")),
        *((["flights", "--joint-speeds", v], "within 1e-06 … 1000 [rad/s]") for v in ("0", "-1", "inf", "nan")),
        *((["frontier", "--scales", v], "within 0.01 … 100 [1]") for v in ("0", "-1", "inf", "nan", "1e200")),
        *(
            ([name, f"--{option}"], f"{option.replace('-', '_')} = [] is not valid; expected at least one value")
            for name, option in (
                ("flights", "controllers"),
                ("flights", "joint-speeds"),
                ("frontier", "controllers"),
                ("frontier", "scales"),
                ("margins", "controllers"),
                ("energy", "crawlers"),
                ("steps", "gaits"),
            )
        ),
        (["flights", "--controllers", "baselines.walking:Walking"], "expected presets, or policies of flights"),
        *(
            (
                [name, "--controllers", "steady", policy],
                "expected presets, or policies of flights that have a controller",
            )
            for name in ("margins", "frontier")
            for policy in ("baselines.walking:Walking", "baselines.hold:Hold")
        ),
        (["margins", "--store", "--check"], "store = True is not valid; expected False with check"),
        *(
            (["margins", f"--{switch}", *given], f"expected no value with {switch}, which has its own")
            for switch in ("store", "check")
            for given in (
                ("--controllers", "paper"),
                ("--world", "calibrated_1:wake-damped"),
                ("--robots", "2"),
            )
        ),
    ],
)
def test_an_impossible_argument_is_refused_in_one_line(arguments, expected, capfd, here):
    assert expected in refused(capfd, *arguments, command=main, prog="python -m spidar_gym.studies")
    assert not files(here)


def test_ablations_evaluate_every_track_and_write_the_printed_rows(here, capfd, monkeypatch):
    made = {"error": [1.0], "success": [True]}
    monkeypatch.setattr(ablations, "finish", lambda call, items, **_: [made for _ in items])
    monkeypatch.setattr(viz, "ablation_figure", lambda rows, path: path.write_bytes(b"drawn"))
    main(["ablations", "--scenarios", "1", "--workers", "1", "--json", "--out", "o"])
    rows = json.loads(capfd.readouterr().out)["ablations"]
    assert sorted(files(here)) == ["o/ablations.json", "o/ablations.png"]
    assert {row["factor"] for row in rows} == {1.0}
    assert {row["group"] for row in rows} == {"flight", "ground"}


def test_lost_reports_every_rotor_in_every_form_and_fault(here, capfd, monkeypatch):
    flight = {
        "position_m": 0.01, "attitude_rad": 0.02, "commands_in_bounds": True, "failure": "", "seconds": 12.0,
    }  # fmt: skip
    monkeypatch.setattr(lost, "_fly_lost", lambda preset, form, disturbances: flight)
    main(["lost", "--json", "--out", "o"])
    rows = json.loads(capfd.readouterr().out)["lost_rotors"]
    assert sorted(files(here)) == ["o/lost.json"]
    assert {(row["fault"], row["form"], row["rotor"]) for row in rows} == {
        (fault, form, rotor) for fault in ("thrust", "vectoring") for form in FORMS for rotor in range(1, 9)
    }
    assert len(rows) == 2 * 8 * len(FORMS)
    # In form ② any seven rotors support the robot.
    assert all(row["feasible"] for row in rows if row["form"] == "form2")
    main(["lost"])
    assert sum(line.startswith(("thrust", "vectoring")) for line in capfd.readouterr().out.splitlines()) == len(rows)


def test_gates_runs_every_gait_at_every_gate_and_writes_the_printed_rows(here, capfd, monkeypatch):
    run = {"arrived": True, "failure": "", "time_s": 20.0, "off_m": 0.0}
    monkeypatch.setattr(gates, "play", lambda case: run)
    monkeypatch.setattr(viz, "gate_figure", lambda rows, path: path.write_bytes(b"drawn"))
    main(["gates", "--seeds", "2", "--workers", "1", "--json", "--out", "o"])
    rows = json.loads(capfd.readouterr().out)["gates"]
    assert sorted(files(here)) == ["o/gates.json", "o/gates.png"]
    assert json.loads((here / "o/gates.json").read_text(encoding="utf-8")) == {"gates": rows}
    assert [(row["kind"], row["size"], row["gait"]) for row in rows] == gates.cells()
    assert all((row["runs"], row["arrived"]) == (2, 2) for row in rows)
    main(["gates", "--seeds", "1", "--workers", "1"])
    assert "all arrive" in capfd.readouterr().out


def test_steps_runs_every_gait_on_every_floor_and_writes_the_printed_rows(here, capfd, monkeypatch):
    monkeypatch.setattr(steps, "play", lambda case: {"failure": "", "slip_m": 0.02, "time_s": 20.0})
    monkeypatch.setattr(viz, "step_figure", lambda rows, path: path.write_bytes(b"drawn"))
    main(["steps", "--gaits", "robust", "overlapped", "--seeds", "2", "--workers", "1", "--json", "--out", "o"])
    rows = json.loads(capfd.readouterr().out)["steps"]
    assert sorted(files(here)) == ["o/steps.json", "o/steps.png"]
    assert {row["gait"] for row in rows} == {"robust", "overlapped"}
    assert all((row["runs"], row["successes"]) == (2, 2) for row in rows)
    main(["steps", "--seeds", "1", "--workers", "1"])
    assert "feet lifted" in capfd.readouterr().out
