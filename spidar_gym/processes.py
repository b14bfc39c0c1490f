"""Work in processes: Ctrl-C ends it at once, what is finished is handed over, and no worker outlives its parent."""

import contextlib
import os
import pickle
import signal
import sys
import threading
import traceback
from collections.abc import Callable, Iterable, Iterator, Sequence
from multiprocessing import get_context
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from types import FrameType, TracebackType
from typing import Any

from spidar_gym.errors import SpidarError, require_least

GRACE = 2.0
"""How long workers that have nothing left to do may take to end by themselves [s]."""
STOPS = (signal.SIGINT, signal.SIGTERM)
"""Ctrl-C, and the polite request to end."""


def cpu_count() -> int:
    """Processors that this process may use: the workers of a command by default."""
    try:
        return len(os.sched_getaffinity(0))
    except AttributeError:  # a system that does not say which ones
        return os.cpu_count() or 1


class LostWorkerError(SpidarError):
    """A worker process that ended in the middle of its work."""


class Patience:
    """Ctrl-C and SIGTERM wait while something finished is handed over, and are answered where nothing can be lost."""

    def __init__(self) -> None:
        """Hold nothing yet."""
        self._handlers: dict[int, Callable[[int, FrameType | None], Any]] = {}
        self._holding, self._late = False, 0

    def __enter__(self) -> "Patience":
        """Stand before the handlers that are in charge; a signal without one in Python ends the process as before."""
        if threading.current_thread() is threading.main_thread():
            self._handlers = {number: h for number in STOPS if callable(h := signal.getsignal(number))}
        for number in self._handlers:
            signal.signal(number, self._come)
        return self

    def __exit__(self, *_: object) -> None:
        """Leave the handlers as they were."""
        for number, handler in self._handlers.items():
            signal.signal(number, handler)

    def _come(self, number: int, frame: FrameType | None) -> None:
        if self._holding:
            self._late = number
        else:
            self._handlers[number](number, frame)

    @contextlib.contextmanager
    def held(self) -> Iterator[None]:
        """Signals wait; what has come in the meantime is answered in the end, unless an error has ended it before."""
        self._holding = True
        try:
            yield
            with self.released():
                pass
        finally:
            self._holding, self._late = False, 0

    @contextlib.contextmanager
    def released(self) -> Iterator[None]:
        """Signals are answered, those that have waited first."""
        self._holding, late = False, self._late
        try:
            if late:
                self._late = 0
                self._handlers[late](late, None)
            yield
        finally:
            self._holding = True


class _Worker:
    """A process that does one job after the other, and the line to it."""

    def __init__(self, life: tuple[Connection, Connection]) -> None:
        """Start it; `life` are the two ends of a pipe, of which the second one is open in the parent alone."""
        context = get_context()
        self.line, theirs = context.Pipe()
        self.process: BaseProcess = context.Process(target=_work, args=(theirs, *life))
        # Nobody is there to answer a signal before the worker has said what it does with it.
        before = signal.pthread_sigmask(signal.SIG_BLOCK, STOPS)
        try:
            self.process.start()
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
        theirs.close()

    def end(self, patience: float = 0.0) -> None:
        """End the process, by force when it does not end by itself in time [s]."""
        self.line.close()
        self.process.join(patience)
        self.process.kill()
        self.process.join()

    def answer(self, name: str) -> tuple[Any, Exception | None]:
        """Result and error of its job; `name` is what the job is called when it went with the worker."""
        try:
            return pickle.loads(self.line.recv_bytes())
        except (EOFError, ConnectionError):
            self.process.join(GRACE)
            code = self.process.exitcode or 0
            how = f"was killed by {signal.Signals(-code).name}" if code < 0 else f"ended with status {code}"
        return None, LostWorkerError(
            f"a worker process {how} at {name}; valid: enough memory for every worker, or fewer of them (--workers)"
        )


def _work(line: Connection, life: Connection, parents_end: Connection) -> None:
    """What a worker does: jobs, until there are no more, or until the parent is gone."""
    # Both reach every process of a terminal, or of a job; the parent decides what becomes of its workers. They are
    # heard and not ignored: a process that is started here would inherit deafness.
    for number in STOPS:
        signal.signal(number, lambda *_: None)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, STOPS)
    parents_end.close()
    if torch := sys.modules.get("torch"):
        # A fork has none of the threads that its parent's products were shared among, and would wait for them for ever.
        torch.set_num_threads(1)
    threading.Thread(target=_end_with, args=(life,), daemon=True).start()
    with contextlib.suppress(EOFError, ConnectionError):
        while job := line.recv_bytes():
            try:
                call, item = pickle.loads(job)
                answer = pickle.dumps((call(item), None))
            except Exception as error:  # the work is anybody's, a policy for example
                answer = pickle.dumps((None, _portable(error)))
            line.send_bytes(answer)


def _end_with(life: Connection) -> None:
    """End this process when the other end of a pipe is closed: by the parent, or by its death, however it died."""
    life.poll(None)
    os._exit(1)


def _portable(error: Exception) -> Exception:
    """An error that arrives as it is, with the place where it was raised; else its words."""
    error.add_note("".join(traceback.format_exception(error)))
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:  # whatever its class does
        return RuntimeError(f"{type(error).__name__}: {error}")
    return error


class Pool:
    """Processes that share work, for as long as the context lasts.

    Ctrl-C, SIGTERM (where it has a handler), an error of the work and the loss of a worker all end it in the same way:
    no job is begun any more, results that are finished are still handed over, the workers are killed, and the error is
    raised. While the consumer has a result in its hands, signals wait.
    """

    def __init__(self, workers: int) -> None:
        """Prepare for `workers` processes, which start when there is work; one works here, in this process."""
        require_least(1, workers=workers)
        self._limit, self._workers, self._patience = workers, list[_Worker](), Patience()
        self._life: tuple[Connection, Connection] = get_context().Pipe(duplex=False)

    def __enter__(self) -> "Pool":
        """Take care of signals."""
        self._patience.__enter__()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        """End the workers."""
        if kind is None:
            for worker in self._workers:
                with contextlib.suppress(OSError):
                    worker.line.send_bytes(b"")
        else:
            self._life[1].close()
        self._dismiss(self._workers, GRACE if kind is None else 0.0)
        for end in self._life:
            end.close()
        self._patience.__exit__()

    def _dismiss(self, workers: Iterable[_Worker], patience: float = 0.0) -> None:
        for worker in workers:
            worker.end(patience)
        self._workers = [worker for worker in self._workers if worker.process.is_alive()]

    def map(self, call: Callable[[Any], Any], items: Iterable[Any]) -> Iterator[Any]:
        """Results in the order of the items, each as soon as it and all before it are there."""
        early, due = {}, 0
        for k, result in self.as_done(call, items):
            early[k] = result
            while due in early:
                yield early.pop(due)
                due += 1

    def as_done(
        self, call: Callable[[Any], Any], items: Iterable[Any], name: Callable[[int], str] = lambda k: f"piece {k + 1}"
    ) -> Iterator[tuple[int, Any]]:
        """Results as they come.

        Args:
            call: The work; like items and results it must be picklable.
            items: What it is done on, one after the other.
            name: What the work on the item of an index is called when it is lost.

        Yields:
            Index of an item and its result.

        Raises:
            LostWorkerError: When a worker has been killed.
        """
        items = list(items)
        with self._patience.held():
            if self._limit > 1:
                yield from self._share(call, items, name)
                return
            for k, item in enumerate(items):
                with self._patience.released():
                    result = call(item)
                yield k, result

    def _share(
        self, call: Callable[[Any], Any], items: Sequence[Any], name: Callable[[int], str]
    ) -> Iterator[tuple[int, Any]]:
        """Results as they come from the workers, each of which has one job at a time."""
        while len(self._workers) < min(self._limit, len(items)):
            self._workers.append(_Worker(self._life))
        idle, busy = list(self._workers), dict[Connection, tuple[_Worker, int]]()
        rest, stop = list(range(len(items)))[::-1], None
        try:
            while busy or (rest and stop is None):
                while rest and idle and stop is None:
                    worker, k = idle.pop(), rest.pop()
                    busy[worker.line] = worker, k
                    with contextlib.suppress(ConnectionError):  # a dead one's line is heard of below
                        worker.line.send_bytes(pickle.dumps((call, items[k])))
                ready: list[Any] = []
                try:
                    with self._patience.released():
                        ready = wait(busy, 0.0 if stop else None)
                except KeyboardInterrupt as interruption:
                    stop = interruption
                    continue
                if not ready:
                    break
                for line in ready:
                    worker, k = busy.pop(line)
                    result, error = worker.answer(name(k))
                    idle.append(worker)
                    if error is None:
                        yield k, result
                    else:
                        stop = stop or error
            if stop is not None:
                raise stop
        finally:
            # Of what is still at work nobody will take the result.
            self._dismiss(worker for worker, _ in busy.values())
