"""What the benchmark ranks: anything with `reset` and `act`, found by its name, and called with care."""

import hashlib
import importlib
import inspect
import signal
import sys
import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, ClassVar, Protocol, runtime_checkable

import numpy as np

from spidar_gym.envs.registry import ENVIRONMENTS
from spidar_gym.errors import InvalidValueError, SpidarError

KINDS = ("classical", "learned", "residual")
"""Valid classes of a policy."""
ARGUMENTS = ("action_mode", "preset", "controller", "allocator", "schedule", "avoid_interference", "max_iter")
"""Arguments of the environment that a policy may choose; the others are the track's."""
ARTIFACT = ".npz"
"""A policy whose name ends like this is the artifact of a learned one."""


@runtime_checkable
class Policy(Protocol):
    """What a policy has to have. What it may have besides, with defaults, is on `PresetPolicy`."""

    def reset(self, seed: int) -> None:
        """Begin an episode; whatever the policy draws comes from this seed."""

    def act(self, observation: np.ndarray) -> np.ndarray:
        """The action, in [−1, 1]."""
        ...


class PresetPolicy:
    """A controller that the environments have: the zero action, which adds nothing to a preset."""

    name: ClassVar[str] = ""
    """Of its row; the class's name in small letters if empty."""
    kind: ClassVar[str] = "classical"
    """`classical`, `learned`, or `residual` for what learned to add to a controller."""
    presets: ClassVar[Mapping[str, Mapping[str, Any]]] = {}
    """Arguments of `gym.make` by environment id; it is not defined where it has none."""
    _size = 0

    def arguments(self, env_id: str) -> Mapping[str, Any] | None:
        """Arguments of `gym.make`, of those in `ARGUMENTS`; None where the policy is not defined."""
        return self.presets.get(env_id)

    def begin(self, action_size: int) -> None:
        """Learn how long an action is."""
        self._size = action_size

    def reset(self, seed: int) -> None:
        """Nothing to forget."""

    def act(self, observation: np.ndarray) -> np.ndarray:
        """Zero."""
        return np.zeros(self._size)


class PolicyError(SpidarError):
    """A policy that raised, took too long, or answered with something that is no action."""


def load_policy(spec: str) -> Policy:
    """The policy that a name stands for.

    Args:
        spec: `module:Class`, or the path of a learned policy's artifact, `*.npz`. Modules are also looked for in the
            working folder.

    Raises:
        PolicyError: When there is none, it does not start, or it lacks `reset` or `act`.
        SpidarError: When an artifact does not match this version of the environments.
    """
    if spec.endswith(ARTIFACT):
        from spidar_gym.benchmark.artifact import LearnedPolicy, read_artifact

        return LearnedPolicy(read_artifact(Path(spec)), Path(spec))
    module, _, name = spec.partition(":")
    if not (module and name):
        raise InvalidValueError("policy", spec, f"module:Class, or the path of an artifact *{ARTIFACT}")
    here = str(Path.cwd())
    if here not in sys.path:
        sys.path.insert(0, here)
    try:
        found = getattr(importlib.import_module(module), name)
        policy = found() if inspect.isclass(found) else found
    except (Exception, SystemExit) as error:
        raise PolicyError(f"policy {spec}: {type(error).__name__}: {error}; valid: module:Class, importable") from error
    if not isinstance(policy, Policy):
        raise PolicyError(f"policy {spec}: lacks reset or act; valid: reset(seed), act(observation) -> action")
    return policy


def policy_name(policy: Policy) -> str:
    """Name of the policy's row: letters, digits, `_`, `-`."""
    return check_name(getattr(policy, "name", "") or type(policy).__name__.lower())


def check_name(name: object) -> str:
    """A name that can be a file's, or `InvalidValueError`."""
    if not (isinstance(name, str) and name and all(c.isalnum() or c in "_-" for c in name)):
        raise InvalidValueError("name", name, "letters, digits, _ and -")
    return name


def policy_kind(policy: Policy) -> str:
    """Its class, one of `KINDS`."""
    kind = getattr(policy, "kind", "classical")
    if kind not in KINDS:
        raise InvalidValueError("kind", kind, " or ".join(KINDS))
    return kind


def policy_arguments(policy: Policy, env_id: str) -> dict[str, Any] | None:
    """What it asks `gym.make` for; None where it is not defined (`InvalidValueError` for what is not its choice)."""
    choose = getattr(policy, "arguments", None)
    if choose is None:
        return {}
    try:
        chosen = choose(env_id)
    except (Exception, SystemExit) as error:
        raise PolicyError(
            f"policy {policy_name(policy)}: arguments() raised {type(error).__name__}: {error}"
        ) from error
    for name in chosen or {}:
        if name not in ARGUMENTS:
            raise InvalidValueError("arguments", name, "those that a policy may choose: " + ", ".join(ARGUMENTS))
    return None if chosen is None else dict(chosen)


def policy_digest(policy: Policy) -> str:
    """SHA-256 of the file that the policy comes from: its module's, or the artifact's."""
    path = getattr(policy, "path", None)
    if path is None:
        try:
            path = inspect.getsourcefile(type(policy))
        except TypeError:
            path = None
    if path is None:
        return ""
    try:
        return hashlib.sha256(Path(path).read_bytes()).hexdigest()
    except OSError:
        return ""


def policy_doc(policy: Policy) -> str:
    """What it is, in one line."""
    doc = inspect.getdoc(policy) or ""
    return doc.splitlines()[0] if doc else ""


def defined_on(policy: Policy) -> list[str]:
    """Environments on which the policy is defined."""
    return [env_id for env_id in ENVIRONMENTS if policy_arguments(policy, env_id) is not None]


class Actor:
    """A policy that is called with care: what goes wrong becomes a `PolicyError` that says where."""

    def __init__(self, policy: Policy, shape: tuple[int, ...], place: str, *, limit_s: float) -> None:
        """Take a policy, the action's shape, where it acts, in words, and how long an answer may take [s]."""
        self.policy, self._shape, self._place, self._limit = policy, shape, place, limit_s
        self.ticks = 0
        self.times: list[float] = []
        """How long each action took [s]."""
        begin = getattr(policy, "begin", None)
        if begin is not None:
            with self._care("begin"):
                begin(shape[0])

    def reset(self, seed: int) -> None:
        """Begin an episode."""
        with self._care("reset"):
            self.policy.reset(seed)

    def act(self, observation: np.ndarray) -> np.ndarray:
        """A valid action (`PolicyError` if it is none)."""
        start = time.perf_counter()
        with self._care("act"):
            action = np.asarray(self.policy.act(observation))
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
            with _alarm(self._limit):
                yield
        except _TooLongError:
            self._fail(f"took longer than {self._limit:g} s in {what}()")
        except (Exception, SystemExit) as error:
            raise PolicyError(f"{self._where}: {what}() raised {type(error).__name__}: {error}") from error
        if time.perf_counter() - start > self._limit:  # where no alarm could ring
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
    """Raise `_TooLongError` after so many seconds, in a main thread with signals; elsewhere time is only looked at."""
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
