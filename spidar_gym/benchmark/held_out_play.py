"""Evaluation under held-out conditions: selection of policies and of their comparison, and the resumable run."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from spidar_gym.benchmark.evaluate import BEHAVIOUR, RESULT, calibration_words, play
from spidar_gym.benchmark.held_out import CONDITIONS, COUNT, draw_held_out
from spidar_gym.benchmark.metrics import check_metrics
from spidar_gym.benchmark.resume import code_digest, digest_of, finish
from spidar_gym.benchmark.row import BASES, Row, require_one_policy
from spidar_gym.benchmark.scenario import Scenario
from spidar_gym.benchmark.verify import require_own_policies
from spidar_gym.border import require_form
from spidar_gym.envs.registry import ENVIRONMENTS
from spidar_gym.errors import InvalidValueError, require_name
from spidar_gym.policies.guest import close_guests, keeps_to_itself, open_policy
from spidar_gym.policies.policy import (
    Policy,
    acts_in_batches,
    defined_on,
    policy_arguments,
    policy_digest,
    policy_kind,
    policy_name,
)


@dataclass(frozen=True)
class Entrant:
    """Policy to evaluate: the runs of a row, or the user's files."""

    name: str
    """Name of the policy."""
    kind: str
    """One of `KINDS`."""
    policies: tuple[str, ...]
    """Specification of each run."""
    against: str
    """Name of the policy for comparison; empty for no comparison."""
    conditions: tuple[str, ...]
    """Conditions on which the policy is defined."""


@dataclass(frozen=True)
class Episode:
    """One scenario of a condition, to be run with one policy."""

    policy: str
    """Specification of the policy."""
    condition: str
    """Condition."""
    scenario: Scenario
    """Scenario."""

    def __str__(self) -> str:
        """Return policy, condition and scenario as text."""
        return f"{self.policy} on {self.condition}, scenario {self.scenario.index}"


def choose(
    rows: Mapping[str, Row],
    names: Sequence[str] = (),
    policies: Sequence[str] = (),
    against: str = "",
    *,
    trust: bool = False,
) -> list[Entrant]:
    """Select the policies to evaluate and the policies with which they are compared.

    Args:
        rows: Rows by name.
        names: Names of the rows to evaluate. Without names and policies, all rows of policies that act through a
            controller are selected.
        policies: Specifications of a candidate policy, one per run.
        against: Row, or preset that has a row, with which the candidate is compared; by default the preset of a
            residual candidate.
        trust: Whether rows may run code from outside the package and the committed baselines.

    Raises:
        UnknownNameError: For a row or preset that does not exist.
        InvalidValueError: For a candidate with the name of a selected row, or compared with a policy that has no row.
        RowError: For a row whose policy's file has changed since its evaluation, or may not run.
    """
    for name in names:
        require_name("row", name, rows)
    if against and not policies:
        raise InvalidValueError("against", against, "a candidate that is compared with it, --policy FILE …")
    own = _candidate(rows, policies, against) if policies else None
    chosen = set(names)
    if own is not None:
        chosen |= {own.against} - {""}
    elif not names:
        chosen = set(rows)
    chosen |= {rows[name].base for name in chosen} & set(rows)
    found = []
    for name, row in rows.items():
        if name in chosen:
            require_own_policies(row, trust=trust)
            # Most policies without a controller fall in every condition; they are evaluated only if named.
            if names or own is not None or _has_controller(open_policy(row.policies[0])):
                entrant = _entrant(name, row.kind, row.policies, row.base if row.base in rows else "")
                found += [entrant] if entrant.conditions else []
    if own is not None:
        if own.name in chosen:
            raise InvalidValueError("policy", own.name, "a candidate with another name than the rows")
        found.append(own)
    return found


def _candidate(rows: Mapping[str, Row], specs: Sequence[str], against: str) -> Entrant:
    """Return the candidate with the row for its comparison."""
    policies = [open_policy(spec) for spec in specs]
    require_one_policy(policies, specs)
    name, kind = policy_name(policies[0]), policy_kind(policies[0])
    if against:
        require_name("row or preset", against, (*rows, *BASES))
    elif kind == "residual":
        against = str(_arguments(policies[0])[0].get("preset", ""))
    base = BASES.get(against, against)
    if base and base not in rows:
        raise InvalidValueError("against", against, f"one of {', '.join(rows)}, or a preset with a row among them")
    return _entrant(name, kind, tuple(specs), base)


def _entrant(name: str, kind: str, policies: tuple[str, ...], against: str) -> Entrant:
    defined = defined_on(open_policy(policies[0]))
    conditions = tuple(name for name, condition in CONDITIONS.items() if condition.env_id in defined)
    return Entrant(name, kind, policies, against, conditions)


def _arguments(policy: Policy) -> list[dict[str, Any]]:
    """Return the policy's arguments for each environment on which it is defined."""
    return [chosen for env_id in ENVIRONMENTS if (chosen := policy_arguments(policy, env_id)) is not None]


def _has_controller(policy: Policy) -> bool:
    return any(chosen.get("action_mode") != "direct" for chosen in _arguments(policy))


def plan(entrants: Sequence[Entrant], count: int = COUNT) -> list[Episode]:
    """Return the episodes to run: the first `count` scenarios of each condition, for every run."""
    return [
        Episode(policy, condition, scenario)
        for entrant in entrants
        for policy in entrant.policies
        for condition in entrant.conditions
        for scenario in draw_held_out(condition, count)
    ]


def play_episodes(episodes: Sequence[Episode]) -> list[dict[str, Any]]:
    """Run episodes of one policy in one condition: as a batch if supported, else each with a new policy."""
    policy, name = episodes[0].policy, episodes[0].condition
    scenarios, how = [one.scenario for one in episodes], {"track": CONDITIONS[name]}
    if acts_in_batches(open_policy(policy)):
        return play(open_policy(policy), name, scenarios, **how)
    return [play(open_policy(policy), name, [scenario], **how)[0] for scenario in scenarios]


def play_all(
    episodes: Sequence[Episode],
    *,
    workers: int = 1,
    folder: Path | None = None,
    on_episode: Callable[[], object] = lambda: None,
) -> list[dict[str, Any]]:
    """Run the episodes without a stored result.

    Args:
        episodes: Episodes.
        workers: Number of processes.
        folder: Folder for finished episodes, from which an interrupted run resumes.
        on_episode: Called after every episode, for progress.

    Returns:
        `METRICS` by name for each episode.

    Raises:
        PolicyError: When a policy raises, returns an invalid action, or exceeds the time limit.
    """
    policies = {spec: open_policy(spec) for spec in dict.fromkeys(one.policy for one in episodes)}
    names = {spec: (policy_name(policy), policy_digest(policy)) for spec, policy in policies.items()}
    batches = {spec: acts_in_batches(policy) for spec, policy in policies.items()}

    def name(one: Episode) -> str:
        own, digest = names[one.policy]
        words = one.policy, digest, one.condition, one.scenario, code_digest(*BEHAVIOUR, "benchmark/held_out.py")
        return f"{own}/{one.condition}/{digest_of(*words, *calibration_words(CONDITIONS[one.condition]))[:24]}"

    if not all(map(keeps_to_itself, policies)):
        folder = None  # stored results must not be writable by a policy
    if workers > 1:
        close_guests()  # each worker opens its own
    try:
        results = finish(
            play_episodes, episodes, workers=workers, folder=folder, name=name, check=_check_result,
            label=lambda k: str(episodes[k]), on_done=lambda *_: on_episode(),
            together=[(e.policy, e.condition) if batches[e.policy] else (k,) for k, e in enumerate(episodes)],
        )  # fmt: skip
    finally:
        close_guests()
    return [result["metrics"] for result in results]


def _check_result(episode: Episode, result: dict[str, Any]) -> None:
    """Refuse a stored result that no episode can have."""
    require_form(result, RESULT, "result")
    check_metrics(result["metrics"], world=CONDITIONS[episode.condition].world)
