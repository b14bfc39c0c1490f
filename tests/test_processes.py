"""Pins the pool of processes: every result arrives, Ctrl-C stops at once without losses, no worker remains."""

import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from spidar_gym.console import Terminated, kept, run_cli
from spidar_gym.errors import InvalidValueError, SpidarError, UnknownNameError
from spidar_gym.processes import LostWorkerError, Pool, cpu_count

LONG = 600.0
"""A duration longer than any test [s]."""
SOON = 10.0
"""Time in which something quick is done on a busy machine [s]."""


class Stubborn(Exception):
    """An exception that cannot be unpickled."""

    def __init__(self, one, two):
        super().__init__(f"{one} and {two}")


def work(item):
    """Do what the item specifies; for a pair, process the second entry a second later."""
    if isinstance(item, tuple):
        time.sleep(1.0)
        return work(item[1])
    match item:
        case float():
            time.sleep(item)
        case BaseException():
            raise item
        case "stubborn":
            raise Stubborn(1, 2)
        case "kill":
            os.kill(os.getpid(), signal.SIGKILL)
        case "leave":
            sys.exit(3)
        case Path():
            item.write_text(str(os.getpid()))
            time.sleep(LONG)
    return item, os.getpid()


def done(pool, items, found=None):
    """Return the items whose results arrived, appended to `found` on arrival, and the error raised or None."""
    found = [] if found is None else found
    try:
        for k, _ in pool.as_done(work, items, "item {}".format):
            found.append(items[k])
    except BaseException as error:
        return found, error
    return found, None


def gone(pid):
    """Whether a process has ended; a zombie counts as ended."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] == "Z"
    except OSError:
        return True


def until(happens, seconds=SOON):
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if happens():
            return True
        time.sleep(0.01)
    return False


def interrupt(when, number=signal.SIGINT):
    """Send this process a signal as soon as `when()` is true."""
    threading.Thread(target=lambda: until(when) and os.kill(os.getpid(), number), daemon=True).start()


@pytest.mark.parametrize("workers", [1, 2, 5])
def test_every_result_arrives_in_order_or_as_it_comes(workers):
    items = [*range(20)]
    with Pool(workers) as pool:
        assert [item for item, _ in pool.map(work, iter(items))] == items
        found, error = done(pool, items)
        assert [*pool.map(work, [])] == []
    assert error is None
    assert sorted(found) == items


def test_one_worker_is_this_process_and_several_are_processes_that_the_next_call_reuses():
    for workers in (1, 3):
        with Pool(workers) as pool:
            calls = [{pid for _, pid in pool.map(work, [0.05] * 6)} for _ in range(2)]
        assert (os.getpid() in calls[0]) == (workers == 1)
        assert calls[0] == calls[1]
        assert len(calls[0]) == workers


def test_no_worker_waits_for_another_ones_job():
    with Pool(2) as pool:
        assert done(pool, [0.5, 1, 2, 3]) == ([1, 2, 3, 0.5], None)


def test_a_result_that_is_larger_than_any_pipe_arrives_whole():
    with Pool(2) as pool:
        assert [len(item) for item, _ in pool.map(work, ["x" * 5_000_000] * 3)] == [5_000_000] * 3


@pytest.mark.parametrize("workers", [1, 2])
@pytest.mark.parametrize(
    "error", [SpidarError("words"), UnknownNameError("form", "x", ["y"]), ValueError("other")], ids=repr
)
def test_an_error_of_the_work_is_raised_unchanged_and_at_once(error, workers):
    began = time.monotonic()
    with Pool(workers) as pool:
        found, raised = done(pool, [1, (1, error), LONG])
    assert type(raised) is type(error)
    assert str(raised) == str(error)
    assert found == [1]
    assert time.monotonic() - began < SOON


def test_an_error_that_cannot_be_pickled_is_raised_as_its_message():
    with Pool(2) as pool:
        _, raised = done(pool, ["stubborn"])
        assert str(raised) == "Stubborn: 1 and 2"
        _, raised = done(pool, [1, lambda: None])
    assert isinstance(raised, AttributeError)


@pytest.mark.parametrize(("how", "words"), [("kill", "was killed by SIGKILL"), ("leave", "ended with status 3")])
def test_a_lost_worker_is_a_one_line_error_that_names_the_item_and_finished_results_arrive(how, words):
    began = time.monotonic()
    with Pool(2) as pool:
        found, raised = done(pool, [1, 2, (1, how), LONG, 3])
        assert isinstance(raised, LostWorkerError)
        assert f"{words} at item 2; valid: " in str(raised)
        assert "--workers" in str(raised)
        assert sorted(found) == [1, 2]
        assert time.monotonic() - began < SOON
        assert done(pool, [4, 5])[1] is None  # a new worker has replaced it


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interruption_returns_finished_results_and_kills_the_rest(number, tmp_path, capfd):
    began, found = time.monotonic(), []

    def run():
        with Pool(3) as pool, kept(lambda: f"{len(found)} kept"):
            # The consumer processes the first result while the second one and the signal arrive.
            for _, result in pool.as_done(work, [1, 0.2, tmp_path / "pid", LONG, 2]):
                found.append(result)
                if result[0] == 1:
                    assert until((tmp_path / "pid").exists, 5.0)
                    os.kill(os.getpid(), number)
                    time.sleep(0.5)
                    found.append("held")

    with pytest.raises(SystemExit) as stop:
        run_cli("test", run)
    assert stop.value.code == {signal.SIGINT: 130, signal.SIGTERM: 143}[number]
    assert time.monotonic() - began < SOON
    assert [f if isinstance(f, str) else f[0] for f in found] == [1, "held", 0.2]
    word = {signal.SIGINT: "interrupted", signal.SIGTERM: "terminated"}[number]
    assert capfd.readouterr().err == f"test: {word}; 3 kept\n"
    assert gone((tmp_path / "pid").read_text())
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    assert signal.getsignal(signal.SIGTERM) == signal.SIG_DFL


@pytest.mark.parametrize("workers", [1, 2])
def test_ctrl_c_during_the_work_stops_at_once(workers, tmp_path):
    began = time.monotonic()
    found = []
    interrupt(lambda: found and (tmp_path / "pid").exists())
    with Pool(workers) as pool:
        _, raised = done(pool, [1, tmp_path / "pid", LONG], found)
    assert isinstance(raised, KeyboardInterrupt)
    assert not isinstance(raised, Terminated)
    assert found == [1]
    assert time.monotonic() - began < SOON
    assert workers == 1 or gone((tmp_path / "pid").read_text())


def test_ctrl_c_between_two_calls_is_raised_there():
    with Pool(2) as pool:
        [*pool.map(work, [1, 2])]
        with pytest.raises(KeyboardInterrupt):
            os.kill(os.getpid(), signal.SIGINT)
        assert len([*pool.map(work, [1, 2])]) == 2


def test_a_consumer_that_stops_early_stops_the_workers(tmp_path):
    with Pool(2) as pool:
        results = pool.as_done(work, [1, tmp_path / "pid", 2])
        next(results)
        assert until((tmp_path / "pid").exists)
        results.close()
        assert gone((tmp_path / "pid").read_text())
        assert [item for item, _ in pool.map(work, [3, 4, 5])] == [3, 4, 5]


def test_a_pool_works_in_a_thread_too():
    found = []

    def run():
        with Pool(2) as pool:
            found.extend(item for item, _ in pool.map(work, [1, 2, 3]))

    thread = threading.Thread(target=run)
    thread.start()
    thread.join()
    assert found == [1, 2, 3]


def torch_product(size):
    """Compute something for which torch uses threads."""
    import torch

    return float(torch.linalg.qr(torch.eye(size) + 1.0)[0].square().sum())


def test_workers_of_a_process_in_which_torch_has_threads_do_not_hang():
    torch = pytest.importorskip("torch", reason="the extra `train` is not installed")
    before = torch.get_num_threads()
    torch.set_num_threads(4)
    try:
        here = torch_product(400)
        with Pool(2) as pool:
            assert list(pool.map(torch_product, [400, 400])) == pytest.approx([here, here], rel=1e-4)
    finally:
        torch.set_num_threads(before)


def test_zero_workers_are_refused():
    with pytest.raises(InvalidValueError, match="workers"):
        Pool(0)


ORPHANS = """
import sys, threading, os
sys.path.insert(0, {tests!r})
from pathlib import Path
from test_processes import Pool, work

with Pool(3) as pool:
    list(pool.map(work, [1, 2, 3, *(Path({folder!r}) / name for name in "abc")]))
"""


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM, signal.SIGINT])
def test_no_worker_outlives_its_parent(number, tmp_path):
    script = ORPHANS.format(tests=str(Path(__file__).parent), folder=str(tmp_path))
    parent = subprocess.Popen([sys.executable, "-c", script], stderr=subprocess.PIPE, text=True)
    files = [tmp_path / name for name in "abc"]
    assert until(lambda: all(file.exists() and file.read_text() for file in files), 60.0)
    parent.send_signal(number)
    _, said = parent.communicate(timeout=SOON)
    assert until(lambda: all(gone(file.read_text()) for file in files), 5.0)
    assert "test_processes" not in said.partition("KeyboardInterrupt")[2]  # workers print nothing


def test_there_is_at_least_one_processor_and_a_machine_has_no_fewer():
    assert 1 <= cpu_count() <= (os.cpu_count() or 1)


def test_processors_are_counted_on_systems_without_cpu_affinity(monkeypatch):
    monkeypatch.delattr(os, "sched_getaffinity")
    assert cpu_count() == (os.cpu_count() or 1)
