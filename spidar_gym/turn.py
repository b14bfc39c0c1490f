"""A lock that serialises calls from several threads and is free in a forked process."""

import os
import threading
import time
import weakref
from typing import Any

FORK_WAIT = 2.0
"""Longest time that a fork waits for running calls of other threads to finish [s]."""
process = os.getpid()
"""Id of this process, updated after a fork; the threads of the parent do not exist in the child."""
_TURNS: weakref.WeakSet["Turn"] = weakref.WeakSet()


class Turn:
    """A reentrant lock: `with turn.lock:`; a copy is a new one."""

    def __init__(self) -> None:
        """Create a free lock."""
        self.lock = threading.RLock()
        """Not shared with other turns; replaced in a forked process if another thread holds it."""
        _TURNS.add(self)

    def __getstate__(self) -> dict[str, Any]:
        """Return no state: a copy is free."""
        return {}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Create a free lock."""
        del state
        self.__init__()


_forking = threading.local()
"""Turns that the current thread holds while it forks."""


def _before_fork() -> None:
    """Wait for running calls, so that the data they write is complete in the child."""
    until = time.monotonic() + FORK_WAIT
    _forking.turns = [
        turn for turn in list(_TURNS) if turn.lock.acquire(timeout=max(0.0, until - time.monotonic()))
    ]  # fmt: skip


def _after_in_parent() -> None:
    """Release the locks that were acquired before the fork."""
    for turn in _forking.turns:
        turn.lock.release()
    _forking.turns = []


def _after_in_child() -> None:
    """Replace locks that are held by threads of the parent, which do not exist in the child."""
    global process
    process = os.getpid()
    held = {id(turn) for turn in _forking.turns}
    for turn in list(_TURNS):
        if id(turn) not in held:
            turn.lock = threading.RLock()
    _after_in_parent()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(before=_before_fork, after_in_parent=_after_in_parent, after_in_child=_after_in_child)
