"""Generate the tables of figures in the guide and README, between two markers, from committed JSON."""

import json
import re
from collections.abc import Callable
from datetime import date
from pathlib import Path
from typing import Any

from spidar_gym.benchmark.comparison import compare_rows, comparison_tables
from spidar_gym.benchmark.held_out import HELD_OUT
from spidar_gym.benchmark.held_out_table import condition_lines, held_out_lines, origin_lines, read_content, worst_lines
from spidar_gym.benchmark.leaderboard import FRONT, ranked, tabulate
from spidar_gym.benchmark.leaderboard_tables import first_lines, order_lines, part_cell, result_on, track_lines
from spidar_gym.benchmark.row import BASES, read_row, read_rows
from spidar_gym.benchmark.suite_results import RESULTS as SUITE_RESULTS
from spidar_gym.benchmark.suite_results import read_results, suite_lines, task_lines, variant_lines
from spidar_gym.benchmark.track import CALIBRATED, FLIGHT, TRACKS, WORLD
from spidar_gym.cli.bench import engine_lines
from spidar_gym.cli.bench_in_turn import effect_lines, grasp_lines
from spidar_gym.cli.cards import card_lines, method_lines
from spidar_gym.control.presets import FORMER_PRESETS, PRESETS, controller_config
from spidar_gym.errors import InvalidValueError, SpidarError, UnknownNameError
from spidar_gym.margins import leg_lines, preset_margins
from spidar_gym.onboard.topics_file import topic_lines
from spidar_gym.paper.crawl import crawl_lines
from spidar_gym.paper.crawl_study import study_lines
from spidar_gym.paper.flight import flight_lines
from spidar_gym.paper.flight_studies import speed_lines
from spidar_gym.sim.worlds import find_world, world_lines
from spidar_gym.sitl.course_faults import course_fault_lines
from spidar_gym.sitl.first_flights import first_flight_lines
from spidar_gym.studies.ablations import ablation_lines
from spidar_gym.studies.calibrate import fit_lines, profile_lines
from spidar_gym.studies.drift import drift_lines
from spidar_gym.studies.energy import energy_lines
from spidar_gym.studies.flights import flight_lines as calibrated_flight_lines
from spidar_gym.studies.frontier import frontier_lines
from spidar_gym.studies.gates import gate_lines
from spidar_gym.studies.hidden import hidden_lines
from spidar_gym.studies.hops import hop_lines
from spidar_gym.studies.lost import lost_lines
from spidar_gym.studies.margins import check_lines
from spidar_gym.studies.reality import reality_lines
from spidar_gym.studies.sagging import sagging_lines
from spidar_gym.studies.searches import search_lines
from spidar_gym.studies.steps import step_lines
from spidar_gym.text import format_table
from spidar_gym.tune.flight import loops, margin_lines

RESULTS = Path("docs") / "results"
"""Folder of the committed results in a clone."""
BEGIN, END = "<!-- table: {} -->", "<!-- /table -->"
"""Markers around a table; `table:` is followed by a name of `COMPUTED` with its arguments, or by a result's name."""
MARKED = re.compile(r"^<!-- table: ([^\n]*?) -->\n(?:(?!<!-- table:).)*?^<!-- /table -->$", re.DOTALL | re.MULTILINE)
KEYS = {"command", "version", "date"}
"""Keys of every result: the command that reproduces it, and version and date of its measurement."""

Lines = list[list[str]]


def _compared(root: Path, name: str, base: str, group: str = "") -> Lines:
    """Return the comparison of two rows, on the tracks of one group if both rows have tracks of several groups."""
    row, other = (read_row(root / "baselines" / "scores" / f"{n}.json") for n in (name, base))
    found = compare_rows(row, other)
    tables = comparison_tables([each for each in found if not group or TRACKS[each.track].group == group])
    if len(tables) != 1:
        raise InvalidValueError("compare", f"{name} {base}", "rows with tracks of one group, or the group after them")
    return tables[0]


def _overall(root: Path, count: str = "") -> Lines:
    lines = first_lines(tabulate(read_rows(root / "baselines" / "scores")), wide=not count)
    return lines[: int(count) + 1] if count else lines


def _track(root: Path, track: str, *names: str) -> Lines:
    """Return the rows of a track, or only those with the given names."""
    heading, *lines = track_lines(tabulate(read_rows(root / "baselines" / "scores")), track)
    return [heading, *(line for line in lines if not names or line[0] in names)]


def _margins(root: Path, preset: str) -> Lines:
    return margin_lines(loops(controller_config(preset)))


def _orders(root: Path) -> Lines:
    """Return the least margins of each flight preset, rigid and with legs that bend, its places and its results.

    Margins with legs are the worst over forms and calibrated robots; results are those on each variant of the robots.
    """
    board = tabulate(read_rows(root / "baselines" / "scores"))
    heads, *places = order_lines(board)
    order = ranked(board, [CALIBRATED[FLIGHT]])
    variants = [name for name, _ in find_world(WORLD).variants]
    lines = [["preset", "rigid: gain, delay", "with legs: gain, delay", *heads[1:3],
              *(f"{name}: error, failed" for name in variants)]]  # fmt: skip
    with_rows = [preset for preset in (*PRESETS, *FORMER_PRESETS) if BASES.get(preset) in order]
    for preset in sorted(with_rows, key=lambda preset: order.index(BASES[preset])):
        name, config, legs = BASES[preset], controller_config(preset), preset_margins(preset)
        pairs = [(min(m.gain for m in loops(config)), min(m.delay for m in loops(config))), (legs.gain, legs.delay)]
        cells = [f"{gain:.2f}, {1e3 * delay:.0f} ms" for gain, delay in pairs]
        if config.motion == "observed":  # the loops of a rigid robot have no observer
            cells[0] = "–"
        nominal, calibrated = next(line[1:3] for line in places if line[0] == name)
        halves = [part_cell(result_on(board, name, FRONT[CALIBRATED[FLIGHT]], variant)) for variant in variants]
        lines.append([preset, *cells, nominal, calibrated, *halves])
    return lines


SUMMARY = {
    "flight_quasi": (
        "RMSE position x y z, 0–27 s [m]", "RMSE attitude x y z, 0–27 s [rad]", "θ of rotors 1 3 5 7, form ③ [rad]",
        "allocated τ₂, form ③ [Nm]", "endurance in form ① (calibrated) [min]",
    ),
    "crawl": (
        "final position error x y z [mm]", "duration [s]", "Σλ / mg, mean", "endurance (predicted) [min]",
    ),
}  # fmt: skip
"""Result → labels of its lines that README shows."""


def _summary(root: Path) -> Lines:
    """Return the paper's experiments in about eight lines, with the ratio of the real errors to the calibrated ones."""
    lines = [["experiment", "", "nominal", "with noise", "calibrated", "paper", "paper ÷ calibrated"]]
    for name, chosen in SUMMARY.items():
        result = read_result(root / RESULTS / f"{name}.json")
        rows = {first: rest for first, *rest in DRAWN[result["table"]](result["result"])}
        for label in chosen:
            *_, calibrated, paper = rows[label]
            ratio = "–"
            if label.startswith(("RMSE", "final")):  # errors
                pairs = zip(calibrated.split(), paper.split(), strict=True)
                ratio = ", ".join(f"{abs(float(real) / float(ours)):.2g}" for ours, real in pairs)
            cells = (cell.replace("  ", ", ") for cell in rows[label])
            lines.append([name.removesuffix("_quasi"), label, *cells, ratio])
    return lines


COMPUTED: dict[str, Callable[..., Lines]] = {
    "card": card_lines,
    "compare": _compared,
    "held-out": lambda root, group: held_out_lines(read_content(root / HELD_OUT), group),
    "held-out-conditions": lambda root: condition_lines(),
    "held-out-origin": lambda root: origin_lines(read_content(root / HELD_OUT)),
    "held-out-worst": lambda root: worst_lines(read_content(root / HELD_OUT)),
    "leaderboard": _overall,
    "leaderboard-track": _track,
    "margins": _margins,
    "methods": method_lines,
    "orders": _orders,
    "suite": lambda root, *which: suite_lines(read_results(SUITE_RESULTS), only_runs=which == ("runs",)),
    "suite-tasks": lambda root: task_lines(),
    "suite-variants": lambda root, task: variant_lines(read_results(SUITE_RESULTS), task),
    "summary": _summary,
    "topics": lambda root: topic_lines(),
    "world": lambda root, name: world_lines(find_world(name)),
    "tracks": lambda root: [["track", "what it tests"], *([f"`{name}`", t.doc] for name, t in TRACKS.items())],
}
"""Tables from the leaderboard's rows and from the code: name → function of the clone's root and arguments → cells."""
DRAWN: dict[str, Callable[[Any], Lines]] = {
    "flight": lambda result: flight_lines(result["flight"], result.get("noisy"), result.get("calibrated")),
    "crawl": lambda result: crawl_lines(result["crawl"], result.get("noisy"), result.get("calibrated")),
    "speeds": lambda result: speed_lines(result["speeds"]),
    "study": lambda result: study_lines(result["study"]),
    "draws": lambda result: study_lines(result["draws"]),
    "lost": lambda result: lost_lines(result["lost_rotors"]),
    "course_faults": lambda result: course_fault_lines(result["course_faults"]),
    "first_flights": lambda result: first_flight_lines(result["flights"]),
    "hidden": lambda result: hidden_lines(result["hidden"]),
    "searches": lambda result: search_lines(result["searches"]),
    "sagging": lambda result: sagging_lines(result["sagging"]),
    "hops": lambda result: hop_lines(result["hops"]),
    "gates": lambda result: gate_lines(result["gates"]),
    "ablations": lambda result: ablation_lines(result["ablations"]),
    "steps": lambda result: step_lines(result["steps"]),
    "drift": lambda result: drift_lines(result["drift"]),
    "energy": lambda result: energy_lines(result["energy"]),
    "frontier": lambda result: frontier_lines(result["frontier"]),
    "flights": lambda result: calibrated_flight_lines(result["flights"]),
    "calibrate": lambda result: fit_lines(result["calibrate"]),
    "profiles": lambda result: profile_lines(result["profiles"]),
    "reality": lambda result: reality_lines(result["reality"]),
    "leg_margins": lambda result: leg_lines(result["leg_margins"]),
    "leg_falls": lambda result: check_lines(result["leg_falls"]),
    "engine": lambda result: engine_lines(result["engine"]),
    "effects": lambda result: effect_lines(result["effects"]),
    "grasp_costs": lambda result: grasp_lines(result["grasps"]),
}
"""Tables of results by the key `table`: the JSON of a command's `--json` → the table that it prints otherwise."""


def read_result(path: Path) -> dict[str, Any]:
    """Read a committed result (`SpidarError` if its origin or its table is missing)."""
    try:
        result = json.loads(path.read_text(encoding="utf-8"))
        missing = KEYS - result.keys()
        date.fromisoformat(result["date"])
        notes = result.get("notes", [])
        whole = not missing and ("lines" in result or (result["table"] in DRAWN and "result" in result))
        whole = whole and isinstance(notes, list) and all(isinstance(note, str) for note in notes)
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise SpidarError(f"{path} is no result: {error}; valid: the format in docs/development/results.md") from error
    if not whole:
        raise SpidarError(
            f"{path} is no result; valid: JSON with {', '.join(sorted(KEYS))}, and either lines or table "
            f"({', '.join(DRAWN)}) with result; notes is a list of sentences"
        )
    return result


def markdown_table(root: Path, name: str) -> str:
    """Return a table as Markdown, followed by the command that produced it.

    Args:
        root: Root of the clone.
        name: Text of the marker: a name of `COMPUTED` with its arguments, or of a file in `RESULTS`.

    Raises:
        SpidarError: For an unknown name or a damaged result.
    """
    first, *arguments = name.split()
    if first in COMPUTED:
        return format_table(COMPUTED[first](root, *arguments), markdown=True)
    path = root / RESULTS / f"{first}.json"
    if arguments or not path.is_file():
        known = sorted(p.stem for p in (root / RESULTS).glob("*.json"))
        raise UnknownNameError("table", name, [*COMPUTED, *known])
    result = read_result(path)
    lines = result["lines"] if "lines" in result else DRAWN[result["table"]](result["result"])
    notes = "".join(f"\n\n{note}" for note in result.get("notes", ()))
    source = f"`{result['command']}`, spidar_gym {result['version']}, {result['date']}."
    return format_table(lines, markdown=True) + f"{notes}\n\n{source}"


def with_tables(root: Path, text: str) -> str:
    """Return a page with every marked table replaced by its current version."""

    def written(found: re.Match[str]) -> str:
        return f"{BEGIN.format(found[1])}\n{markdown_table(root, found[1])}\n{END}"

    if len(MARKED.findall(text)) != len(re.findall("^<!-- table:", text, re.MULTILINE)):
        raise SpidarError(f"a table has no end; valid: {BEGIN.format('NAME')} … {END}, each on a separate line")
    return MARKED.sub(written, text)


def pages(root: Path) -> list[Path]:
    """Return every page that may contain tables: README, the guide, and the README of an export."""
    onboard = root / "spidar_gym" / "onboard" / "README.md"
    return [root / "README.md", *sorted((root / "docs").rglob("*.md")), onboard]
