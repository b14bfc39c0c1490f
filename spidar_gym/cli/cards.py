"""Cards of methods, from their rows: CPU time, tuning, stability margins, and tracks where each is better or worse."""

import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from spidar_gym.benchmark.comparison import Comparison, compare_rows
from spidar_gym.benchmark.row import Row, read_rows
from spidar_gym.control.flight.controller import ControllerConfig
from spidar_gym.control.flight.margins import Margins
from spidar_gym.control.presets import controller_config
from spidar_gym.envs.registry import HOVER
from spidar_gym.margins import leg_lines
from spidar_gym.policies.load import load_policy
from spidar_gym.policies.policy import policy_arguments
from spidar_gym.policies.source import load_module, module_of
from spidar_gym.tune.flight import loops
from spidar_gym.tune.search import Search, find_search

SEARCHED = {
    "qp_tuned": ("flight",), "qp_robust_overlapped": ("crawl",), "qp_retuned": ("retuned", "recrawl"),
    "qp_steady": ("steady",),
}  # fmt: skip
"""Row → the built-in searches that found its parameters; for other rows the search has the name of the row."""

LEG_MARGINS = "docs/results/leg_margins.json"
"""Result of the study `margins`."""

Lines = list[list[str]]


def _row(root: Path, name: str) -> Row:
    """Read a committed row with all of its tracks."""
    return read_rows(root / "baselines" / "scores", name)[name]


def _log(root: Path, search: str) -> list[dict[str, Any]]:
    """Return the log of a search; empty if there is none."""
    path = root / "baselines" / "searches" / f"{search}.json"
    return json.loads(path.read_text(encoding="utf-8"))["log"] if path.exists() else []


def _step(row: Row) -> tuple[float, float]:
    """Return median and 99th percentile of the time of an environment step on the slowest track [ms]."""
    steps = [own["step_ms_p50_p99"] for own in row.content["timing"].values()]
    return max(median for median, _ in steps), max(most for _, most in steps)


def method_lines(root: Path, *names: str) -> Lines:
    """Return the table of the rows' costs: time of an environment step during evaluation, and length of the search."""
    lines = [["row", "time of a step, median", "99th percentile", "search"]]
    for name in names:
        median, most = _step(_row(root, name))
        log = [line for search in SEARCHED.get(name, (name,)) for line in _log(root, search)]
        lines.append([f"`{name}`", f"{median:.1f} ms", f"{most:.1f} ms", _searched(log) or "–"])
    return lines


def _searched(log: Sequence[dict[str, Any]]) -> str:
    ticks = sum(line["ticks"] for line in log)
    return f"{len(log)} generations, {ticks / 1e6:.1f} M ticks" if log else ""


def card_lines(root: Path, name: str, base: str) -> Lines:
    """Return the card of a row.

    Args:
        root: Root of the checkout.
        name: Name of the row; its policy is in `baselines/`.
        base: Name of the row for comparison.
    """
    row, other = _row(root, name), _row(root, base)
    spec = row.content["policies"][0]
    searches = _searches(spec, name)
    median, most = _step(row)
    unsolved = sum(int(row.column(track, "unsolved").sum()) for track in row.content["tracks"])
    found = compare_rows(row, other)
    lines = [
        [f"`{name}`", row.doc],
        ["command", f"`{row.content['command']}`"],
        ["parameters", _numbers(root, searches)],
    ]
    margins = _margins(spec, searches)
    if margins:
        lines.append(["margins", _least(margins)])
    lines += [["margins with legs", cell] for cell in _with_legs(root, spec)]
    return [
        *lines,
        ["time of a step", f"median {median:.1f} ms, 99th percentile {most:.1f} ms; {unsolved} without a solution"],
        [f"better than `{base}`", _places(found, lambda low, high: high < 0.0)],
        [f"worse than `{base}`", _places(found, lambda low, high: low > 0.0)],
    ]


def _searches(spec: str, name: str) -> dict[str, Search]:
    """Return the searches that found a policy's parameters, by their names for `spidar tune`."""
    module = module_of(spec)[0]
    if name in SEARCHED:
        return {own: find_search(own) for own in SEARCHED[name]}
    found = vars(load_module(module)).items()
    return {f"{module}:{own}": search for own, search in found if isinstance(search, Search) and search.name == name}


def _numbers(root: Path, searches: Mapping[str, Search]) -> str:
    """Return the origin of a policy's parameters, in words."""
    logs = {of: _searched(_log(root, search.name)) for of, search in searches.items()}
    origins = [f"`spidar tune {of}`: {log or 'initial values, chosen by hand; no log'}" for of, log in logs.items()]
    return "; ".join(origins) or "those of its components, or chosen by hand"


def _margins(spec: str, searches: Mapping[str, Search]) -> list[Margins]:
    """Return the margins of a policy's loops; none without loops of a rigid robot, as with an observed motion.

    A custom law's module holds its parameters in `FOUND`.
    """
    arguments = policy_arguments(load_policy(spec), HOVER)
    if arguments is None:
        return []
    own = next((search.loops for search in searches.values() if search.loops is not None), None)
    if "law" in arguments:
        return [*own(load_module(module_of(spec)[0]).FOUND)] if own is not None else []
    config = arguments.get("controller") or controller_config(arguments.get("preset", "paper"))
    is_rigid = isinstance(config, ControllerConfig) and config.motion != "observed"
    return loops(config) if is_rigid else []


def _with_legs(root: Path, spec: str) -> list[str]:
    """Return the worst margins with legs that bend, in words, if the result of the study `margins` has them."""
    preset = (policy_arguments(load_policy(spec), HOVER) or {}).get("preset")
    rows = json.loads((root / LEG_MARGINS).read_text(encoding="utf-8"))["result"]["leg_margins"]
    lines = dict(zip((row["controller"] for row in rows), leg_lines(rows)[1:], strict=True))
    return [
        f"gain margin {gain} ({gain_at}), delay margin {delay} ({delay_at}), rings from {rings}; each the worst of "
        "forms and calibrated robots"
        for _, gain, gain_at, delay, delay_at, _, _, rings, _ in (lines[own] for own in (spec, preset) if own in lines)
    ]


def _least(margins: Sequence[Margins]) -> str:
    """Return the worst margins of all axes, in words."""
    gain, delay = min(m.gain for m in margins), min(m.delay for m in margins)
    sensitivity, noise = max(m.sensitivity for m in margins), max(m.noise for m in margins)
    return (
        f"gain margin {gain:.2f}, delay margin {1e3 * delay:.0f} ms, sensitivity {sensitivity:.2f}, noise "
        f"{noise:.1f} s⁻¹; each for the worst of four axes"
    )


def _places(found: Sequence[Comparison], holds: Callable[[float, float], bool]) -> str:
    """Return the tracks on which the interval of the error's change fulfils `holds`, in words."""
    places = []
    for comparison in found:
        change = comparison.changes["error"]
        if holds(change.low, change.high):
            places.append(f"`{comparison.track}` {change.relative:+.0%} [{change.low:+.0%}, {change.high:+.0%}]")
    return ", ".join(places) or "on no track"
