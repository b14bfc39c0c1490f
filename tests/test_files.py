"""Pins the writing of files: atomic, by concurrent writers, and with errors of the disk."""

import os
import resource
import signal
import subprocess
import sys

import pytest

from spidar_gym import files
from spidar_gym.errors import SpidarError
from spidar_gym.files import AFTER, BEFORE, own_folder, whole_file, write_bytes, write_text

WRITING = """
import sys
from pathlib import Path
from spidar_gym.files import write_text
write_text(Path(sys.argv[1]), "new")
"""
KILLED = """
import os, signal, sys
from pathlib import Path
from spidar_gym.files import whole_file
with whole_file(Path(sys.argv[1])) as part:
    part.write_bytes(b"half")
    os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.fixture
def room():
    """Limit the size of files; writes beyond it fail as on a full disk."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    yield lambda size: resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    resource.setrlimit(resource.RLIMIT_FSIZE, before)


def parts(folder):
    return [path.name for path in folder.iterdir() if path.name.startswith(".")]


def test_two_writers_of_one_file_both_write_all_of_it(tmp_path):
    path = tmp_path / "one.json"
    with whole_file(path) as slow:
        slow.write_bytes(b"slow ")
        write_bytes(path, b"quick")
        assert path.read_bytes() == b"quick"
        with slow.open("ab") as file:
            file.write(b"but whole")
    assert path.read_bytes() == b"slow but whole"
    assert [p.name for p in tmp_path.iterdir()] == ["one.json"]


def test_no_link_is_followed(tmp_path):
    victim, path = tmp_path / "victim", tmp_path / "mine"
    victim.write_text("another's")
    for name in (".mine.part", "mine.part", f"{BEFORE}planted{AFTER}", "mine"):
        (tmp_path / name).symlink_to(victim)
    write_text(path, "my own")
    assert victim.read_text() == "another's"
    assert path.read_text() == "my own\n"
    assert not path.is_symlink(), "the link is replaced, not its target"


@pytest.mark.parametrize("mask", [0o022, 0o027, 0o000])
def test_a_file_gets_the_mode_of_any_other(tmp_path, mask):
    before = os.umask(mask)
    try:
        write_bytes(tmp_path / "x", b"")
    finally:
        os.umask(before)
    assert (tmp_path / "x").stat().st_mode & 0o777 == 0o666 & ~mask


def test_a_name_may_be_as_long_as_the_disk_allows(tmp_path):
    path = tmp_path / (250 * "n" + ".json")
    write_text(path, "{}")
    assert path.read_text() == "{}\n"


def test_the_leftovers_of_a_killed_writer_are_removed_and_those_of_a_running_one_are_kept(tmp_path):
    path = tmp_path / "x"
    path.write_text("old")
    done = subprocess.run([sys.executable, "-c", KILLED, path], check=False)
    assert done.returncode == -signal.SIGKILL
    assert path.read_text() == "old"
    left = parts(tmp_path)
    assert len(left) == 1
    with own_folder(tmp_path) as living:
        assert parts(tmp_path) == [living.name], "the first writer of a process removes the leftovers"
        (living / "x").write_text("going on")
        subprocess.run([sys.executable, "-c", WRITING, path], check=True)
        assert (living / "x").read_text() == "going on"
    assert path.read_text() == "new\n"
    assert parts(tmp_path) == []


@pytest.mark.parametrize("error", [ValueError("not for files"), KeyboardInterrupt()])
def test_an_error_during_writing_leaves_the_old_file(tmp_path, error):
    def interrupted():
        with whole_file(path) as part:
            part.write_bytes(b"half")
            raise error

    path = tmp_path / "x"
    path.write_text("old")
    with pytest.raises(type(error)):
        interrupted()
    assert path.read_text() == "old"
    assert parts(tmp_path) == []


def test_a_full_disk_is_a_one_line_error_and_leaves_the_old_file(tmp_path, room):
    path = tmp_path / "x"
    path.write_text("old")
    room(100)
    with pytest.raises(SpidarError) as refusal:
        write_bytes(path, bytes(101))
    write_bytes(tmp_path / "y", bytes(100))
    assert str(refusal.value) == (
        f"cannot write {path}: File too large; valid: a path in a writable folder, on a disk with room"
    )
    assert path.read_text() == "old"
    assert parts(tmp_path) == []


@pytest.mark.parametrize("place", ["file/x", "/proc/x", "folder"])
def test_a_path_where_no_file_can_be_written_is_a_one_line_error(tmp_path, place):
    (tmp_path / "file").write_text("")
    (tmp_path / "folder" / "kept").mkdir(parents=True)
    with pytest.raises(SpidarError, match=r"cannot write .*; valid: a"):
        write_bytes(tmp_path / place, b"")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["file", "folder"]


def test_the_data_is_synchronised_before_the_renaming_and_the_folder_after_it(tmp_path, monkeypatch):
    done, fsync, replace = [], os.fsync, os.replace
    monkeypatch.setattr(files.os, "fsync", lambda h: (done.append(os.readlink(f"/proc/self/fd/{h}")), fsync(h)))
    monkeypatch.setattr(files.os, "replace", lambda a, b: (done.append("replace"), replace(a, b)))
    write_bytes(tmp_path / "x", b"data")
    assert [step.rpartition("/")[2] for step in done] == ["x", "replace", tmp_path.name]
