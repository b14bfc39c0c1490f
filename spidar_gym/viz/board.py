"""The leaderboard as a picture: a panel a track, its rows sorted and named, a colour a class."""

from pathlib import Path

from spidar_gym.benchmark.leaderboard import GROUPS, Board, ranking
from spidar_gym.benchmark.row import REFERENCE
from spidar_gym.policies.policy import KINDS
from spidar_gym.viz.style import BLACK, BLUE, GREEN, GREY, PURPLE, VERMILLION, pyplot, save

CLASSES: dict[str, tuple[str, str]] = dict(
    zip(KINDS, ((BLUE, "o"), (VERMILLION, "D"), (GREEN, "s"), (PURPLE, "v")), strict=True)
)
"""Colour and mark of a class of policies."""
COLUMNS = 3
WIDE = (0.01, 0.1, 1.0, 10.0)
FINE = (0.5, 0.7, 1.0, 1.5, 2.0, 3.0)


def leaderboard_picture(board: Board, path: Path) -> None:
    """Scores with their 95 % intervals, written as PNG and PDF: the best of a track at the top of its panel."""
    plt = pyplot()
    groups = [own for tracks in GROUPS.values() if (own := [track for track in tracks if track in board.tracks])]
    ranked = {track: ranking(board, track) for track in board.tracks}
    lines = [tracks[k : k + COLUMNS] for tracks in groups for k in range(0, len(tracks), COLUMNS)]
    heights = [max(len(ranked[track]) for track in line) for line in lines]
    figure = plt.figure(figsize=(10.0, 1.1 + 0.55 * len(lines) + 0.155 * sum(heights)))
    grid = figure.add_gridspec(len(lines), COLUMNS, height_ratios=[height + 1.5 for height in heights])
    for k, line in enumerate(lines):
        limits = _limits(board, next(tracks for tracks in groups if line[0] in tracks))
        for column, track in enumerate(line):
            axis = figure.add_subplot(grid[k, column])
            axis.set_title(track)
            axis.axvline(1.0, color=GREY, linewidth=0.8, linestyle=(0, (4, 3)), zorder=1)
            for y, name in enumerate(ranked[track]):
                score, (color, mark) = board.cells[name, track].score, CLASSES[board.rows[name].kind]
                axis.plot([score.low, score.high], [y, y], color=color, linewidth=1.6, linestyle="-", alpha=0.45)
                axis.plot([score.value], [y], mark, color=color, markersize=4)
            axis.set_yticks(range(len(ranked[track])), ranked[track])
            for label, name in zip(axis.get_yticklabels(), ranked[track], strict=True):
                label.set_color(BLACK if name == REFERENCE else CLASSES[board.rows[name].kind][0])
                label.set_fontweight("bold" if name == REFERENCE else "normal")
            axis.set_ylim(len(ranked[track]) - 0.4, -0.6)
            axis.tick_params(axis="y", length=0)
            axis.set_xscale("log")
            axis.set_xlim(limits)
            ticks = [tick for tick in (WIDE if limits[1] > 8.0 * limits[0] else FINE) if limits[0] <= tick <= limits[1]]
            axis.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
            axis.minorticks_off()
            axis.grid(axis="y", visible=False)
    figure.supxlabel(
        f"score: mean error of {REFERENCE} over one's own, 95 % interval, log scale; right of 1 is better", fontsize=8
    )
    kinds = [kind for kind in CLASSES if any(row.kind == kind for row in board.rows.values())]
    handles = [
        plt.Line2D([], [], color=CLASSES[kind][0], marker=CLASSES[kind][1], ls="-", label=kind) for kind in kinds
    ]
    figure.legend(handles=handles, loc="outside upper center", ncols=len(handles), fontsize=8)
    save(figure, path)


def _limits(board: Board, tracks: list[str]) -> tuple[float, float]:
    """Limits of the score within which all intervals of some tracks lie."""
    scores = [cell.score for (_, track), cell in board.cells.items() if track in tracks]
    return 0.85 * min(score.low for score in scores), 1.18 * max(score.high for score in scores)
