"""Artifacts of random networks, of any size and of the size which an environment requires."""

from functools import cache
from itertools import pairwise

import numpy as np

from spidar_gym.benchmark.track import HOVER
from spidar_gym.policies.artifact import Artifact, interface


@cache
def sizes(env_id):
    """Sizes of an observation and of an action."""
    shown = interface(env_id, {})
    return sum(size for _, size, _ in shown["observation"]), shown["action"]


def network(shape, seed=0, scale=1.0):
    """Weights and biases of a network with these layers."""
    rng = np.random.default_rng(seed)
    pairs = list(pairwise(shape))
    weights = tuple((scale * rng.normal(size=(n, m)) / np.sqrt(m)).astype(np.float32) for m, n in pairs)
    return weights, tuple((scale * 0.3 * rng.normal(size=n)).astype(np.float32) for _, n in pairs)


def made(shape=(3, 8, 5, 2), *, seed=0, scale=1.0, **options):
    weights, biases = network(shape, seed, scale)
    rng = np.random.default_rng(seed + 1)
    known = {"name": "net", "kind": "learned", "doc": "A net.", "env_id": HOVER, "arguments": {}}
    known |= {"mean": rng.normal(size=shape[0]), "variance": rng.uniform(0.2, 3.0, shape[0])}
    return Artifact(**(known | {"weights": weights, "biases": biases} | options))


def flier(env_id=HOVER, **options):
    """An artifact that fits its environment."""
    n, m = sizes(env_id)
    training = {"seed": 3, "steps": 1000, "curve": [[0, 0.1], [1000, 0.5]], "command": "train ½"}
    return made((n, 6, 5, m), **({"env_id": env_id, "training": training} | options))
