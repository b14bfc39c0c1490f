"""The network that a run begins as: an artifact of the same kind, taken apart into an actor's layers."""

from pathlib import Path

import numpy as np

from spidar_gym.errors import SpidarError
from spidar_gym.policies.artifact import Artifact, read_artifact
from train.lib.envs import EnvConfig
from train.lib.learner import Layers, LearnerConfig


def find_origin(start: str, seed: int, env: EnvConfig, learner: LearnerConfig) -> Artifact | None:
    """The artifact whose network a run begins as.

    Args:
        start: Its path, in which {seed} stands for the seed; none if empty.
        seed: Seed of the run.
        env: What the run's agent sees and does.
        learner: What its network is.

    Raises:
        ArtifactError: For what is no artifact.
        SpidarError: For a network that the run cannot go on with.
    """
    if not start:
        return None
    path = Path(start.replace("{seed}", str(seed)))
    found = read_artifact(path)
    widths = [learner.hidden] * 2
    same = (
        found.env_id == env.env_id
        and dict(found.arguments) == env.arguments
        and found.output == ("torso" if env.torso else "clip")
        and found.activation == learner.activation
        and (found.skip.size > 0) == learner.skip
        and [len(bias) for bias in found.biases[:-1]] == widths
        and (found.traced.tolist(), found.trace_times.tolist()) == (env.traced.tolist(), list(env.trace_times))
        and not found.washout.any()
    )
    if not same:
        raise SpidarError(
            f"{path} is another kind of network; valid: one of {env.env_id} {env.arguments} with torso={env.torso}, "
            f"hidden layers of {widths} {learner.activation}, skip={learner.skip}, trace_times={env.trace_times}"
        )
    return found


def first_layers(found: Artifact, action_scale: float = 1.0) -> Layers:
    """Its layers as those of an actor of which a 1 is `action_scale` of an action."""
    *first, (weight, bias) = zip(found.weights, found.biases, strict=True)
    if found.skip.size:
        weight = np.concatenate([weight, found.skip], axis=1)
    return (*first, (weight / action_scale, bias / action_scale))
