"""Random networks that fit their environment."""

from dataclasses import replace
from itertools import pairwise

import numpy as np

from spidar_gym.benchmark.track import CRAWL, HOVER
from spidar_gym.control.crawl.observation import crawl_layout
from spidar_gym.control.flight.observation import layout
from spidar_gym.envs.actions import ACTION_MODES, CRAWL_MODES, TORSO, find_action_mode
from spidar_gym.policies import external, torso
from spidar_gym.policies.artifact import Artifact
from spidar_gym.robot import N_ROTORS


def made(env_id=HOVER, mode="residual_wrench", *, scale=1.0, loud=1.0, hidden=(24, 16), preset=None, **options):
    """A random network that fits its environment; its outputs are in the middle of their range."""
    rng, crawls = np.random.default_rng(7), env_id == CRAWL
    size = find_action_mode(mode, CRAWL_MODES if crawls else ACTION_MODES).size
    fields = crawl_layout(size, clock=mode == TORSO) if crawls else layout(size)
    bound = np.concatenate([np.full(f.size, f.bound) for f in fields])
    shape = (len(bound), *hidden, size)
    weights = [rng.normal(size=(n, m)) / np.sqrt(m) for m, n in pairwise(shape)]
    weights[-1] *= loud
    arguments = {"action_mode": mode} | ({} if preset is None else {"preset": preset})
    known = {
        "name": "net", "kind": "residual", "doc": "Random.", "env_id": env_id, "arguments": arguments,
        "weights": tuple((scale * w).astype(np.float32) for w in weights),
        "biases": tuple(rng.normal(scale=0.2, size=n).astype(np.float32) for n in shape[1:]),
        "mean": 0.1 * bound * rng.normal(size=len(bound)),
        "variance": (0.2 * bound * rng.uniform(0.5, 1.5, len(bound))) ** 2,
    }  # fmt: skip
    return Artifact(**(known | options))


def feeling(loud=1.0, times=(0.1, 1.0), hidden=(24, 16), lag=0.05):
    """A random network on `tuned` that observes the external force, with traces of this force and of an error."""
    net, rng = made(hidden=hidden, loud=loud, preset="tuned"), np.random.default_rng(9)
    seen = net.sees
    traced = np.array([0.0, seen, seen + 1, seen + 5])
    more = external.SIZE + len(traced) * len(times)
    first = np.concatenate([net.weights[0], rng.normal(size=(hidden[0], more)) / np.sqrt(more)], axis=1)
    return replace(
        net, weights=(first.astype(np.float32), *net.weights[1:]), traced=traced, trace_times=np.array(times),
        mean=np.concatenate([net.mean, np.zeros(more)]), variance=np.concatenate([net.variance, np.full(more, 9.0)]),
        rotor_lag=np.array([lag]),
    )  # fmt: skip


def in_torso_axes(loud=0.1, traced=(0.0, 1.0, 2.0, 7.0), times=(0.1, 0.5), hidden=(40, 24), joints=True):
    """A random network in torso axes with outputs near a hover, traces and a skip matrix.

    Without `joints` the outputs of the joints are zero.
    """
    rng = np.random.default_rng(8)
    size = torso.FEATURES + len(traced) * len(times)
    weights = [rng.normal(size=(n, m)) / np.sqrt(m) for m, n in pairwise((size, *hidden, torso.ACTION))]
    biases = [rng.normal(scale=0.02, size=len(w)) for w in weights]
    skip = loud * rng.normal(size=(torso.ACTION, size)) / np.sqrt(size)
    weights[-1] *= loud
    if not joints:
        for last in (weights[-1], biases[-1], skip):
            last[3 * N_ROTORS :] = 0.0
    return Artifact(
        name="net", kind="learned", doc="Random.", env_id=HOVER, arguments={"action_mode": "direct"}, output="torso",
        weights=tuple(w.astype(np.float32) for w in weights),
        biases=tuple(b.astype(np.float32) for b in biases),
        mean=0.1 * rng.normal(size=size), variance=rng.uniform(0.5, 1.5, size),
        skip=skip.astype(np.float32),
        traced=np.array(traced), trace_times=np.array(times),
    )  # fmt: skip
