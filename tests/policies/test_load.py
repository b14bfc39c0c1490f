"""Pins loading policies by name: zips run no code without --trust, committed artifacts are found from any folder."""

import subprocess
import sys
import zipfile
from pathlib import Path

import pytest
from support.zips import Trap, changed, learned, packed

from spidar_gym.onboard.export import export_files
from spidar_gym.policies.artifact import LearnedPolicy
from spidar_gym.policies.load import load_policy
from spidar_gym.policies.policy import policy_digest
from spidar_gym.policies.source import PolicyError, is_own, source_file

ROOT = Path(__file__).resolve().parents[2]
MEMORY = "baselines/learned/memory/seed0.npz"


def asked(code: str, *arguments: object) -> str:
    """Run a process that loads a policy; return what the process prints about the error."""
    code = f"""
import sys
{code}
from spidar_gym.policies.load import load_policy
try:
    load_policy({", ".join(map(str, arguments))})
except Exception as error:
    print(type(error).__name__, error)
print("torch" in sys.modules and sys.modules["torch"] is not None)
"""
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout


def test_a_zip_without_trust_is_refused_in_one_line_and_loads_no_framework(tmp_path):
    path = tmp_path / "model.zip"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("data", "{}")
    refusal, loaded = asked("", repr(str(path))).splitlines()
    assert loaded == "False"
    assert refusal.startswith(f"PolicyError policy {path}: a zip of Stable-Baselines3 can run code; valid: ")
    for valid in ("--trust", "*.npz"):
        assert valid in refusal
    assert len(refusal) < len(str(path)) + 160


@pytest.mark.parametrize("missing", ["torch", "stable_baselines3"])
def test_a_trusted_zip_without_the_extra_is_refused_with_the_install_command(missing):
    refusal, _ = asked(f"sys.modules[{missing!r}] = None", repr("model.zip"), "trust=True").splitlines()
    assert refusal.startswith("MissingDependencyError")
    assert "pip install 'spidar-gym[train]'" in refusal


@pytest.mark.train
def test_a_trap_in_a_zip_goes_off_with_trust_only(tmp_path):
    pytest.importorskip("stable_baselines3", reason="the extra `train` is not installed")
    path, sprung = learned(tmp_path / "model.zip"), tmp_path / "sprung"
    path.write_bytes(changed(path.read_bytes(), policy_class=packed(Trap(sprung))))
    with pytest.raises(PolicyError, match="--trust"):
        load_policy(str(path))
    assert not sprung.exists()
    with pytest.raises(PolicyError, match="cannot be read"):
        load_policy(str(path), trust=True)
    assert sprung.exists()


def test_a_committed_artifact_is_found_from_any_folder_by_the_name_that_its_row_has(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    policy = load_policy(MEMORY)
    assert isinstance(policy, LearnedPolicy)
    assert policy.name == "memory"
    assert source_file(MEMORY) == policy.path == ROOT / MEMORY
    assert is_own(MEMORY)
    assert export_files(golden=False, residual=Path(MEMORY)) == export_files(golden=False, residual=ROOT / MEMORY)


def test_a_local_artifact_takes_precedence_over_a_committed_one_of_its_name(tmp_path, monkeypatch):
    (tmp_path / MEMORY).parent.mkdir(parents=True)
    (tmp_path / MEMORY).write_bytes((ROOT / "baselines/learned/gait/seed0.npz").read_bytes())
    committed = policy_digest(load_policy(str(ROOT / MEMORY)))
    monkeypatch.chdir(tmp_path)
    assert load_policy(MEMORY).name == "gait"
    assert policy_digest(load_policy(MEMORY)) != committed, "so a row refuses to play it"


@pytest.mark.parametrize("name", ["baselines/learned/memry/seed0.npz", "baselines/learned/memory/seed9.npz"])
def test_an_artifact_that_is_not_committed_is_refused_with_the_list_of_those_that_are(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for ask in (load_policy, source_file, lambda spec: export_files(golden=False, residual=Path(spec))):
        with pytest.raises(PolicyError, match=rf"{name}: no such artifact is committed; valid: ") as refusal:
            ask(name)
        assert "baselines/learned/memory/seed*.npz" in str(refusal.value)
