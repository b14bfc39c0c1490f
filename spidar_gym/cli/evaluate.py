"""`spidar eval`, `spidar leaderboard`, `spidar scenarios`: the benchmark on the command line."""

import importlib.util
import sys
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import tyro

from spidar_gym import viz
from spidar_gym.arguments import Flag, JsonArg, choice
from spidar_gym.benchmark import answers as answering
from spidar_gym.benchmark import verify as verifying
from spidar_gym.benchmark.comparison import compare_rows, comparison_text
from spidar_gym.benchmark.evaluate import evaluate_runs
from spidar_gym.benchmark.leaderboard import as_json, summary, tabulate
from spidar_gym.benchmark.leaderboard_tables import markdown, report, text
from spidar_gym.benchmark.row import (
    ROWS,
    Row,
    among_committed,
    committed_references,
    committed_rows,
    eval_command,
    make_row,
    read_row,
    read_rows,
    require_one_policy,
    write_row,
)
from spidar_gym.benchmark.scenario import WRITER, load_scenarios, scenario_files
from spidar_gym.benchmark.scoring import ACT_LIMIT_S, CONTROL
from spidar_gym.benchmark.track import REFERENCES, SCENARIOS, SECOND, SPLITS, TRACKS
from spidar_gym.cli.held_out import held_out
from spidar_gym.console import drawn, goes_on, kept, progress
from spidar_gym.errors import InvalidValueError, MissingDependencyError, require_least, require_name
from spidar_gym.files import json_text, refresh, write_text
from spidar_gym.paper.calibration import require_robots
from spidar_gym.policies.guest import open_policy
from spidar_gym.policies.policy import defined_on, policy_name
from spidar_gym.processes import cpu_count
from spidar_gym.robot.description import assets_dir
from spidar_gym.text import format_table

BASELINES = (
    "baselines.qp:QP", "baselines.qp_as_flown:QPAsFlown", "baselines.qp_as_flown_quasi:QPAsFlownQuasi",
    "baselines.qp_unconstrained:QPUnconstrained",
    "baselines.pinv:Pinv", "baselines.unlimited:Unlimited", "baselines.scaled:Scaled",
    "baselines.compensation:Compensation", "baselines.planning:Planning",
    "baselines.indi:Indi", "baselines.adrc:Adrc", "baselines.mpc:MPC",
    "baselines.steady_rivals:AdrcSteady", "baselines.steady_rivals:IndiSteady",
    "baselines.steady_rivals:CompensationSteady", "baselines.steady_rivals:MPCSteady",
    "baselines.qp_tuned:QPTuned", "baselines.qp_tuned:QPTunedV1",
    "baselines.qp_retuned:QPRetuned", "baselines.qp_steady:QPSteady",
    "baselines.qp_tuned:QPOverlapped", "baselines.qp_robust_overlapped:QPRobustOverlapped",
    "baselines.qp_robust_overlapped:QPRobustOverlappedV1", "baselines.walking:Walking", "baselines.hold:Hold",
    "baselines.blind:Blind",
    "baselines.course:CourseRule", "baselines.course:CourseFly", "baselines.course:CourseCrawl",
    "baselines.course_planner:CoursePlanner", "baselines.course_steady:SteadyRule",
    "baselines.course_steady:SteadyPlanner",
    "baselines.grasp:GraspRule", "baselines.grasp:Grasp10", "baselines.grasp:Grasp20", "baselines.grasp:Grasp30",
    "baselines.grasp:GraspJoints", "baselines.grasp:GraspPaperRows", "baselines.grasp:GraspTold",
)  # fmt: skip
"""The classical baselines."""

SplitArg = Annotated[str, choice(SPLITS)]


def eval_(
    policy: tuple[str, ...] = (),
    tracks: tuple[str, ...] = (),
    baselines: Flag = False,
    split: SplitArg = "test",
    scenarios: int = SCENARIOS,
    robots: Path | None = None,
    out: Path = Path("out/scores"),
    cache: Path = Path("out/eval"),
    workers: int = cpu_count(),
    ray: str | None = None,
    act_limit: float = ACT_LIMIT_S,
    trust: Flag = False,
    json: JsonArg = False,
) -> None:
    """Evaluate a policy on the benchmark's tracks and write its row; resumes an interrupted evaluation.

    Args:
        policy: module:Class, a learned policy's artifact, or with --trust a zip of Stable-Baselines3.
            Several policies become the runs (training seeds) of one row.
        tracks: Tracks; all on which the policy is defined if none is given.
        baselines: Evaluate all classical baselines instead of --policy, with one row each.
        split: Scenarios to use: test; validation for choosing among your own policies; second for the second draw of
            the calibrated tracks.
        scenarios: Number of scenarios per track, from the first.
        robots: File of a calibrated world or of an identified robot, whose robots replace those of the calibrated
            tracks; prints the scores, and writes no row.
        out: Folder for the row, NAME.json; a row of the second draw is written to its subfolder second.
        cache: Folder for finished scenarios, from which an interrupted evaluation resumes.
        workers: Number of processes, or of workers of a local Ray cluster.
        ray: Address of the Ray cluster that evaluates the scenarios: local, auto, or host:port.
        act_limit: Time limit of the policy for one action [s].
        trust: Load zips saved by Stable-Baselines3. They can run any code: use only files that you trust.
    """
    _check_eval(policy, tracks, baselines, split, scenarios, workers, act_limit)
    if robots is not None:
        how = dict(split=split, workers=workers, folder=cache, ray=ray, act_limit_s=act_limit, trust=trust)
        _eval_with(robots, [(spec,) for spec in BASELINES] if baselines else [policy], tracks, scenarios, how, json)
        return
    rows: list[Row] = []
    folder = out / SECOND if split == SECOND else out
    for specs in [(spec,) for spec in BASELINES] if baselines else [policy]:
        policies = [open_policy(spec, trust=trust) for spec in specs]
        require_one_policy(policies, specs)
        defined = defined_on(policies[0])
        chosen = [t for t in (tracks or TRACKS) if TRACKS[t].env_id in defined and split in TRACKS[t].splits]
        if not chosen:
            if baselines:
                continue
            raise InvalidValueError("tracks", tracks, f"tracks of {', '.join(defined) or 'another policy'}")
        total = len(chosen) * scenarios * len(specs)
        bar = progress(total=total, unit="scenario", desc=policy_name(policies[0]))
        with bar, kept(goes_on(bar, cache)):
            scores = evaluate_runs(
                specs, chosen, scenarios, split=split, workers=workers, folder=cache, ray=ray,
                act_limit_s=act_limit, trust=trust, on_scenario=bar.update, on_track=bar.set_postfix_str,
            )  # fmt: skip
        row = make_row(policies, specs, scores, command=eval_command(specs, tracks, split, scenarios))
        write_row(row, folder)
        rows.append(row)
    references = committed_references(split) | {row.name: row for row in rows if row.name in REFERENCES.values()}
    if json:
        print(json_text({"rows": [summary(row, references) for row in rows]}))
        return
    for row in rows:
        print(report(row, references))
        print(f"written to {folder / (row.name + '.json')}\n")


def _eval_with(
    robots: Path, policies: Sequence[tuple[str, ...]], tracks: tuple[str, ...], scenarios: int, how: dict[str, Any],
    json: bool,
) -> None:  # fmt: skip
    """Evaluate policies on the calibrated tracks with other robots, and print the scores."""
    require_robots(str(robots))
    rows = []
    for specs in policies:
        opened = [open_policy(spec, trust=how["trust"]) for spec in specs]
        require_one_policy(opened, specs)
        defined = defined_on(opened[0])
        named = tracks or tuple(name for name, track in TRACKS.items() if track.is_calibrated)
        chosen = [name for name in named if TRACKS[name].env_id in defined]
        with progress(total=len(chosen) * scenarios * len(specs), unit="scenario", desc=policy_name(opened[0])) as bar:
            scores = evaluate_runs(
                specs,
                chosen,
                scenarios,
                robots=str(robots),
                on_scenario=bar.update,
                on_track=bar.set_postfix_str,
                **how,
            )
        for track, runs in scores.items():
            errors = np.concatenate([run.errors for run in runs])
            rows.append({
                "policy": policy_name(opened[0]), "track": track, "episodes": len(errors),
                "error": float(errors.mean()),
                "success": float(np.mean([run.success for run in runs])),
                "failed": float(np.mean([bool(own) for run in runs for own in run.metrics["failure"]])),
            })  # fmt: skip
    if json:
        print(json_text({"robots": str(robots), "scores": rows}))
        return
    lines = [["policy", "track", "episodes", "error", "success", "failed"]]
    lines += [
        [row["policy"], row["track"], f"{row['episodes']}", f"{row['error']:.3f}", f"{row['success']:.0%}",
         f"{row['failed']:.0%}"] for row in rows
    ]  # fmt: skip
    print(format_table(lines))


def _check_eval(
    policy: tuple[str, ...], tracks: tuple[str, ...], baselines: bool, split: str, scenarios: int, workers: int,
    act_limit: float,
) -> None:  # fmt: skip
    """Check the arguments of `eval_` before any scenario is evaluated."""
    if bool(policy) == baselines:
        raise InvalidValueError("policy", policy, "either --policy module:Class … or --baselines")
    if baselines and importlib.util.find_spec("cma") is None:  # checked before the other baselines, which take hours
        raise MissingDependencyError("cma, which one of the baselines requires,", "pip install 'spidar-gym[tune]'")
    for track in tracks:
        require_name("track", track, TRACKS)
    require_name("split", split, SPLITS)
    for track in tracks:
        if split not in TRACKS[track].splits:
            has = [name for name, own in TRACKS.items() if split in own.splits]
            raise InvalidValueError("tracks", track, f"tracks with the split {split}: {', '.join(has)}")
    require_least(1, workers=workers)
    if not 1 <= scenarios <= SCENARIOS:
        raise InvalidValueError("scenarios", scenarios, f"a number within 1 … {SCENARIOS}")
    if not act_limit > 0.0:
        raise InvalidValueError("act_limit", act_limit, "a time above 0 [s]")


board_app = tyro.extras.SubcommandApp()
FolderArg = Annotated[Path, tyro.conf.arg(help="Folder of the rows.")]


@board_app.command
def build(rows: FolderArg = Path(ROWS), out: Path = Path("baselines")) -> None:
    """Write LEADERBOARD.md from the rows, and its picture if matplotlib is installed.

    Args:
        out: Folder for LEADERBOARD.md and leaderboard.png.
    """
    board = tabulate(read_rows(rows))
    write_text(out / "LEADERBOARD.md", markdown(board))
    drawn("picture", lambda: viz.leaderboard_picture(board, out / "leaderboard.png"))
    print(f"{len(board.rows)} rows in {out / 'LEADERBOARD.md'}")


@board_app.command
def show(
    rows: FolderArg = Path(ROWS),
    tracks: tuple[str, ...] = (),
    wide: Flag = False,
    json: JsonArg = False,
) -> None:
    """Print the leaderboard, with your own rows among the committed ones.

    Args:
        rows: Folder of your own rows.
        tracks: Print the tables of these tracks only; the overall ranking always uses all tracks.
        wide: Print every metric, in lines of 230 characters.
    """
    for track in tracks:
        require_name("track", track, TRACKS)
    every, own = among_committed(_own_rows(rows))
    board = tabulate(every)
    if json:
        print(json_text(as_json(board)))
        return
    print(text(board, tracks, wide=wide))
    if own:
        print(f"\nfrom {rows}: {', '.join(own)}; the other rows are the committed ones")


def _own_rows(folder: Path) -> dict[str, Row]:
    """Return the rows of a folder; none if it is the default folder and does not exist, as outside a clone."""
    return {} if folder == Path(ROWS) and not folder.is_dir() else read_rows(folder)


@board_app.command
def compare(row: Path, base: str = "qp", rows: FolderArg = Path(ROWS), json: JsonArg = False) -> None:
    """Compare a row with another: paired differences of position, attitude, time, energy and success.

    Args:
        row: File of the row.
        base: Name of the row to compare with, from the folder of rows or from the committed rows.
    """
    known = {**committed_rows(), **_own_rows(rows)}
    require_name("row", base, known)
    own = read_row(row)
    if json:
        print(json_text({"comparisons": [asdict(c) for c in compare_rows(own, known[base])]}))
        return
    print(comparison_text(own, known[base]))


@board_app.command
def verify(
    rows: FolderArg = Path(ROWS), sample: int = 12, per_run: int = 0,
    every: Annotated[Flag, tyro.conf.arg(name="all", help="Every scenario once.")] = False,
    names: tuple[str, ...] = (), tracks: tuple[str, ...] = (), seed: int = 0, workers: int = cpu_count(),
    trust: Flag = False, control: Literal["python", "core"] = CONTROL, results: Path | None = None,
    cache: Path = Path("out/verify"),
) -> None:  # fmt: skip
    """Evaluate scenarios of rows again and compare the metrics; fails if a result differs.

    Args:
        sample: Number of scenarios, sampled from all rows without replacement.
        per_run: Instead of --sample, the number of scenarios sampled from every row, track and run.
        names: Names of the rows; all if none is given.
        tracks: Tracks; all if none is given.
        seed: Seed of the sampling.
        workers: Number of processes.
        trust: Also run policies from outside the package and the committed baselines.
            The authors of the rows wrote their code, so read it first.
        control: Implementation of the controllers: core, with which rows are made, or python, which rounds differently.
        results: File for the exact metrics of every scenario, for comparison between two commits.
        cache: Folder for finished scenarios with --all or --per-run, from which an interrupted command resumes.
    """
    require_least(1, sample=sample, workers=workers)
    require_least(0, seed=seed, per_run=per_run)
    for track in tracks:
        require_name("track", track, TRACKS)
    found = read_rows(rows)
    for name in names:
        require_name("row", name, found)
    found = verifying.with_second_draws({name: row for name, row in found.items() if name in (names or found)})
    picks = verifying.every_scenario(found, tracks)
    if not picks:
        raise InvalidValueError("tracks", tracks, "tracks of the rows")
    rng = np.random.Generator(np.random.PCG64(seed))
    if not every:
        picks = verifying.drawn_per_run(picks, per_run, rng) if per_run else verifying.drawn_sample(picks, sample, rng)
    folder = cache if every or per_run else None
    bar = progress(total=len(picks), unit="scenario", desc="verify")

    def on_check(check: verifying.Check) -> None:
        bar.write(check.line, file=sys.stdout)
        bar.update()

    played = f"of {len(picks)} scenarios evaluated again; their results are printed above"
    with bar, kept(goes_on(bar, folder) if folder else lambda: f"{bar.n} {played}"):
        checks = verifying.verify(
            found, picks, workers=workers, trust=trust, control=control, folder=folder, on_check=on_check
        )
    if results is not None:
        write_text(results, json_text({"scenarios": verifying.results(found, picks, checks)}))
    verifying.require_verified(checks)
    for line in verifying.measures(checks):
        print(line)
    if moved := verifying.largest_differences(checks):
        print(f"largest differences, as shares of the tolerance: {moved}")
    exact = sum(check.equal for check in checks)
    near = f", {len(checks) - exact} within tolerance, which does not verify them" if exact < len(checks) else ""
    print(f"{len(checks)} scenarios of {len(found)} rows evaluated again: {exact} equal bit for bit{near}")


@board_app.command
def answers(
    rows: FolderArg = Path(ROWS), names: tuple[str, ...] = (), tracks: tuple[str, ...] = (),
    scenarios: int = SCENARIOS, workers: int = cpu_count(), trust: Flag = False,
    json: JsonArg = False,
) -> None:  # fmt: skip
    """Evaluate rows again and count the ticks by the allocation's status, such as solved or held.

    Policies with custom allocators or control laws run with the Python controller, all others with the compiled core.


    Args:
        names: Names of the rows; all if none is given.
        tracks: Tracks; all if none is given.
        scenarios: Number of scenarios per track, from the first.
        workers: Number of processes.
        trust: Also run policies from outside the package and the committed baselines; read their code first.
    """
    require_least(1, scenarios=scenarios, workers=workers)
    for track in tracks:
        require_name("track", track, TRACKS)
    known = read_rows(rows)
    for name in names:
        require_name("row", name, known)
    chosen = {name: row for name, row in known.items() if name in (names or known)}
    shards = answering.answer_shards(chosen, tracks or list(TRACKS), scenarios, trust=trust)
    with progress(total=len(shards), unit="scenario", desc="answers") as bar:
        counts = answering.count_answers(shards, workers=workers, on_scenario=bar.update)
    if json:
        print(json_text({"answers": counts}))
        return
    print(answering.answers_text(counts))


board_app.command(held_out)


def scenarios(check: Flag = False) -> None:
    """Write the benchmark's scenario files and their hashes.

    Args:
        check: Write nothing; fail if a committed file differs from the sampled scenarios.
    """
    root = assets_dir()
    total = SCENARIOS * sum(len(track.splits) for track in TRACKS.values())
    with progress(total=total, unit="scenario", desc="draw") as bar:
        files = scenario_files(on_scenario=bar.update)
    written = refresh({root / name: text for name, text in files.items()}, WRITER, check=check)
    if check:
        print(f"{len(files)} scenario files in {root} are up to date")
        return
    load_scenarios.cache_clear()
    print(f"{written} of {len(files)} files written to {root}")
