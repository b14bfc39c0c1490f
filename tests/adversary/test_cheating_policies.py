"""Cheating policies, one for each method: none scores better than the honest one; each failure is one line."""

import json
import os
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest

from spidar_gym.benchmark import TRACKS, PolicyError, evaluate
from spidar_gym.benchmark.row import make_row, read_row, write_row
from spidar_gym.benchmark.verify import every_scenario, verify
from spidar_gym.policies import confine, guest
from spidar_gym.policies.guest import close_guests, open_policy
from spidar_gym.policies.policy import policy_arguments

TRACK, SCENARIOS, LIMIT = "flight-fast5", [0, 1, 2], 3.0
MODULE = '''
import gc, os, signal, sys, threading, time
from contextlib import suppress
import numpy as np


class Honest:
    """Pushes a little."""
    name = "honest"

    def arguments(self, env_id):
        return {"action_mode": "residual_wrench"} if env_id == "spidar_gym/Hover-v0" else None

    def reset(self, seed):
        pass

    def cheat(self, observation):
        pass

    def act(self, observation):
        action = 0.3 * np.tanh(observation[:6])
        self.cheat(observation)
        return action


class Patches(Honest):
    def cheat(self, observation):
        from spidar_gym.benchmark import metrics, tally
        if not hasattr(tally, "real"):
            tally.real = tally.Tally.metrics
            tally.Tally.metrics = lambda *given: {**tally.real(*given), "error": 1e-9, "success": True}
            metrics.differences = lambda *given, **how: {}


class Seed(Honest):
    """Could compute the robot and the future wind if it received the scenario's seed."""

    def reset(self, seed):
        from spidar_gym.benchmark import load_scenarios
        self.known = any(scenario.seed == seed for scenario in load_scenarios("flight-fast5")[0])

    def cheat(self, observation):
        if self.known:
            raise RuntimeError("received the scenario's seed")


class Mutates(Honest):
    def cheat(self, observation):
        observation[:] = 0.0


class Reaches(Honest):
    """Searches for the environment, the tally and the parent's memory."""

    def cheat(self, observation):
        kinds = {"SpidarEnv", "HoverEnv", "Fleet", "Tally", "Scenario", "FleetWatch"}
        if any(type(each).__name__ in kinds for each in gc.get_objects()):
            raise RuntimeError("found an environment")
        from spidar_gym.policies.confine import landlock
        for name in ("mem", "environ", "fd/0") if landlock() else ():
            with suppress(OSError):
                open(f"/proc/{os.getppid()}/{name}", "r+b").close()
                raise RuntimeError(f"opened {name} of its parent")


class Sleeps(Honest):
    """Ignores alarms and signals to end."""

    def cheat(self, observation):
        for number in (signal.SIGALRM, signal.SIGTERM, signal.SIGINT):
            signal.signal(number, lambda *_: None)
        while True:
            with suppress(BaseException):
                time.sleep(60.0)


class Forks(Honest):
    """Continues in a process that outlives its answer."""
    forked = False

    def cheat(self, observation):
        if not Forks.forked:
            Forks.forked = True
            if os.fork() == 0:
                open(os.environ["TMPDIR"] + "/forked", "w").close()
                time.sleep(60.0)
                os._exit(0)


class Forges(Honest):
    """Writes results of later scenarios with valid digests."""

    def cheat(self, observation):
        import pathlib
        from spidar_gym.benchmark import load_scenarios
        from spidar_gym.benchmark.evaluate import Shard
        from spidar_gym.benchmark.resume import digest_of
        from spidar_gym.policies.provenance import file_digest
        import json
        better = json.loads(pathlib.Path("better.json").read_text())
        for scenario in load_scenarios("flight-fast5")[0][:3]:
            shard = Shard("mine:Forges", "flight-fast5", "test", scenario)
            name = shard.key(file_digest(pathlib.Path(__file__)))
            path = pathlib.Path("kept/honest/flight-fast5") / f"{name}.json"
            with suppress(OSError):
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_text(json.dumps({"result": better, "sha256": digest_of(name, better)}))


class Pickles(Honest):
    def act(self, observation):
        class Action:
            def __reduce__(self):
                return os.system, ("touch ran",)
        return np.array([Action()] * 6, dtype=object)


class Talks(Honest):
    """Writes to every file descriptor a message whose stated length exceeds any memory."""

    def cheat(self, observation):
        for line in range(3, 20):
            with suppress(OSError):
                os.write(line, b"\\xff" * 4096)


class Grows(Honest):
    def cheat(self, observation):
        self.kept = bytearray(2**35)


class Dies(Honest):
    def cheat(self, observation):
        os.kill(os.getpid(), signal.SIGSEGV)


class Leaves(Honest):
    def cheat(self, observation):
        os._exit(0)


class OwnLaw(Honest):
    def arguments(self, env_id):
        return {"law": type("Law", (), {})}


class Tuned(Honest):
    """Chooses a controller's configuration, which is data."""

    def arguments(self, env_id):
        from dataclasses import replace
        from spidar_gym.control.presets import TUNED
        chosen = {"controller": replace(TUNED, joint_speed=0.7), "action_scale": {"share": 0.5}}
        return chosen if env_id == "spidar_gym/Hover-v0" else None
'''
HONEST = ("Patches", "Seed", "Mutates", "Reaches", "Forks", "Forges")
WRONG = {
    "Sleeps": rf"took longer than {LIMIT:g} s in act\(\)",
    "Pickles": r"gave object of shape \(6,\)",
    "Talks": "its process answered with a message of 8589934590 bytes",
    "Grows": r"act\(\) raised MemoryError",
    "Dies": "its process was killed by SIGSEGV",
    "Leaves": r"its process ended \(0\)",
}


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch):
    """A working folder with the policies; flights of a quarter of a second."""
    (tmp_path / "mine.py").write_text(MODULE, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(TRACKS, TRACK, replace(TRACKS[TRACK], seconds=0.25))
    (tmp_path / "scratch").mkdir()
    monkeypatch.setattr(guest.tempfile, "tempdir", str(tmp_path / "scratch"))  # apart from other tests
    yield tmp_path
    assert "mine" not in sys.modules  # the policy's code never runs in this process
    close_guests()


@pytest.fixture(scope="module")
def honest(tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        folder = tmp_path_factory.mktemp("honest")
        (folder / "mine.py").write_text(MODULE, encoding="utf-8")
        patch.chdir(folder)
        patch.setitem(TRACKS, TRACK, replace(TRACKS[TRACK], seconds=0.25))
        return played("Honest")


def played(name, **how):
    return evaluate(f"mine:{name}", TRACK, SCENARIOS, act_limit_s=LIMIT, **how)


def running(folder):
    """Processes with this text in their environment."""
    found = []
    for process in Path("/proc").glob("[0-9]*"):
        try:
            found += [process.name] if folder in (process / "environ").read_bytes() else []
        except OSError:
            continue
    return found


@pytest.mark.parametrize("name", HONEST)
def test_a_cheat_gets_the_score_of_its_honest_self(name, honest, here):
    better = {"metrics": {k: v[0] for k, v in honest.metrics.items()} | {"error": 1e-9}, "timing": honest.timing[0]}
    (here / "better.json").write_text(json.dumps(better), encoding="utf-8")
    for _ in range(2 if name == "Forges" else 1):  # a second call reads the results stored by the first
        assert played(name, folder=here / "kept").metrics == honest.metrics
    assert not running(b"TMPDIR=" + os.fsencode(here / "scratch") + b"/spidar-policy-")


@pytest.mark.parametrize("name", WRONG)
def test_one_that_dies_hangs_or_grows_ends_in_one_line(name, here):
    begin = time.monotonic()
    with pytest.raises(PolicyError, match=rf"policy honest on {TRACK}, scenario 0, tick 0: {WRONG[name]}") as caught:
        played(name)
    assert "\n" not in str(caught.value)
    assert time.monotonic() - begin < 30.0
    assert not (here / "ran").exists()


def test_without_a_kernel_that_forbids_writing_nothing_that_was_kept_is_believed(honest, here, monkeypatch):
    monkeypatch.setattr(confine, "landlock", lambda: 0)
    played("Honest", folder=here / "kept")
    assert not (here / "kept").exists()


def test_a_row_is_verified_in_a_process_of_its_own_and_a_cheating_one_is_found_out(honest, here):
    rows = {}
    for name in ("Honest", "Patches"):
        spec = f"mine:{name}"
        row = make_row([open_policy(spec)], [spec], {TRACK: [played(name)]}, command="")
        rows[name] = read_row(write_row(row, here / name))
    picks = every_scenario({"Patches": rows["Patches"]}) + every_scenario({"Honest": rows["Honest"]})
    assert all(check.equal for check in verify(rows, picks, trust=True))
    forged = replace(honest, metrics=honest.metrics | {"error": [1e-9] * len(SCENARIOS)})
    row = make_row([open_policy("mine:Patches")], ["mine:Patches"], {TRACK: [forged]}, command="")
    assert not any(check.passes for check in verify({"Patches": row}, every_scenario({"Patches": row}), trust=True))


def test_what_a_guest_chooses_is_data_and_code_that_sees_the_state_is_refused():
    chosen = policy_arguments(open_policy("mine:Tuned"), "spidar_gym/Hover-v0")
    assert chosen is not None
    assert chosen["controller"].joint_speed == 0.7
    assert chosen["action_scale"] == {"share": 0.5}
    assert policy_arguments(open_policy("mine:Tuned"), "spidar_gym/Crawl-v0") is None
    with pytest.raises(PolicyError, match=r"law = .* code from outside the package acts by its actions alone"):
        policy_arguments(open_policy("mine:OwnLaw"), "spidar_gym/Hover-v0")
