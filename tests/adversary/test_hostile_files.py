"""Concurrent writers, readers and planters of links at one file; more cores than a process can hold."""

import subprocess
import sys

WRITES, READS = 3000, 149_000
"""Total over all processes."""
COUNT = 3
"""Number of writing processes, and of reading processes."""
CORES = 11_000
"""More than the 10,810 copies that a process could hold."""

ABOUT = """
import hashlib, os, random, sys
from pathlib import Path
from spidar_gym.errors import SpidarError
from spidar_gym.files import write_bytes

path, count, seed = Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3])
rng = random.Random(seed)
"""
WRITER = """
failed = 0
for _ in range(count):
    body = rng.randbytes(rng.choice((0, 10, 5000, 70_000)))
    try:
        write_bytes(path, hashlib.sha256(body).digest() + body)
    except SpidarError as error:
        failed += 1
print(failed)
"""
READER = """
torn = 0
for _ in range(count):
    try:
        data = path.read_bytes()
    except FileNotFoundError:
        data = b""
    torn += hashlib.sha256(data[32:]).digest() != data[:32]
print(torn)
"""
PLANTER = """
victim = path.parent / "victim"
for k in range(count):
    for name in (path.name, f".{path.name}.part", f"{path.name}.part", f".spidar.{k}.part"):
        link = path.parent.parent / "link"
        link.symlink_to(victim)
        link.replace(path.parent / name)
print(0)
"""
LOADER = """
import sys
from spidar_gym.native.library import load_core

for _ in range(int(sys.argv[1])):
    core = load_core()
with open("/proc/self/maps", encoding="utf-8") as maps:
    print(len({line.split(maxsplit=5)[5] for line in maps if "libspidar" in line}))
"""


def test_many_writers_readers_and_planted_links_of_one_file(tmp_path, tries):
    folder = tmp_path / "shared"
    folder.mkdir()
    path, victim = folder / "one.bin", folder / "victim"
    whole = bytes.fromhex("e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855")  # of an empty body
    for file in (path, victim):
        file.write_bytes(whole)
    parts = [(WRITER, tries(WRITES) // COUNT), (READER, tries(READS) // COUNT)] * COUNT + [(PLANTER, tries(WRITES))]
    running = [
        subprocess.Popen(
            [sys.executable, "-c", ABOUT + script, path, str(count), str(seed)], stdout=subprocess.PIPE, text=True
        )
        for seed, (script, count) in enumerate(parts)
    ]
    answers = [process.communicate(timeout=300)[0].strip() for process in running]
    assert answers == ["0"] * len(parts), "failed writes and torn reads by process"
    assert victim.read_bytes() == whole
    assert [p for p in folder.iterdir() if not p.is_symlink() and p not in (path, victim)] == []


def test_more_cores_are_made_and_dropped_than_a_process_can_hold(tries):
    """In a separate process, since this one may still map the cores of other tests."""
    answer = subprocess.run(
        [sys.executable, "-c", LOADER, str(tries(CORES))],
        capture_output=True,
        text=True,
        check=True,
    )
    assert answer.stdout.split() == ["1"]
