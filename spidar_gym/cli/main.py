"""`spidar`: the command line. Only here angles are in degrees."""

import math
import sys
from pathlib import Path

import tyro

from spidar_gym.arguments import JsonArg
from spidar_gym.benchmark.track import TRACKS
from spidar_gym.cli.assets import assets
from spidar_gym.cli.bench import PARTS, bench_table, run_bench
from spidar_gym.cli.docs import docs
from spidar_gym.cli.evaluate import BASELINES, board_app, eval_, scenarios
from spidar_gym.cli.export import export_
from spidar_gym.cli.identify import identify_
from spidar_gym.cli.log import log_app
from spidar_gym.cli.paper import paper_app
from spidar_gym.cli.parameters import parameters
from spidar_gym.cli.run import run
from spidar_gym.cli.sitl import sitl_app
from spidar_gym.cli.suite import suite
from spidar_gym.cli.view import view
from spidar_gym.committed import artifact_patterns
from spidar_gym.console import goes_on, kept, named_steps, progress, run_cli
from spidar_gym.control.presets import CRAWL_PRESETS, PRESETS, SCHEDULES
from spidar_gym.envs.actions import ACTION_MODES, CRAWL_MODES
from spidar_gym.envs.docs import page
from spidar_gym.envs.registry import ENVIRONMENTS, import_id
from spidar_gym.envs.suite import SUITE
from spidar_gym.errors import require_above
from spidar_gym.files import json_text, output_folder
from spidar_gym.policies.provenance import versions
from spidar_gym.processes import cpu_count
from spidar_gym.robot.description import CAMERAS
from spidar_gym.tasks.hover import SEQUENCES
from spidar_gym.text import format_table
from spidar_gym.tune import search as tuning
from spidar_gym.tune.flight import margin_lines

app = tyro.extras.SubcommandApp()
app.command(paper_app, name="paper", help="Simulate the paper's flight and crawl, and compare with its figures.")
app.command(run)
app.command(name="eval")(eval_)
app.command(board_app, name="leaderboard", help="Build and show the leaderboard, compare and verify its rows.")
app.command(suite)
app.command(scenarios)
app.command(name="export")(export_)
app.command(parameters)
app.command(docs)
app.command(sitl_app, name="sitl", help="Software in the loop: the C runner drives the simulated robot.")
app.command(log_app, name="log", help="Describe logs of runner, robot and simulation; convert them to MCAP or CSV.")
app.command(name="identify")(identify_)


@app.command
def tune(
    search: str,
    /,
    out: Path = Path("out/tune"),
    generations: int = 100,
    population: int | None = None,
    scenarios: int = 3,
    seed: int = 0,
    workers: int = cpu_count(),
    robots: Path | None = None,
) -> None:
    """Tune a controller's parameters: flight and crawl with CMA-ES, the others by pattern search; resumable.

    Args:
        search: flight or retuned (flight tracks), steady (calibrated flight tracks), crawl or recrawl (ground tracks),
            steady_crawl (calibrated ground track, also at 0.8 rad/s), or module:NAME of a custom Search.
        out: Folder for the log of the search, written after every generation, from which the search resumes.
        generations: Total number of generations; a pattern search can end earlier, when no step improves the cost.
        population: Number of candidates per generation, 12 if not given; always 2 for a pattern search.
        scenarios: Number of scenarios per track and candidate, sampled for each generation.
            A pattern search uses the same scenarios in all generations.
        seed: Seed of the search.
        workers: Number of processes.
        robots: File of a calibrated world or of an identified robot, whose robots replace those of the calibrated
            tracks and of the margins that are held: for steady and steady_crawl.
    """
    candidates = tuning.candidates(search, population)
    how = dict(generations=generations, population=candidates, scenarios=scenarios, seed=seed, workers=workers)
    tuning.check_search(search, **how)
    folder = output_folder(out)
    total = sum(tuning.pieces(search, candidates, k) for k in range(generations))
    with progress(total=total, unit="play", desc=f"tune {search}") as bar, kept(goes_on(bar, folder)):
        last = tuning.tune(
            search, folder, **how, robots="" if robots is None else str(robots), on_piece=bar.update,
            on_generation=lambda line: bar.set_postfix(gain=math.exp(line["reference"] - line["cost"])),
        )  # fmt: skip
    found = tuning.find_search(search)
    print(json_text(last["parameters"]))
    gain = math.exp(last["reference"] - last["cost"])
    print(
        f"errors of {found.reference} over those of the result, geometric mean: {gain:.3f} after "
        f"{last['generation'] + 1} "
        f"generations, written to {folder / tuning.log_name(search)}"
    )
    if lack := float(last["shortfall"]):
        print(f"its margins are too small, by {lack:.1%} in sum; more generations with the same command may hold them")
    if found.loops is not None:
        print("\n" + format_table(margin_lines(found.loops(last["parameters"])), left=1))


app.command(view)
app.command(assets)


@app.command
def bench(seconds: float = 0.5, json: JsonArg = False) -> None:
    """Measure the time of physics, controller snapshot, QP, control tick and environment steps.

    In a clone with the extra train, `python -m train.speed` measures the time of learning.

    Args:
        seconds: Time spent on each measurement [s].
    """
    require_above(seconds=seconds)
    with progress(total=PARTS, unit="part", desc="bench", leave=False) as bar:
        result = run_bench(seconds=seconds, on_step=named_steps(bar))
    print(json_text(result) if json else bench_table(result))


@app.command(name="list")
def list_(env_id: tyro.conf.Positional[str | None] = None) -> None:
    """List environments, presets, forms, action modes, cameras, tracks and policies, or print an environment's page.

    Args:
        env_id: Environment whose page is printed.
    """
    if env_id is not None:
        print(page(env_id))
        return
    for name, entry in ENVIRONMENTS.items():
        print(f"{name}: {entry.doc}")
    for task in SUITE.values():
        print(f"{task.id}: {task.doc}")
    print(f"ids that import spidar_gym automatically: {', '.join(map(import_id, ENVIRONMENTS))}")
    for title, names in (
        ("presets", PRESETS), ("form sequences", SEQUENCES), ("action modes", ACTION_MODES),
        ("crawl presets", CRAWL_PRESETS), ("schedules", SCHEDULES), ("crawl action modes", CRAWL_MODES),
        ("cameras", CAMERAS), ("benchmark tracks", TRACKS), ("policies", BASELINES),
        ("learned policies", artifact_patterns()),
    ):  # fmt: skip
        print(f"{title}: {', '.join(names)}")


def print_versions() -> None:
    """Print the versions to name in a bug report, one per line; packages of extras only if they are installed."""
    for package, number in versions("torch", "stable-baselines3", "viser").items():
        if number:
            print(package, number)


def main(arguments: list[str] | None = None) -> None:
    """Run the command line; an error prints one line on stderr and exits with status 2, Ctrl-C with 130."""
    given = sys.argv[1:] if arguments is None else arguments
    description = (
        "SPIDAR, a quadruped with a vectorable rotor in each of its eight links, in simulation: environments, "
        "controllers and benchmark. --version prints the versions of spidar_gym and of its dependencies."
    )
    run_cli(
        "spidar",
        print_versions
        if given == ["--version"]
        else lambda: app.cli(prog="spidar", description=description, args=given),
    )


if __name__ == "__main__":
    main()
