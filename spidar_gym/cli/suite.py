"""`spidar suite`: tasks for learning, results of standard algorithms and of a policy, the scale of the returns."""

from pathlib import Path
from typing import Any

import tyro

from spidar_gym.arguments import Flag, JsonArg
from spidar_gym.benchmark.scoring import ACT_LIMIT_S
from spidar_gym.benchmark.suite import EPISODES, anchoring, find_task, play
from spidar_gym.benchmark.suite_results import RESULTS, merged, read_results, results_text, suite_lines
from spidar_gym.console import kept, progress
from spidar_gym.envs.suite import ANCHORS, CEILING, CLASSICAL, LAZY, SUITE, SUITE_IDS, SuiteTask, read_anchors
from spidar_gym.errors import InvalidValueError, StaleAssetError, require_above, require_least
from spidar_gym.files import json_text, write_text
from spidar_gym.policies.guest import close_guests, open_policy
from spidar_gym.policies.policy import policy_name
from spidar_gym.processes import cpu_count
from spidar_gym.text import format_table

TOLERANCE = 0.02
"""Largest difference of a return played again, as a share of the task's scale: processors differ in the last bits, and
a fall amplifies them."""


def suite(
    task: tyro.conf.Positional[str | None] = None,
    policy: str = "",
    episodes: int = EPISODES,
    anchors: Flag = False,
    check: Flag = False,
    runs: Path | None = None,
    trust: Flag = False,
    act_limit: float = ACT_LIMIT_S,
    json: JsonArg = False,
) -> None:
    """Show the tasks for learning and the results of standard algorithms, or evaluate a policy on a task.

    `python -m train.standard TASK ALGORITHM` trains.

    Args:
        task: Task of the suite, or its id; with --anchors and --check all tasks if none is given.
        policy: Policy to evaluate: module:Class, a learned policy's artifact, or with --trust a zip of
            Stable-Baselines3.
        episodes: Number of episodes, with the first seeds of the evaluation.
        anchors: Play zero action, random policy and the best classical controller, and write their results, which
            define the scale of the returns, and the latter with the true state, a privileged
            ceiling where that is an option; for a new version of the suite.
        check: Play them again, and fail if a return differs by more than 2 % of the scale; takes about twenty minutes.
        runs: Folder with runs of train.standard; their results.csv are merged into the committed table.
        trust: Load zips saved by Stable-Baselines3. They can run any code: use only files that you trust.
        act_limit: Largest time of the policy for one action [s].
    """
    require_least(1, episodes=episodes)
    require_above(act_limit=act_limit)
    if (bool(policy) + anchors + check + (runs is not None)) > 1:
        raise InvalidValueError("suite", "several of --policy, --anchors, --check, --runs", "one of them")
    name = None if task is None else find_task(SUITE_IDS.get(task, task)).name
    if policy:
        if name is None:
            raise InvalidValueError("task", "none with --policy", f"one of {', '.join(SUITE)}")
        _evaluate(SUITE[name], policy, episodes, trust, act_limit, json)
    elif anchors or check:
        _anchor([*SUITE] if name is None else [name], check)
    elif runs is not None:
        _collect(runs)
    else:
        _show(name, json)


def _evaluate(task: SuiteTask, spec: str, episodes: int, trust: bool, act_limit: float, json: bool) -> None:
    chosen = open_policy(spec, trust=trust)
    try:
        with progress(total=episodes, unit="episode", desc=task.name) as bar:
            found = play(task.name, chosen, episodes, threads=cpu_count(), act_limit_s=act_limit, on_end=bar.update)
    finally:
        close_guests()
    scaled = float(task.normalised(found.returns.mean()))
    if json:
        terms = {name: float(value.mean()) for name, value in found.terms.items()}
        print(json_text({"task": task.name, "policy": policy_name(chosen), "episodes": episodes, "scaled": scaled,
                         **found.means, "terms": terms}))  # fmt: skip
        return
    terms = ", ".join(f"{name} {value.mean():.3g}" for name, value in found.terms.items())
    print(f"{policy_name(chosen)} on {task.id}, {episodes} episodes: {scaled:.3f} of the scale")
    print(", ".join(f"{name} {value:.4g}" for name, value in found.means.items()))
    print(f"terms of the return: {terms}")


def _anchor(names: list[str], check: bool) -> None:
    """Play the anchoring policies, and compare their results or write them, one after the other."""
    pairs = [(name, key, policy) for name in names for key, policy in anchoring(name).items()]
    with (
        progress(total=EPISODES * len(pairs), unit="episode", desc="anchors") as bar,
        kept(lambda: "a check keeps no results" if check else f"finished results are kept in {ANCHORS}"),
    ):
        for name, key, policy in pairs:
            sensors = False if key == CEILING else None
            episodes = play(name, policy, threads=cpu_count(), sensors=sensors, on_end=bar.update)
            terms = {term: round(float(value.mean()), 4) for term, value in episodes.terms.items()}
            found = {metric: round(value, 4) for metric, value in episodes.means.items()} | {"terms": terms}
            if check:
                _compare(SUITE[name], key, found)
            else:
                _keep(name, key, found)
    print(f"{len(names)} of {len(SUITE)} tasks {'as committed' if check else 'written'}: {ANCHORS}")


def _keep(name: str, key: str, found: dict[str, Any]) -> None:
    """Write the result of an anchoring policy beside the others."""
    read_anchors.cache_clear()
    tasks = read_anchors() if ANCHORS.exists() else {}
    tasks = {**tasks, name: {**tasks.get(name, {}), key: found}}
    ordered = {
        task: {each: tasks[task][each] for each in (*LAZY, CLASSICAL, CEILING) if each in tasks[task]}
        for task in SUITE if task in tasks
    }  # fmt: skip
    write_text(ANCHORS, json_text({"command": "spidar suite --anchors", "tasks": ordered}) + "\n")
    read_anchors.cache_clear()


def _compare(task: SuiteTask, key: str, found: dict[str, Any]) -> None:
    (zero, one), was = task.anchors, read_anchors()[task.name][key]["return"]
    if abs(found["return"] - was) > TOLERANCE * (one - zero):
        raise StaleAssetError(
            str(ANCHORS), "spidar suite --anchors", f"has {was:g} for {key} on {task.name}; now {found['return']:g}"
        )


def _collect(runs: Path) -> None:
    paths = sorted(runs.glob("*/*/results.csv"))
    if not paths:
        raise InvalidValueError("runs", str(runs), "a folder with TASK/ALGORITHM-SEED/results.csv")
    rows = read_results(RESULTS) if RESULTS.exists() else []
    for path in paths:
        rows = merged(rows, read_results(path))
    write_text(RESULTS, results_text(rows))
    print(f"{len(paths)} runs merged into {RESULTS}")


def _show(name: str | None, json: bool) -> None:
    rows = read_results(RESULTS) if RESULTS.exists() else []
    names = [*SUITE] if name is None else [name]
    if json:
        print(json_text({
            each: {"id": SUITE[each].id, "doc": SUITE[each].doc, "success": SUITE[each].success,
                   "options": dict(SUITE[each].options), "anchors": list(SUITE[each].anchors),
                   "budgets": dict(SUITE[each].budgets)}
            for each in names
        }))  # fmt: skip
        return
    for each in names:
        own = SUITE[each]
        print(f"{own.id}: {own.doc}; success: {own.success}")
    lines = suite_lines(rows)
    print()
    print(format_table([lines[0], *(line for line in lines[1:] if name is None or line[0] == name)], left=2))
