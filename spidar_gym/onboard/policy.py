"""A learned policy for the onboard core: network, normaliser, bounds and authorities as a header of exact numbers."""

import inspect
import math

import numpy as np

from spidar_gym.control.crawl.observation import crawl_layout
from spidar_gym.control.flight.controller import CONTROL_RATE
from spidar_gym.control.flight.observation import layout
from spidar_gym.envs import actions
from spidar_gym.envs.actions import ActionMode
from spidar_gym.envs.crawl.env import CrawlEnv
from spidar_gym.envs.hover.env import HoverEnv
from spidar_gym.envs.registry import CRAWL, HOVER
from spidar_gym.errors import InvalidValueError, require_name
from spidar_gym.native.codegen.header import array, header, hex_float
from spidar_gym.native.constants import MAX_ACTION, MAX_OBSERVATION, MAX_WIDTH
from spidar_gym.policies.artifact import Artifact
from spidar_gym.policies.filters import Washout

RATE = 10.0
"""Largest change of every entry of an action in a second; from −1 to 1 it is 2."""
ENVIRONMENTS = {
    HOVER: ("SP_POLICY_FLIGHT", HoverEnv, actions.ACTION_MODES, layout),
    CRAWL: ("SP_POLICY_CRAWL", CrawlEnv, actions.CRAWL_MODES, crawl_layout),
}
"""Environment → its name in C, class, action modes, layout of the observation."""


def policy_header(artifact: Artifact | None, rate: float = RATE) -> str:
    """spidar_policy.h: a policy, or that there is none.

    Args:
        artifact: Network and origin.
        rate: Largest change of every entry of an action in a second [1/s].

    Raises:
        UnknownNameError: For an environment or action mode that does not exist.
        InvalidValueError: For a policy that adds to no controller, does not fit its environment or is too large for C.
    """
    if not (isinstance(rate, int | float) and 0.0 < rate < math.inf):
        raise InvalidValueError("residual_rate", rate, "a number above 0")
    if artifact is None:
        return _header("no policy", _words("SP_POLICY_NONE", "", "", (0,), "0"), {})
    require_name("environment of a residual", artifact.env_id, ENVIRONMENTS)
    kind, env, modes, fields = ENVIRONMENTS[artifact.env_id]
    if artifact.skip.size or len(artifact.mean) > artifact.sees:
        raise InvalidValueError(
            "network", "a skip matrix or traces", "layers alone: the core has no memory of what was seen"
        )
    mode = _mode(artifact, str(_argument(artifact, env, "action_mode")), modes)
    bound = np.concatenate([np.full(field.size, field.bound) for field in fields(mode.size)])
    sizes = (len(artifact.mean), *(len(bias) for bias in artifact.biases))
    _check_sizes(sizes, (len(bound), mode.size))
    # A controller of one's own has no name.
    preset = "" if "controller" in artifact.arguments else str(_argument(artifact, env, "preset"))
    channels = " | ".join(f"SP_CHANNEL_{channel.name.upper()}" for channel in mode.channels)
    words = _words(kind, artifact.name, preset, sizes, channels)
    words["RELU"] = int(artifact.activation == "relu")
    words["SQUASH"] = int(artifact.output == "tanh")
    words["CLIP"] = f"{hex_float(artifact.clip)} /* of a normalised observation */"
    words["STEP"] = f"{hex_float(rate / CONTROL_RATE)} /* largest change of an action in a tick: {rate:g} a second */"
    share = Washout(artifact.washout).share
    layers = zip(artifact.weights, artifact.biases, strict=True)
    arrays = {
        "MEAN": artifact.mean.astype(float),
        "DEVIATION": np.sqrt(artifact.variance.astype(float)),
        "BOUND": bound,
        "WASHOUT": share if len(share) else np.zeros(mode.size),
        "AUTHORITY": np.concatenate(
            [np.broadcast_to(actions.AUTHORITIES[each.name], each.size) for each in mode.channels]
        ),
        "WEIGHTS": np.concatenate([part.astype(np.float32).reshape(-1) for layer in layers for part in layer]),
    }
    return _header(f"the policy {artifact.name}, learned in {artifact.env_id}", words, arrays)


def _argument(artifact: Artifact, env: type, name: str) -> object:
    """What the environment was told, or takes by default."""
    return artifact.arguments.get(name, inspect.signature(env).parameters[name].default)


def _mode(artifact: Artifact, name: str, modes: dict[str, ActionMode]) -> ActionMode:
    """The action mode, where it adds to a controller."""
    mode = actions.find_action_mode(name, modes)
    if mode.residual is None:
        adding = ", ".join(n for n, m in modes.items() if m.residual is not None)
        raise InvalidValueError(f"action mode of {artifact.name}", name, f"one that adds to the controller: {adding}")
    return mode


def _check_sizes(sizes: tuple[int, ...], shown: tuple[int, int]) -> None:
    """Refuse a network that does not fit its environment, or the core's arrays."""
    if (sizes[0], sizes[-1]) != shown:
        raise InvalidValueError("network", f"{sizes[0]} to {sizes[-1]}", f"{shown[0]} to {shown[1]}")
    found = (
        ("observation", sizes[0], MAX_OBSERVATION),
        ("action", sizes[-1], MAX_ACTION),
        ("width", max(sizes), MAX_WIDTH),
    )
    for name, size, most in found:
        if size > most:
            raise InvalidValueError(f"network's {name}", size, f"at most {most} numbers")


def _words(kind: str, name: str, preset: str, sizes: tuple[int, ...], channels: str) -> dict[str, object]:
    """Constants by name without `SP_POLICY_`, as they are without a network."""
    return {
        "KIND": kind,
        "NAME": f'"{name}"',
        "PRESET": f'"{preset}" /* whose controller it adds to */',
        "LAYERS": len(sizes) - 1,
        "SIZES": f"{{{', '.join(map(str, sizes))}}}",
        "WIDTH": max(1, *sizes),
        "ACTIONS": sizes[-1],
        "CHANNELS": f"({channels})",
        "RELU": 0,
        "SQUASH": 0,
        "CLIP": "0.0",
        "STEP": "0.0",
    }


def _header(what: str, words: dict[str, object], arrays: dict[str, np.ndarray]) -> str:
    """The header; arrays that are missing have one zero, since C knows none of length 0."""
    lines = [f"#define SP_POLICY_{name} {value}" for name, value in words.items()]
    doubles = ("MEAN", "DEVIATION", "BOUND", "WASHOUT", "AUTHORITY")
    for name, kind in (*((n, "double") for n in doubles), ("WEIGHTS", "float")):
        numbers, suffix = arrays.get(name, np.zeros(1)).tolist(), "f" if kind == "float" else ""
        lines += ["", *array(kind, f"SP_POLICY_{name}", [hex_float(x) + suffix for x in numbers])]
    return header("SPIDAR_POLICY", f"{what}.", lines, ('"spidar_constants.h"',))
