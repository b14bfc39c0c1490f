"""What can act: the protocol `Policy`, and what a policy says of itself."""

import inspect
import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, Protocol, TypeGuard, runtime_checkable

import gymnasium
import numpy as np

from spidar_gym.envs.registry import ENVIRONMENTS
from spidar_gym.errors import InvalidValueError, shown
from spidar_gym.policies.presets import PresetPolicy
from spidar_gym.policies.provenance import file_digest
from spidar_gym.policies.source import PolicyError
from spidar_gym.robot import ROBOT, RobotSpec

UNSTATED = "unstated"
"""Class of a policy that does not say of which it is."""
LEARNED = ("learned", "residual")
"""Classes of what comes from a training."""
KINDS = ("classical", *LEARNED, UNSTATED)
"""Valid classes of a policy."""
NAME, DOC, LINE = 64, 200, 4000
"""Longest name, longest word on what a policy is, and longest line of any other text, in characters."""
READABLE = ("allocator", "law")
"""Arguments that are code of one's own, which the readable controllers call."""
ARGUMENTS = ("action_mode", "preset", "controller", *READABLE, "schedule", "avoid_interference", "max_iter")
"""Arguments of the environment that a policy may choose; the others are the track's."""


def control_of(arguments: Mapping[str, Any], control: str) -> str:
    """Who controls where it is to be `control`: with code of the policy's own it is always `python`."""
    return "python" if any(name in arguments for name in READABLE) else control


@runtime_checkable
class Policy(Protocol):
    """What a policy has to have. What it may have besides, with defaults, is on `PresetPolicy`."""

    def reset(self, seed: int) -> None:
        """Begin an episode; whatever the policy draws comes from this seed, in the benchmark the run's number."""

    def act(self, observation: np.ndarray) -> np.ndarray:
        """The action, in [−1, 1]."""
        ...


@runtime_checkable
class BatchPolicy(Policy, Protocol):
    """What a policy has that can act for many robots at once, each as it would for that one alone, bit for bit.

    NumPy's matrix products do not promise that, as their order of summation may change with the number of rows:
    `np.matmul(W, x[..., None])[..., 0]` does each row by itself.
    """

    def reset_batch(self, seeds: Sequence[int]) -> None:
        """Begin an episode of each robot; whatever the policy draws for it comes from its seed."""

    def act_batch(self, observations: np.ndarray) -> np.ndarray:
        """The actions (robots, size), in [−1, 1], at observations (robots, size).

        Rows of robots whose episode is over go on being asked for; they mean nothing.
        """
        ...


def acts_in_batches(policy: Policy) -> TypeGuard[BatchPolicy]:
    """Whether a policy can act for many robots, as it acts for one: who changes the one way has to say the other."""
    if isinstance(told := getattr(policy, "in_batches", None), bool):  # a guest's description says it
        return told
    for one, many in (("reset", "reset_batch"), ("act", "act_batch")):
        for level in (vars(policy) if hasattr(policy, "__dict__") else {}, *map(vars, type(policy).__mro__)):
            if many in level:
                break
            if one in level:
                return False
        else:
            return False
    return True


def policy_name(policy: Policy) -> str:
    """Name of the policy's row: letters, digits, `_`, `-`."""
    return check_name(getattr(policy, "name", "") or type(policy).__name__.lower())


def check_name(name: object) -> str:
    """A name that can be a file's, or `InvalidValueError`."""
    if not (isinstance(name, str) and 0 < len(name) <= NAME and all(c.isalnum() or c in "_-" for c in name)):
        raise InvalidValueError("name", name, f"letters, digits, _ and -, at most {NAME}")
    return name


def check_line(name: str, text: object, most: int = LINE) -> str:
    """A text that can stand in a table and on a terminal: one line, nothing that steers, no HTML.

    Raises:
        InvalidValueError: For any other.
    """
    if not (isinstance(text, str) and len(text) <= most and text.isprintable() and not re.search("<[a-zA-Z/!?]", text)):
        raise InvalidValueError(name, text, f"one line of at most {most} printable characters without HTML")
    return text


def policy_kind(policy: Policy) -> str:
    """Its class, one of `KINDS`."""
    kind = getattr(policy, "kind", UNSTATED)
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


def require_spaces(policy: Policy, env_id: str, env: gymnasium.Env) -> None:
    """Refuse a policy that says for which spaces it is, where the environment has others (`PolicyError`).

    Args:
        policy: It may have `observation_space` and `action_space`.
        env_id: Name of the environment.
        env: Where it is to act.
    """
    has = env.observation_space, env.action_space
    asks = tuple(
        getattr(policy, name, space) for name, space in zip(("observation_space", "action_space"), has, strict=True)
    )
    if asks != has:
        was, now = (" and actions ".join(map(_range, spaces)) for spaces in (asks, has))
        raise PolicyError(
            f"policy {policy_name(policy)} learned on observations {was}; {env_id} has {now} here; "
            "valid: the environment and the --action-mode that it learned in"
        )


def require_robot(policy: Policy, env_id: str, robot: RobotSpec) -> None:
    """Refuse a baseline or an artifact that knows the nominal robot alone, where there is another (`PolicyError`).

    A preset flies any robot, and what a policy of a user's own knows is the user's to say.
    """
    mine = type(policy).__module__.partition(".")[0] == "baselines" or hasattr(policy, "path")
    plain = getattr(type(policy), "act", None) is PresetPolicy.act
    own = any(name in READABLE for name in policy_arguments(policy, env_id) or {})
    if robot != ROBOT and mine and (own or not plain):
        raise PolicyError(
            f"policy {policy_name(policy)} knows the nominal robot alone; valid with a robot of one's own: a preset, "
            "or a policy that learned on it"
        )


def _range(space: gymnasium.Space) -> str:
    """A space in a few words: shape, type and bounds."""
    if not isinstance(space, gymnasium.spaces.Box):
        return shown(space)
    return f"{space.shape} {space.dtype} in {space.low.min():g} … {space.high.max():g}"


def policy_digest(policy: Policy) -> str:
    """SHA-256 of the file that the policy comes from: its module's, or the artifact's."""
    path = getattr(policy, "path", None)
    if path is None:
        with suppress(TypeError):
            path = inspect.getsourcefile(type(policy))
    return "" if path is None else file_digest(Path(path))


def policy_doc(policy: Policy) -> str:
    """What it is, in one line (`InvalidValueError` where no row may hold it)."""
    doc = inspect.getdoc(policy) or ""
    return check_line("doc", doc.splitlines()[0] if doc else "", DOC)


def defined_on(policy: Policy) -> list[str]:
    """Environments on which the policy is defined."""
    return [env_id for env_id in ENVIRONMENTS if policy_arguments(policy, env_id) is not None]
