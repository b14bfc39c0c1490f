"""Pins the engine under sanitizers: no invalid access, no undefined behaviour, no race, the same bits as in Python."""

import ctypes
import json
import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import mujoco
import numpy as np
import pytest
from support.vectors import WORN

from spidar_gym.envs.registry import COURSE, CRAWL, GRASP, HOVER
from spidar_gym.envs.vector import NativeVectorEnv
from spidar_gym.native import recipe
from spidar_gym.native.compiler import compiler
from spidar_gym.native.mujoco import BOXED, DATA, FLAT, FREE, MODEL, OWN, STATE, library, member_offsets, offsets
from spidar_gym.native.robot import robot

DRIVER = Path(__file__).with_name("driver.c")
SANITIZERS = {"address": "-fsanitize=address,undefined", "thread": "-fsanitize=thread"}
CASES = {
    "flight": (HOVER, {"forms": "narrow", "joint_speed": 1.0}),
    "randomised flight": (HOVER, WORN),
    "crawl": (CRAWL, {"preset": "robust"}),
    "randomised crawl": (CRAWL, {"randomization": 1.0, "sensors": True}),
    "crawl on tiles": (CRAWL, {"steps": 0.01, "slope": 0.05}),
    "course by targets": (COURSE, {"sensors": True, "randomization": 1.0, "battery": True}),
    "course by the rule": (COURSE, {"action_mode": "residual", "hold": 20, "count": (1, 1), "gates": ("beam",)}),
    "course alone": (COURSE, {"action_mode": "direct", "floors": ("tiles",), "disturbances": {"wind": 2.0}}),
    "grasp": (GRASP, {"shapes": ("box", "ball", "cylinder"), "randomization": 1.0, "disturbances": {"wind": 2.0}}),
}  # fmt: skip
KINDS = (HOVER, CRAWL, COURSE, GRASP)
"""Environments in the order of the driver's functions."""
JOBS = ("reset", "step", "show", "hold")
"""Jobs in the driver's order."""
ROBOTS, TICKS = 5, 40
OF_DATA, OF_MODEL, ITSELF = range(3)
RACE, OVERFLOW, UNDEFINED = range(1, 4)
LIBRARY = "library"
"""Builds the library for Python instead of a driver."""
STATES = {"hover": 120, "path": 60, "crawl": 80, "course": 100}
"""Number of changed states of each kind; `tests/adversary` tests more, without sanitizers."""


def compile_objects(sanitizer, folder):
    """Compile the library's sources; return the command for the driver, and the object files."""
    flags = [SANITIZERS[sanitizer], "-fno-sanitize-recover=all", "-O1", "-g", "-ffp-contract=off"]
    done = subprocess.run(
        [*compiler(), flags[0], "-x", "c", "-", "-o", str(folder / "none")],
        input="int main(void) { return 0; }", capture_output=True, text=True, check=False,
    )  # fmt: skip
    if done.returncode or subprocess.run([folder / "none"], check=False).returncode:
        pytest.skip(f"the compiler has no {sanitizer} sanitizer, or it does not run here: {done.stderr.strip()[-200:]}")
    (folder / "spidar_interface.h").write_text(recipe.interface_header(recipe.library_digest()))
    command = [*compiler(), *flags, "-DSPIDAR_SHARED", "-fPIC", *recipe.includes(folder)]

    def compile_one(source):
        out = folder / f"{Path(source).parent.name}-{Path(source).stem}.o"
        done = subprocess.run([*command, "-std=c99", "-c", source, "-o", out], capture_output=True, text=True)
        assert done.returncode == 0, done.stderr[:2000]
        return str(out)

    with ThreadPoolExecutor(2) as pool:
        return command, list(pool.map(compile_one, recipe.sources()))


@pytest.fixture(scope="module")
def build(tmp_path_factory):
    """Return a function that builds a driver by sanitizer and bug."""
    objects, drivers = {}, {}

    def get(sanitizer, broken=0):
        folder = tmp_path_factory.getbasetemp() / f"{sanitizer}_objects"
        folder.mkdir(exist_ok=True)
        if sanitizer not in objects:
            objects[sanitizer] = compile_objects(sanitizer, folder)
        if (sanitizer, broken) not in drivers:
            command, files = objects[sanitizer]
            out = folder / f"driver{broken}"
            first = ["-shared"] if broken == LIBRARY else [str(DRIVER)]
            end = [*first, *files, "-o", out, "-lm", "-ldl", "-pthread"]
            words = [*command, "-std=gnu11", f"-DBROKEN={broken}", *end]
            done = subprocess.run(words, capture_output=True, text=True, check=False)
            assert done.returncode == 0, done.stderr[:2000]
            if broken == LIBRARY:
                recipe.seal(out)
            drivers[sanitizer, broken] = out
        return drivers[sanitizer, broken]

    return get


def members():
    """Return the members of `sp_sim` as offsets, without the addresses of this process."""
    data, model, at = member_offsets("mjData"), member_offsets("mjModel"), offsets()
    table = [
        (OF_DATA, 0, at["time"]), *((OF_DATA, 1, data[name]) for name in DATA), (OF_DATA, 0, at["ncon"]),
        (OF_DATA, 0, at["contact"]), (OF_DATA, 0, at["warning"]), *((OF_MODEL, 1, model[name]) for name in MODEL),
        (OF_MODEL, 0, at["disableflags"]), (ITSELF, 0, at["stride"]), (ITSELF, 0, at["geom"]),
        (ITSELF, 0, at["frame"]), (ITSELF, 0, at["warning_bytes"]),
    ]  # fmt: skip
    return np.array(table, np.int64)


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """Return a function that writes the driver's files for a case, and returns the hash that it must print."""
    done = {}

    def get(case):
        if case not in done:
            done[case] = write(case, tmp_path_factory.mktemp("written"))
        return done[case]

    return get


class Called:
    """Wraps the library and records the jobs that Python called; the task decides which robots reset."""

    def __init__(self, library):
        self.library, self.calls, self.resets = library, [], 0

    def __getattr__(self, name):
        function, (_, job, *_) = getattr(self.library, name), f"{name}_".split("_")
        if not name.endswith("_robots"):
            return function

        def call(engine, ids, count, *more):
            chosen = () if ids is None else np.ctypeslib.as_array((ctypes.c_int32 * count).from_address(ids.value))
            self.resets += job == "reset"
            self.calls += [JOBS.index(job), len(chosen), *chosen]
            return function(engine, ids, count, *more)

        return call


def write(case, folder):
    name, options = CASES[case]
    env = NativeVectorEnv(name, ROBOTS, autoreset_mode="SameStep", max_episode_steps=15, **options)
    fleet = env.fleet
    engine = fleet.engine
    for k in range(ROBOTS):
        fleet.seed(k, np.random.default_rng(k))
    model, rows = member_offsets("mjModel"), engine._pieces[0].tolist()
    names = next(names for names in (FREE, BOXED, OWN, FLAT) if len(names) == len(rows))
    rows = zip(names, rows, strict=True)
    pieces = np.array([(model[piece], *row[1:]) for piece, row in rows], np.int64)
    actions = np.random.default_rng(9).normal(0.0, 0.4, (TICKS, *fleet.actions.shape))
    numbers = [
        ROBOTS, TICKS, KINDS.index(name), engine.robots.itemsize, engine.copies.shape[1], engine.record["own_copies"],
        fleet.actions.shape[1], fleet.observations.shape[1], fleet.infos.itemsize, fleet.quantities.itemsize,
        engine.record["goal_room"],
        int(STATE), int(mujoco.mjtDisableBit.mjDSBL_CONTACT),
    ]  # fmt: skip
    parts = [
        np.array(numbers, np.int64), engine._world, robot(), fleet.rules, engine.robots, engine.copies,
        members(), pieces, actions,
    ]  # fmt: skip
    parts = [(part.nbytes, part.tobytes()) for part in parts]  # as they are before the first tick
    assert len(members()) == len(engine.simulations[0].record) - 3
    mujoco.mj_saveModel(engine.simulations[0].model, str(folder / "model.mjb"))
    engine.library = library = Called(engine.library)
    fleet.reset()
    library.calls.append(-1)
    seen = [fleet.observations.tobytes()]
    for action in actions:
        fleet.actions[:] = action
        fleet.step()
        library.calls.append(-1)
        seen.append(fleet.observations.tobytes())
    env.close()
    assert library.resets > 1
    calls = np.array(library.calls, np.int32)
    with (folder / "data").open("wb") as file:
        for size, content in [*parts, (calls.nbytes, calls.tobytes())]:
            file.write(size.to_bytes(8, "little") + content)
    value = 0xCBF29CE484222325
    for byte in b"".join(seen):
        value = (value ^ byte) * 0x100000001B3 & 0xFFFFFFFFFFFFFFFF
    return folder, f"{value:016x}"


def drive(driver, folder):
    # Leaks are not checked: neither the driver nor MuJoCo frees its memory at the end.
    calm = {"ASAN_OPTIONS": "detect_leaks=0", "TSAN_OPTIONS": "halt_on_error=1", "UBSAN_OPTIONS": "print_stacktrace=1"}
    words = [driver, folder / "data", folder / "model.mjb", library()._name]
    return subprocess.run(words, env={**os.environ, **calm}, capture_output=True, text=True, check=False, timeout=250)


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("sanitizer", SANITIZERS)
def test_no_sanitizer_reports_an_error_and_other_threads_compute_the_same_bits(build, written, sanitizer, case):
    driver, (folder, expected) = build(sanitizer), written(case)
    done = drive(driver, folder)
    assert (done.returncode, done.stderr) == (0, ""), done.stderr[:4000]
    assert done.stdout.strip() == expected


@pytest.mark.slow
@pytest.mark.parametrize(
    ("sanitizer", "broken", "words"),
    [
        ("thread", RACE, "data race"),
        ("address", OVERFLOW, "heap-buffer-overflow"),
        ("address", UNDEFINED, "runtime error: shift exponent"),
    ],
)
def test_a_bug_is_found(build, written, sanitizer, broken, words):
    done = drive(build(sanitizer, broken), written("flight")[0])
    assert done.returncode != 0
    assert words in done.stderr


@pytest.mark.slow
@pytest.mark.parametrize("case", STATES)
def test_no_sanitizer_reports_an_error_for_changed_states(build, case):
    """Run Python with a library that was built with sanitizers."""
    library = build("address", LIBRARY)
    # libstdc++ too, else the sanitizer does not see C++ exceptions.
    first = [
        subprocess.run([*compiler(), f"-print-file-name={name}"], capture_output=True, text=True, check=True).stdout
        for name in ("libasan.so", "libstdc++.so")
    ]
    env = {**os.environ, "SPIDAR_CORE": str(library), "LD_PRELOAD": " ".join(map(str.strip, first)),
           "ASAN_OPTIONS": "detect_leaks=0", "UBSAN_OPTIONS": "print_stacktrace=1"}  # fmt: skip
    plans = [f"{way}:{kind}:{STATES[case]}" for way in ("vector", "core") for kind in ("integers", "floats")]
    words = [sys.executable, "-m", "support.hostile_states", case, "7", *plans, f"python:integers:{STATES[case] // 4}"]
    done = subprocess.run(
        words, cwd=DRIVER.parents[1], env=env, capture_output=True, text=True, check=False, timeout=1200
    )
    tried, _, message = done.stderr.rpartition(f"{case} ")
    assert done.returncode == 0, (tried[-200:], message[:3000])
    report = json.loads(done.stdout.splitlines()[-1])
    # Under a sanitizer a tick may take more than a second.
    assert not [line for line in report["wrong"] if "more than a second" not in line]
