"""Pins the paths of committed files: beside the package in a checkout, inside an installed one, by one name."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from spidar_gym import committed

ROOT = Path(__file__).resolve().parents[1]
ARTIFACT = Path("baselines/learned/memory/seed0.npz")
INSTALLED = """
import multiprocessing
import sys
from pathlib import Path

import spidar_gym
from spidar_gym.benchmark.row import ROWS, committed_rows, read_row
from spidar_gym.benchmark.verify import require_own_policies
from spidar_gym.policies.load import load_policy
from spidar_gym.policies.policy import policy_name
from spidar_gym.policies.source import source_file


def named(spec):
    return policy_name(load_policy(spec))


if __name__ == "__main__":
    assert Path(spidar_gym.__file__).is_relative_to(sys.argv[1])
    rows = committed_rows()
    for row in rows.values():
        require_own_policies(row, trust=False)
        for spec in row.policies:
            assert source_file(spec).is_relative_to(sys.argv[1]), spec
    print(len(rows), read_row(Path(ROWS, "qp_tuned.json")).name, named("baselines.adrc:Adrc"))
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        print(pool.map(named, ["baselines.adrc:Adrc", "baselines/learned/memory/seed0.npz"]))
"""


def test_a_committed_path_leads_from_any_folder_to_the_checkout(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert committed.committed(ARTIFACT) == ROOT / ARTIFACT
    assert committed.committed(Path("baselines/scores")) == ROOT / "baselines" / "scores"


def test_files_of_the_working_folder_have_precedence(tmp_path, monkeypatch):
    (tmp_path / ARTIFACT).parent.mkdir(parents=True)
    (tmp_path / ARTIFACT).write_bytes(b"mine")
    monkeypatch.chdir(tmp_path)
    assert committed.committed(ARTIFACT) == ARTIFACT


@pytest.mark.parametrize("path", ["mine.npz", "out/scores", "README.md", "baselines/nothing", "/baselines/scores"])
def test_any_other_path_is_unchanged(path, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert committed.committed(Path(path)) == Path(path)


def test_every_run_of_a_learned_policy_has_a_name_and_its_policy_a_pattern():
    found = committed.committed_artifacts()
    assert len(found) == len(list((ROOT / "baselines" / "learned").glob("*/*.npz"))) > 50
    assert str(ARTIFACT) in found
    assert "baselines/learned/memory/seed*.npz" in committed.artifact_patterns()
    assert len(committed.artifact_patterns()) == len({Path(name).parent for name in found})


def test_an_installed_package_has_rows_policies_and_artifacts_by_the_same_names(tmp_path):
    site, empty = tmp_path / "site", tmp_path / "empty"
    shutil.copytree(ROOT / "spidar_gym", site / "spidar_gym", ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("assets", "baselines"):
        (site / "spidar_gym" / name).symlink_to(ROOT / name)
    empty.mkdir()
    (tmp_path / "query.py").write_text(INSTALLED)
    done = subprocess.run(
        [sys.executable, str(tmp_path / "query.py"), str(site)], cwd=empty, env={"PYTHONPATH": str(site)},
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    rows = {path.stem for path in (ROOT / "baselines" / "scores").rglob("*.json")}
    assert done.stdout == f"{len(rows)} qp_tuned adrc\n['adrc', 'memory']\n"
