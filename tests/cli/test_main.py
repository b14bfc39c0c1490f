"""Pins the command line: help with units; every error is one line and writes nothing."""

import ctypes.util
import os
import platform
import re
import subprocess
import sys
from importlib import metadata

import pytest
from support.commands import LEARNED, refused

import spidar_gym
from spidar_gym.cli import main as cli
from spidar_gym.cli.main import main
from spidar_gym.envs.actions import ACTION_MODES, CRAWL_MODES
from spidar_gym.envs.docs import page
from spidar_gym.envs.registry import ENVIRONMENTS, import_id
from spidar_gym.robot import FORMS
from spidar_gym.robot.description import CAMERAS
from spidar_gym.tasks.hover import SEQUENCES

NAMES = (
    "paper",
    "run",
    "eval",
    "leaderboard",
    "suite",
    "scenarios",
    "export",
    "parameters",
    "docs",
    "sitl",
    "log",
    "identify",
    "tune",
    "view",
    "assets",
    "bench",
    "list",
)
COMMANDS = [["paper"], ["paper", "flight"], ["paper", "crawl"], *([name] for name in NAMES[1:])]


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
    counts = {"run": 13, "view": 12, "paper crawl": 4, "bench": 1, "eval": 1, "suite": 1, "export": 1, "identify": 2}
    assert len(quantities) == counts.get(" ".join(command), 0)
    # A strength has a range instead of a unit; friction has neither. Degrees exist on the command line only.
    unit = r"\[(s|kg|1/s|rad/s|m/s|N|m|degrees; radians in gymnasium\.make)\]|0 … 1\b|Sliding friction"
    assert all(re.search(unit, option) for option in quantities)


def test_the_help_names_every_command(capfd):
    with pytest.raises(SystemExit):
        main(["--help"])
    out = capfd.readouterr().out
    assert all(f"• {name} " in out for name in NAMES)


def test_list_names_everything_and_prints_a_page_by_id(capfd):
    main(["list"])
    out = capfd.readouterr().out
    assert {import_id(name) for name in ENVIRONMENTS} <= set(re.split(r"[\s,]+", out))
    words = re.split(r"[\s,:]+", out)
    assert {"baselines.qp", "baselines/learned/memory/seed*.npz"} <= set(words)
    assert set(ENVIRONMENTS) | set(SEQUENCES) | set(CAMERAS) | {"as_flown", "tuned", "residual_force"} <= set(words)
    for name in ENVIRONMENTS:
        main(["list", name])
        assert capfd.readouterr().out == page(name) + "\n"


def test_the_versions_are_those_of_the_package_and_of_its_dependencies(capfd):
    main(["--version"])
    found = dict(line.split() for line in capfd.readouterr().out.splitlines())
    assert found["spidar-gym"] == spidar_gym.__version__
    assert found["python"] == platform.python_version()
    for package in ("mujoco", "gymnasium", "numpy", "osqp", "pin", "scipy", "torch", "stable-baselines3"):
        assert found[package] == metadata.version(package)


def run(*arguments, **environment):
    """Run the command line in a separate process."""
    code = "import sys; from spidar_gym.cli.main import main; main(sys.argv[1:])"
    return subprocess.run(
        [sys.executable, "-c", code, *arguments], env=os.environ | environment, capture_output=True, text=True,
        check=False,
    )  # fmt: skip


@pytest.mark.parametrize("named", ["foo", "disable", "osmesa", "glfw"])
def test_a_missing_opengl_library_stops_nothing_but_drawing(named, here):
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


def test_characters_that_a_terminal_lacks_become_question_marks():
    done = run("list", "spidar_gym/Hover-v0", PYTHONIOENCODING="ascii")
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout == page("spidar_gym/Hover-v0").encode("ascii", "replace").decode() + "\n"


@pytest.mark.parametrize("unbuffered", ["", "1"])
def test_a_full_output_is_one_line(unbuffered):
    code = "import sys; from spidar_gym.cli.main import main; main(['list', 'spidar_gym/Hover-v0'])"
    with open("/dev/full", "w", encoding="utf-8") as full:
        done = subprocess.run(
            [sys.executable, "-c", code], stdout=full, stderr=subprocess.PIPE, text=True, check=False,
            env=os.environ | {"PYTHONUNBUFFERED": unbuffered},
        )  # fmt: skip
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    assert line.startswith("spidar: cannot write the standard output: No space left on device; valid: ")


def test_python_without_docstrings_and_assertions_makes_environments_and_writes_the_same_pages():
    code = (
        "import gymnasium, spidar_gym\n"
        "from spidar_gym.cli.main import main\n"
        "gymnasium.make('spidar_gym/Hover-v0').close()\n"
        "main(['list', 'spidar_gym/Hover-v0'])"
    )
    done = subprocess.run([sys.executable, "-OO", "-c", code], capture_output=True, text=True, check=False)
    assert (done.stdout, done.stderr) == (page("spidar_gym/Hover-v0") + "\n", "")


@pytest.mark.parametrize("unbuffered", ["", "1"])
def test_a_closed_pipe_ends_the_command_silently(unbuffered):
    code = "import sys; from spidar_gym.cli.main import main; main(['list', 'spidar_gym/Hover-v0'])"
    reader, writer = os.pipe()
    os.close(reader)
    done = subprocess.run(
        [sys.executable, "-c", code], stdout=writer, stderr=subprocess.PIPE, text=True, check=False,
        env=os.environ | {"PYTHONUNBUFFERED": unbuffered},
    )  # fmt: skip
    os.close(writer)
    assert done.stderr == ""
    assert done.returncode == 141


def test_the_error_of_another_broken_pipe_is_raised(monkeypatch):
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
        (["paper", "crawl", "--distance", "0"], "a distance or a turn above 0"),
        (["paper", "crawl", "--direction", "inf"], "finite numbers [degrees]"),
        (["paper", "crawl", "--turn", "359.8"], "within -237.296 … 237.296 [degrees]"),
        (["paper", "crawl", "--turn", "235"], "the arc leads 0.56 m away from the goal"),
        (["paper", "crawl", "--distance", "9"], "a goal within 300 s; the planned duration is 504 s"),
        (["paper", "crawl", "--study", "--seeds", "0"], "at least 1"),
        (["paper", "crawl", "--draws", "-1"], "at least 0"),
        (["run", "spidar_gym/Crawl-v0", "--schedule", "trot"], "sequential, overlapped"),
        (["run", "spidar_gym/Crawl-v0", "--friction", "-1"], "within 0.001"),
        (["run", "spidar_gym/Crawl-v0", "--forms", "paper"], "distance, direction, turn"),
        (["run", "--slope", "3"], "forms, joint_speed"),
        (["paper", "flight", "--preset", "mine"], "paper, as_flown, as_flown_quasi, tuned, retuned"),
        *((["paper", "flight", what, "--scenarios", "0"], "at least 1") for what in ("--speeds", "--ablation")),
        (["paper", "flight", "--speeds", "--workers", "0"], "at least 1"),
        (["paper", "flight", "--noise", "--seed", "-1"], "at least 0"),
        *(
            (["tune", "flight", f"--{name}", "0"], "at least 1") for name in ("generations", "scenarios", "workers")
        ),
        (["tune", "crawl", "--population", "1", "--generations", "1"], "at least 2"),
        (["tune", "swim"], "flight, retuned, steady, crawl, recrawl, steady_crawl"),
        (["paper", "flight", "--camera", "back"], "fixed, chase, side, front, top"),
        (["run", "spidar_gym/Walk-v0"], "spidar_gym/Hover-v0"),
        (["run", "--forms", "form4"], ", ".join(SEQUENCES)),
        (["run", "--preset", "mine"], "paper, as_flown, as_flown_quasi, tuned, retuned"),
        (["run", "--action-mode", "mine"], ", ".join(ACTION_MODES)),
        (["run", "--action-mode", "residual_gait"], ", ".join(ACTION_MODES)),
        (["run", "spidar_gym/Crawl-v0", "--action-mode", "mine"], ", ".join(CRAWL_MODES)),
        (["run", "--policy", LEARNED, "--action-mode", "residual"], "which selects residual_wrench"),
        *((["run", "--randomization", v], "within 0 … 1") for v in ("-0.1", "1.5", "nan")),
        *((["run", "--wind", v], "at least 0 [m/s]") for v in ("-1", "nan", "inf")),
        *((["run", "--push", v], "at least 0 [N]") for v in ("-1", "nan")),
        *((["run", "--lost-rotor", v], "1 … 8, or 0 for none") for v in ("9", "-1")),
        (["run", "--lost-rotor", "2.5"], "--lost-rotor = '2.5' is not valid; expected a whole number: Module"),
        (["run", "--lost-rotor", "3", "--fault", "engine"], "thrust, vectoring"),
        (["run", "--seconds", "0.1", "--seed", "-1"], "at least 0"),
        (["run", "--policy", "missing"], "module:Class, or the path of an artifact"),
        (["run", "--policy", "none.npz"], "none.npz"),
        (["run", "spidar_gym/Crawl-v0", "--policy", LEARNED], "this one is for spidar_gym/Hover-v0"),
        (["run", "--policy", LEARNED, "--preset", "tuned"], "no value with this policy, which selects paper"),
        (["run", "--camera", "back", "--seconds", "0.1"], "fixed, chase, side, front, top"),
        (["run", "--camera", "back", "--seconds", "0.1", "--out", "films/x.mp4"], "fixed, chase, side, front, top"),
        *(
            (["run", "--seconds", "0.1", "--joint-speed", v], "within 1e-06 … 1000 [rad/s]")
            for v in ("0", "-0.2", "nan", "inf")
        ),
        (["run", "--joint-speed", "fast"], "--joint-speed = 'fast' is not valid; expected a number: Joint"),
        (["paper", "crawl", "--distance", "far"], "--distance = 'far' is not valid; expected a number: Distance to"),
        (["run", "--episodes", "1.5"], "expected a whole number: Number of episodes"),
        (["eval", "--scenarios", "x"], "--scenarios = 'x' is not valid; expected a whole number: Number of"),
        (["run", "--seed"], "Missing value for argument '--seed'"),
        (["run", "--episodes", "0"], "at least 1"),
        *((["run", "--seconds", v], "at least one tick, 0.025 s") for v in ("0", "-1", "nan", "inf", "0.01")),
        (["run", "--seconds", "0.1", "--out", "film.gif"], ".mp4"),
        (["run", "--velocity", "1"], "spidar --help"),
        (["run", "--seconds", "0.1", "--show"], "--out FILE.mp4"),
        (["view", "--form", "form4"], ", ".join(FORMS)),
        (["view"], "--out FILE.mp4"),
        (["list", "spidar_gym/Walk-v0"], "spidar_gym/Hover-v0"),
        (["bench", "--seconds", "0"], "above 0 [s]"),
        (["sitl", "faults", "--only", "gremlin"], "none, pose_stops"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)  # fmt: skip
def test_bad_input_is_refused_in_one_line_that_names_what_is_valid_and_nothing_is_written(
    arguments, valid, capfd, here
):
    assert valid in refused(capfd, *arguments)
    assert list(here.iterdir()) == []
