"""Courses of no track: drawn by the environment from seeds, and played side by side in the engine."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from spidar_gym.benchmark.scenario import Scenario
from spidar_gym.benchmark.track import CAP
from spidar_gym.envs.registry import COURSE
from spidar_gym.envs.vector import NativeVectorEnv
from spidar_gym.errors import require_name
from spidar_gym.policies.actor import Actor
from spidar_gym.policies.policy import BatchPolicy, policy_arguments
from train.lib.evaluate import Bench

TRACKS: Mapping[str, Mapping[str, Any]] = {"course-mixed": {"sensors": True, "randomization": 0.5}}
"""Kinds of courses by name: arguments of the environment."""
TIME_SCALE, ENERGY_SCALE = 100.0, 60.0
"""A course that takes so long [s], and so much energy [Wh], has error 1."""
VALIDATION = 1000
"""Seeds of what is validated on begin here; those of training lie above 2³¹."""
ROOM = 50
"""So many there are."""
ACT_LIMIT_S = 10.0
"""How long the policy may think about one action of each [s]."""


def load(name: str, split: str) -> tuple[Sequence[Scenario], str]:
    """Courses to validate on."""
    require_name("track", name, TRACKS)
    require_name("split", split, ("validation",))
    return [Scenario(k, VALIDATION + k, {}, None, {}, "") for k in range(ROOM)], ""


def draw(name: str, rng: np.random.Generator, index: int) -> Scenario:
    """One of any generator."""
    require_name("track", name, TRACKS)
    return Scenario(index, int(rng.integers(2**31)), {}, None, {}, "")


def play(
    policy: BatchPolicy, name: str, scenarios: Sequence[Scenario], *, control: str = "core"
) -> list[dict[str, Any]]:  # fmt: skip
    """What a policy does on courses, to the end of each: `metrics` as the benchmark names them.

    Args:
        policy: Who acts, for all of them at once.
        name: Kind of courses.
        scenarios: Which ones.
        control: `core`: the engine has no other.
    """
    require_name("control", control, ("core",))
    require_name("track", name, TRACKS)
    count = len(scenarios)
    arguments = policy_arguments(policy, COURSE) or {}
    envs = NativeVectorEnv(COURSE, count, autoreset_mode="Disabled", **TRACKS[name], **arguments)
    envs.reset(seed=[one.seed for one in scenarios])
    fleet, shape = envs.fleet, envs.action_space.shape or ()
    actor = Actor(policy, shape, name, limit_s=ACT_LIMIT_S * count)
    actor.reset_batch([one.seed for one in scenarios])
    ids = np.arange(count)
    while ids.size:
        # A copy: what a policy does to its observations changes nothing.
        envs.advance(actor.act_batch(fleet.observations.copy()), ids)
        over = fleet.terminated | fleet.truncated | fleet.infos["finished"].astype(bool)
        ids = ids[~over[ids]]
    found = [{"metrics": _metrics(info, bool(lost))} for info, lost in zip(fleet.infos, fleet.terminated, strict=True)]
    envs.close()
    return found


def _metrics(info: Any, lost: bool) -> dict[str, Any]:  # noqa: ANN401 - a record
    """Numbers of a course that is over."""
    arrived, seconds, energy = bool(info["finished"]), float(info["time_s"]), float(info["info"]["energy_wh"])
    error = 0.5 * (seconds / TIME_SCALE + energy / ENERGY_SCALE)
    return {
        "success": arrived and not lost,
        "failed": lost or not arrived,
        "error": min(CAP, error) if arrived and not lost else CAP,
        "duration_s": seconds,
        "energy_wh": energy,
        "final_error_m": float(info["distance_m"]),
        "hit_n": float(info["most_hit_n"]),
    }


def compared(name: str) -> tuple[str, ...]:
    """The error alone: who hits something at once has taken neither time nor energy."""
    require_name("track", name, TRACKS)
    return ("error",)


COURSES = Bench(load, draw, play, compared)
"""These courses in place of the benchmark's."""
