"""A policy from outside the package: it runs in a process of its own, which knows what it is told and nothing else."""

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
"""How long its process may take to begin and to say what the policy is [s]."""
MEMORY = 2**34
"""Most memory that the process may ask for [bytes]: address space, of which frameworks take more than they use."""
ODD = re.compile(r"gave [\w<>=|, \[\]'().]{1,300}")
"""What it may say of an answer that is no array of numbers."""


class GuestError(PolicyError):
    """What went wrong in the process of a policy, in words that follow its name and place."""


class Guest:
    """A policy in a process of its own: what comes back are its description and its actions, as data."""

    def __init__(self, spec: str, *, trust: bool = False) -> None:
        """Start the process, and ask what the policy is.

        Args:
            spec: `module:Class`, or a zip of Stable-Baselines3.
            trust: Whether a zip may be loaded.

        Raises:
            PolicyError: When there is none, it does not start, or does not say in time what it is.
        """
        self.path = source_file(spec)
        """The file that it comes from."""
        self.limit_s = START_S
        """How long an answer may take [s]."""
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
        """Whether it can act for many robots at once."""
        self._arguments: Any = said.get("arguments")

    @property
    def is_open(self) -> bool:
        """Whether its process can still be asked by this one."""
        return self._owner == os.getpid() and self._end.alive and not _has_ended(self._process)

    def close(self) -> None:
        """End the process, and what it has started with it."""
        self._end()

    def arguments(self, env_id: str) -> Mapping[str, Any] | None:
        """What it asks of an environment; None where it is not defined.

        Raises:
            PolicyError: When it refused to say so, or asks for what is no data.
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
        """A policy that has seen nothing before, and knows how long an action is."""
        self._ask("begin", action_size)

    def reset(self, seed: int) -> None:
        """Begin an episode."""
        self._ask("reset", seed)

    def act(self, observation: np.ndarray) -> np.ndarray:
        """Its action."""
        return self._numbers("act", observation)

    def reset_batch(self, seeds: Sequence[int]) -> None:
        """Begin an episode of each robot."""
        self._ask("reset_batch", list(seeds))

    def act_batch(self, observations: np.ndarray) -> np.ndarray:
        """Its actions."""
        return self._numbers("act_batch", observations)

    def _numbers(self, call: str, seen: np.ndarray) -> np.ndarray:
        words, array = self._ask(call, seen=seen)
        if array is None:
            odd = words.get("odd")
            raise GuestError(odd if isinstance(odd, str) and ODD.fullmatch(odd) else "gave no action")
        return array

    def _ask(self, call: str, *given: Any, seen: np.ndarray | None = None) -> tuple[dict[str, Any], np.ndarray | None]:  # noqa: ANN401 - JSON
        """An answer of its process, which ends with whatever goes wrong with it."""
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
        except BaseException:  # interrupted between a question and its answer
            self.close()
            raise
        if "refused" in words:
            raise GuestError(" ".join(str(words["refused"]).split()))
        return words, array

    def _fate(self, error: str) -> str:
        """What became of the process, in words."""
        ended = _has_ended(self._process, 1.0)
        self.close()
        code = self._process.returncode
        if not ended:
            return f"its process answered with {error}"
        return f"its process was killed by {signal.Signals(-code).name}" if code < 0 else f"its process ended ({code})"


def _has_ended(process: subprocess.Popen[bytes], within_s: float = 0.0) -> bool:
    """Whether a process has ended, or does so in time; its number stays its own until `_end` has used it."""
    end = time.monotonic() + within_s
    while process.returncode is None and not os.waitid(os.P_PID, process.pid, os.WEXITED | os.WNOHANG | os.WNOWAIT):
        if time.monotonic() >= end:
            return False
        time.sleep(0.005)
    return True


def _end(process: subprocess.Popen[bytes], scratch: str, owner: int) -> None:
    """End a process and those that it has started; a fork of its owner has none to end."""
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
    """A policy that the benchmark can play: our own in this process, any other in one of its own.

    The same name gives the same process until another one's policy is opened, or `close_guests` is called.

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
    """Whether nothing that runs for a policy can write what is kept of it."""
    return is_own(spec) or confine.landlock() > 0
