"""Pins the guide's patches: applied as printed to a copy of the package, each works in all its parts."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "tutorials" / "your_own_task.md"
PATCH = re.compile(r"<!-- patch: ([a-z ]+) -->\n```diff\n--- a/(\S+)\n\+\+\+ b/\2\n(.*?)```", re.S)
PATCHES = {name: (file, hunks) for name, file, hunks in PATCH.findall(PAGE.read_text(encoding="utf-8"))}
CHECKS = {
    "reward term": """
import gymnasium, numpy as np, spidar_gym
name = "spidar_gym/Hover-v0"
for env in (gymnasium.make(name), gymnasium.make(name, control="python")):
    env.reset(seed=0)
    _, reward, *_, info = env.step(np.zeros(6))
    terms = env.unwrapped.reward_terms
    assert abs(info["reward_calm"] - 1.0 / (1.0 + (info["power_w"] / 3000.0) ** 2)) < 1e-12
    assert abs(reward - sum(weight * info[f"reward_{term}"] for term, (weight, _) in terms.items())) < 1e-12
vector = gymnasium.make_vec(name, num_envs=3)
vector.reset(seed=0)
*_, info = vector.step(np.zeros((3, 6)))
assert info["term"].shape == (3, 5)
assert (info["reward_calm"] > 0.0).all()
""",
    "track": """
from spidar_gym.benchmark.scenario import draw_scenario
from spidar_gym.benchmark.scoring import play_scenario
from spidar_gym.benchmark.track import TRACKS
from baselines.qp import QP
track = TRACKS["flight-gusts"]
assert (track.group, track.reference) == ("gusts", "qp")
scenario = draw_scenario("flight-gusts", "test", 0)
assert 2.0 <= scenario.disturbances["wind"] <= 4.0
played = play_scenario(QP(), "flight-gusts", scenario)
assert not played["metrics"]["failed"], played
from spidar_gym.benchmark.comparison import COMPARED
from spidar_gym.benchmark.leaderboard import SHOWN
assert (COMPARED["gusts"], SHOWN["gusts"]) == (COMPARED["flight"], SHOWN["flight"])
""",
}


def patched(folder: Path, file: str, hunks: str) -> None:
    """Copy the package and apply a patch: each hunk's `-` lines, which must occur once, become its `+` lines."""
    for part in ("spidar_gym", "assets", "baselines"):
        for source in (ROOT / part).rglob("*"):
            if source.is_file() and "__pycache__" not in source.parts:
                target = folder / source.relative_to(ROOT)
                target.parent.mkdir(parents=True, exist_ok=True)
                target.symlink_to(source)
    text = (ROOT / file).read_text(encoding="utf-8")
    for hunk in hunks.split("@@\n")[1:]:
        before, after = (
            "\n".join(line[1:] for line in hunk.splitlines() if line.startswith(sign)) for sign in ("-", "+")
        )
        assert text.count(before) == 1, before
        text = text.replace(before, after)
    (folder / file).unlink()
    (folder / file).write_text(text, encoding="utf-8")


def test_every_patch_of_the_page_is_tried():
    assert PATCHES.keys() == CHECKS.keys()


@pytest.mark.parametrize("name", CHECKS)
def test_a_patch_of_the_page_works_as_printed(name, tmp_path):
    patched(tmp_path, *PATCHES[name])
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", CHECKS[name]], cwd=tmp_path, check=False, capture_output=True, text=True,
        env=os.environ | {"PYTHONPATH": str(tmp_path)},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
