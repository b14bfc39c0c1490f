"""Pins zips of Stable-Baselines3 at the border: nothing of one is unpickled, or torch loaded, without trust."""

import subprocess
import sys
import zipfile

import pytest
from support.zips import Trap, changed, learned, packed

from spidar_gym.policies.load import load_policy
from spidar_gym.policies.source import PolicyError


def asked(code: str, *arguments: object) -> str:
    """What a process of its own prints that asks for a policy and is refused."""
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


def test_a_zip_without_trust_is_refused_in_a_line_that_says_what_is_valid_and_loads_no_framework(tmp_path):
    path = tmp_path / "model.zip"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("data", "{}")
    refusal, loaded = asked("", repr(str(path))).splitlines()
    assert loaded == "False"
    assert refusal.startswith(f"PolicyError policy {path}: a zip of Stable-Baselines3 can run code; valid: ")
    for valid in ("--trust", "*.npz", "module:Class"):
        assert valid in refusal


@pytest.mark.parametrize("missing", ["torch", "stable_baselines3"])
def test_a_trusted_zip_without_the_extra_is_refused_in_a_line_that_says_how_to_get_it(missing):
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
