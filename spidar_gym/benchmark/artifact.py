"""The artifact of a learned policy: one file with network, normaliser, arguments and origin, and who refuses it."""

import io
import json
import math
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

import spidar_gym.envs.registry
from spidar_gym.benchmark.policy import KINDS, check_name
from spidar_gym.benchmark.row import model_hash, versions
from spidar_gym.control.controller import CONTROL_RATE
from spidar_gym.envs.env import SpidarEnv
from spidar_gym.envs.registry import ENVIRONMENTS
from spidar_gym.errors import InvalidValueError, SpidarError, require_name, require_not_negative
from spidar_gym.files import write_bytes

FORMAT = 2
"""Version of the format."""
ACTIVATIONS = {"tanh": np.tanh, "relu": lambda x: np.maximum(x, np.float32(0.0))}
"""Valid activations of the hidden layers."""
OUTPUTS = ("clip", "tanh")
"""How the last layer becomes an action: clipped to ± 1 (PPO), or squashed (SAC)."""
EPOCH = (1980, 1, 1, 0, 0, 0)
"""Date of everything in the file, so that the same policy gives the same bytes."""


class ArtifactError(SpidarError):
    """An artifact that cannot be read, or that was learned in another environment or on another robot."""


class Washout:
    """A first-order high-pass on entries of an action: what stays fades, so that none drifts into an offset."""

    def __init__(self, times: np.ndarray) -> None:
        """Begin with nothing to take away.

        Args:
            times: Time constant of every entry of the action [s], 0 where it passes unchanged; or none at all.

        Raises:
            InvalidValueError: For a time that is negative or not finite.
        """
        for time in times.tolist():
            require_not_negative(washout=time)
        self.share = np.array([-math.expm1(-1.0 / (CONTROL_RATE * t)) if t > 0.0 else 0.0 for t in times.tolist()])
        """Of the way to the action that its low-pass goes in a tick."""
        self.reset()

    def reset(self) -> None:
        """Forget the actions so far."""
        self.slow = np.zeros(len(self.share))
        """The actions, low-passed."""

    def __call__(self, action: np.ndarray) -> np.ndarray:
        """The action of this tick, with its type: where it is washed out within ± 1, elsewhere as it came."""
        if not self.share.any():
            return action
        self.slow = self.slow + self.share * (action - self.slow)
        washed = np.clip(action - self.slow, -1.0, 1.0).astype(action.dtype)
        return np.where(self.share > 0.0, washed, action)


@dataclass(frozen=True)
class Artifact:
    """A multi-layer perceptron from observations to actions, and where it comes from."""

    name: str
    """Of its row."""
    kind: str
    """`learned`, or `residual` where it adds to a controller."""
    doc: str
    """What it is, in one line."""
    env_id: str
    """Environment, with version."""
    arguments: Mapping[str, Any]
    """What `gym.make` was told of action mode and controller."""
    weights: tuple[np.ndarray, ...]
    """W of every layer, shape (out, in)."""
    biases: tuple[np.ndarray, ...]
    """b of every layer, shape (out,)."""
    mean: np.ndarray
    """Of the observations; they enter the network as (o − mean) / √variance, clipped."""
    variance: np.ndarray
    """… > 0."""
    clip: float = 10.0
    """Bound of a normalised observation."""
    activation: str = "tanh"
    """Of the hidden layers."""
    output: str = "clip"
    """How the last layer becomes an action."""
    washout: np.ndarray = field(default_factory=lambda: np.zeros(0))
    """Time constants of the `Washout` of every entry of the action [s], or none at all."""
    training: Mapping[str, Any] = field(default_factory=dict)
    """Command, seed, steps, wall time, and the learning `curve`."""

    def __post_init__(self) -> None:
        """Refuse what is no network."""
        require_name("kind", self.kind, KINDS)
        require_name("activation", self.activation, ACTIVATIONS)
        require_name("output", self.output, OUTPUTS)
        check_name(self.name)
        if not (isinstance(self.clip, int | float) and 0.0 < self.clip < math.inf):
            raise InvalidValueError("clip", self.clip, "a number above 0")
        arrays = {"mean": self.mean, "variance": self.variance, "washout": self.washout}
        arrays |= {f"weights[{k}]": w for k, w in enumerate(self.weights)}
        arrays |= {f"biases[{k}]": b for k, b in enumerate(self.biases)}
        for name, array in arrays.items():
            if array.dtype.kind != "f" or not np.isfinite(array).all():
                raise InvalidValueError(name, "NaN, infinite or no number", "finite numbers")
            if array.ndim != (2 if name.startswith("weights") else 1):
                raise InvalidValueError(name, array.shape, "a matrix for weights, vectors otherwise")
        if not (self.variance > 0.0).all() or self.variance.shape != self.mean.shape:
            raise InvalidValueError("variance", self.variance.shape, f"{self.mean.shape} numbers above 0")
        if not (self.weights and len(self.weights) == len(self.biases)):
            raise InvalidValueError("weights", len(self.weights), "at least one layer, as many as biases")
        size = len(self.mean)
        for w, b in zip(self.weights, self.biases, strict=True):
            if w.shape != (len(b), size):
                raise InvalidValueError("weights", w.shape, f"({len(b)}, {size})")
            size = len(b)
        if len(self.washout) not in (0, size):
            raise InvalidValueError("washout", self.washout.shape, f"({size},) time constants, or none")
        require_not_negative(washout=float(self.washout.min(initial=0.0)))

    def act(self, observation: np.ndarray) -> np.ndarray:
        """The network's answer, in [−1, 1], in single precision as it was learned."""
        x = (observation - self.mean) / np.sqrt(self.variance)
        x = np.minimum(np.maximum(x, -self.clip), self.clip).astype(np.float32)
        last = len(self.weights) - 1
        for k, (w, b) in enumerate(zip(self.weights, self.biases, strict=True)):
            x = w @ x + b
            if k < last:
                x = ACTIVATIONS[self.activation](x)
        return np.tanh(x) if self.output == "tanh" else np.minimum(np.maximum(x, np.float32(-1.0)), np.float32(1.0))


def interface(env_id: str, arguments: Mapping[str, Any]) -> dict[str, Any]:
    """What an environment shows and takes: names and sizes of the observation's pieces, length of the action."""
    spidar_gym.envs.registry.register()
    env = gymnasium.make(env_id, **arguments, disable_env_checker=True).unwrapped
    assert isinstance(env, SpidarEnv)
    fields = [[f.name, f.size, f.bound] for f in env.layout]
    size = (env.action_space.shape or (0,))[0]
    env.close()
    return {"observation": fields, "action": size}


def write_artifact(artifact: Artifact, path: Path) -> None:
    """Write an artifact whole or not at all; the same one gives the same bytes."""
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
    arrays: dict[str, np.ndarray] = {
        "mean": artifact.mean.astype(np.float64),
        "variance": artifact.variance.astype(np.float64),
        "washout": artifact.washout.astype(np.float64),
    }
    for k, (w, b) in enumerate(zip(artifact.weights, artifact.biases, strict=True)):
        arrays[f"weight{k}"], arrays[f"bias{k}"] = w.astype(np.float32), b.astype(np.float32)
    buffer = io.BytesIO()
    # Stored, not compressed: another version of the compressor would give other bytes.
    with zipfile.ZipFile(buffer, "w") as archive:
        archive.writestr(zipfile.ZipInfo("policy.json", EPOCH), json.dumps(meta, indent=1, ensure_ascii=False))
        for name, array in arrays.items():
            data = io.BytesIO()
            np.lib.format.write_array(data, np.ascontiguousarray(array), allow_pickle=False)
            archive.writestr(zipfile.ZipInfo(f"{name}.npy", EPOCH), data.getvalue())
    write_bytes(path, buffer.getvalue())


def read_artifact(path: Path) -> Artifact:
    """Read an artifact.

    Raises:
        ArtifactError: When there is none, it is damaged, lacks a part, or does not match the environments or the robot.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            meta = json.loads(archive.read("policy.json"))
            names = [name for name in archive.namelist() if name.endswith(".npy")]
            arrays = {
                name.removesuffix(".npy"): np.lib.format.read_array(io.BytesIO(archive.read(name)), allow_pickle=False)
                for name in names
            }
    except OSError as error:
        raise ArtifactError(f"{path}: {error.strerror}; valid: a learned policy's artifact") from error
    except (KeyError, ValueError, EOFError, RuntimeError, zipfile.BadZipFile) as error:
        raise ArtifactError(f"{path} is no artifact ({error}); valid: a file that `write_artifact` wrote") from error
    was = meta.get("format") if isinstance(meta, dict) else None
    if was != FORMAT:
        raise ArtifactError(f"{path} has format {was}; valid: format {FORMAT}")
    try:
        return _artifact(path, meta, arrays)
    except (KeyError, TypeError, AttributeError) as error:
        raise ArtifactError(f"{path} lacks {error}; valid: a file that `write_artifact` wrote") from error
    except ArtifactError:
        raise
    except SpidarError as error:
        raise ArtifactError(f"{path}: {error}") from error


def _artifact(path: Path, meta: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> Artifact:
    """The artifact of a file's parts, where they fit the environments, the robot and each other."""
    _check_origin(path, meta)
    check_name(meta["name"])
    layers = range(meta["layers"])
    needed = ["mean", "variance", "washout", *(f"{part}{k}" for k in layers for part in ("weight", "bias"))]
    missing = [name for name in needed if name not in arrays]
    if missing:
        what = {"mean": "normaliser", "variance": "normaliser", "washout": "action"}.get(missing[0], "network")
        raise ArtifactError(f"{path} lacks {missing[0]} of its {what}; valid: an artifact with all its parts")
    weights, biases = (tuple(arrays[f"{part}{k}"] for k in layers) for part in ("weight", "bias"))
    known = {
        name: meta[name] for name in ("name", "kind", "doc", "env_id", "arguments", "clip", "activation", "output")
    }
    artifact = Artifact(
        **known, weights=weights, biases=biases, mean=arrays["mean"], variance=arrays["variance"],
        washout=arrays["washout"], training=meta["training"],
    )  # fmt: skip
    sizes = sum(size for _, size, _ in meta["interface"]["observation"]), meta["interface"]["action"]
    if (len(artifact.mean), len(artifact.biases[-1])) != sizes:
        raise ArtifactError(
            f"{path}: a network from {len(artifact.mean)} to {len(artifact.biases[-1])}; valid: {sizes}"
        )
    return artifact


def _check_origin(path: Path, meta: Mapping[str, Any]) -> None:
    """Refuse what was learned elsewhere."""
    if meta["env_id"] not in ENVIRONMENTS:
        raise ArtifactError(f"{path} was learned in {meta['env_id']}; valid: {', '.join(ENVIRONMENTS)}")
    if meta["model_sha256"] != model_hash():
        raise ArtifactError(f"{path} was learned on another robot model; valid: one learned on the present one")
    present = interface(meta["env_id"], meta["arguments"])
    if present != meta["interface"]:
        was, now = ({name: size for name, size, _ in i["observation"]} for i in (meta["interface"], present))
        differ = sorted(set(was.items()) ^ set(now.items())) or [("bounds or action", 0)]
        raise ArtifactError(
            f"{path} was learned with another interface of {meta['env_id']} ({differ[0][0]}); valid: the present one"
        )


class LearnedPolicy:
    """An artifact, acting."""

    def __init__(self, artifact: Artifact, path: Path | None = None) -> None:
        """Take it, and the file that it comes from."""
        self.path, self.artifact = path, artifact
        self.name, self.kind, self.training = artifact.name, artifact.kind, dict(artifact.training)
        self.__doc__ = artifact.doc
        self.washout = Washout(artifact.washout)

    def arguments(self, env_id: str) -> Mapping[str, Any] | None:
        """What it was learned with; None elsewhere."""
        return self.artifact.arguments if env_id == self.artifact.env_id else None

    def reset(self, seed: int) -> None:
        """Forget what the washout has seen; there is nothing to draw."""
        self.washout.reset()

    def act(self, observation: np.ndarray) -> np.ndarray:
        """The network's answer, washed out."""
        return self.washout(self.artifact.act(observation))
