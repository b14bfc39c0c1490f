"""Parallel work in processes: Ctrl-C stops it, finished results are still returned, no worker outlives its parent."""

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
"""Time that a worker without further jobs has to exit before it is killed [s]."""
STOPS = (signal.SIGINT, signal.SIGTERM)
"""Signals that stop the work: Ctrl-C and the request to terminate."""


def cpu_count() -> int:
    """Return the number of processors that this process may use, the default number of workers of a command."""
    try:
        return len(os.sched_getaffinity(0))
    except AttributeError:  # not available on every system
        return os.cpu_count() or 1


class LostWorkerError(SpidarError):
    """A worker process that ended before it finished its job."""


class Patience:
    """Defers Ctrl-C and SIGTERM while a result is handed over, and handles them when no result can be lost."""

    def __init__(self) -> None:
        """Prepare; no signal is deferred yet."""
        self._handlers: dict[int, Callable[[int, FrameType | None], Any]] = {}
        self._holding, self._late = False, 0

    def __enter__(self) -> "Patience":
        """Replace the installed Python handlers; a signal without one still ends the process."""
        if threading.current_thread() is threading.main_thread():
            self._handlers = {number: h for number in STOPS if callable(h := signal.getsignal(number))}
        for number in self._handlers:
            signal.signal(number, self._come)
        return self

    def __exit__(self, *_: object) -> None:
        """Restore the handlers."""
        for number, handler in self._handlers.items():
            signal.signal(number, handler)

    def _come(self, number: int, frame: FrameType | None) -> None:
        if self._holding:
            self._late = number
        else:
            self._handlers[number](number, frame)

    @contextlib.contextmanager
    def held(self) -> Iterator[None]:
        """Defer signals; a deferred signal is handled at the end of the context, unless the context raises an error."""
        self._holding = True
        try:
            yield
            with self.released():
                pass
        finally:
            self._holding, self._late = False, 0

    @contextlib.contextmanager
    def released(self) -> Iterator[None]:
        """Handle signals immediately, a deferred one first."""
        self._holding, late = False, self._late
        try:
            if late:
                self._late = 0
                self._handlers[late](late, None)
            yield
        finally:
            self._holding = True


class _Worker:
    """A process that executes one job after the other, and the connection to it."""

    def __init__(self, life: tuple[Connection, Connection]) -> None:
        """Start the process; `life` are the two ends of a pipe whose second end is open only in the parent."""
        context = get_context()
        self.line, theirs = context.Pipe()
        self.process: BaseProcess = context.Process(target=_work, args=(theirs, *life))
        # Signals stay blocked until the worker has installed its handlers.
        before = signal.pthread_sigmask(signal.SIG_BLOCK, STOPS)
        try:
            self.process.start()
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
        theirs.close()

    def end(self, patience: float = 0.0) -> None:
        """End the process; kill it if it has not exited after `patience` [s]."""
        self.line.close()
        self.process.join(patience)
        self.process.kill()
        self.process.join()

    def answer(self, name: str) -> tuple[Any, Exception | None]:
        """Receive result and error of the job; `name` is the job's name in the error of a lost worker."""
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
    """Execute jobs in a worker until there are no more, or until the parent has ended."""
    # A terminal sends the signals to all of its processes, but only the parent decides when workers end. The handlers
    # do nothing instead of being SIG_IGN, because a process started here would inherit SIG_IGN.
    for number in STOPS:
        signal.signal(number, lambda *_: None)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, STOPS)
    parents_end.close()
    if torch := sys.modules.get("torch"):
        # A fork has none of its parent's threads for matrix products, and would wait for them for ever.
        torch.set_num_threads(1)
    threading.Thread(target=_end_with, args=(life,), daemon=True).start()
    with contextlib.suppress(EOFError, ConnectionError):
        while job := line.recv_bytes():
            try:
                call, item = pickle.loads(job)
                answer = pickle.dumps((call(item), None))
            except Exception as error:  # the job may be foreign code, for example a policy
                answer = pickle.dumps((None, _portable(error)))
            line.send_bytes(answer)


def _end_with(life: Connection) -> None:
    """End this process when the other end of the pipe is closed, by the parent or because the parent has died."""
    life.poll(None)
    os._exit(1)


def _portable(error: Exception) -> Exception:
    """Return the error with its traceback as a note, or its text as a `RuntimeError` if it cannot be pickled."""
    error.add_note("".join(traceback.format_exception(error)))
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:  # pickling runs foreign code
        return RuntimeError(f"{type(error).__name__}: {error}")
    return error


class Pool:
    """Pool of worker processes, used as a context.

    Ctrl-C, SIGTERM (if it has a handler), an error in a job and the loss of a worker all end the work in the same way:
    no further job is started, finished results are still yielded, the workers are killed, and the error is raised.
    While the consumer processes a result, signals are deferred.
    """

    def __init__(self, workers: int) -> None:
        """Prepare for `workers` processes, which start with the first job; with one, jobs run in this process."""
        require_least(1, workers=workers)
        self._limit, self._workers, self._patience = workers, list[_Worker](), Patience()
        self._life: tuple[Connection, Connection] = get_context().Pipe(duplex=False)

    def __enter__(self) -> "Pool":
        """Install the signal handlers."""
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
        """Yield results in the order of the items, each as soon as it and all earlier ones are finished."""
        early, due = {}, 0
        for k, result in self.as_done(call, items):
            early[k] = result
            while due in early:
                yield early.pop(due)
                due += 1

    def as_done(
        self, call: Callable[[Any], Any], items: Iterable[Any], name: Callable[[int], str] = lambda k: f"piece {k + 1}"
    ) -> Iterator[tuple[int, Any]]:
        """Yield results as they finish.

        Args:
            call: Function of an item; function, items and results must be picklable.
            items: The items, started in this order.
            name: Returns the name of the job with a given index, for the error of a lost worker.

        Yields:
            Index of an item and its result.

        Raises:
            LostWorkerError: When a worker process has ended unexpectedly.
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
        """Yield results as they finish; each worker has one job at a time."""
        while len(self._workers) < min(self._limit, len(items)):
            self._workers.append(_Worker(self._life))
        idle, busy = list(self._workers), dict[Connection, tuple[_Worker, int]]()
        rest, stop = list(range(len(items)))[::-1], None
        try:
            while busy or (rest and stop is None):
                while rest and idle and stop is None:
                    worker, k = idle.pop(), rest.pop()
                    busy[worker.line] = worker, k
                    with contextlib.suppress(ConnectionError):  # the loss of a worker is handled below
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
            # Results of unfinished jobs are no longer needed.
            self._dismiss(worker for worker, _ in busy.values())
