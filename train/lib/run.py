"""Folder of a run: checkpoint, learning curve and artifact, written atomically; resuming validates the checkpoint."""

import json
import os
import platform
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from spidar_gym.border import BorderError, pack, read_file, require_form, unpack
from spidar_gym.errors import MissingDependencyError, SpidarError
from spidar_gym.files import cannot_write, json_text, output_folder, write_bytes, write_text
from spidar_gym.policies.artifact import Artifact, interface, write_artifact
from spidar_gym.policies.provenance import processor, versions
from train.lib.config import OutputConfig, Recipe, flatten
from train.lib.envs import Scaling
from train.lib.evaluate import Verdict
from train.lib.learner import Layers

FRAMEWORKS = ("torch", "stable-baselines3")
"""Training packages whose versions are recorded."""
FORMAT = 3
"""Format version of checkpoints."""
TITLE = "checkpoint.json"
"""Entry of a checkpoint that holds everything except arrays."""
MOST_BYTES = 2**32
"""Largest accepted checkpoint [bytes]."""
LINE = {
    "steps": int, "seconds": float, "score": float, "worst": float, "success": float, "reward": (float, None),
    "cells": {str: {str: float}},
}  # fmt: skip
"""Schema of a line of a learning curve."""
FORM = {
    "segment": int, "learner": {str: int}, "clip": float, "best_score": float, "best_steps": int,
    "base": {str: {str: float}}, "curve": [LINE], "seconds": float, "parts": {str: float},
}  # fmt: skip
"""Schema of the parts of a state that are not arrays."""


class CheckpointError(SpidarError):
    """Raised for a checkpoint that cannot be read, or that belongs to another run, environment or version."""


@dataclass
class State:
    """Complete state of a run."""

    segment: int = 0
    """Number of completed segments."""
    learner: Mapping[str, Any] = field(default_factory=dict)
    """Arrays and integers of the learner by name, for example from `train.lib.agent.save_state`."""
    scaling: Mapping[str, Any] = field(default_factory=dict)
    """Mean, variance and clip of the observation scaling."""
    mean: Layers = ()
    """Layers of the averaged actor."""
    best: Layers = ()
    """Layers of the chosen actor; initially the untrained one."""
    best_score: float = 0.0
    """Paired score of the chosen actor."""
    best_steps: int = 0
    """Training length at which the chosen actor was reached [control ticks]."""
    base: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    """Track → metric → mean of the base on the validation scenarios."""
    curve: list[dict[str, Any]] = field(default_factory=list)
    """A line for each validation."""
    seconds: float = 0.0
    """Wall time so far, validation included [s]."""
    parts: dict[str, float] = field(default_factory=dict)
    """Part of the run → wall time [s], including the time before the first segment."""


def require_frameworks() -> None:
    """Import the training packages (`MissingDependencyError` without the extra `train`); not needed for `--help`."""
    try:
        import stable_baselines3  # noqa: F401 - only whether it is there
        import tensorboard  # noqa: F401 - only whether it is there
        import torch
    except ModuleNotFoundError as error:
        raise MissingDependencyError(str(error.name), "pip install -e '.[train]'") from error
    # One thread per run, so that several runs can share a machine.
    torch.set_num_threads(1)


class Run:
    """The folder of one run."""

    def __init__(self, folder: Path, settings: Mapping[str, Any], env_id: str, arguments: Mapping[str, Any]) -> None:
        """Create the folder if it does not exist (`SpidarError` if that fails).

        Args:
            folder: Folder, used by this run only.
            settings: All settings that the result depends on; a checkpoint with other settings is rejected.
            env_id: Environment id.
            arguments: Arguments of `gym.make`.
        """
        self.folder = output_folder(folder)
        self.checkpoint = folder / "checkpoint.npz"
        """Path of the checkpoint."""
        self.previous = folder / "previous.npz"
        """Path of the previous checkpoint, a backup in case the last one is damaged."""
        self._settings = json.loads(json.dumps(dict(settings)))
        self._identity = {
            "settings": self._settings,
            "env_id": env_id,
            "interface": interface(env_id, arguments),
            "versions": versions(*FRAMEWORKS),
        }

    @classmethod
    def of(cls, recipe: Recipe, env_id: str, arguments: Mapping[str, Any]) -> "Run":
        """Create the run of a recipe; the numbers of processes and threads and the outputs do not identify it."""
        flat = flatten(recipe, OutputConfig)
        settings = {name: value for name, value in flat.items() if name not in ("workers", "threads")}
        return cls(recipe.output.out / recipe.name / f"seed{recipe.seed}", settings, env_id, arguments)

    def save(self, state: State) -> None:
        """Write the checkpoint and the curve, each atomically."""
        words = {
            name: getattr(state, name) for name in ("segment", "best_score", "best_steps", "base", "curve", "parts")
        }
        arrays = {name: value for name, value in state.learner.items() if isinstance(value, np.ndarray)}
        words |= {"seconds": state.seconds, "clip": state.scaling["clip"]}
        words["learner"] = {name: value for name, value in state.learner.items() if name not in arrays}
        arrays = {f"learner/{name}": value for name, value in arrays.items()}
        arrays |= {f"scaling/{name}": state.scaling[name] for name in ("mean", "variance")}
        arrays |= layer_arrays("mean", state.mean) | layer_arrays("best", state.best)
        content = {"format": FORMAT, "identity": self._identity, "state": words}
        data = pack(TITLE, content, arrays, sealed=True)
        if self.checkpoint.exists():
            try:
                os.replace(self.checkpoint, self.previous)
            except OSError as error:
                raise cannot_write(self.previous, error) from error
        write_bytes(self.checkpoint, data)
        self.write_curve(state)

    def load(self) -> State | None:
        """Load the state to resume from; None without a checkpoint (`CheckpointError` for one that does not match)."""
        path = self.checkpoint if self.checkpoint.exists() else self.previous
        if not path.exists():
            old = self.folder / "checkpoint.pt"
            if old.exists():
                raise CheckpointError(
                    f"{old} is of an earlier version, and is not read because it can run code; "
                    "valid: another --out, or this one without the file, which starts the run again"
                )
            return None
        try:
            content, arrays = unpack(TITLE, read_file(path, MOST_BYTES), sealed=True)
            require_form(content, {"format": int, "identity": dict, "state": dict}, TITLE)
            if content["format"] != FORMAT:
                raise CheckpointError(
                    f"{path} has format {content['format']}; valid: format {FORMAT}, or another --out"
                )
            self._require_own(path, content["identity"])
            require_form(content["state"], FORM, "state")
        except BorderError as error:
            less = (
                f"resumes from {self.previous.name}"
                if path != self.previous and self.previous.exists()
                else "starts again"
            )
            raise CheckpointError(
                f"{path} is no checkpoint ({error}); valid: one that this script wrote; without the file the run {less}"
            ) from error
        return _state(path, content["state"], arrays)

    def _require_own(self, path: Path, identity: Mapping[str, Any]) -> None:
        """Raise `CheckpointError` if settings, environment or versions differ from those of this run."""
        for name, value in self._identity.items():
            if identity.get(name) != value:
                raise CheckpointError(
                    f"{path} is of another run: {_difference(name, identity.get(name), value)}; "
                    "valid: the same settings and versions, or another --out"
                )

    def require_alike(self, found: Mapping[str, Any], like: Mapping[str, Any]) -> None:
        """Raise `CheckpointError` if names, types or shapes of a loaded state differ from those of an initial one.

        Args:
            found: Arrays and numbers of the loaded state.
            like: Arrays and numbers of an initial state; an array with zero rows matches any number of rows.
        """
        for name in sorted(found.keys() ^ like.keys()):
            raise CheckpointError(
                f"{self.folder}'s checkpoint {'has' if name in found else 'lacks'} {name[:60]!r}; "
                "valid: one with all its parts and no others"
            )
        for name, value in found.items():
            a, b = np.asarray(value), np.asarray(like[name])
            rows = 1 if b.ndim and not len(b) else 0
            if a.dtype != b.dtype or a.ndim != b.ndim or a.shape[rows:] != b.shape[rows:] or not np.isfinite(a).all():
                raise CheckpointError(
                    f"{self.folder}'s checkpoint has {a.dtype} {a.shape} or non-finite numbers in {name[:60]!r}; "
                    f"valid: {b.dtype} {b.shape}"
                )

    def write_curve(self, state: State) -> None:
        """Write the learning curve, with settings, wall times and versions, as curve.json."""
        content = {
            "settings": self._settings,
            "command": command_line(),
            "seconds": round(state.seconds, 1),
            "parts": {name: round(seconds, 1) for name, seconds in state.parts.items()},
            "processor": processor(),
            "python": platform.python_version(),
            "versions": {name: self._identity["versions"][name] for name in FRAMEWORKS},
            "chosen": {"steps": state.best_steps, "score": state.best_score},
            "base": state.base,
            "curve": state.curve,
        }
        write_text(self.folder / "curve.json", json_text(content))

    def publish(self, artifact: Artifact) -> Path:
        """Write the artifact and return its path."""
        path = self.folder / "policy.npz"
        write_artifact(artifact, path)
        return path


def layer_arrays(name: str, layers: Layers) -> dict[str, np.ndarray]:
    """Return the arrays of layers by name."""
    named = (zip(("weight", "bias"), layer, strict=True) for layer in layers)
    return {f"{name}/{k}/{part}": array for k, layer in enumerate(named) for part, array in layer}


def _state(path: Path, words: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> State:
    """Build the state from a checkpoint's parts."""

    def under(head: str) -> dict[str, np.ndarray]:
        return {name.removeprefix(head): array for name, array in arrays.items() if name.startswith(head)}

    def layers(name: str) -> Layers:
        own = under(f"{name}/")
        count = sum(key.endswith("/weight") for key in own)
        if set(own) != {f"{k}/{part}" for k in range(count) for part in ("weight", "bias")}:
            raise CheckpointError(f"{path} lacks some of the layers of {name}; valid: a checkpoint with all its parts")
        return tuple((own[f"{k}/weight"], own[f"{k}/bias"]) for k in range(count))

    words = dict(words)
    scaling = {**under("scaling/"), "clip": float(words.pop("clip"))}
    if not {"mean", "variance"} <= set(scaling):
        raise CheckpointError(f"{path} lacks its normaliser; valid: a checkpoint with all its parts")
    learner = {**under("learner/"), **words.pop("learner")}
    if not learner or min(words["segment"], words["best_steps"], words["seconds"]) < 0:
        raise CheckpointError(f"{path} lacks its learner or its counts; valid: a checkpoint with all its parts")
    return State(**words, learner=learner, scaling=scaling, mean=layers("mean"), best=layers("best"))


def make_artifact(layers: Layers, scaling: Scaling, state: State, **about: Any) -> Artifact:  # noqa: ANN401 - fields of `Artifact`
    """Build the artifact of an actor.

    Args:
        layers: Layers of the actor.
        scaling: Scaling of its observations.
        state: State of the run, whose curve is stored in the artifact.
        **about: All other fields of the `Artifact`; the command and the curve are added to `training`.
    """
    curve = [[entry["steps"], round(entry["score"], 5)] for entry in state.curve]
    return Artifact(
        weights=tuple(w for w, _ in layers),
        biases=tuple(b for _, b in layers),
        mean=scaling.mean,
        variance=scaling.variance,
        clip=scaling.clip,
        **{**about, "training": {"command": command_line(), **about["training"], "curve": curve}},
    )


def curve_line(steps: int, seconds: float, verdict: Verdict, reward: float | None = None) -> dict[str, Any]:
    """Build a line of a learning curve."""
    return {
        "steps": steps,
        "seconds": round(seconds, 1),
        "score": verdict.score,
        "worst": verdict.worst,
        "success": verdict.success,
        "reward": reward,
        "cells": {track: dict(cell) for track, cell in verdict.cells.items()},
    }


def command_line() -> str:
    """Return the command of this process: `python -m train.residual …`."""
    module = sys.modules["__main__"].__spec__
    return " ".join(["python -m", module.name if module else Path(sys.argv[0]).name, *sys.argv[1:]])


def _difference(name: str, was: Any, now: Any) -> str:  # noqa: ANN401 - JSON
    """Describe the first difference between two values in a few words."""
    if isinstance(was, dict) and isinstance(now, dict):
        key = next((k for k in now if was.get(k) != now[k]), next(iter(set(was) - set(now)), ""))
        return f"{_brief(key)} = {_brief(was.get(key))} instead of {_brief(now.get(key))}"
    return f"{name} = {_brief(was)} instead of {_brief(now)}"


def _brief(value: object) -> str:
    """Format a value in one line of at most 60 characters."""
    return " ".join("".join(c if c.isprintable() else " " for c in str(value)).split())[:60]
