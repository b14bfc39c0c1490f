"""Export a learned policy to a C header: network, normaliser, bounds and authorities, as exact numbers."""

import inspect
import math
from collections.abc import Mapping

import numpy as np

from spidar_gym.control.crawl.observation import crawl_layout
from spidar_gym.control.flight.controller import CONTROL_RATE
from spidar_gym.control.flight.observation import layout
from spidar_gym.envs import actions
from spidar_gym.envs.actions import ActionMode, scaled_action_mode
from spidar_gym.envs.crawl_env import CrawlEnv
from spidar_gym.envs.hover_env import HoverEnv
from spidar_gym.envs.registry import CRAWL, HOVER
from spidar_gym.errors import InvalidValueError, require_name
from spidar_gym.native.codegen.header import array, header, hex_float
from spidar_gym.native.constants import MAX_ACTION, MAX_OBSERVATION, MAX_TRACES, MAX_WIDTH
from spidar_gym.native.network import Network, padded
from spidar_gym.policies import external, torso
from spidar_gym.policies.artifact import Artifact
from spidar_gym.policies.external import ExternalForce
from spidar_gym.policies.filters import Traces, Washout
from spidar_gym.robot import ROBOT

TORSO_UNITS = {
    "FORCE": torso.FORCE, "OFFSET": torso.OFFSET, "SPEED": torso.SPEED, "ACCELERATION": torso.ACCELERATION,
    "SURE": torso.SURE, "JOINT_LIMIT": ROBOT.joint_limit,
}  # fmt: skip
"""Constants of a network in torso axes, by names in C."""
PLACES = {
    "JOINTS": "joint_position", "SINE": "vectoring_sine", "COSINE": "vectoring_cosine", "THRUST": "thrust_command",
    "COMMAND_SINE": "vectoring_command_sine", "COMMAND_COSINE": "vectoring_command_cosine",
    "ACTION": "previous_action", "SPEEDS": "joint_command_velocity", "ASIDE": "joint_target_error",
    "VELOCITY": "velocity_error", "ATTITUDE": "attitude_error", "INTEGRAL": "position_integral",
}  # fmt: skip
"""Entries of the flight observation that the core reads, by names in C."""
RATE = 10.0
"""Largest rate of every entry of an action [1/s]; the range −1 … 1 has length 2."""
ENVIRONMENTS = {
    HOVER: ("SP_POLICY_FLIGHT", "SP_POLICY_DIRECT", HoverEnv, actions.action_modes, actions.AIR, layout),
    CRAWL: ("SP_POLICY_CRAWL", "SP_POLICY_CRAWL_DIRECT", CrawlEnv, actions.crawl_modes, actions.FLOOR, crawl_layout),
}
"""Environment → its names in C with and without a controller, class, action modes, trim, layout of the observation."""


def policy_header(artifact: Artifact | None, rate: float = RATE) -> str:
    """Return the text of spidar_policy.h, for a policy or for none.

    Args:
        artifact: The policy, or None for none.
        rate: Largest rate of every entry of an action [1/s].

    Raises:
        UnknownNameError: For an environment or action mode that does not exist.
        InvalidValueError: If the core does not support the policy, or the policy does not fit its environment.
    """
    if not (isinstance(rate, int | float) and 0.0 < rate < math.inf):
        raise InvalidValueError("residual_rate", rate, "a number above 0")
    if artifact is None:
        return _header("no policy", _words("SP_POLICY_NONE", "", "", (0,), "0"), {})
    require_name("environment of a residual", artifact.env_id, ENVIRONMENTS)
    kind, alone, env, modes, trim, fields = ENVIRONMENTS[artifact.env_id]
    name, given = str(_argument(artifact, env, "action_mode")), _argument(artifact, env, "action_scale")
    mode = scaled_action_mode(name, given, trim, modes)
    _require_known(artifact, name, mode, modes(ROBOT))
    seen = fields(mode.size, **({"clock": True} if mode.has_clock else {}))
    bound = np.concatenate([np.full(field.size, field.bound) for field in seen])
    gain = np.concatenate([np.full(field.size, 1.0 / field.scale) for field in seen])
    sizes = (len(artifact.mean), *(len(bias) for bias in artifact.biases))
    traces = len(artifact.traced) * len(artifact.trace_times)
    _check_sizes(artifact, max(sizes), traces, (len(bound), mode.size))
    # A custom controller has no name.
    preset = "" if "controller" in artifact.arguments else str(_argument(artifact, env, "preset"))
    added = mode.channels if mode.residual else ()
    channels = " | ".join(f"SP_CHANNEL_{channel.name.upper()}" for channel in added) or "0"
    said = _said(artifact)
    words = _words(kind if mode.residual else alone, artifact.name, preset, (*sizes[:-1], said), channels)
    words |= {"ACTIONS": artifact.answers, "SEES": artifact.sees, "TRACES": traces, "SKIP": int(artifact.skip.size > 0)}
    words |= _held(artifact, mode)
    words["RELU"] = int(artifact.activation == "relu")
    words["SQUASH"] = int(artifact.output == "tanh")
    words["CLIP"] = f"{hex_float(artifact.clip)} /* of a normalised observation */"
    words["STEP"] = f"{hex_float(rate / CONTROL_RATE)} /* largest change of an action per tick: {rate:g} per second */"
    known = mode.scale.authorities if mode.scale else actions.AUTHORITIES if added else {}
    share = Washout(artifact.washout).share
    *first, (weight, bias) = zip(artifact.weights, artifact.biases, strict=True)
    network = Network((*first, (weight[:said], bias[:said])), skip=artifact.skip[:said])
    arrays = {
        "MEAN": artifact.mean.astype(float),
        "DEVIATION": np.sqrt(artifact.variance.astype(float)),
        "BOUND": bound,
        "WASHOUT": share if len(share) else np.zeros(mode.size),
        "GAIN": gain if words["SCALED"] else np.zeros(1),
        "AUTHORITY": mode.share
        * np.concatenate(
            [np.broadcast_to(known[each.name], each.size) for each in mode.channels if known] or [np.zeros(1)]
        ),
        "WEIGHTS": network.numbers,
    }
    if traces:
        arrays["TRACED"] = np.tile(artifact.traced, len(artifact.trace_times)).astype(int)
        arrays["TRACE_SHARE"] = Traces(artifact.traced, artifact.trace_times).share
    if len(artifact.rotor_lag):
        own = ExternalForce(float(artifact.rotor_lag[0]))
        words |= {"EXTERNAL": external.SIZE, "ROTOR_SHARE": hex_float(own.share), **_places()}
    if artifact.output == "torso":
        words |= _torso_words()
        arrays["KEPT"] = torso.KEPT_ENTRIES
    return _header(f"the policy {artifact.name}, learned in {artifact.env_id}", words, arrays)


def _argument(artifact: Artifact, env: type, name: str) -> object:
    """Return an argument of the artifact's environment, or its default."""
    return artifact.arguments.get(name, inspect.signature(env).parameters[name].default)


def _require_known(artifact: Artifact, name: str, mode: ActionMode, modes: Mapping[str, ActionMode]) -> None:
    """Require an action mode that the core supports: not `direct` on the floor, no washout without a controller."""
    if mode.residual is None and mode.scale is None and artifact.env_id != HOVER:
        adding = ", ".join(n for n, m in modes.items() if m.residual is not None)
        raise InvalidValueError(
            f"action mode of {artifact.name}", name, f"{actions.TORSO}, or one that adds to the controller: {adding}"
        )
    if mode.residual is None and artifact.washout.any():
        raise InvalidValueError(f"washout of {artifact.name}", "given", "none without a controller")


def _held(artifact: Artifact, mode: ActionMode) -> dict[str, object]:
    """Return how an action and an observation are scaled, and for how many ticks an action is held."""
    hold = artifact.arguments.get("hold", 1)
    if hold != 1 and mode.scale is None:
        raise InvalidValueError(f"hold of {artifact.name}", hold, f"1, or the action mode {actions.TORSO}")
    return {
        "SCALED": int(artifact.arguments.get("observation") == "scaled"),
        "IN_TORSO_AXES": int(mode.scale is not None),
        "TRIM": hex_float(mode.scale.trim if mode.scale else 0.0),
        "HOLD": f"{hold} /* ticks per decision */",
    }


def _said(artifact: Artifact) -> int:
    """Return the number of leading outputs up to the last that is not always 0: the others need not be computed."""
    parts = [artifact.weights[-1], artifact.biases[-1][:, None], *([artifact.skip] if artifact.skip.size else [])]
    loud = np.flatnonzero(np.any([np.any(part != 0.0, axis=1) for part in parts], axis=0))
    return int(loud[-1]) + 1 if loud.size else 1


def _check_sizes(artifact: Artifact, width: int, traces: int, shown: tuple[int, int]) -> None:
    """Refuse a network that does not fit its environment or the core's arrays."""
    if (artifact.sees, artifact.answers) != shown:
        raise InvalidValueError("network", f"{artifact.sees} to {artifact.answers}", f"{shown[0]} to {shown[1]}")
    found = (
        ("observation", artifact.sees, MAX_OBSERVATION),
        ("traces", traces, MAX_TRACES),
        ("action", artifact.answers, MAX_ACTION),
        ("width", width, MAX_WIDTH),
    )
    for name, size, most in found:
        if size > most:
            raise InvalidValueError(f"network's {name}", size, f"at most {most} numbers")


def _torso_words() -> dict[str, object]:
    """Return the units of a network in torso axes, and the entries of the observation that it reads."""
    return {
        "TORSO": 1,
        "KEPT_SIZE": len(torso.KEPT_ENTRIES),
        **{name: hex_float(value) for name, value in TORSO_UNITS.items()},
        **_places(),
    }


def _places() -> dict[str, int]:
    """Return the index of each entry in `PLACES` of the observation."""
    return {f"AT_{name}": int(torso.entries(piece)[0]) for name, piece in PLACES.items()}


def _words(kind: str, name: str, preset: str, sizes: tuple[int, ...], channels: str) -> dict[str, object]:
    """Return the constants by name without `SP_POLICY_`, with the values of an export without a policy."""
    return {
        "KIND": kind,
        "NAME": f'"{name}"',
        "PRESET": f'"{preset}" /* preset of the controller that it adds to */',
        "LAYERS": len(sizes) - 1,
        "SIZES": f"{{{', '.join(map(str, sizes))}}}",
        "WIDTH": f"{padded(max(1, *sizes))} /* of the widest layer, in whole blocks */",
        "SEES": 0,
        "TRACES": 0,
        "SKIP": 0,
        "TORSO": 0,
        "KEPT_SIZE": 0,
        "EXTERNAL": 0,
        "ROTOR_SHARE": "0.0",
        **{name: "0.0" for name in TORSO_UNITS},
        **{f"AT_{name}": 0 for name in PLACES},
        "ACTIONS": sizes[-1],
        "CHANNELS": f"({channels})",
        "RELU": 0,
        "SQUASH": 0,
        "CLIP": "0.0",
        "STEP": "0.0",
        "SCALED": 0,
        "IN_TORSO_AXES": 0,
        "TRIM": "0.0",
        "HOLD": 1,
    }


def _header(what: str, words: dict[str, object], arrays: dict[str, np.ndarray]) -> str:
    """Return the header; missing arrays have one zero, since C has no arrays of length 0."""
    lines = [f"#define SP_POLICY_{name} {value}" for name, value in words.items()]
    for name in ("TRACED", "KEPT"):
        lines += ["", *array("int", f"SP_POLICY_{name}", [str(k) for k in arrays.get(name, np.zeros(1, int)).tolist()])]
    doubles = ("MEAN", "DEVIATION", "BOUND", "GAIN", "WASHOUT", "AUTHORITY", "TRACE_SHARE")
    for name, kind in (*((n, "double") for n in doubles), ("WEIGHTS", "float")):
        numbers, suffix = arrays.get(name, np.zeros(1)).tolist(), "f" if kind == "float" else ""
        lines += ["", *array(kind, f"SP_POLICY_{name}", [hex_float(x) + suffix for x in numbers])]
    return header("SPIDAR_POLICY", f"{what}.", lines, ('"spidar_constants.h"',))
