"""`spidar eval`, `spidar leaderboard`, `spidar scenarios`: the benchmark at the command line."""

import sys
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro
from tqdm import tqdm

from spidar_gym import viz
from spidar_gym.benchmark import leaderboard
from spidar_gym.benchmark import verify as verifying
from spidar_gym.benchmark.comparison import compare_rows, comparison_json, comparison_text
from spidar_gym.benchmark.episode import ACT_LIMIT_S
from spidar_gym.benchmark.evaluate import evaluate_runs
from spidar_gym.benchmark.policy import defined_on, load_policy, policy_name
from spidar_gym.benchmark.row import (
    ROWS,
    Row,
    committed_row,
    cores,
    eval_command,
    make_row,
    read_row,
    read_rows,
    require_one_policy,
    write_row,
)
from spidar_gym.benchmark.scenario import WRITER, load_scenarios, scenario_files
from spidar_gym.benchmark.track import SCENARIOS, SPLITS, TRACKS
from spidar_gym.description import assets_dir
from spidar_gym.errors import InvalidValueError, StaleAssetError, require_least, require_name
from spidar_gym.files import has_text, json_text, write_text

BASELINES = (
    "baselines.qp:QP", "baselines.qp_as_flown:QPAsFlown", "baselines.qp_unconstrained:QPUnconstrained",
    "baselines.pinv:Pinv", "baselines.qp_tuned:QPTuned", "baselines.qp_tuned:QPOverlapped",
    "baselines.qp_robust_overlapped:QPRobustOverlapped", "baselines.hold:Hold",
)  # fmt: skip
"""The classical baselines of a checkout."""

SplitArg = Annotated[str, tyro.conf.arg(metavar="{" + ",".join(SPLITS) + "}")]


def eval_(
    policy: tuple[str, ...] = (),
    tracks: tuple[str, ...] = (),
    baselines: tyro.conf.FlagCreatePairsOff[bool] = False,
    split: SplitArg = "test",
    scenarios: int = SCENARIOS,
    out: Path = Path("out/scores"),
    cache: Path = Path("out/eval"),
    workers: int = cores(),
    ray: str | None = None,
    act_limit: float = ACT_LIMIT_S,
    json: tyro.conf.FlagCreatePairsOff[bool] = False,
) -> None:
    """Evaluate a policy on the benchmark's tracks and write its row; goes on where an interrupted evaluation was.

    Args:
        policy: module:Class, or the path of a learned policy's artifact; several are the runs (training seeds) of one
            row.
        tracks: Tracks; every one on which the policy is defined if none is given.
        baselines: Evaluate every classical baseline of a checkout, each a row of its own.
        split: test, or validation for choosing among one's own policies.
        scenarios: How many scenarios of each track, from the first on.
        out: Folder for the row, NAME.json.
        cache: Folder in which finished scenarios are kept.
        workers: Processes, or workers of a local Ray cluster.
        ray: Address of a Ray cluster to send the scenarios to: local, auto, or host:port.
        act_limit: How long the policy may think about one action [s].
        json: Print one JSON object on stdout and nothing else there.
    """
    _check_eval(policy, tracks, baselines, split, scenarios, workers, act_limit)
    rows: list[Row] = []
    for specs in [(spec,) for spec in BASELINES] if baselines else [policy]:
        policies = [load_policy(spec) for spec in specs]
        require_one_policy(policies, specs)
        defined = defined_on(policies[0])
        chosen = [t for t in (tracks or TRACKS) if TRACKS[t].env_id in defined]
        if not chosen:
            if baselines:
                continue
            raise InvalidValueError("tracks", tracks, f"tracks of {', '.join(defined) or 'another policy'}")
        total = len(chosen) * scenarios * len(specs)
        with tqdm(total=total, unit="scenario", desc=policy_name(policies[0]), file=sys.__stderr__) as bar:
            scores = evaluate_runs(
                specs, chosen, scenarios, split=split, workers=workers, folder=cache, ray=ray,
                act_limit_s=act_limit, on_scenario=bar.update, on_track=bar.set_postfix_str,
            )  # fmt: skip
        row = make_row(policies, specs, scores, command=eval_command(specs, tracks, split, scenarios))
        write_row(row, out)
        rows.append(row)
    base = next((row for row in rows if row.name == "qp"), None) or committed_row()
    if json:
        print(json_text({"rows": [leaderboard.summary(row, base) for row in rows]}))
        return
    for row in rows:
        print(leaderboard.report(row, base))
        print(f"written to {out / (row.name + '.json')}\n")


def _check_eval(
    policy: tuple[str, ...], tracks: tuple[str, ...], baselines: bool, split: str, scenarios: int, workers: int,
    act_limit: float,
) -> None:  # fmt: skip
    """Refuse what cannot be evaluated, before anything is."""
    if bool(policy) == baselines:
        raise InvalidValueError("policy", policy, "either --policy module:Class … or --baselines")
    for track in tracks:
        require_name("track", track, TRACKS)
    require_name("split", split, SPLITS)
    require_least(1, workers=workers)
    if not 1 <= scenarios <= SCENARIOS:
        raise InvalidValueError("scenarios", scenarios, f"a number within 1 … {SCENARIOS}")
    if not act_limit > 0.0:
        raise InvalidValueError("act_limit", act_limit, "a time above 0 [s]")


board_app = tyro.extras.SubcommandApp()
FolderArg = Annotated[Path, tyro.conf.arg(help="Folder of the rows.")]


@board_app.command
def build(rows: FolderArg = Path(ROWS), out: Path = Path("baselines")) -> None:
    """Write LEADERBOARD.md and its picture from the rows.

    Args:
        rows: Folder of the rows.
        out: Folder for LEADERBOARD.md and leaderboard.png.
    """
    board = leaderboard.tabulate(read_rows(rows))
    write_text(out / "LEADERBOARD.md", leaderboard.markdown(board))
    viz.leaderboard_picture(board, out / "leaderboard.png")
    print(f"{len(board.names)} rows in {out / 'LEADERBOARD.md'}")


@board_app.command
def show(
    rows: FolderArg = Path(ROWS),
    tracks: tuple[str, ...] = (),
    json: tyro.conf.FlagCreatePairsOff[bool] = False,
) -> None:
    """Print the leaderboard.

    Args:
        rows: Folder of the rows.
        tracks: Only these tracks.
        json: Print one JSON object on stdout and nothing else there.
    """
    for track in tracks:
        require_name("track", track, TRACKS)
    board = leaderboard.tabulate(read_rows(rows))
    if json:
        print(json_text(leaderboard.as_json(board)))
        return
    print(leaderboard.text(board, tracks or board.tracks))


@board_app.command
def compare(
    row: Path, base: str = "qp", rows: FolderArg = Path(ROWS), json: tyro.conf.FlagCreatePairsOff[bool] = False
) -> None:
    """Compare a row with another one: paired differences of position, attitude, time, energy, success.

    Args:
        row: File of the row.
        base: Name of the row to compare it with, in the folder of the rows.
        rows: Folder of the rows.
        json: Print one JSON object on stdout and nothing else there.
    """
    known = read_rows(rows)
    require_name("row", base, known)
    own = read_row(row)
    if json:
        print(json_text({"comparisons": [comparison_json(c) for c in compare_rows(own, known[base])]}))
        return
    print(comparison_text(own, known[base]))


@board_app.command
def verify(rows: FolderArg = Path(ROWS), sample: int = 12, seed: int = 0, workers: int = cores()) -> None:
    """Play scenarios of committed rows once more and compare; fails when one gives something else.

    Args:
        rows: Folder of the rows.
        sample: How many scenarios, drawn from all rows.
        seed: Of the draw.
        workers: Processes.
    """
    require_least(1, sample=sample, workers=workers)
    require_least(0, seed=seed)
    found = read_rows(rows)
    rng = np.random.Generator(np.random.PCG64(seed))
    with tqdm(total=sample, unit="scenario", desc="verify", file=sys.__stderr__) as bar:
        checks = verifying.verify(found, sample, rng, workers=workers, on_scenario=bar.update)
    for check in checks:
        print(check.line)
    verifying.require_verified(checks)
    exact = sum(check.equal for check in checks)
    print(f"{len(checks)} scenarios of {len(found)} rows played again: {exact} equal bit for bit, all within tolerance")


def scenarios(check: tyro.conf.FlagCreatePairsOff[bool] = False) -> None:
    """Write the benchmark's scenario files and their hashes.

    Args:
        check: Write nothing; fail when a committed file is not what is drawn.
    """
    root = assets_dir()
    with tqdm(total=len(SPLITS) * len(TRACKS) * SCENARIOS, unit="scenario", desc="draw", file=sys.__stderr__) as bar:
        files = scenario_files(on_scenario=bar.update)
    stale = [name for name, text in files.items() if not has_text(root / name, text)]
    if check:
        if stale:
            raise StaleAssetError(", ".join(str(root / name) for name in stale), WRITER)
        print(f"{len(files)} scenario files in {root} are what is drawn")
        return
    for name in stale:
        write_text(root / name, files[name])
    load_scenarios.cache_clear()
    print(f"{len(stale)} of {len(files)} files written to {root}")
