"""The protocol `Policy`, and the description of a policy by its attributes."""

import inspect
import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, Protocol, TypeGuard, runtime_checkable

import gymnasium
import numpy as np

from spidar_gym.envs.registry import ENVIRONMENTS
from spidar_gym.errors import InvalidValueError, require_name, shown
from spidar_gym.policies.presets import PresetPolicy
from spidar_gym.policies.provenance import file_digest
from spidar_gym.policies.source import PolicyError
from spidar_gym.robot import ROBOT, RobotSpec

UNSTATED = "unstated"
"""Class of a policy that does not state its class."""
LEARNED = ("learned", "residual")
"""Classes of trained policies."""
CEILING = "ceiling"
"""Class of a policy that is told what is hidden from a robot, and shows how much there is to gain."""
KINDS = ("classical", *LEARNED, CEILING, UNSTATED)
"""Valid classes of a policy."""
NAME, DOC, LINE = 64, 200, 4000
"""Length limits of a name, of a policy's description and of any other line of text, in characters."""
READABLE = ("allocator", "law")
"""Arguments that are custom code, which only the Python controllers call."""
ARGUMENTS = (
    "action_mode", "action_scale", "hold", "observation", "preset", "gait", "controller", *READABLE, "schedule",
    "avoid_interference", "max_iter", "grip", "grasp",
)  # fmt: skip
"""Arguments of the environment that a policy may set; the others are the track's."""


def control_of(arguments: Mapping[str, Any], control: str) -> str:
    """Return the implementation of the controller: `python` for a policy with custom code, else `control`."""
    return "python" if any(name in arguments for name in READABLE) else control


@runtime_checkable
class Policy(Protocol):
    """Required methods of a policy. `PresetPolicy` has the optional attributes with their defaults."""

    def reset(self, seed: int) -> None:
        """Begin an episode; seeds all random numbers of the policy. In the benchmark the seed is the run's number."""

    def act(self, observation: np.ndarray) -> np.ndarray:
        """Return the action, in [−1, 1]."""
        ...


@runtime_checkable
class BatchPolicy(Policy, Protocol):
    """Methods of a policy that can act for many robots at once, bit for bit as for each robot alone.

    NumPy's matrix products do not guarantee this, as their order of summation may depend on the number of rows;
    `np.matmul(W, x[..., None])[..., 0]` computes each row separately.
    """

    def reset_batch(self, seeds: Sequence[int]) -> None:
        """Begin an episode of each robot; each seed determines the policy's random numbers for that robot."""

    def act_batch(self, observations: np.ndarray) -> np.ndarray:
        """Return the actions (robots, size), in [−1, 1], for observations (robots, size).

        Rows of robots whose episode is over are included and ignored.
        """
        ...


def acts_in_batches(policy: Policy) -> TypeGuard[BatchPolicy]:
    """Return whether a policy can act for many robots; a class that overrides `act` must override `act_batch` too."""
    if isinstance(told := getattr(policy, "in_batches", None), bool):  # from a guest's description
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
    """Return the name of the policy's row: letters, digits, `_`, `-`."""
    return check_name(getattr(policy, "name", "") or type(policy).__name__.lower())


def check_name(name: object) -> str:
    """Require a name that can be a file's (`InvalidValueError`), and return it."""
    if not (isinstance(name, str) and 0 < len(name) <= NAME and all(c.isalnum() or c in "_-" for c in name)):
        raise InvalidValueError("name", name, f"letters, digits, _ and -, at most {NAME}")
    return name


def check_line(name: str, text: object, most: int = LINE) -> str:
    """Require a text for tables and terminals, one line without control characters and HTML, and return it.

    Raises:
        InvalidValueError: For any other text.
    """
    if not (isinstance(text, str) and len(text) <= most and text.isprintable() and not re.search("<[a-zA-Z/!?]", text)):
        raise InvalidValueError(name, text, f"one line of at most {most} printable characters without HTML")
    return text


def policy_kind(policy: Policy) -> str:
    """Return the class of a policy, one of `KINDS`."""
    kind = getattr(policy, "kind", UNSTATED)
    if kind not in KINDS:
        raise InvalidValueError("kind", kind, " or ".join(KINDS))
    return kind


def policy_arguments(policy: Policy, env_id: str) -> dict[str, Any] | None:
    """Return a policy's arguments of `gym.make`; None where it is not defined (`InvalidValueError` for others)."""
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
    if chosen is not None and chosen.get("observation") is not None:
        require_name("observation of a policy", str(chosen["observation"]), ("vector", "scaled"))
    if chosen is not None and chosen.get("grip") == "told" and policy_kind(policy) != CEILING:
        raise InvalidValueError("grip", "told", f"a policy of class {CEILING}: mass and friction are hidden")
    return None if chosen is None else dict(chosen)


def require_spaces(policy: Policy, env_id: str, env: gymnasium.Env) -> None:
    """Require an environment to have the spaces that a policy states, if any (`PolicyError`).

    Args:
        policy: Policy, which may have `observation_space` and `action_space`.
        env_id: Name of the environment.
        env: The environment.
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
    """Refuse a baseline or an artifact that supports only the nominal robot on another one (`PolicyError`).

    A preset flies any robot. Policies from outside the package are not checked.
    """
    mine = type(policy).__module__.partition(".")[0] == "baselines" or hasattr(policy, "path")
    plain = getattr(type(policy), "act", None) is PresetPolicy.act
    own = any(name in READABLE for name in policy_arguments(policy, env_id) or {})
    if robot != ROBOT and mine and (own or not plain):
        raise PolicyError(
            f"policy {policy_name(policy)} supports only the nominal robot; valid with a custom robot: a preset, or a "
            "policy that learned on it"
        )


def _range(space: gymnasium.Space) -> str:
    """Describe a space by shape, type and bounds."""
    if not isinstance(space, gymnasium.spaces.Box):
        return shown(space)
    return f"{space.shape} {space.dtype} in {space.low.min():g} … {space.high.max():g}"


def policy_digest(policy: Policy) -> str:
    """Return the SHA-256 of the policy's file: its module's or the artifact's."""
    path = getattr(policy, "path", None)
    if path is None:
        with suppress(TypeError):
            path = inspect.getsourcefile(type(policy))
    return "" if path is None else file_digest(Path(path))


def policy_doc(policy: Policy) -> str:
    """Return the first line of the policy's docstring (`InvalidValueError` for a line that no row may contain)."""
    doc = inspect.getdoc(policy) or ""
    return check_line("doc", doc.splitlines()[0] if doc else "", DOC)


def defined_on(policy: Policy) -> list[str]:
    """Return the environments on which the policy is defined."""
    return [env_id for env_id in ENVIRONMENTS if policy_arguments(policy, env_id) is not None]
