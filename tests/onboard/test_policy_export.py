"""Pins the export of a learned policy: its header's exact numbers, refusals, the command that exports it."""

import hashlib
import json
import re
import shlex
import subprocess
from dataclasses import fields, replace
from functools import partial

import numpy as np
import pytest
from support.needs import needs_compiler
from support.networks import made
from support.robots import OTHER

from spidar_gym.benchmark.track import CRAWL
from spidar_gym.cli.main import main
from spidar_gym.envs.actions import ACTION_MODES, AUTHORITIES, CRAWL_MODES, TORSO
from spidar_gym.errors import InvalidValueError, SpidarError, UnknownNameError
from spidar_gym.native import recipe
from spidar_gym.native.compiler import compiler
from spidar_gym.native.constants import CHANNELS, MAX_ACTION, MAX_WIDTH
from spidar_gym.native.constants import NETWORK_BLOCK as BLOCK
from spidar_gym.native.core_flight import CoreFlightController
from spidar_gym.native.library import Struct
from spidar_gym.native.network import padded
from spidar_gym.native.recipe import FLAGS
from spidar_gym.onboard import golden
from spidar_gym.onboard.build import build_core
from spidar_gym.onboard.export import export, export_files
from spidar_gym.onboard.parameters import parameters_record, parameters_text
from spidar_gym.onboard.policy import RATE, policy_header
from spidar_gym.policies.artifact import Washout, write_artifact
from spidar_gym.state import Residual

pytestmark = needs_compiler


def test_the_headers_numbers_are_the_artifacts_bit_for_bit():
    net, found = made(preset="tuned", clip=7.5, washout=np.array([0.5, 0.0, 2.0, 0.0, 1e-9, 1e9])), {}
    text = policy_header(net, 4.0)
    for name, words in re.findall(r"SP_POLICY_(\w+)\[\d+\] = \{(.*?)\};", text, flags=re.S):
        found[name] = np.array([float.fromhex(word.strip("f")) for word in words.replace(",", " ").split()])
    rest = found["WEIGHTS"]
    for weights, biases in zip(net.weights, net.biases, strict=True):
        out, size = weights.shape
        room = padded(out)
        layer, last, rest = np.split(rest, [room * size, room * (size + 1)])
        for k in range(room):  # output k is in block k // BLOCK, its weights BLOCK numbers apart
            own = layer[k // BLOCK * BLOCK * size :][k % BLOCK : BLOCK * size : BLOCK]
            np.testing.assert_array_equal(own, weights[k] if k < out else 0.0)
        np.testing.assert_array_equal(last, [*biases, *np.zeros(room - out)])
    assert not len(rest)
    np.testing.assert_array_equal(found["MEAN"], net.mean)
    np.testing.assert_array_equal(found["DEVIATION"] ** 2, np.sqrt(net.variance) ** 2)
    np.testing.assert_array_equal(found["WASHOUT"], Washout(net.washout).share)
    assert '#define SP_POLICY_PRESET "tuned"' in text
    assert f"#define SP_POLICY_STEP {(0.1).hex()}" in text
    assert '#define SP_POLICY_PRESET "paper"' in policy_header(made()), "the environment's own"
    assert '#define SP_POLICY_PRESET "published"' in policy_header(made(CRAWL, "residual_gait"))


@pytest.mark.parametrize(
    ("net", "error", "message"),
    [
        (lambda: made(CRAWL, "direct"), InvalidValueError, "'direct' is not valid; .* residual_gait"),
        (lambda: made(mode="direct", washout=np.ones(40)), InvalidValueError, "washout of net .* none without"),
        (lambda: replace(made(), arguments={"action_mode": "fly"}), UnknownNameError, "valid: residual_wrench"),
        (lambda: replace(made(), env_id="CartPole-v1"), UnknownNameError, "valid: spidar_gym/Hover-v0, spidar_gym/"),
        (lambda: replace(made(), arguments={}, env_id=CRAWL), InvalidValueError, r"207 to 6.*expected \d+ to 4"),
        (lambda: made(hidden=(MAX_WIDTH + 1,)), InvalidValueError, f"at most {MAX_WIDTH} numbers"),
    ],
)
def test_what_adds_to_no_controller_or_does_not_fit_is_refused(net, error, message):
    with pytest.raises(error, match=message) as caught:
        policy_header(net(), RATE)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("most", ["OBSERVATION", "ACTION"])
def test_more_than_the_cores_arrays_hold_is_refused(monkeypatch, most):
    monkeypatch.setattr(f"spidar_gym.onboard.policy.MAX_{most}", 5)
    with pytest.raises(InvalidValueError, match=f"{most.lower()} = .* at most 5 numbers"):
        policy_header(made(), RATE)


@pytest.mark.parametrize("rate", [0.0, -1.0, np.nan, np.inf])
def test_an_invalid_rate_is_refused(rate):
    with pytest.raises(InvalidValueError, match=r"residual_rate = .* above 0"):
        policy_header(made(), rate)


def test_the_core_has_room_for_every_mode_and_knows_its_channels():
    assert tuple(AUTHORITIES) == CHANNELS
    for mode in (*ACTION_MODES.items(), *CRAWL_MODES.items()):
        assert mode[1].size <= MAX_ACTION
    assert {f"has_{f.name}" for f in fields(Residual)} & set(Struct("residual").views) == {
        "has_forces_l", "has_leg_forces_b",
    }  # fmt: skip


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    path = tmp_path_factory.mktemp("artifact") / "net.npz"
    write_artifact(made(preset="tuned"), path)
    return path


@pytest.fixture
def short_recordings(monkeypatch):
    """Shorter recordings than those of the export; test_export.py has the whole ones."""
    for kind, ticks in (("flight", 40), ("crawl", 60)):
        monkeypatch.setattr(golden, f"record_{kind}", partial(getattr(golden, f"record_{kind}"), ticks))


def compiled(folder):
    """Compile the runner of an exported folder as its README says."""
    line = next(w.strip() for w in (folder / "README.md").read_text().splitlines() if w.strip().startswith("gcc "))
    line = line.replace("gcc", shlex.join(compiler()), 1).replace("-O2", "-O0")  # the same bytes, but faster to compile
    subprocess.run(line, shell=True, cwd=folder, check=True)


def benched(folder, log):
    run = ["./spidar-runner", "bench", f"golden/{log}.in"]
    return subprocess.run(run, cwd=folder, check=True, capture_output=True, text=True).stdout


@pytest.mark.usefixtures("short_recordings")
def test_a_crawl_without_a_controller_is_exported_and_timed_in_crawls(tmp_path):
    net = made(CRAWL, TORSO)
    write_artifact(replace(net, arguments={**net.arguments, "hold": 5, "observation": "scaled"}), tmp_path / "net.npz")
    export(tmp_path / "onboard", residual=tmp_path / "net.npz")
    compiled(tmp_path / "onboard")
    told = [
        line for line in benched(tmp_path / "onboard", "crawl").splitlines() if "in place of the controller" in line
    ]
    assert re.search(r" 60 ticks +median +\d+\.\d ", told[0])
    assert "in place of" not in benched(tmp_path / "onboard", "flight")


@pytest.mark.usefixtures("short_recordings")
def test_the_command_exports_a_folder_that_compiles_replays_and_names_its_policy(written, tmp_path, capsys):
    folder = tmp_path / "onboard"
    main(["export", "--out", str(folder), "--residual", str(written), "--residual-rate", "4"])
    assert f"files in {folder}" in capsys.readouterr().out
    manifest = json.loads((folder / "MANIFEST.json").read_text())
    digest = hashlib.sha256(written.read_bytes()).hexdigest()
    told = {name: manifest["residual"][name] for name in ("name", "sha256", "rate")}
    assert told == {"name": "net", "sha256": digest, "rate": 4.0}
    compiled(folder)
    for log in ("flight", "crawl"):
        subprocess.run(["./spidar-runner", "replay", f"golden/{log}.in", "out"], cwd=folder, check=True)
        run = ["./spidar-runner", "compare", "out", f"golden/{log}.out"]
        assert subprocess.run(run, cwd=folder, check=False, capture_output=True).returncode == 0
    for log, told in (("flight", True), ("crawl", False)):  # the policy of a flight is not used in a crawl
        assert ("flight with the residual" in benched(folder, log)) == told
    (folder / "other.txt").write_bytes(parameters_text(parameters_record(OTHER)))
    run = ["./spidar-runner", "sim", "127.0.0.1:1", "missions/hover.txt", "--parameters", "other.txt"]
    for option, why in ((["--residual"], "the residual was learned on another robot"), ([], "no simulator there")):
        done = subprocess.run([*run, *option], cwd=folder, check=False, capture_output=True, text=True)
        assert done.stderr.startswith(f"runner: {why}; valid: ")
    includes = ["-Icore", "-Igenerated", "-Irunner", "-isystem", "osqp"]
    words = ["-Wall", "-Wextra", "-Wpedantic", "-Werror", "-fsyntax-only"]
    for source in [p for part in ("core", "runner") for p in sorted((folder / part).glob("*.c"))]:
        run = [*compiler(), *FLAGS, *words, *includes, str(source)]
        done = subprocess.run(run, cwd=folder, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr[:2000]


def test_the_same_policy_gives_the_same_bytes_and_another_rate_others(written):
    first, again = (export_files(golden=False, residual=written, rate=4.0) for _ in range(2))
    assert first == again
    other, none = export_files(golden=False, residual=written), export_files(golden=False)
    differ = {name for name in first if first[name] != other[name]}
    assert differ == {name for name in first if first[name] != none[name]}
    assert differ == {"generated/spidar_policy.h", "MANIFEST.json"}
    assert json.loads(none["MANIFEST.json"])["residual"] is None


def test_a_core_is_built_with_a_policy(written, tmp_path, monkeypatch):
    monkeypatch.setattr(recipe, "LIBRARY_FLAGS", ("-std=c99", "-O0"))  # only its kind is read
    path = build_core(tmp_path / "libspidar.so", written)
    monkeypatch.setenv("SPIDAR_CORE", str(path))
    assert CoreFlightController().library.sp_policy_kind() == 0


def test_the_command_refuses_in_one_line(tmp_path, capfd, written):
    direct = tmp_path / "direct.npz"
    write_artifact(made(CRAWL, "direct"), direct)
    for arguments, message in (
        (
            ["--out", str(tmp_path / "o"), "--residual", str(tmp_path / "none.npz")],
            "valid: a learned policy's artifact",
        ),
        (["--out", str(tmp_path / "o"), "--residual", str(direct)], "residual_wrench"),
        (["--out", str(tmp_path / "o"), "--residual", str(written), "--residual-rate", "0"], "above 0"),
    ):
        with pytest.raises(SystemExit):
            main(["export", *arguments])
        error = capfd.readouterr().err
        assert message in error
        assert error.count("\n") == 1
    assert not (tmp_path / "o").exists()
    with pytest.raises(SpidarError, match="direct"):
        export(tmp_path / "o", residual=direct)
