"""Held-out results: the file of all policies' metrics, their comparisons, and the lines of the tables."""

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from spidar_gym.benchmark.comparison import COMPARED, Comparison, compare_columns, comparison_cells
from spidar_gym.benchmark.held_out import CONDITIONS, draw_held_out, scenarios_digest
from spidar_gym.benchmark.held_out_play import Entrant, Episode
from spidar_gym.benchmark.metrics import METRICS
from spidar_gym.benchmark.row import row_hash
from spidar_gym.benchmark.statistics import iqm
from spidar_gym.border import BorderError, parse_json, read_file, require_form
from spidar_gym.errors import InvalidValueError, SpidarError, require_name
from spidar_gym.files import write_text
from spidar_gym.policies.guest import open_policy
from spidar_gym.policies.policy import KINDS, check_line, check_name, policy_digest
from spidar_gym.policies.provenance import processor, versions
from spidar_gym.robot.description import model_hash
from spidar_gym.text import code

FORMAT = 1
"""Version of the file's format."""
WRITER = "spidar leaderboard held-out"
"""Command that writes the file."""
KEPT = {group: (*metrics, "success", "failed") for group, metrics in COMPARED.items()}
"""Metrics in the file, by group of tracks."""
DIGITS = 1
"""Decimal places of percentages, enough to show whether an interval ends above 2 %."""

MOST_BYTES = 2**26
"""Largest size of the file [bytes]."""
FORM = {
    "format": int, "command": str, "versions": {str: str}, "processor": str, "model_sha256": str, "scenarios": int,
    "conditions": {str: str},
    "policies": [
        {
            "name": str, "kind": str, "against": str, "policies": [str], "policies_sha256": [str],
            "runs": {str: [{str: list}]},
        }
    ],
    "sha256": str,
}  # fmt: skip
"""Form of the file: `conditions` has the hashes of the scenarios, `runs` one value per scenario for each metric."""


# ---- the file ----


def make_content(
    entrants: Sequence[Entrant], episodes: Sequence[Episode], metrics: Sequence[Mapping[str, Any]], *, command: str
) -> dict[str, Any]:
    """Assemble the content of the file.

    Args:
        entrants: Evaluated policies.
        episodes: Episodes: for every run the same number of scenarios of each condition, in order.
        metrics: `METRICS` by name for each episode.
        command: Command line that reproduces the file.
    """
    found: dict[tuple[str, str], list[Mapping[str, Any]]] = {}
    for episode, own in zip(episodes, metrics, strict=True):
        found.setdefault((episode.policy, episode.condition), []).append(own)
    count = len(next(iter(found.values())))

    def run(policy: str, condition: str) -> dict[str, list[Any]]:
        return {name: [own[name] for own in found[policy, condition]] for name in KEPT[CONDITIONS[condition].group]}

    played = [name for name in CONDITIONS if any(condition == name for _, condition in found)]
    content: dict[str, Any] = {
        "format": FORMAT,
        "command": command,
        "versions": versions(),
        "processor": processor(),
        "model_sha256": model_hash(),
        "scenarios": count,
        "conditions": {name: scenarios_digest(draw_held_out(name, count)) for name in played},
        "policies": [
            {
                "name": entrant.name,
                "kind": entrant.kind,
                "against": entrant.against,
                "policies": list(entrant.policies),
                "policies_sha256": [policy_digest(open_policy(policy)) for policy in entrant.policies],
                "runs": {name: [run(policy, name) for policy in entrant.policies] for name in entrant.conditions},
            }
            for entrant in entrants
        ],
    }
    return {**content, "sha256": row_hash(content)}


def content_text(content: Mapping[str, Any]) -> str:
    """Format the file: one line for every condition of every policy."""

    def words(value: object) -> str:
        return json.dumps(value, ensure_ascii=False)

    policies = []
    for entry in content["policies"]:
        head = [f"   {words(key)}: {words(value)}" for key, value in entry.items() if key != "runs"]
        runs = [f"    {words(name)}: {words(own)}" for name, own in entry["runs"].items()]
        policies.append("  {\n" + ",\n".join([*head, '   "runs": {\n' + ",\n".join(runs) + "\n   }"]) + "\n  }")
    lines = [f" {words(key)}: {words(value)}" for key, value in content.items() if key not in ("policies", "sha256")]
    lines += [' "policies": [\n' + ",\n".join(policies) + "\n ]", f' "sha256": {words(content["sha256"])}']
    return "{\n" + ",\n".join(lines) + "\n}\n"


def write_content(path: Path, content: Mapping[str, Any]) -> None:
    """Write the file atomically."""
    write_text(path, content_text(content))


def read_content(path: Path) -> dict[str, Any]:
    """Read and check the content of a file.

    Raises:
        SpidarError: When it cannot be read, was edited by hand, has another format or robot, or has values that no
            condition can have.
    """
    try:
        content = parse_json(read_file(path, MOST_BYTES))
        require_form(content, FORM, path.name)
        if content["sha256"] != row_hash(content):
            raise BorderError("it was edited by hand: its hash does not match")
        if (content["format"], content["model_sha256"]) != (FORMAT, model_hash()):
            raise BorderError("another format or another robot model")
        for text in (content["command"], content["processor"], *content["versions"].values()):
            check_line("words", text)
        for entry in content["policies"]:
            _check_entry(entry, content)
    except SpidarError as error:
        raise SpidarError(f"{path}: {error}; valid: the file that `{WRITER}` writes") from error
    return content


def _check_entry(entry: Mapping[str, Any], content: Mapping[str, Any]) -> None:
    """Check the texts of a policy, and that it has a value for each scenario, metric and run."""
    check_name(entry["name"])
    require_name("kind", entry["kind"], KINDS)
    if entry["against"]:
        require_name("policy", entry["against"], [other["name"] for other in content["policies"]])
    for spec in entry["policies"]:
        check_line("policies", spec)
    for name, runs in entry["runs"].items():
        require_name("condition", name, [known for known in CONDITIONS if known in content["conditions"]])
        if not len(runs) == len(entry["policies"]) == len(entry["policies_sha256"]) > 0:
            raise InvalidValueError(f"runs of {entry['name']} on {name}", len(runs), "one a policy, at least one")
        for run in runs:
            _check_run(run, name, content["scenarios"])


def _check_run(run: Mapping[str, list[Any]], name: str, count: int) -> None:
    condition = CONDITIONS[name]
    if set(run) != set(KEPT[condition.group]) or any(len(values) != count for values in run.values()) or count < 1:
        raise InvalidValueError(name, sorted(run), f"{count} of each of {', '.join(KEPT[condition.group])}")
    failed = [value is True for value in run["failed"]]
    for metric, values in run.items():
        if (k := METRICS[metric].odd(values, failed, world=condition.world)) is not None:
            raise InvalidValueError(f"{metric} on {name}", values[k], METRICS[metric].expected)


# ---- its lines ----


def _column(entry: Mapping[str, Any], condition: str, metric: str) -> np.ndarray:
    """Return a metric, shape (runs, scenarios); NaN where a diverged simulation left no value."""
    return np.array([run[metric] for run in entry["runs"][condition]], float)


def compare_held_out(content: Mapping[str, Any], entry: Mapping[str, Any], condition: str) -> Comparison | None:
    """Compare a policy's runs with the mean of the other policy's runs; None where either lacks the condition."""
    base = next((other for other in content["policies"] if other["name"] == entry["against"]), None)
    if base is None or condition not in entry["runs"] or condition not in base["runs"]:
        return None

    def columns(metric: str) -> tuple[np.ndarray, np.ndarray]:
        return _column(base, condition, metric).mean(axis=0), _column(entry, condition, metric)

    return compare_columns(columns, CONDITIONS[condition].group, entry["name"], base["name"], condition)


def held_out_lines(content: Mapping[str, Any], group: str) -> list[list[str]]:
    """Return the results of flights, crawls or courses: a heading and one line per condition and policy.

    Values are interquartile means over the scenarios of the mean over the runs; – where a policy was not evaluated.
    The successes on robots of a calibrated world are followed by those on each variant, where variants differ.

    Args:
        content: Content of the file.
        group: `flight`, `ground` or `course`.

    Raises:
        UnknownNameError: For another group.
    """
    require_name("group", group, COMPARED)
    evaluated = {name for name in CONDITIONS if name in content["conditions"]}
    conditions = [name for name, condition in CONDITIONS.items() if condition.group == group and name in evaluated]
    lines = [["condition", "policy", "against", *(heading for heading, *_ in COMPARED[group].values()), "success"]]
    for condition in conditions:
        for entry in content["policies"]:
            if any(name in entry["runs"] for name in conditions):
                head = [condition, entry["name"], entry["against"]]
                lines.append([*head, *_cells(content, entry, condition, group)])
    return lines


def _cells(content: Mapping[str, Any], entry: Mapping[str, Any], condition: str, group: str) -> list[str]:
    if condition not in entry["runs"]:
        return ["–"] * (len(COMPARED[group]) + 1)
    compared, success = compare_held_out(content, entry, condition), _column(entry, condition, "success")
    parts = "".join(f"; {name} {success[:, k].mean():.0%}" for name, k in _variants(condition, content["scenarios"]))
    if compared is not None:
        *cells, last = comparison_cells(compared, group, digits=DIGITS)
        return [*cells, last + parts]
    cells = []
    for metric, (_, factor, unit) in COMPARED[group].items():
        value = float(iqm(_column(entry, condition, metric).mean(axis=0)))
        cells.append("–" if math.isnan(value) else f"{factor * value:.3g} {unit}".strip())
    return [*cells, f"{success.mean():.0%}{parts}"]


def _variants(name: str, count: int) -> list[tuple[str, list[int]]]:
    """Return the scenarios of each variant of a calibrated world; nothing where all variants are alike."""
    condition = CONDITIONS[name]
    robots = [condition.robots(k) for k in range(count)]
    world = robots[0].world
    if world is None:
        return []
    ranges = {(mixture, variant): tuple(row.kinds[k] for row in robots[0].rows)
              for k, (mixture, variant) in enumerate(world.pairs)}  # fmt: skip
    if all(len({ranges[mixture, variant] for variant, _ in world.variants}) == 1 for mixture, _ in world.mixtures):
        return []
    own = [world.pairs[each.kind][1] for each in robots]
    return [(variant, [k for k, name in enumerate(own) if name == variant]) for variant, _ in world.variants]


def worst_lines(content: Mapping[str, Any]) -> list[list[str]]:
    """Return the largest loss of each compared policy: the highest upper end of an interval, with its condition.

    A missing value on either side counts as the largest loss.
    """
    lines = [["policy", "runs", "against", "largest upper end", "of", "on"]]
    for entry in content["policies"]:
        ends = []
        for condition in entry["runs"]:
            compared = compare_held_out(content, entry, condition)
            for metric, change in ({} if compared is None else compared.changes).items():
                end = math.inf if math.isnan(change.high) else change.high
                ends.append((end, COMPARED[CONDITIONS[condition].group][metric][0], condition))
        if ends:
            end, heading, condition = max(ends, key=lambda found: found[0])
            share = f"{end:+.{DIGITS}%}" if math.isfinite(end) else "none: it diverged"
            lines.append([entry["name"], str(len(entry["policies"])), entry["against"], share, heading, condition])
    return lines


def origin_lines(content: Mapping[str, Any]) -> list[list[str]]:
    """Return the origin of the file: a heading and one line."""
    heads = ["command", "scenarios a condition", "spidar_gym", "processor"]
    own = [code(content["command"]), str(content["scenarios"]), content["versions"].get("spidar-gym", "")]
    return [heads, [*own, content["processor"]]]


def condition_lines() -> list[list[str]]:
    """Return the conditions and their deviations: a heading and one line each."""
    return [["condition", "what is wrong"], *([f"`{name}`", c.doc] for name, c in CONDITIONS.items())]
