"""Pins a run's folder: a checkpoint that does not match is rejected, and the previous one is kept."""

import errno
import pickle
import shutil
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("stable_baselines3", reason="the extra `train` is not installed")
from support.training import TINY

from spidar_gym.border import pack, unpack
from spidar_gym.errors import SpidarError
from train.lib.config import override
from train.lib.run import TITLE, CheckpointError
from train.residual import learn

pytestmark = [pytest.mark.train, pytest.mark.usefixtures("short")]


def test_a_checkpoint_of_another_run_is_refused_and_left_alone(done):
    before = (done / "checkpoint.npz").read_bytes()
    words = rf"another run: lr = {TINY.learner.lr:g} instead of 0\.1; valid: the same settings"
    with pytest.raises(CheckpointError, match=words):
        learn(override(TINY, lr=0.1, out=done.parent.parent))
    assert (done / "checkpoint.npz").read_bytes() == before


@pytest.fixture
def spoilt(done, tmp_path):
    """Return a function that creates a run's folder with a modified checkpoint."""

    def make(change):
        content, arrays = unpack(TITLE, (done / "checkpoint.npz").read_bytes(), sealed=True)
        change(content, arrays)
        folder = tmp_path / TINY.name / "seed0"
        folder.mkdir(parents=True)
        (folder / "checkpoint.npz").write_bytes(pack(TITLE, content, arrays, sealed=True))
        return override(TINY, out=tmp_path)

    return make


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"interface": {"observation": [], "action": 6}}, r"another run: observation = \[\] instead of"),
        ({"env_id": "spidar_gym/Hover-v9"}, "another run: env_id = spidar_gym/Hover-v9 instead of spidar_gym/Hover-v0"),
        ({"versions": {"spidar-gym": "0.0.1"}}, r"another run: \w+ = None instead of"),
    ],
)
def test_a_checkpoint_of_another_environment_version_is_refused(spoilt, change, words):
    args = spoilt(lambda content, _: content["identity"].update(change))
    with pytest.raises(CheckpointError, match=words):
        learn(args)


def test_a_checkpoint_without_its_normaliser_is_refused(spoilt):
    args = spoilt(lambda _, arrays: arrays.pop("scaling/variance"))
    with pytest.raises(CheckpointError, match="lacks its normaliser"):
        learn(args)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda _, arrays: arrays.pop("learner/policy/log_std"), "lacks 'policy/log_std'"),
        (lambda _, arrays: arrays.update({"learner/more": np.zeros(3)}), "has 'more'"),
        (lambda _, arrays: arrays["learner/policy.optimizer/0/exp_avg"].fill(np.nan), "non-finite"),
        (lambda _, arrays: arrays.update({"learner/counters": np.array([-1, 0])}), r"counters = \[-1, 0\]"),
        (lambda _, arrays: arrays.update({"mean/0/weight": np.zeros((2, 2), np.float32)}), r"\(2, 2\)"),
        (lambda _, arrays: arrays.update({"scaling/mean": np.zeros(3)}), r"float64 \(3,\)"),
        (lambda _, arrays: arrays["scaling/variance"].fill(-1.0), "variance"),
        (lambda _, arrays: arrays.pop("best/1/bias"), "lacks some of the layers of best"),
        (lambda content, _: content["state"].update(segment=-1), "lacks its learner or its counts"),
        (lambda content, _: content["state"].update(curve=[{"steps": 1}]), "lacks seconds"),
        (lambda content, _: content.update(format=1), "has format 1; valid: format 3"),
    ],
)
def test_a_checkpoint_of_other_parts_is_refused_though_its_checksum_is_right(spoilt, change, words):
    with pytest.raises(SpidarError, match=words) as caught:
        learn(spoilt(change))
    assert str(caught.value).isprintable()


def test_a_checkpoint_of_an_earlier_version_is_refused_and_not_opened(tmp_path):
    folder = tmp_path / TINY.name / "seed0"
    folder.mkdir(parents=True)
    (folder / "checkpoint.pt").write_bytes(pickle.dumps(Trap()))
    with pytest.raises(CheckpointError, match=r"checkpoint\.pt is of an earlier version, .* can run code; valid: "):
        learn(override(TINY, out=tmp_path))


class Trap:
    """Fails the test when it is unpickled."""

    def __reduce__(self):
        return pytest.fail, ("unpickled",)


def test_a_run_resumes_from_the_previous_checkpoint_without_the_damaged_one(done, tmp_path):
    folder = tmp_path / TINY.name / "seed0"
    shutil.copytree(done, folder)
    data = bytearray((folder / "checkpoint.npz").read_bytes())
    data[len(data) // 2] ^= 1
    (folder / "checkpoint.npz").write_bytes(data)
    (folder / "policy.npz").unlink()
    args = override(TINY, out=tmp_path)
    with pytest.raises(CheckpointError, match=r"checksum.*without the file the run resumes from previous\.npz"):
        learn(args)
    (folder / "checkpoint.npz").unlink()
    lines = []
    path = learn(args, on_segment=lines.append)
    assert [line["steps"] for line in lines] == [192], "the first segment was not learned again"
    assert path.read_bytes() == (done / "policy.npz").read_bytes()


@pytest.mark.parametrize("keep", [0, 10, 1000])
def test_half_a_checkpoint_is_refused_in_words(done, tmp_path, keep):
    folder = tmp_path / TINY.name / "seed0"
    folder.mkdir(parents=True)
    (folder / "checkpoint.npz").write_bytes((done / "checkpoint.npz").read_bytes()[:keep])
    with pytest.raises(CheckpointError, match=r"is no checkpoint .*valid: one that this script wrote"):
        learn(override(TINY, out=tmp_path))


def test_a_full_disk_leaves_the_last_checkpoint_whole(tmp_path, monkeypatch):
    args, write = override(TINY, out=tmp_path), Path.write_bytes
    folder = tmp_path / TINY.name / "seed0"

    def full(path, data):
        if "checkpoint" in path.name and any(folder.glob("*.npz")):
            write(path, data[:100])
            raise OSError(errno.ENOSPC, "No space left on device")
        return write(path, data)

    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(SpidarError, match=r"cannot write .*checkpoint\.npz: No space left on device"):
        learn(args)
    (last,) = folder.glob("**/*.npz*")
    assert unpack(TITLE, last.read_bytes(), sealed=True)[0]["state"]["segment"] == 1
    monkeypatch.undo()
    assert learn(args).exists()
