"""Checked calls of a policy: time limit, validity of its actions, errors with name and place."""

import signal
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from typing import Any

import numpy as np

from spidar_gym.policies.guest import Guest, GuestError
from spidar_gym.policies.policy import BatchPolicy, Policy, policy_name
from spidar_gym.policies.source import PolicyError


class Actor:
    """Calls a policy and converts every failure into a `PolicyError` with the place."""

    def __init__(self, policy: Policy, shape: tuple[int, ...], place: str, *, limit_s: float) -> None:
        """Store a policy and prepare it.

        Args:
            policy: The policy.
            shape: Shape of its actions.
            place: Track and scenario, for messages.
            limit_s: Time limit of a call [s].
        """
        self.policy, self._shape, self._place, self._limit = policy, shape, place, limit_s
        self.ticks = 0
        self.times: list[float] = []
        """Duration of each action's computation [s]."""
        if isinstance(policy, Guest):
            policy.limit_s = limit_s  # a guest limits the time itself: an alarm would leave half an answer in the pipe
        begin = getattr(policy, "begin", None)
        if begin is not None:
            with self._care("begin"):
                begin(shape[-1])

    def reset(self, seed: int) -> None:
        """Begin an episode."""
        with self._care("reset"):
            self.policy.reset(seed)

    def reset_batch(self, seeds: Sequence[int]) -> None:
        """Begin an episode of each robot."""
        assert isinstance(self.policy, BatchPolicy)
        with self._care("reset_batch"):
            self.policy.reset_batch(seeds)

    def act(self, observation: Any) -> np.ndarray:  # noqa: ANN401 - an array, or a dictionary of them
        """Return a valid action (`PolicyError` if it is not)."""
        return self._act("act", self.policy.act, observation)

    def act_batch(self, observations: np.ndarray) -> np.ndarray:
        """Return valid actions of all robots (`PolicyError` if one is not)."""
        assert isinstance(self.policy, BatchPolicy)
        return self._act("act_batch", self.policy.act_batch, observations)

    def _act(self, what: str, call: Callable[[Any], np.ndarray], seen: Any) -> np.ndarray:  # noqa: ANN401 - as above
        start = time.perf_counter()
        with self._care(what):
            action = np.asarray(call(seen))
        self.times.append(time.perf_counter() - start)
        if action.shape != self._shape or action.dtype.kind not in "fiu":
            self._fail(f"gave {action.dtype} of shape {action.shape}; valid: numbers of shape {self._shape}")
        if not np.isfinite(action).all():
            self._fail("gave NaN or infinity; valid: numbers in −1 … 1")
        self.ticks += 1
        return action

    @contextmanager
    def _care(self, what: str) -> Iterator[None]:
        start = time.perf_counter()
        try:
            with nullcontext() if isinstance(self.policy, Guest) else _alarm(self._limit):
                yield
        except GuestError as error:
            raise PolicyError(f"{self._where}: {error}") from error
        except _TooLongError:
            self._fail(f"took longer than {self._limit:g} s in {what}()")
        except (Exception, SystemExit) as error:
            raise PolicyError(f"{self._where}: {what}() raised {type(error).__name__}: {error}") from error
        if time.perf_counter() - start > self._limit:  # without an alarm
            self._fail(f"took longer than {self._limit:g} s in {what}()")

    @property
    def _where(self) -> str:
        return f"policy {policy_name(self.policy)} on {self._place}, tick {self.ticks}"

    def _fail(self, message: str) -> None:
        raise PolicyError(f"{self._where}: {message}")


class _TooLongError(BaseException):
    """Raised by the alarm; not an Exception, so that no policy catches it."""


@contextmanager
def _alarm(seconds: float) -> Iterator[None]:
    """Raise `_TooLongError` after so many seconds, in a main thread with signals; elsewhere do nothing."""
    if not hasattr(signal, "setitimer") or threading.current_thread() is not threading.main_thread():
        yield
        return

    def ring(*_: object) -> None:
        raise _TooLongError

    before = signal.signal(signal.SIGALRM, ring)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
