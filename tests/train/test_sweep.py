"""Pins sweeps: results on a local cluster equal those of this process bit for bit; errors take one line."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("stable_baselines3", reason="the extra `train` is not installed")
from train.lib.config import override
from train.residual import PRESETS, learn

pytestmark = pytest.mark.train
ROOT = Path(__file__).resolve().parents[2]
PRESET = "hover-direct-ppo"
TINY = {"envs": 2, "steps": 512, "segment": 512, "scenarios": 1, "scaling_ticks": 40}
SWEEP = [PRESET, "--seeds", "0", "1", "2", "--workers", "2"]
SWEEP += [word for name, value in TINY.items() for word in (f"--{name.replace('_', '-')}", str(value))]


def called(*options: str) -> subprocess.CompletedProcess:
    command = [sys.executable, "-m", "train.sweep", *options]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=900, check=False)


def trials(folder: Path) -> list[dict]:
    return json.loads((folder / "results.json").read_text(encoding="utf-8"))["trials"]


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:You have specified a mini-batch size")
def test_a_sweep_learns_what_this_process_learns_and_a_damaged_run_is_last(tmp_path, monkeypatch):
    from train.lib import run

    folder = tmp_path / "sweep"
    options = [*SWEEP, "--out", str(folder)]
    damaged = folder / "preset" / "ppo_direct" / "seed2" / "checkpoint.npz"
    damaged.parent.mkdir(parents=True)
    damaged.write_bytes(b"")
    result = called(*options)
    assert result.returncode == 2
    assert "1 of 3 trials failed" in result.stderr
    *found, failed = trials(folder)
    assert {line["seed"] for line in found} == {0, 1}
    assert found[0]["chosen"] < found[1]["chosen"]
    assert failed["seed"] == 2
    assert "checkpoint.npz is no checkpoint" in failed["error"]
    assert "\n" not in failed["error"]
    monkeypatch.setattr(run, "command_line", lambda: " ".join(["python -m train.sweep", *options]))
    line = found[0]
    path = learn(override(PRESETS[PRESET], **TINY, seed=line["seed"], out=tmp_path / "here"))
    assert (folder / f"preset/ppo_direct/seed{line['seed']}/policy.npz").read_bytes() == path.read_bytes()
    curve = json.loads(path.with_name("curve.json").read_text(encoding="utf-8"))
    assert line["chosen"] == curve["chosen"]["score"]
    assert {name: line[name] for name in ("score", "worst", "success")}.items() <= curve["curve"][-1].items()


@pytest.mark.parametrize(
    ("options", "words"),
    [(["hover"], ", ".join(PRESETS)), ([PRESET, "--seeds"], "at least one seed"),
     ([PRESET, "--ray", "127.0.0.1:1"], "no Ray cluster at '127.0.0.1:1'")],
)  # fmt: skip
def test_a_sweep_that_cannot_be_is_refused_in_one_line(options, words, tmp_path):
    result = called(*options, "--out", str(tmp_path / "sweep"))
    assert (result.returncode, result.stdout) == (2, "")
    (line,) = result.stderr.splitlines()
    assert line.startswith("train.sweep: ")
    assert words in line
