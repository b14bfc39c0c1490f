"""Client of a policy from outside the package, which runs in a separate process and receives only observations."""

import contextlib
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import weakref
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from spidar_gym.border import BorderError
from spidar_gym.policies import confine
from spidar_gym.policies.choices import from_data
from spidar_gym.policies.load import load_policy
from spidar_gym.policies.messages import LateError, Line
from spidar_gym.policies.policy import Policy
from spidar_gym.policies.source import PolicyError, is_own, source_file

START_S = 120.0
"""Time limit for starting the process and describing the policy [s]."""
MEMORY = 2**34
"""Limit of the process's address space, of which frameworks reserve more than they use [bytes]."""
ODD = re.compile(r"gave [\w<>=|, \[\]'().]{1,300}")
"""Allowed descriptions of an answer that is not an array of numbers."""


class GuestError(PolicyError):
    """A failure in the process of a policy; the message follows the policy's name and place."""


class Guest:
    """A policy in a separate process, which returns its description and its actions as data."""

    def __init__(self, spec: str, *, trust: bool = False) -> None:
        """Start the process and request the policy's description.

        Args:
            spec: `module:Class`, or a zip of Stable-Baselines3.
            trust: Whether a zip may be loaded.

        Raises:
            PolicyError: When there is no such policy, it does not start, or does not respond in time.
        """
        self.path = source_file(spec)
        """File of the policy."""
        self.limit_s = START_S
        """Time limit of an answer [s]."""
        self._owner = os.getpid()
        scratch = tempfile.mkdtemp(prefix="spidar-policy-")
        script = [sys.executable, "-P", *(["-B"] if sys.dont_write_bytecode else []), confine.__file__]
        told = json.dumps([spec, trust, [str(Path(path).resolve()) for path in sys.path], scratch, MEMORY])
        self._process = subprocess.Popen(
            [*script, told], stdin=subprocess.PIPE, stdout=subprocess.PIPE, start_new_session=True,
            env={**os.environ, "TMPDIR": scratch},
        )  # fmt: skip
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._line = Line(self._process.stdout.fileno(), self._process.stdin.fileno())
        self._end = weakref.finalize(self, _end, self._process, scratch, self._owner)
        try:
            said = self._ask("describe")[0]
        except GuestError as error:
            self.close()
            raise PolicyError(str(error) if spec in str(error) else f"policy {spec}: {error}") from error
        self.name, self.kind, self.__doc__ = (str(said.get(key, "")) for key in ("name", "kind", "doc"))
        self.training = said.get("training") if isinstance(said.get("training"), dict) else None
        self.in_batches = said.get("batches") is True
        """Whether the policy can act for many robots at once."""
        self._arguments: Any = said.get("arguments")

    @property
    def is_open(self) -> bool:
        """Whether the process runs and belongs to this one."""
        return self._owner == os.getpid() and self._end.alive and not _has_ended(self._process)

    def close(self) -> None:
        """End the process and its child processes."""
        self._end()

    def arguments(self, env_id: str) -> Mapping[str, Any] | None:
        """Return the policy's arguments of an environment; None where it is not defined.

        Raises:
            PolicyError: When the policy raised an error, or its arguments are not data.
        """
        try:
            said = self._arguments[env_id]
            if "refused" in said:
                raise PolicyError(str(said["refused"]))
            chosen = said["chosen"]
            return None if chosen is None else {name: from_data(name, value) for name, value in chosen.items()}
        except (TypeError, KeyError, AttributeError) as error:
            raise PolicyError(f"policy {self.name}: its process did not say what it asks of {env_id}") from error

    def begin(self, action_size: int) -> None:
        """Reload the policy in its process, and pass it the length of an action."""
        self._ask("begin", action_size)

    def reset(self, seed: int) -> None:
        """Begin an episode."""
        self._ask("reset", seed)

    def act(self, observation: np.ndarray) -> np.ndarray:
        """Return the policy's action."""
        return self._numbers("act", observation)

    def reset_batch(self, seeds: Sequence[int]) -> None:
        """Begin an episode of each robot."""
        self._ask("reset_batch", list(seeds))

    def act_batch(self, observations: np.ndarray) -> np.ndarray:
        """Return the policy's actions."""
        return self._numbers("act_batch", observations)

    def _numbers(self, call: str, seen: np.ndarray) -> np.ndarray:
        words, array = self._ask(call, seen=seen)
        if array is None:
            odd = words.get("odd")
            raise GuestError(odd if isinstance(odd, str) and ODD.fullmatch(odd) else "gave no action")
        return array

    def _ask(self, call: str, *given: Any, seen: np.ndarray | None = None) -> tuple[dict[str, Any], np.ndarray | None]:  # noqa: ANN401 - JSON
        """Return an answer of the process; a time-out or a broken connection ends the process."""
        if not self.is_open:
            raise GuestError(f"its process has ended before {call}()")
        try:
            self._line.send({"call": call, "given": list(given)}, seen, self.limit_s)
            words, array = self._line.receive(self.limit_s)
        except LateError:
            self.close()
            raise GuestError(f"took longer than {self.limit_s:g} s in {call}()") from None
        except BorderError as error:
            raise GuestError(f"{self._fate(str(error))} in {call}()") from error
        except BaseException:  # interrupted between request and answer
            self.close()
            raise
        if "refused" in words:
            raise GuestError(" ".join(str(words["refused"]).split()))
        return words, array

    def _fate(self, error: str) -> str:
        """End the process and return its failure in words."""
        ended = _has_ended(self._process, 1.0)
        self.close()
        code = self._process.returncode
        if not ended:
            return f"its process answered with {error}"
        return f"its process was killed by {signal.Signals(-code).name}" if code < 0 else f"its process ended ({code})"


def _has_ended(process: subprocess.Popen[bytes], within_s: float = 0.0) -> bool:
    """Return whether a process ends within a time; it is not reaped, so that its id is not reused before `_end`."""
    end = time.monotonic() + within_s
    while process.returncode is None and not os.waitid(os.P_PID, process.pid, os.WEXITED | os.WNOHANG | os.WNOWAIT):
        if time.monotonic() >= end:
            return False
        time.sleep(0.005)
    return True


def _end(process: subprocess.Popen[bytes], scratch: str, owner: int) -> None:
    """End a process and its child processes; do nothing in a fork of its owner."""
    if os.getpid() != owner:
        return
    with contextlib.suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    for line in (process.stdin, process.stdout):
        if line is not None:
            line.close()
    shutil.rmtree(scratch, ignore_errors=True)


_open: dict[str, Guest] = {}
"""The guest of this process, if there is one."""


def open_policy(spec: str, *, trust: bool = False) -> Policy:
    """Open a policy for the benchmark: the package's in this process, any other in a separate one.

    A name returns the same process until another policy from outside is opened, or `close_guests` is called.

    Args:
        spec: As for `load_policy`.
        trust: Whether a zip may be loaded.

    Raises:
        PolicyError: As `load_policy`.
    """
    if is_own(spec):
        return load_policy(spec)
    guest = _open.get(spec)
    if guest is None or not guest.is_open:
        close_guests()
        guest = Guest(spec, trust=trust)
        _open[spec] = guest
    return guest


def close_guests() -> None:
    """End the processes of policies from outside."""
    for guest in _open.values():
        guest.close()
    _open.clear()


def keeps_to_itself(spec: str) -> bool:
    """Return whether the policy's code cannot write to stored results."""
    return is_own(spec) or confine.landlock() > 0
