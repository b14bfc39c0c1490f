"""`spidar`: the command line. Degrees and file paths exist here only."""

# pyright: reportAttributeAccessIssue=false
# The compiled modules below come without stubs.

import contextlib
import io
import math
import os
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated

import gymnasium
import numpy as np
import tyro
from tqdm import tqdm

from spidar_gym import experiments, studies, viz
from spidar_gym import tune as tuning
from spidar_gym.bench import PARTS, bench_table, run_bench
from spidar_gym.control.controller import CONTROL_RATE
from spidar_gym.control.presets import PRESETS
from spidar_gym.description import CAMERAS, assets_dir, generated_files
from spidar_gym.envs.actions import ACTION_MODES
from spidar_gym.envs.hover import HoverEnv
from spidar_gym.envs.hover_task import SEQUENCES, hover_height
from spidar_gym.envs.page import page, pages
from spidar_gym.envs.registry import ENVIRONMENTS, Entry, environment
from spidar_gym.errors import (
    InvalidValueError,
    MissingDependencyError,
    SpidarError,
    StaleAssetError,
    require_least,
    require_name,
)
from spidar_gym.files import json_text, output_folder, write_text
from spidar_gym.robot import FORMS, N_ROTORS, ROBOT
from spidar_gym.scenario import CONDITIONS
from spidar_gym.sim.disturbances import FAULTS
from spidar_gym.sim.plant import Plant
from spidar_gym.sim.scene import scene

app = tyro.extras.SubcommandApp()
paper_app = tyro.extras.SubcommandApp()

PresetArg = Annotated[str, tyro.conf.arg(metavar="{" + ",".join(PRESETS) + "}")]
FormsArg = Annotated[str, tyro.conf.arg(metavar="{" + ",".join(SEQUENCES) + "}")]
FaultArg = Annotated[str, tyro.conf.arg(metavar="{" + ",".join(FAULTS) + "}")]
CameraArg = Annotated[str, tyro.conf.arg(metavar="{" + ",".join(CAMERAS) + "}")]


@paper_app.command(is_default=True)
def flight(
    preset: PresetArg = "as_flown",
    out: Path = Path("out/flight"),
    camera: CameraArg = "chase",
    json: tyro.conf.FlagCreatePairsOff[bool] = False,
    video: bool = True,
    noise: tyro.conf.FlagCreatePairsOff[bool] = False,
    seed: int = 0,
    speeds: tyro.conf.FlagCreatePairsOff[bool] = False,
    ablation: tyro.conf.FlagCreatePairsOff[bool] = False,
    scenarios: int = 24,
    workers: int = os.cpu_count() or 1,
) -> None:
    """Fly the paper's flight experiment (40 s, forms 1 to 2 to 3) and print our figures beside the paper's.

    Args:
        preset: Controller that flies: as_flown is what the robot flew, paper is the paper's cost and rows, tuned goes
            beyond it.
        out: Folder for flight.json, flight.png and flight.mp4; of --speeds: speeds.json and speeds.png.
        camera: Camera of the video.
        json: Print one JSON object on stdout and nothing else there.
        video: Film the flight (about as long as the flight itself).
        noise: Fly with real sensors, 20 ms of delay and unequal rotors: the flight to compare with the paper's RMSE.
        seed: Of that noise.
        speeds: Instead, compare preset tuned with paper in random asymmetric forms at joint speeds 0.2 … 1.0 rad/s.
        ablation: Instead, the same at 0.2, 0.6, 1.0 rad/s, and with each option of tuned switched off.
        scenarios: Flights of a cell of --speeds and --ablation.
        workers: Processes for them.
    """
    require_least(1, scenarios=scenarios, workers=workers)
    require_least(0, seed=seed)
    if speeds or ablation:
        _speeds(output_folder(out), json, ablation, scenarios, workers)
        return
    require_name("preset", preset, PRESETS)
    require_name("camera", camera, CAMERAS)
    folder = output_folder(out)
    remarks = []
    with tqdm(total=experiments.FLIGHT_TICKS, unit="tick", desc=f"flight, {preset}", file=sys.__stderr__) as bar:
        log = experiments.fly_paper(preset, noise=noise, seed=seed, on_tick=bar.update)
    figures = experiments.flight_figures(log)
    text = json_text({"flight": figures, "paper": {"flight": experiments.PAPER_FLIGHT}})
    write_text(folder / "flight.json", text)
    # After the flight, so that drawing does not disturb the times that it reports.
    for name, draw in (
        ("figure", lambda: viz.flight_figure(log, folder / "flight.png")),
        ("video", lambda: viz.film_flight(log, folder / "flight.mp4", camera=camera, ticks=_bar) if video else None),
    ):
        try:
            draw()
        except MissingDependencyError as error:
            remarks.append(f"no {name}: {error}")
    if json:
        print(text)
    else:
        print(experiments.flight_table(figures))
        print(f"\nwritten to {folder}: {', '.join(sorted(p.name for p in folder.glob('flight.*')))}")
    for remark in remarks:
        print(remark, file=sys.__stderr__)


def _speeds(folder: Path, json: bool, ablation: bool, scenarios: int, workers: int) -> None:
    """Compare controllers over joint speeds: table, JSON and figure."""
    name = "ablation" if ablation else "speeds"
    joint_speeds = studies.SPEEDS if ablation else studies.MANY_SPEEDS
    flights = len(CONDITIONS) * len(joint_speeds) * len(studies.controllers(ablation)) * scenarios
    with tqdm(total=flights, unit="flight", desc=name, file=sys.__stderr__) as bar:
        rows = studies.speed_study(
            speeds=joint_speeds, count=scenarios, ablation=ablation, workers=workers, on_flight=bar.update
        )
    text = json_text({name: rows})
    write_text(folder / f"{name}.json", text)
    print(text if json else studies.speed_table(rows))
    if not ablation:
        try:
            viz.speed_figure(rows, folder / "speeds.png")
        except MissingDependencyError as error:
            print(f"no figure: {error}", file=sys.__stderr__)


def _bar(ticks: Iterable[int]) -> Iterable[int]:
    return tqdm(ticks, unit="tick", desc="video", file=sys.__stderr__)


app.command(paper_app, name="paper", help="Fly the paper's experiments and print our figures beside the paper's.")


@app.command
def run(
    env_id: tyro.conf.Positional[str] = "spidar_gym/Hover-v0",
    episodes: int = 1,
    seed: int = 0,
    forms: FormsArg = "mixed",
    preset: PresetArg = "paper",
    joint_speed: float = ROBOT.joint_speed,
    seconds: float | None = None,
    wake: bool = True,
    sensors: tyro.conf.FlagCreatePairsOff[bool] = False,
    randomization: float = 0.0,
    wind: float = 0.0,
    push: float = 0.0,
    lost_rotor: int = 0,
    fault: FaultArg = "thrust",
    camera: CameraArg = "chase",
    out: Path | None = None,
    show: tyro.conf.FlagCreatePairsOff[bool] = False,
) -> None:
    """Fly episodes with the zero action, which is the controller alone; show them or record them.

    Args:
        env_id: Environment.
        episodes: How many episodes.
        seed: Seed of the first episode; the next ones follow it.
        forms: Form sequence.
        preset: Controller.
        joint_speed: Joint speed [rad/s].
        seconds: Length of an episode [s]; the environment's own if not given.
        wake: Air between the rotors.
        sensors: The controller sees real sensors through the estimator.
        randomization: Strength of the domain randomisation, 0 … 1.
        wind: Mean wind [m/s].
        push: Force of pushes on the torso [N].
        lost_rotor: Module that fails after 2 s, 1 … 8; 0 for none.
        fault: What it loses.
        camera: Camera of the video.
        out: Video file to write (.mp4).
        show: Open a window.
    """
    entry = _check_run(env_id, episodes, seed, camera, seconds, out)
    horizon = entry.horizon if seconds is None else round(seconds * CONTROL_RATE)
    env = gymnasium.make(
        env_id, forms=forms, preset=preset, joint_speed=joint_speed,
        horizon_s=horizon / CONTROL_RATE, max_episode_steps=horizon,
        wake=wake, sensors=sensors, randomization=randomization,
        disturbances={"wind": wind, "push": push, "lost_rotor": lost_rotor, "fault": fault},
        render_mode="human" if show else None,
    )  # fmt: skip
    inner = env.unwrapped
    assert isinstance(inner, HoverEnv)
    film = None
    if out is not None:
        output_folder(out.parent)
        film = viz.FlightVideo(out, camera=camera)
    zero = np.zeros(env.action_space.shape or ())
    finished, survived, succeeded, finite = False, 0, 0, 0
    try:
        for episode in range(episodes):
            env.reset(seed=seed + episode)
            rewards, errors, ended, info, observation = [], [], False, {}, zero
            with tqdm(
                total=horizon, unit="tick", desc=f"episode {episode + 1}", file=sys.__stderr__, leave=False
            ) as bar:
                while not ended:
                    observation, reward, terminated, truncated, info = env.step(zero)
                    ended = terminated or truncated
                    rewards.append(reward)
                    errors.append(np.concatenate([info["position_error"], info["attitude_error"]]))
                    bar.update()
                    if film is not None:
                        film.film(
                            len(rewards),
                            inner.plant.data.qpos,
                            f"{env_id}  {forms}  {len(rewards) / CONTROL_RATE:5.1f} s",
                            info["thrust"],
                        )
            finite += bool(np.isfinite(observation).all())
            survived += not info["failure"]
            succeeded += info["is_success"]
            rms = np.sqrt((np.array(errors) ** 2).sum(axis=0) / len(errors))
            print(
                f"episode {episode + 1} (seed {seed + episode}): {len(rewards) / CONTROL_RATE:.1f} s, "
                f"mean reward {np.mean(rewards):.3f}, RMS position {1e3 * np.linalg.norm(rms[:3]):.1f} mm, "
                f"attitude {1e3 * np.linalg.norm(rms[3:]):.1f} mrad, "
                + (f"failure: {info['failure']}" if info["failure"] else f"success: {info['is_success']}")
            )
        if episodes > 1:
            print(f"{survived} of {episodes} stayed in the air, {succeeded} with success, {finite} in finite numbers")
        finished = True
    finally:
        if film is not None:
            film.close(keep=finished)
        env.close()


def _check_run(env_id: str, episodes: int, seed: int, camera: str, seconds: float | None, out: Path | None) -> Entry:
    """The environment's entry, where the arguments of `run` make sense."""
    entry = environment(env_id)
    require_least(1, episodes=episodes)
    require_least(0, seed=seed)
    require_name("camera", camera, CAMERAS)
    if seconds is not None and not 1.0 / CONTROL_RATE <= seconds < math.inf:
        raise InvalidValueError("seconds", seconds, f"at least one tick, {1 / CONTROL_RATE:g} s, and finite")
    if out is not None and (out.suffix != ".mp4" or out.is_dir()):
        raise InvalidValueError("out", str(out), "a path of a file that ends in .mp4")
    return entry


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
        print(f"pictures drawn in {folder}")


@app.command
def bench(seconds: float = 0.5, json: tyro.conf.FlagCreatePairsOff[bool] = False) -> None:
    """Measure where the time goes: physics, snapshot, QP, control tick, environment steps.

    Args:
        seconds: Time spent on each figure [s].
        json: Print one JSON object on stdout and nothing else there.
    """
    if not seconds > 0.0:
        raise InvalidValueError("seconds", seconds, "a number above 0 [s]")
    with tqdm(total=PARTS, unit="part", desc="bench", file=sys.__stderr__, leave=False) as bar:

        def on_step(name: str) -> None:
            bar.set_postfix_str(name)
            bar.update()

        result = run_bench(seconds=seconds, on_step=on_step)
    print(json_text(result) if json else bench_table(result))


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
        ("presets", PRESETS), ("form sequences", SEQUENCES), ("action modes", ACTION_MODES), ("cameras", CAMERAS)
    ):  # fmt: skip
        print(f"{title}: {', '.join(names)}")


def main(arguments: list[str] | None = None) -> None:
    """Entry point: an error is one line on stderr and exit status 2; Ctrl-C is 130."""
    # The parser draws boxes; while it may speak, stderr is kept back, and a refusal is put on one line.
    kept = io.StringIO()
    try:
        with contextlib.redirect_stderr(kept):
            app.cli(prog="spidar", description="SPIDAR in simulation.", args=arguments)
    except SpidarError as error:
        sys.exit(_fail(str(error)))
    except KeyboardInterrupt:
        sys.exit(130)
    except SystemExit as stop:
        if stop.code not in (0, None) and kept.getvalue():
            words = kept.getvalue().translate(dict.fromkeys(map(ord, "╭╮╰╯│─"), " ")).split()
            kept.truncate(0)
            sys.exit(_fail(" ".join(words)))
        raise
    finally:
        print(kept.getvalue(), end="", file=sys.__stderr__)


def _fail(message: str) -> int:
    print(f"spidar: {message}", file=sys.__stderr__)
    return 2
