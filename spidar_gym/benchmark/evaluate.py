"""Evaluation in shards of one scenario each, in processes or on a Ray cluster; stored shards make it resumable."""

import hashlib
import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from spidar_gym.benchmark.content import check_times
from spidar_gym.benchmark.metrics import check_metrics, told_in
from spidar_gym.benchmark.resume import code_digest, digest_of, finish
from spidar_gym.benchmark.scenario import Scenario, load_scenarios, robot_scenarios, scenario_rng
from spidar_gym.benchmark.scoring import ACT_LIMIT_S, CONTROL, play_scenario, play_scenarios
from spidar_gym.benchmark.track import SCENARIOS, TRACKS, Track, find_track
from spidar_gym.border import require_form
from spidar_gym.errors import InvalidValueError, require_least, require_name
from spidar_gym.policies.guest import close_guests, keeps_to_itself, open_policy
from spidar_gym.policies.policy import Policy, acts_in_batches, policy_digest, policy_name

BEHAVIOUR = (
    "so3.py", "state.py", "robot", "model", "control", "native", "sim", "envs",
    "policies/rollout.py", "benchmark/scenario.py", "benchmark/scoring.py", "benchmark/tally.py",
    "benchmark/track.py",
)  # fmt: skip
"""Files and folders of the package that determine the metrics of an episode."""
RESULT = {"metrics": dict, "timing": {"act_s": [float, float], "step_s": [float, float], "wall_s": float}}
"""Form of an episode's result, see `play_scenario`."""


@dataclass(frozen=True)
class Score:
    """Results of a policy on a track."""

    track: str
    """Track."""
    split: str
    """Split."""
    scenarios_sha256: str
    """Hash of the scenarios' file."""
    indices: tuple[int, ...]
    """Indices of the evaluated scenarios."""
    metrics: dict[str, list[Any]]
    """`METRICS` by name, one value per scenario."""
    timing: list[dict[str, Any]]
    """Times of each scenario."""

    @property
    def errors(self) -> np.ndarray:
        """Errors of the scenarios."""
        return np.array(self.metrics["error"], float)

    @property
    def success(self) -> float:
        """Success rate."""
        return float(np.mean(self.metrics["success"]))


@dataclass(frozen=True)
class Shard:
    """One scenario to be run with one policy: the unit of work; its result does not depend on the worker."""

    policy: str
    """Specification of the policy: `module:Class` or the path of an artifact."""
    track: str
    """Track."""
    split: str
    """Split."""
    scenario: Scenario
    """Scenario."""
    act_limit_s: float = ACT_LIMIT_S
    """Largest time for one action [s]."""
    control: str = CONTROL
    """Implementation of the controller, see `play_scenario`."""
    run: int = 0
    """Number of the row's run; seeds the policy."""
    trust: bool = False
    """Whether the policy may be a zip of Stable-Baselines3, which can run code."""

    def load(self) -> Policy:
        """Open the policy without state from earlier episodes."""
        return open_policy(self.policy, trust=self.trust)

    def __str__(self) -> str:
        """Return policy, track and scenario as text."""
        return f"{self.policy} on {self.track}, scenario {self.scenario.index}"

    def key(self, digest: str) -> str:
        """Return the name of the stored result, which depends on the policy's file, the scenario and the code."""
        words = self.policy, digest, self.track, self.split, self.scenario, self.control, self.run
        return digest_of(*words, *calibration_words(TRACKS[self.track]), code_digest(*BEHAVIOUR))[:24]


def calibration_words(track: Track) -> list[str]:
    """Return the hash of the track's calibrated world, for names of stored results; nothing without a world."""
    return [] if track.calibration is None else [track.calibration.digest]


def play_shards(shards: Sequence[Shard]) -> list[dict[str, Any]]:
    """Run shards of one policy on one track: as a batch if the policy supports it, else each with a new policy."""
    first = shards[0]
    how: dict[str, Any] = {"act_limit_s": first.act_limit_s, "control": first.control, "run": first.run}
    if acts_in_batches(first.load()):
        return play(first.load(), first.track, [shard.scenario for shard in shards], **how)
    return [play(first.load(), first.track, [shard.scenario], **how)[0] for shard in shards]


def play(policy: Policy, name: str, scenarios: Sequence[Scenario], **how: Any) -> list[dict[str, Any]]:  # noqa: ANN401 - of `play_scenario`
    """Run a policy on scenarios of a track, batched if it supports that; `how` and results as in `play_scenario`."""
    if len(scenarios) > 1 and acts_in_batches(policy):
        return play_scenarios(policy, name, scenarios, **how)
    return [play_scenario(policy, name, scenario, **how) for scenario in scenarios]


def evaluate(
    policy: str | Policy,
    track: str,
    scenarios: int | Sequence[int] | None = None,
    *,
    split: str = "test",
    robots: str = "",
    workers: int = 1,
    folder: Path | None = None,
    ray: str | None = None,
    act_limit_s: float = ACT_LIMIT_S,
    run: int = 0,
    trust: bool = False,
    on_scenario: Callable[[], object] = lambda: None,
) -> Score:
    """Evaluate a policy on scenarios of a track.

    Args:
        policy: `module:Class`, the path of an artifact, or an object with `reset` and `act`, which is
            evaluated in this process.
        track: Track.
        scenarios: Number of scenarios from the first, their indices, or None for all.
        split: One of `SPLITS`.
        robots: File or name of a calibrated world whose robots replace those of a calibrated track; the scenarios are
            sampled anew, with the same starts and goals.
        workers: Number of processes.
        folder: Folder for finished scenarios, from which an interrupted evaluation resumes.
        ray: Address of a Ray cluster, `local` for one of `workers` workers on this machine.
        act_limit_s: Largest time for one action [s].
        run: Number of the run, the policy's seed in every scenario.
        trust: Whether the policy may be a zip of Stable-Baselines3, which can run code.
        on_scenario: Called after every scenario, for progress.

    Raises:
        PolicyError: When the policy raises, returns an invalid action, or exceeds the time limit.
        UnknownNameError: For a track or split that does not exist.
        InvalidValueError: For scenarios that the track does not have, or options that need a specification.
    """
    every, digest = _with_robots(track, split, robots) if robots else load_scenarios(track, split)
    if isinstance(scenarios, int) and not 1 <= scenarios <= len(every):
        raise InvalidValueError("scenarios", scenarios, f"a number within 1 … {len(every)}")
    indices = range(scenarios or len(every)) if scenarios is None or isinstance(scenarios, int) else scenarios
    if not indices:
        raise InvalidValueError("scenarios", list(indices), "at least one")
    for index in indices:
        if not 0 <= index < len(every):
            raise InvalidValueError("scenarios", index, f"an index within 0 … {len(every) - 1}")
    chosen = [every[index] for index in indices]
    if isinstance(policy, str):
        shards = [Shard(policy, track, split, each, act_limit_s, run=run, trust=trust) for each in chosen]
        results = run_shards(shards, workers=workers, folder=folder, ray=ray, on_done=lambda *_: on_scenario())
    else:
        if workers > 1 or folder is not None or ray is not None:
            raise InvalidValueError("policy", policy, "module:Class for more than one process, a folder, or Ray")
        results = []
        parts = [chosen] if acts_in_batches(policy) else [[scenario] for scenario in chosen]
        for part in parts:
            results += play(policy, track, part, act_limit_s=act_limit_s, run=run)
            for _ in part:
                on_scenario()
    names = told_in(TRACKS[track].world)
    columns = {name: [result["metrics"][name] for result in results] for name in names}
    return Score(track, split, digest, tuple(indices), columns, [result["timing"] for result in results])


def _with_robots(track: str, split: str, robots: str) -> tuple[tuple[Scenario, ...], str]:
    """Sample the scenarios of a track with other robots, and hash them."""
    require_name("split", split, find_track(track).splits)
    found = robot_scenarios(track, robots, (scenario_rng(track, split, k) for k in range(SCENARIOS)))
    return found, hashlib.sha256(json.dumps([asdict(each) for each in found]).encode()).hexdigest()


def evaluate_runs(
    policies: Sequence[str],
    tracks: Sequence[str],
    scenarios: int,
    *,
    on_track: Callable[[str], object] = lambda _: None,
    **how: Any,  # noqa: ANN401 - of `evaluate`
) -> dict[str, list[Score]]:
    """Evaluate all runs of one policy on the same scenarios of every track.

    Args:
        policies: Specifications, one for each run.
        tracks: Tracks.
        scenarios: Number of scenarios per track, from the first.
        on_track: Called with each track before its evaluation.
        **how: Further arguments of `evaluate`.

    Returns:
        Track → one score per run.
    """
    scores: dict[str, list[Score]] = {}
    for track in tracks:
        on_track(track)
        scores[track] = [evaluate(spec, track, scenarios, run=run, **how) for run, spec in enumerate(policies)]
    return scores


def run_shards(
    shards: Sequence[Shard],
    *,
    workers: int = 1,
    folder: Path | None = None,
    ray: str | None = None,
    on_done: Callable[[int, dict[str, Any]], object] = lambda k, result: None,
) -> list[dict[str, Any]]:
    """Run shards; arguments and results as in `finish`."""
    require_least(1, workers=workers)
    policies = {spec: shard.load() for spec, shard in {shard.policy: shard for shard in shards}.items()}
    if not all(map(keeps_to_itself, policies)):
        folder = None  # stored results must not be writable by the policy
    names: dict[str, tuple[str, str]] = {}
    if folder is not None:
        names = {spec: (policy_name(policy), policy_digest(policy)) for spec, policy in policies.items()}

    def name(shard: Shard) -> str:
        own, digest = names[shard.policy]
        return f"{own}/{shard.track}/{shard.key(digest)}"

    batches = {spec: acts_in_batches(policy) for spec, policy in policies.items()}
    together = [
        (shard.policy, shard.track, shard.split, shard.control, shard.act_limit_s, shard.run)
        if batches[shard.policy]
        else k
        for k, shard in enumerate(shards)
    ]
    if workers > 1 or ray is not None:
        close_guests()  # each worker opens its own
    try:
        return finish(
            play_shards, shards, workers=workers, ray=ray, folder=folder, name=name, check=_check_result,
            label=lambda k: str(shards[k]), on_done=on_done, together=together,
        )  # fmt: skip
    finally:
        close_guests()


def _check_result(shard: Shard, result: dict[str, Any]) -> None:
    """Refuse a stored result that no episode can have."""
    require_form(result, RESULT, "result")
    check_metrics(result["metrics"], world=TRACKS[shard.track].world)
    check_times(result["timing"])
