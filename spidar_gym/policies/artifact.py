"""Artifact of a learned policy: one file with network, normaliser, arguments and origin, and its validation."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

from spidar_gym.border import MOST_WORDS, BorderError, pack, read_file, require_form, unpack
from spidar_gym.envs.env import SpidarEnv
from spidar_gym.envs.registry import COURSE, ENVIRONMENTS, HOVER
from spidar_gym.errors import InvalidValueError, SpidarError, require_name, require_not_negative
from spidar_gym.files import write_bytes
from spidar_gym.native.network import Network
from spidar_gym.policies import course, external, torso
from spidar_gym.policies.external import ExternalForce
from spidar_gym.policies.filters import Traces, Washout
from spidar_gym.policies.policy import KINDS, check_name
from spidar_gym.policies.provenance import versions
from spidar_gym.robot.description import model_hash

FORMAT = 3
"""Version of the format."""
READABLE = (2, FORMAT)
"""Versions that can be read; version 2 has neither traces nor a skip matrix."""
ACTIVATIONS = ("tanh", "relu")
"""Valid activations of the hidden layers."""
OUTPUTS = ("clip", "tanh", "torso", "rule")
"""Conversions of the last layer to an action: clipped to ± 1 (PPO), squashed (SAC), a `direct` command in torso axes.

With `torso` the network's input is the `features` of an observation, and its output the input of `command`. With `rule`
the output is clipped and sets the numbers of the rule on a course.
"""
VECTORS = {"mean": "normaliser", "variance": "normaliser", "washout": "action"}
"""Fields of an artifact that are vectors in its file, and the part that they belong to."""
LATER = {
    "traced": np.zeros(0), "trace_times": np.zeros(0), "rotor_lag": np.zeros(0), "skip": np.zeros((0, 0), np.float32)
}  # fmt: skip
"""Fields that format 3 introduced, with their values for older files."""
RENAMED = {"tuned": "tuned_v1", "robust_overlapped": "robust_overlapped_v1"}
"""Presets that were tuned again after format 2, and the current names of their values at that time."""
TITLE = "policy.json"
"""Part of the file with the text."""
MOST_LAYERS, MOST_WIDTH = 8, 1024
"""Largest number of layers of a network in a file, and of outputs of a layer; the onboard core has the same limit."""
MOST_BYTES = 4 * MOST_LAYERS * MOST_WIDTH * (MOST_WIDTH + 1) + 2 * MOST_WORDS
"""Largest size of a file [bytes]."""
MOST_LETTERS = 500
"""Length limit of a name and of other texts in one line [characters]."""
ARGUMENT_FORMS: dict[str, Any] = {
    "action_mode": str, "preset": str, "schedule": (str, None), "avoid_interference": bool, "max_iter": int,
    "action_scale": {str: float}, "hold": int, "observation": str,
}  # fmt: skip
"""Arguments of the environment that a file may set, and their types."""
FORM = {
    "format": int, "name": str, "kind": str, "doc": str, "env_id": str, "arguments": dict,
    "interface": {"observation": [[str, int, float]], "action": int},
    "clip": float, "activation": str, "output": str, "layers": int, "model_sha256": str, "versions": {str: str},
    "training": dict,
}  # fmt: skip
"""Entries of the text, and their types."""
LINES = ("name", "kind", "doc", "env_id", "activation", "output")
"""Entries of one line each."""
TRAINING = {"command": str, "seed": int, "steps": int, "chosen_at": int, "curve": [[float, float]]}
"""Types of optional entries of `training`; others are not checked."""


class ArtifactError(SpidarError):
    """An artifact that cannot be read, or that was learned in another environment or on another robot."""


@dataclass(frozen=True)
class Artifact:
    """A multi-layer perceptron from observations to actions, and its origin."""

    name: str
    """Name of its row."""
    kind: str
    """`learned`, or `residual` if it adds to a controller."""
    doc: str
    """Description in one line."""
    env_id: str
    """Environment, with version."""
    arguments: Mapping[str, Any]
    """Arguments of `gym.make` for action mode and controller."""
    weights: tuple[np.ndarray, ...]
    """W of every layer, shape (out, in)."""
    biases: tuple[np.ndarray, ...]
    """b of every layer, shape (out,)."""
    mean: np.ndarray
    """Mean of the network's input, observation or features and traces, which is scaled to (o − mean) / √variance."""
    variance: np.ndarray
    """Variance of the network's input, above 0."""
    clip: float = 10.0
    """Bound of a normalised observation."""
    activation: str = "tanh"
    """Activation of the hidden layers."""
    output: str = "clip"
    """Conversion of the last layer to an action, one of `OUTPUTS`."""
    washout: np.ndarray = field(default_factory=lambda: np.zeros(0))
    """Time constants of the `Washout` of every entry of the action [s]; empty for none."""
    rotor_lag: np.ndarray = field(default_factory=lambda: np.zeros(0))
    """Time constant of the rotors in the `ExternalForce`, an input of the network after the observation [s], (1,);
    empty for none."""
    traced: np.ndarray = field(default_factory=lambda: np.zeros(0))
    """Entries of the observation, or of the inputs after it, that have `Traces`, the last inputs of the network."""
    trace_times: np.ndarray = field(default_factory=lambda: np.zeros(0))
    """Time constants of the traces [s]."""
    skip: np.ndarray = field(default_factory=lambda: np.zeros((0, 0), np.float32))
    """Matrix from the network's input to its last layer, (out, in); empty for none."""
    training: Mapping[str, Any] = field(default_factory=dict)
    """Command, seed, steps, wall time, and the learning `curve`."""

    def __post_init__(self) -> None:
        """Validate the artifact."""
        require_name("kind", self.kind, KINDS)
        require_name("activation", self.activation, ACTIVATIONS)
        require_name("output", self.output, OUTPUTS)
        check_name(self.name)
        if not (isinstance(self.clip, int | float) and 0.0 < self.clip < math.inf):
            raise InvalidValueError("clip", self.clip, "a number above 0")
        arrays = {name: getattr(self, name) for name in (*VECTORS, *LATER)}
        arrays |= {f"weights[{k}]": w for k, w in enumerate(self.weights)}
        arrays |= {f"biases[{k}]": b for k, b in enumerate(self.biases)}
        for name, array in arrays.items():
            if array.dtype.kind != "f" or not np.isfinite(array).all():
                raise InvalidValueError(name, "NaN, infinite or no number", "finite numbers")
            if array.ndim != (2 if name.startswith(("weights", "skip")) else 1):
                raise InvalidValueError(name, array.shape, "a matrix for weights, vectors otherwise")
        self._check_network()
        self._check_memory()

    def _check_network(self) -> None:
        """Validate the shapes of the layers."""
        if not (self.variance > 0.0).all() or self.variance.shape != self.mean.shape:
            raise InvalidValueError("variance", self.variance.shape, f"{self.mean.shape} numbers above 0")
        if not (self.weights and len(self.weights) == len(self.biases)):
            raise InvalidValueError("weights", len(self.weights), "at least one layer, as many as biases")
        size = len(self.mean)
        for w, b in zip(self.weights, self.biases, strict=True):
            if w.shape != (len(b), size):
                raise InvalidValueError("weights", w.shape, f"({len(b)}, {size})")
            size = len(b)
        if self.skip.shape not in ((0, 0), (size, len(self.mean))):
            raise InvalidValueError("skip", self.skip.shape, f"({size}, {len(self.mean)}), or none")
        if self.output == "torso" and (self.sees, size) != (torso.OBSERVATION, torso.ACTION):
            raise InvalidValueError("network", (len(self.mean), size), f"{torso.FEATURES} and traces to {torso.ACTION}")
        if self.output == "rule" and (self.env_id != COURSE or size != len(course.RANGES)):
            raise InvalidValueError("network", (self.env_id, size), f"one of {COURSE} to {len(course.RANGES)}")

    def _check_memory(self) -> None:
        """Validate the washout, the traces and the external force."""
        if len(self.washout) not in (0, self.answers):
            raise InvalidValueError("washout", self.washout.shape, f"({self.answers},) time constants, or none")
        require_not_negative(washout=float(self.washout.min(initial=0.0)))
        require_not_negative(trace_times=float(self.trace_times.min(initial=0.0)))
        if len(self.rotor_lag) > (self.env_id == HOVER and self.output != "torso"):
            raise InvalidValueError("rotor_lag", self.rotor_lag.shape, "one in flights on a controller, else none")
        if len(self.rotor_lag):
            ExternalForce(float(self.rotor_lag[0]))
        shown = self.sees + external.SIZE * len(self.rotor_lag)
        if np.any(self.traced % 1.0) or not all(0 <= entry < shown for entry in self.traced.tolist()):
            raise InvalidValueError("traced", self.traced.shape, f"entries within 0 … {shown - 1}")

    @property
    def sees(self) -> int:
        """Length of an observation, without the external force and traces."""
        shown = len(self.mean) - len(self.traced) * len(self.trace_times) - external.SIZE * len(self.rotor_lag)
        return shown - torso.FEATURES + torso.OBSERVATION if self.output == "torso" else shown

    @property
    def answers(self) -> int:
        """Length of an action."""
        return len(course.ACTION) if self.output == "rule" else len(self.biases[-1])

    @cached_property
    def _network(self) -> Network:
        layers = zip(self.weights, self.biases, strict=True)
        return Network(tuple(layers), relu=self.activation == "relu", skip=self.skip)

    def act(self, observation: np.ndarray) -> np.ndarray:
        """Return the network's action in [−1, 1], in single precision as in training, and with the bits of the robot.

        Args:
            observation: Shape (…, size), followed by the commanded joints with the output `torso`, or by the external
                force if there is one, and by the traces. Each row's action is bit for bit that of the row alone.
        """
        seen, in_torso = observation, self.output == "torso"
        if in_torso:
            observation, traces = np.split(observation, [torso.SHOWN], axis=-1)
            seen = np.concatenate([torso.features(observation), traces], axis=-1)
        x = (seen - self.mean) / np.sqrt(self.variance)
        x = np.minimum(np.maximum(x, -self.clip), self.clip).astype(np.float32)
        x = self._network(x)
        if in_torso:
            return torso.command(x, observation).astype(np.float32)
        if self.output == "tanh":
            return np.tanh(x.astype(np.float64)).astype(np.float32)
        x = np.minimum(np.maximum(x, np.float32(-1.0)), np.float32(1.0))
        return course.command(x, observation) if self.output == "rule" else x


def interface(env_id: str, arguments: Mapping[str, Any]) -> dict[str, Any]:
    """Return an environment's interface: names, sizes and bounds of the observation's fields, length of the action."""
    env = gymnasium.make(env_id, **arguments, disable_env_checker=True).unwrapped
    assert isinstance(env, SpidarEnv)
    fields = [[f.name, f.size, f.bound] for f in env.layout]
    size = (env.action_space.shape or (0,))[0]
    env.close()
    return {"observation": fields, "action": size}


def write_artifact(artifact: Artifact, path: Path) -> None:
    """Write an artifact atomically; equal artifacts yield equal bytes."""
    meta = {
        "format": FORMAT,
        "name": artifact.name,
        "kind": artifact.kind,
        "doc": artifact.doc,
        "env_id": artifact.env_id,
        "arguments": dict(artifact.arguments),
        "interface": interface(artifact.env_id, artifact.arguments),
        "clip": artifact.clip,
        "activation": artifact.activation,
        "output": artifact.output,
        "layers": len(artifact.weights),
        "model_sha256": model_hash(),
        "versions": versions(),
        "training": dict(artifact.training),
    }
    arrays: dict[str, np.ndarray] = {name: getattr(artifact, name).astype(np.float64) for name in VECTORS}
    arrays |= {name: getattr(artifact, name).astype(np.float64) for name in ("rotor_lag", "traced", "trace_times")}
    arrays["skip"] = artifact.skip.astype(np.float32)
    for k, (w, b) in enumerate(zip(artifact.weights, artifact.biases, strict=True)):
        arrays[f"weight{k}"], arrays[f"bias{k}"] = w.astype(np.float32), b.astype(np.float32)
    write_bytes(path, pack(TITLE, meta, arrays))


def read_artifact(path: Path) -> Artifact:
    """Read an artifact.

    Raises:
        ArtifactError: When the file is missing, damaged, incomplete or too large, or does not match the environments
            or the robot.
    """
    try:
        meta, arrays = unpack(TITLE, read_file(path, MOST_BYTES))
        was = meta.get("format") if isinstance(meta, dict) else None
        if was not in READABLE or isinstance(was, bool):
            raise ArtifactError(f"{path} has format {was!r:.20}; valid: format {' or '.join(map(str, READABLE))}")
        require_form(meta, FORM, TITLE)
        if was != FORMAT and (preset := meta["arguments"].get("preset")) in RENAMED:
            meta["arguments"] = {**meta["arguments"], "preset": RENAMED[preset]}
        return _artifact(path, meta, arrays)
    except BorderError as error:
        raise ArtifactError(
            f"{path} is no artifact ({error}); valid: a learned policy's artifact, as `write_artifact` wrote it"
        ) from error
    except ArtifactError:
        raise
    except SpidarError as error:
        raise ArtifactError(f"{path}: {error}") from error


def _artifact(path: Path, meta: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> Artifact:
    """Make the artifact of a file's parts, after checking them against the environments, the robot and each other."""
    for name in LINES:
        if not (len(meta[name]) <= MOST_LETTERS and meta[name].isprintable()):
            raise BorderError(f"its {name} is not a line of at most {MOST_LETTERS} characters")
    _check_origin(path, meta)
    for name in TRAINING.keys() & meta["training"].keys():
        require_form(meta["training"][name], TRAINING[name], f"training's {name}")
    if not 1 <= meta["layers"] <= MOST_LAYERS:
        raise InvalidValueError("layers", meta["layers"], f"1 … {MOST_LAYERS}")
    layers = range(meta["layers"])
    later = LATER
    if meta["format"] == FORMAT:
        later = {name: arrays[name] for name in LATER if name in arrays}
    needed = [*VECTORS, *(f"{part}{k}" for k in layers for part in ("weight", "bias"))]
    missing = [name for name in needed if name not in arrays] + [name for name in LATER if name not in later]
    if missing:
        what = VECTORS.get(missing[0], "network")
        raise ArtifactError(f"{path} lacks {missing[0]} of its {what}; valid: an artifact with all its parts")
    weights, biases = (tuple(arrays[f"{part}{k}"] for k in layers) for part in ("weight", "bias"))
    known: dict[str, Any] = {name: meta[name] for name in (*LINES, "arguments", "training")}
    known |= {name: arrays[name] for name in VECTORS} | later
    artifact = Artifact(**known, clip=float(meta["clip"]), weights=weights, biases=biases)
    sizes = sum(size for _, size, _ in meta["interface"]["observation"]), meta["interface"]["action"]
    if (artifact.sees, artifact.answers) != sizes:
        raise ArtifactError(f"{path}: a network from {artifact.sees} to {artifact.answers}; valid: {sizes}")
    widest = max(len(artifact.mean), *(len(bias) for bias in artifact.biases))
    if widest > MOST_WIDTH:
        raise InvalidValueError("widest layer", widest, f"at most {MOST_WIDTH} numbers")
    return artifact


def _check_origin(path: Path, meta: Mapping[str, Any]) -> None:
    """Check that an artifact was learned in this version of an environment and on this robot (`ArtifactError`)."""
    if meta["env_id"] not in ENVIRONMENTS:
        raise ArtifactError(f"{path} was learned in {meta['env_id']}; valid: {', '.join(ENVIRONMENTS)}")
    if meta["model_sha256"] != model_hash():
        raise ArtifactError(f"{path} was learned on another robot model; valid: one learned on the present one")
    for name, value in meta["arguments"].items():
        # A file contains only text and numbers; a custom controller or allocator is code.
        require_name("argument of the environment", name, ARGUMENT_FORMS)
        require_form(value, ARGUMENT_FORMS[name], name)
    present = interface(meta["env_id"], meta["arguments"])
    if present != meta["interface"]:
        was, now = ({name: size for name, size, _ in i["observation"]} for i in (meta["interface"], present))
        differ = sorted(set(was.items()) ^ set(now.items())) or [("bounds or action", 0)]
        raise ArtifactError(
            f"{path} was learned with another interface of {meta['env_id']} ({ascii(differ[0][0][:40])[1:-1]}); "
            "valid: the present one"
        )


def _behind(artifact: Artifact) -> torso.Joints | ExternalForce | None:
    """Make the memory whose values follow the observation, before the traces; None if there is none."""
    if artifact.output == "torso":
        return torso.Joints()
    return ExternalForce(float(artifact.rotor_lag[0])) if len(artifact.rotor_lag) else None


class LearnedPolicy:
    """Policy of an artifact."""

    def __init__(self, artifact: Artifact, path: Path | None = None) -> None:
        """Store the artifact and the path of its file."""
        self.path, self.artifact = path, artifact
        self.name, self.kind, self.training = artifact.name, artifact.kind, dict(artifact.training)
        self.__doc__ = artifact.doc
        self.washout = Washout(artifact.washout)
        self.traces = Traces(artifact.traced, artifact.trace_times)
        self.behind = _behind(artifact)

    def arguments(self, env_id: str) -> Mapping[str, Any] | None:
        """Return the arguments of `gym.make` in its training; None for other environments."""
        return self.artifact.arguments if env_id == self.artifact.env_id else None

    def reset(self, seed: int) -> None:
        """Reset its memory; the policy is deterministic."""
        self._forget()

    def _forget(self, *robots: int) -> None:
        for memory in (self.washout, self.traces, self.behind):
            if memory is not None:
                memory.reset(*robots)

    def act(self, observation: np.ndarray) -> np.ndarray:
        """Return the network's action after the washout."""
        return self.washout(self.artifact.act(self.see(observation)))

    def see(self, observation: np.ndarray) -> np.ndarray:
        """Append the remembered values to an observation; each call advances the memory by a tick."""
        return self.traces(observation if self.behind is None else self.behind(observation))

    def reset_batch(self, seeds: Sequence[int]) -> None:
        """Reset the memory of each robot."""
        self._forget(len(seeds))

    def act_batch(self, observations: np.ndarray) -> np.ndarray:
        """Return the network's actions after the washout."""
        return self.act(observations)
