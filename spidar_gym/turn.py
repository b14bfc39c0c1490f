"""A lock by which calls from several threads take turns, and which a forked process finds free."""

import os
import threading
import time
import weakref
from typing import Any

FORK_WAIT = 2.0
"""How long a fork waits at most for the calls that other threads have begun [s]: the child then finds them done."""
process = os.getpid()
"""The process that this is: threads that another one has started do not exist here."""
_TURNS: weakref.WeakSet["Turn"] = weakref.WeakSet()


class Turn:
    """A reentrant lock: `with turn.lock:`; a copy is a new one."""

    def __init__(self) -> None:
        """Make one that is free."""
        self.lock = threading.RLock()
        """Shared with no other turn; a forked process has another."""
        _TURNS.add(self)

    def __getstate__(self) -> dict[str, Any]:
        """Nothing: a copy is free."""
        return {}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Become a lock that is free."""
        del state
        self.__init__()


_forking = threading.local()
"""Per thread, the turns that it holds while it forks."""


def _before_fork() -> None:
    """Wait for calls that are going on, so that what they write is whole in the child."""
    until = time.monotonic() + FORK_WAIT
    _forking.turns = [
        turn for turn in list(_TURNS) if turn.lock.acquire(timeout=max(0.0, until - time.monotonic()))
    ]  # fmt: skip


def _after_in_parent() -> None:
    """Go on."""
    for turn in _forking.turns:
        turn.lock.release()
    _forking.turns = []


def _after_in_child() -> None:
    """Where a call had not ended, its thread does not exist here: that turn gets a lock that is free."""
    global process
    process = os.getpid()
    held = {id(turn) for turn in _forking.turns}
    for turn in list(_TURNS):
        if id(turn) not in held:
            turn.lock = threading.RLock()
    _after_in_parent()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(before=_before_fork, after_in_parent=_after_in_parent, after_in_child=_after_in_child)
