"""Serialisation of calls on an environment or a vector from several threads, and refusal of calls after `close`."""

import functools
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, TypeVar

from spidar_gym.errors import closed

CallT = TypeVar("CallT", bound=Callable[..., Any])


def in_turn(method: CallT) -> CallT:
    """Decorate a method so that it waits for other threads' calls and raises `SpidarError` if its object `is_closed`.

    The object has a `turn`, which is kept when `reset` rebuilds the environment.
    """

    @functools.wraps(method)
    def in_turn(self: Any, *arguments: Any, **named: Any) -> Any:  # noqa: ANN401 - of any method
        with self.turn.lock:
            if self.is_closed:
                raise closed()
            return method(self, *arguments, **named)

    return in_turn  # pyright: ignore[reportReturnType] - `wraps` keeps the signature


@contextmanager
def whole() -> Iterator[None]:
    """Delay the handling of Ctrl-C to the end of the block; threads other than the main one do not receive it."""
    before = signal.getsignal(signal.SIGINT)
    if threading.current_thread() is not threading.main_thread() or not callable(before):
        yield
        return
    came: list[tuple[int, Any]] = []
    signal.signal(signal.SIGINT, lambda *signs: came.append(signs))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
        if came:
            before(*came[0])
