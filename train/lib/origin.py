"""Initial network of a run: loads an artifact of the same kind and converts it to the layers of an actor."""

from pathlib import Path

import numpy as np

from spidar_gym.errors import SpidarError
from spidar_gym.policies.artifact import Artifact, read_artifact
from train.lib.envs import EnvConfig
from train.lib.learner import Layers, LearnerConfig


def find_origin(start: str, seed: int, env: EnvConfig, learner: LearnerConfig) -> Artifact | None:
    """Load the artifact whose network initialises a run; None if `start` is empty.

    Args:
        start: Path of the artifact; {seed} is replaced by the seed.
        seed: Seed of the run.
        env: Observation and action settings of the run's agent.
        learner: Network settings of the run's agent.

    Raises:
        ArtifactError: If the file is not an artifact.
        SpidarError: If the network does not match the settings of the run.
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
    """Return the artifact's layers, rescaled so that an output of 1 is `action_scale` of the environment's action."""
    *first, (weight, bias) = zip(found.weights, found.biases, strict=True)
    if found.skip.size:
        weight = np.concatenate([weight, found.skip], axis=1)
    return (*first, (weight / action_scale, bias / action_scale))
