"""Pins how compilers are called, and that errors of compilers and disks are reported in one line."""

import ctypes
import os
import re
import resource
import shutil
import subprocess
import sys

import pytest
from support.needs import needs_compiler

from spidar_gym.errors import InvalidValueError, MissingDependencyError, SpidarError
from spidar_gym.native import recipe
from spidar_gym.native.compiler import compile_library, compiler, run_tool
from spidar_gym.onboard.export import export

FULL_LINKER = """#!/bin/sh
echo "In file included from core/allocate.c:3:" >&2
echo "/usr/bin/ld: final link failed: No space left on device" >&2
echo "collect2: error: ld returned 1 exit status" >&2
exit 1
"""
DISK = 'mount -t tmpfs -o size="$1" none "$2" && shift 2 && exec "$@"'
"""Shell script that runs a command with a small disk mounted for it alone."""
EXPORT = """
import sys
from spidar_gym.cli.main import main
from spidar_gym.onboard import export
export.golden_files = lambda robot: {}  # they take half a minute
main(sys.argv[1:])
"""


def small_disks():
    """Return whether this machine can mount a disk in a new namespace."""
    if not shutil.which("unshare"):
        return False
    run = ["unshare", "-rm", "sh", "-c", DISK, "sh", "64k", "/mnt", "true"]
    return subprocess.run(run, check=False, capture_output=True).returncode == 0


needs_small_disks = pytest.mark.skipif(not small_disks(), reason="no disk can be mounted here (unshare -rm)")


@pytest.fixture
def cc(tmp_path, monkeypatch):
    """Return a function that writes a script and sets CC to it."""

    def put(script):
        path = tmp_path / "bin" / "their cc"
        path.parent.mkdir(exist_ok=True)
        path.write_text(script)
        path.chmod(0o755)
        monkeypatch.setenv("CC", f"'{path}' -O0")

    return put


def exported(words, before=(), **options):
    run = [*before, sys.executable, "-c", EXPORT, *words]
    return subprocess.run(run, capture_output=True, text=True, check=False, **options)


@needs_compiler
def test_cc_may_have_arguments(tmp_path, monkeypatch):
    plain = compiler()
    monkeypatch.setenv("CC", f"{plain[0]} -O0  -DNAME='a b'")
    assert compiler() == [plain[0], "-O0", "-DNAME=a b"]
    monkeypatch.setattr(recipe, "LIBRARY_FLAGS", ("-std=c99",))
    assert ctypes.CDLL(str(compile_library(tmp_path / "libspidar.so"))).sp_interface() != 0


@pytest.mark.parametrize("given", ["no-such-compiler", "no-such-compiler -O2", "'", "gcc 'half", "/"])
def test_a_cc_that_is_not_a_command_is_named(monkeypatch, given):
    monkeypatch.setenv("CC", given)
    with pytest.raises(InvalidValueError, match=r"CC = .* is not valid; expected a C99 compiler that is installed"):
        compiler()


def test_without_a_compiler_the_message_states_what_to_install(monkeypatch, tmp_path):
    monkeypatch.setenv("PATH", str(tmp_path))
    for given in ("", " "):
        monkeypatch.setenv("CC", given)
        with pytest.raises(MissingDependencyError, match="apt-get install gcc"):
            compiler()


def test_a_linker_without_disk_space_is_not_reported_as_a_missing_compiler(cc, tmp_path):
    cc(FULL_LINKER)
    with pytest.raises(SpidarError) as refusal:
        compile_library(tmp_path / "out" / "libspidar.so")
    assert str(refusal.value) == (
        "the library does not compile: their cc: /usr/bin/ld: final link failed: No space left on device / "
        "collect2: error: ld returned 1 exit status; valid: compilers for C99 (CC) and, for ROS, C++11, and room on "
        "the disks of the output and of TMPDIR"
    )
    assert list((tmp_path / "out").iterdir()) == []


@pytest.mark.parametrize(
    ("script", "message"),
    [
        ("#!/bin/sh\nexit 3\n", "ended with status 3"),
        ("#!/bin/sh\nprintf 'x.c:1: error: \\377\\n' >&2\nexit 1\n", "x.c:1: error: \ufffd"),
        ("#!/bin/sh\nkill -9 $$\n", "ended with status -9"),
        ("#!/no/such/interpreter\n", "cannot be started: No such file or directory"),
    ],
)
def test_any_failure_of_a_tool_is_reported_in_one_line(cc, script, message):
    cc(script)
    with pytest.raises(SpidarError) as refusal:
        run_tool(compiler(), "the core")
    assert f"their cc: {message}; valid: " in str(refusal.value)
    assert "\n" not in str(refusal.value)


@pytest.mark.slow
@pytest.mark.parametrize("room", [1000, 200_000])
def test_a_file_size_limit_is_reported_in_one_line_and_keeps_the_old_core(tmp_path, room):
    core = tmp_path / "libspidar.so"
    core.write_bytes(b"old")

    def limit():
        resource.setrlimit(resource.RLIMIT_FSIZE, (room, room))

    done = exported(["assets"], env={**os.environ, "SPIDAR_CORE": str(core)}, preexec_fn=limit)
    assert re.fullmatch("spidar: .*File (too large|size limit exceeded).*; valid: .*\n", done.stderr)
    assert done.returncode == 2
    assert core.read_bytes() == b"old"
    assert [path.name for path in tmp_path.iterdir()] == ["libspidar.so"]


@needs_small_disks
@pytest.mark.slow
@pytest.mark.parametrize(
    ("words", "where", "size"),
    [
        ("assets", "TMPDIR", "64k"),
        ("assets", "TMPDIR", "700k"),
        ("assets", "output", "64k"),
        ("--out", "output", "500k"),
    ],
)
def test_a_full_disk_is_reported_in_one_line_and_leaves_no_files(tmp_path, words, where, size):
    places = {name: tmp_path / name for name in ("TMPDIR", "output")}
    for place in places.values():
        place.mkdir()
    environment = {**os.environ, "TMPDIR": str(places["TMPDIR"])}
    if words == "assets":
        environment["SPIDAR_CORE"] = str(places["output"] / "libspidar.so")
    words = [words] if words == "assets" else ["export", words, str(places["output"] / "onboard")]
    before = ["unshare", "-rm", "sh", "-c", DISK, "sh", size, str(places.pop(where))]
    done = exported(words, before, env=environment)
    assert re.fullmatch("spidar: .*No space left on device.*; valid: .*\n", done.stderr)
    assert done.returncode == 2
    assert [list(place.iterdir()) for place in places.values()] == [[]]


@pytest.mark.parametrize("place", ["file", "file/onboard", "/proc/onboard"])
def test_a_place_that_cannot_hold_a_folder_is_reported_in_one_line(tmp_path, place):
    (tmp_path / "file").write_text("mine")
    with pytest.raises(SpidarError, match=r"cannot write .*; valid: a"):
        export(tmp_path / place)
    assert [path.name for path in tmp_path.iterdir()] == ["file"]
