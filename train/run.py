"""A run's folder: checkpoint, learning curve and artifact; nothing half-written, nothing resumed that does not fit."""

import io
import json
import platform
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import stable_baselines3
import torch

from spidar_gym.benchmark.artifact import Artifact, interface, write_artifact
from spidar_gym.benchmark.row import processor, versions
from spidar_gym.errors import SpidarError
from spidar_gym.files import json_text, output_folder, write_bytes, write_text
from train.kinds import Scaling
from train.learner import Layers
from train.referee import Verdict

FORMAT = 1
"""Version of the checkpoints' format."""


class CheckpointError(SpidarError):
    """A checkpoint that cannot be read, or that belongs to another run, environment or version."""


@dataclass
class State:
    """All that a run has reached."""

    segment: int = 0
    """Segments done."""
    learner: Mapping[str, Any] = field(default_factory=dict)
    """What `train.learner.save_state` gave."""
    scaling: Mapping[str, Any] = field(default_factory=dict)
    """Mean and variance of the observations."""
    mean: Layers = ()
    """The averaged actor."""
    best: Layers = ()
    """The chosen actor; the one that adds nothing until there is a better one."""
    best_score: float = 0.0
    """Its paired score."""
    best_steps: int = 0
    """When it was reached."""
    base: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    """Track → metric → mean of the base on the validation scenarios."""
    curve: list[dict[str, Any]] = field(default_factory=list)
    """A line for each validation."""
    seconds: float = 0.0
    """Wall time so far, validation included [s]."""


def learner_versions() -> dict[str, str]:
    """Versions of what learns."""
    return {"torch": torch.__version__, "stable-baselines3": stable_baselines3.__version__}


class Run:
    """The folder of one run."""

    def __init__(self, folder: Path, settings: Mapping[str, Any], env_id: str, arguments: Mapping[str, Any]) -> None:
        """Make it where it is not (`SpidarError` where it cannot be).

        Args:
            folder: Of this run and no other.
            settings: Everything on which the result depends; a checkpoint with others is refused.
            env_id: Environment.
            arguments: Of `gym.make`.
        """
        self.folder = output_folder(folder)
        self._settings = json.loads(json.dumps(dict(settings)))
        self._identity = {
            "settings": self._settings,
            "env_id": env_id,
            "interface": interface(env_id, arguments),
            "versions": versions() | learner_versions(),
        }

    @property
    def checkpoint(self) -> Path:
        """File of the state."""
        return self.folder / "checkpoint.pt"

    def save(self, state: State) -> None:
        """Write the checkpoint and the curve, each whole or not at all."""
        buffer = io.BytesIO()
        torch.save({"format": FORMAT, "identity": self._identity, "state": vars(state)}, buffer)
        write_bytes(self.checkpoint, buffer.getvalue())
        self.write_curve(state)

    def load(self) -> State | None:
        """The state to go on from; None where there is none (`CheckpointError` for one that does not fit)."""
        path = self.checkpoint
        if not path.exists():
            return None
        try:
            content = torch.load(path, weights_only=False, map_location="cpu")
            identity, state = content["identity"], content["state"]
            form = content["format"]
        except Exception as error:
            raise CheckpointError(
                f"{path} is no checkpoint ({type(error).__name__}); valid: one that this script wrote, or another --out"
            ) from error
        if form != FORMAT:
            raise CheckpointError(f"{path} has format {form}; valid: format {FORMAT}, or another --out")
        for name, value in self._identity.items():
            if identity.get(name) != value:
                raise CheckpointError(
                    f"{path} is of another run: {_difference(name, identity.get(name), value)}; "
                    "valid: the same settings and versions, or another --out"
                )
        if not {"mean", "variance"} <= set(state.get("scaling") or ()):
            raise CheckpointError(f"{path} lacks its normaliser; valid: a checkpoint with all its parts")
        missing = set(State.__dataclass_fields__) - set(state)
        if missing:
            raise CheckpointError(f"{path} lacks {sorted(missing)[0]}; valid: a checkpoint with all its parts")
        return State(**state)

    def write_curve(self, state: State) -> None:
        """The learning curve and what it cost, for people and plots."""
        content = {
            "settings": self._settings,
            "command": called(),
            "seconds": round(state.seconds, 1),
            "processor": processor(),
            "python": platform.python_version(),
            "versions": learner_versions(),
            "chosen": {"steps": state.best_steps, "score": state.best_score},
            "base": state.base,
            "curve": state.curve,
        }
        write_text(self.folder / "curve.json", json_text(content))

    def publish(self, artifact: Artifact) -> Path:
        """Write the artifact; its path."""
        path = self.folder / "policy.npz"
        write_artifact(artifact, path)
        return path


def make_artifact(layers: Layers, scaling: Scaling, state: State, **about: Any) -> Artifact:  # noqa: ANN401 - of `Artifact`
    """An actor as the benchmark's artifact.

    Args:
        layers: Of the actor.
        scaling: Of its observations.
        state: Of the run, whose curve the artifact carries.
        **about: Everything else of the `Artifact`; to `training` come the command and the curve.
    """
    curve = [[entry["steps"], round(entry["score"], 5)] for entry in state.curve]
    return Artifact(
        weights=tuple(w for w, _ in layers),
        biases=tuple(b for _, b in layers),
        mean=scaling.mean,
        variance=scaling.variance,
        clip=scaling.clip,
        **{**about, "training": {"command": called(), **about["training"], "curve": curve}},
    )


def curve_line(steps: int, seconds: float, verdict: Verdict, reward: float | None = None) -> dict[str, Any]:
    """One line of a learning curve."""
    return {
        "steps": steps,
        "seconds": round(seconds, 1),
        "score": verdict.score,
        "worst": verdict.worst,
        "success": verdict.success,
        "reward": reward,
        "cells": {track: dict(cell) for track, cell in verdict.cells.items()},
    }


def called() -> str:
    """The command that is being run: `python -m train.residual …`."""
    module = sys.modules["__main__"].__spec__
    return " ".join(["python -m", module.name if module else Path(sys.argv[0]).name, *sys.argv[1:]])


def _difference(name: str, was: Any, now: Any) -> str:  # noqa: ANN401 - JSON
    """What is not the same, in a few words."""
    if isinstance(was, dict) and isinstance(now, dict):
        key = next((k for k in now if was.get(k) != now[k]), next(iter(set(was) - set(now)), ""))
        return f"{key} = {str(was.get(key))[:60]} instead of {str(now.get(key))[:60]}"
    return f"{name} = {str(was)[:60]} instead of {str(now)[:60]}"
