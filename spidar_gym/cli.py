"""`spidar`: the command line. Degrees and file paths exist here only."""

# pyright: reportAttributeAccessIssue=false
# The compiled modules below come without stubs.

import os
import sys
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro
from tqdm import tqdm

from spidar_gym import crawl_experiment, experiments, studies, viz
from spidar_gym import tune as tuning
from spidar_gym.bench import PARTS, bench_table, load_speed, run_bench
from spidar_gym.benchmark.track import TRACKS
from spidar_gym.cli_deploy import export_
from spidar_gym.cli_eval import board_app, eval_, scenarios
from spidar_gym.cli_paper import PresetArg, paper_app
from spidar_gym.cli_run import run
from spidar_gym.cli_sitl import sitl_app
from spidar_gym.control.presets import CRAWL_PRESETS, PRESETS, SCHEDULES
from spidar_gym.description import CAMERAS, assets_dir, generated_files
from spidar_gym.envs.actions import ACTION_MODES, CRAWL_MODES
from spidar_gym.envs.hover_task import SEQUENCES, hover_height
from spidar_gym.envs.page import page, pages
from spidar_gym.envs.registry import ENVIRONMENTS
from spidar_gym.errors import (
    InvalidValueError,
    StaleAssetError,
    require_name,
)
from spidar_gym.files import json_text, output_folder, write_text
from spidar_gym.robot import FORMS, N_ROTORS
from spidar_gym.sim.disturbances import FAULTS
from spidar_gym.sim.plant import Plant
from spidar_gym.sim.scene import scene
from spidar_gym.terminal import speak_plainly

app = tyro.extras.SubcommandApp()
app.command(paper_app, name="paper", help="The paper's flight and crawl, our figures beside the paper's.")
app.command(run)
app.command(name="eval")(eval_)
app.command(board_app, name="leaderboard", help="The leaderboard: build it, show it, verify its rows.")
app.command(scenarios)
app.command(name="export")(export_)
app.command(sitl_app, name="sitl", help="The runner drives the simulated robot through ROS 1 or a socket.")


@app.command
def lost(
    preset: PresetArg = "paper", out: Path = Path("out/lost"), json: tyro.conf.FlagCreatePairsOff[bool] = False
) -> None:
    """Lose each rotor in each form, its thrust or its vectoring: what statics allows and what flight shows.

    Args:
        preset: Controller.
        out: Folder for lost.json.
        json: Print one JSON object on stdout and nothing else there.
    """
    require_name("preset", preset, PRESETS)
    folder = output_folder(out)
    with tqdm(total=len(FAULTS) * len(FORMS) * N_ROTORS, unit="flight", desc="lost", file=sys.__stderr__) as bar:
        rows = studies.lost_rotors(preset, on_flight=bar.update)
    text = json_text({"lost_rotors": rows})
    write_text(folder / "lost.json", text)
    print(text if json else studies.lost_table(rows))


@app.command
def tune(
    out: Path = Path("out/tune"),
    generations: int = 40,
    population: int = 12,
    flights: int = 6,
    seed: int = 0,
    workers: int = os.cpu_count() or 1,
) -> None:
    """Search the gains and compensations of preset tuned with CMA-ES; goes on where an earlier search in --out stopped.

    Args:
        out: Folder of the search's state and log, written after every generation.
        generations: Generations in all.
        population: Candidates a generation.
        flights: Flights a candidate, of 7 s each, on seeds that nothing else flies.
        seed: Seed of the search.
        workers: Processes.
    """
    search = dict(generations=generations, population=population, flights=flights, seed=seed, workers=workers)
    tuning.check_search(**search)
    folder = output_folder(out)
    with tqdm(unit="flight", desc="tune", file=sys.__stderr__) as bar:
        last = tuning.tune(
            folder, **search, on_flight=bar.update, on_generation=lambda line: bar.set_postfix(cost=line["cost"])
        )
    print(json_text(last["parameters"]))
    print(f"cost {last['cost']:.3f} after {last['generation'] + 1} generations, written to {folder / 'tune.json'}\n")
    print(tuning.margin_table(tuning.configuration(last["parameters"])))


@app.command
def view(form: Annotated[str, tyro.conf.arg(metavar="{" + ",".join(FORMS) + "}")] = "form1") -> None:
    """Open MuJoCo's viewer on the robot in a form; needs a display.

    Args:
        form: Form that the robot starts in.
    """
    import mujoco
    import mujoco.viewer

    from spidar_gym.sim.renderer import require_display

    require_name("form", form, FORMS)
    require_display()
    plant = Plant()
    plant.reset(np.array([0.0, 0.0, hover_height()]), joint_position=FORMS[form])
    model = scene(visual=True)
    data = mujoco.MjData(model)
    data.qpos[:], data.act[:], data.ctrl[:] = plant.data.qpos, plant.data.act, plant.data.ctrl
    mujoco.viewer.launch(model, data)


@app.command
def assets(
    check: tyro.conf.FlagCreatePairsOff[bool] = False, pictures: tyro.conf.FlagCreatePairsOff[bool] = False
) -> None:
    """Write the generated files: MJCF, URDF, specification table, environment pages.

    Args:
        check: Write nothing; fail when a committed file is stale.
        pictures: Draw README's pictures too; flies the paper's experiment and needs OpenGL and matplotlib.
    """
    root = assets_dir()
    files = {**generated_files(), **pages()}
    stale = [
        name
        for name, text in files.items()
        if not (root / name).is_file() or (root / name).read_text(encoding="utf-8") != text
    ]
    if check:
        if stale:
            raise StaleAssetError(", ".join(str(root / name) for name in stale))
        print(f"{len(files)} generated files in {root} are up to date")
        return
    for name in stale:
        write_text(root / name, files[name])
    print(f"{len(stale)} of {len(files)} files written to {root}")
    if pictures:
        folder = output_folder(root / "pictures")
        viz.forms_picture(folder / "forms.png")
        viz.flight_figure(experiments.fly_paper("as_flown"), folder / "flight.png")
        log = crawl_experiment.crawl_paper(noise=True)
        viz.crawl_figure(log, folder / "crawl.png")
        viz.crawl_strip(log, folder / "cycle.png")
        print(f"pictures drawn in {folder}")


@app.command
def bench(
    seconds: float = 0.5,
    train: tyro.conf.FlagCreatePairsOff[bool] = False,
    json: tyro.conf.FlagCreatePairsOff[bool] = False,
) -> None:
    """Measure where the time goes: physics, snapshot, QP, control tick, environment steps.

    Args:
        seconds: Time spent on each figure [s].
        train: Instead, measure control ticks a second of the simulation alone, with the allocator, and with a learner;
            takes minutes, and needs a clone of the repository with the extra train.
        json: Print one JSON object on stdout and nothing else there.
    """
    if not seconds > 0.0:
        raise InvalidValueError("seconds", seconds, "a number above 0 [s]")
    parts, measured, table = PARTS, run_bench, bench_table
    if train:
        speed = load_speed()
        parts, measured, table = speed.PARTS, speed.run_speed, speed.speed_table
    with tqdm(total=parts, unit="part", desc="bench", file=sys.__stderr__, leave=False) as bar:

        def on_step(name: str) -> None:
            bar.set_postfix_str(name)
            bar.update()

        result = measured(seconds=seconds, on_step=on_step)
    print(json_text(result) if json else table(result))


@app.command(name="list")
def list_(env_id: tyro.conf.Positional[str | None] = None) -> None:
    """List environments, presets, forms, action modes and cameras, or print one environment's page.

    Args:
        env_id: Environment whose page to print.
    """
    if env_id is not None:
        print(page(env_id))
        return
    for name, entry in ENVIRONMENTS.items():
        print(f"{name}: {entry.doc}")
    for title, names in (
        ("presets", PRESETS), ("form sequences", SEQUENCES), ("action modes", ACTION_MODES),
        ("crawl presets", CRAWL_PRESETS), ("schedules", SCHEDULES), ("crawl action modes", CRAWL_MODES),
        ("cameras", CAMERAS), ("benchmark tracks", TRACKS),
    ):  # fmt: skip
        print(f"{title}: {', '.join(names)}")


def main(arguments: list[str] | None = None) -> None:
    """Entry point: an error is one line on stderr and exit status 2; Ctrl-C is 130."""
    speak_plainly("spidar", lambda: app.cli(prog="spidar", description="SPIDAR in simulation.", args=arguments))
