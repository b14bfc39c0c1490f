"""Server of a policy in its own process, which returns only data."""

import contextlib
import inspect
import json
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from spidar_gym.border import BorderError
from spidar_gym.envs.registry import ENVIRONMENTS
from spidar_gym.errors import SpidarError
from spidar_gym.policies.choices import as_data
from spidar_gym.policies.load import load_policy
from spidar_gym.policies.messages import MOST_ARRAY, NUMBERS, Line
from spidar_gym.policies.policy import UNSTATED, Policy, acts_in_batches, policy_arguments

LONGEST = 2000
"""Longest text of an answer, in characters."""


def serve(spec: str, trust: bool, inward: int, outward: int) -> None:
    """Answer requests until the pipe is closed.

    Args:
        spec: The policy.
        trust: Whether a zip may be loaded.
        inward: File to read requests from.
        outward: File to write answers to.
    """
    line, loaded = Line(inward, outward), list[Any]()

    def begin(size: int) -> None:
        """Reload the policy."""
        loaded[:] = [load_policy(spec, trust=trust)]
        if hasattr(loaded[0], "begin"):
            loaded[0].begin(size)

    calls: dict[str, Callable[..., Any]] = {
        "describe": lambda: describe(load_policy(spec, trust=trust)),
        "begin": begin,
        "reset": lambda seed: loaded[0].reset(seed),
        "reset_batch": lambda seeds: loaded[0].reset_batch(seeds),
        "act": lambda seen: loaded[0].act(seen),
        "act_batch": lambda seen: loaded[0].act_batch(seen),
    }
    with contextlib.suppress(BorderError):  # the pipe is closed
        while True:
            request, seen = line.receive()
            what, given = request["call"], request.get("given", [])
            words, array = dict[str, Any](), None
            try:
                answer = calls[what](*given, *([] if seen is None else [seen]))
                if what.startswith("act"):
                    words, array = _numbers(answer)
                elif what == "describe":
                    words = answer
            except SpidarError as error:
                words = {"refused": str(error)[:LONGEST]}
            except (Exception, SystemExit) as error:
                words = {"refused": f"{what}() raised {type(error).__name__}: {error}"[:LONGEST]}
            line.send(words, array)


def _numbers(answer: Any) -> tuple[dict[str, Any], np.ndarray | None]:  # noqa: ANN401 - a policy's
    """Return actions as an array, or a description of an answer that is not an array of numbers."""
    array = np.asarray(answer)
    if not NUMBERS.fullmatch(array.dtype.str) or array.nbytes > MOST_ARRAY:
        return {"odd": f"gave {array.dtype} of shape {array.shape}"[:LONGEST]}, None
    return {}, array


def describe(policy: Policy) -> dict[str, Any]:
    """Return the description of a policy as data."""
    arguments: dict[str, Any] = {}
    for env_id in ENVIRONMENTS:
        try:
            chosen = policy_arguments(policy, env_id)
            data = None if chosen is None else {name: as_data(name, value) for name, value in chosen.items()}
            arguments[env_id] = {"chosen": data}
        except SpidarError as error:
            arguments[env_id] = {"refused": str(error)[:LONGEST]}
    doc = inspect.getdoc(policy) or ""
    return {
        "name": str(getattr(policy, "name", "") or type(policy).__name__.lower())[:LONGEST],
        "kind": str(getattr(policy, "kind", UNSTATED))[:LONGEST],
        "doc": doc.splitlines()[0][:LONGEST] if doc else "",
        "training": _training(policy),
        "batches": acts_in_batches(policy),
        "arguments": arguments,
    }


def _training(policy: Policy) -> Mapping[str, Any] | None:
    """Return the policy's `training` if it is data, else None."""
    try:
        found = json.loads(json.dumps(getattr(policy, "training", None), allow_nan=False))
    except (TypeError, ValueError):
        return None
    return found if isinstance(found, dict) else None
