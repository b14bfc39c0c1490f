"""LEADERBOARD.md: every table, what learning adds, how to read it, and what each row rests on."""

from spidar_gym.benchmark.comparison import compare_rows, comparison_tables
from spidar_gym.benchmark.leaderboard import SHOWN, Board
from spidar_gym.benchmark.leaderboard_text import FEWEST_RUNS, flag, overall_lines, partial_lines, track_lines
from spidar_gym.benchmark.metrics import METRICS
from spidar_gym.benchmark.row import REFERENCE, Row
from spidar_gym.benchmark.track import CAP, TRACKS
from spidar_gym.policies.policy import LEARNED
from spidar_gym.text import code, escaped, format_table


def markdown(board: Board) -> str:
    """LEADERBOARD.md."""
    base = board.rows[REFERENCE]
    lines = [
        "# Leaderboard",
        "",
        "Written by `spidar leaderboard build` from the rows in `scores/`; nothing here is typed. A score is the mean",
        f"error of `{REFERENCE}`, the paper's controller, over the policy's own on the same scenarios: 1 is the",
        "paper's controller, above 1 is beyond the paper. A failed scenario costs an error of "
        f"{CAP:g}. In brackets: 95 %",
        "bootstrap intervals over scenarios (and training runs, where there are several).",
        "",
        "![scores with intervals by track](leaderboard.png)",
        "",
        "## All tracks",
        "",
        "Geometric mean of the tracks' scores; – where a policy is not defined on all of them.",
        "",
        format_table(overall_lines(board), markdown=True),
    ]
    partial = partial_lines(board, board.tracks)
    if len(partial) > 1:
        lines += ["", "Policies that are defined on some tracks only, and their place there:", ""]
        lines.append(format_table(partial, markdown=True))
    lines += _added_lines(board)
    if any(flag(row) for row in board.rows.values()):
        lines += ["", f"† fewer than {FEWEST_RUNS} training runs."]
    for track in board.tracks:
        scenarios = board.cells[REFERENCE, track].scenarios
        lines += [
            "",
            f"## {track}",
            "",
            f"{TRACKS[track].doc[0].upper()}{TRACKS[track].doc[1:]}.",
            f"Error: {TRACKS[track].formula}. {scenarios} scenarios.",
            "",
            format_table(track_lines(board, track), markdown=True),
        ]
    lines += [
        "",
        "## How to read it",
        "",
        "- error, IQM: interquartile mean of the scenarios' errors.",
        f"- against {REFERENCE}: interquartile mean of the paired differences over that of `{REFERENCE}`; below 0 is",
        "  better.",
        "- P(better): probability that the error on a scenario is below the reference's.",
        "- The other columns are medians, but for violations and unsolved QPs, which are means a scenario.",
        *(f"- {heading}: {METRICS[name].doc}." for name, heading in _headings()),
        "",
        "## Rows",
        "",
        *(
            f"- {code(name)}: {code(row.content['command'])}" + _trained(row) + f", {row.content['sha256'][:12]}"
            for name, row in board.rows.items()
        ),
        "",
        "Versions: " + escaped(", ".join(" ".join(entry) for entry in base.content["versions"].items())) + ".",
        "",
    ]
    return "\n".join(lines)


def _added_lines(board: Board) -> list[str]:
    """What learning adds: every residual against the controller that it adds to."""
    lines = []
    for row in board.rows.values():
        if row.base not in board.rows:
            continue
        for cells in comparison_tables(compare_rows(row, board.rows[row.base])):
            lines += ["", f"{code(row.name)}{flag(row)} against `{row.base}`:", "", format_table(cells, markdown=True)]
    if not lines:
        return []
    head = (
        "IQM of the paired differences over that of the base, with 95 % intervals over scenarios and runs; below 0 is"
    )
    return ["", "## What learning adds", "", head, "better.", *lines]


def _trained(row: Row) -> str:
    """What the training cost, as its artifact says."""
    first = next((entry for entry in row.content["training"] or () if entry), None)
    if first is None:
        return ""
    steps = first.get("steps")
    verb = "trained" if row.kind in LEARNED else "tuned"
    return f"; {verb} with {code(first.get('command', ''))}" + (f", {steps:,} steps a run" if steps else "")


def _headings() -> list[tuple[str, str]]:
    return list(dict.fromkeys((name, heading) for shown in SHOWN.values() for name, heading, *_ in shown))
