"""`spidar`: the command line. Degrees and file paths exist here only."""

# pyright: reportAttributeAccessIssue=false
# The compiled modules below come without stubs.

import contextlib
import io
import json
import math
import sys
from pathlib import Path
from typing import Annotated, Any

import gymnasium
import numpy as np
import tyro
from tqdm import tqdm

from spidar_gym import experiments, viz
from spidar_gym.bench import bench_table, run_bench
from spidar_gym.control.controller import CONTROL_RATE
from spidar_gym.control.modes import PRESETS
from spidar_gym.description import CAMERAS, assets_dir, generated_files
from spidar_gym.envs.actions import ACTION_MODES
from spidar_gym.envs.env import SpidarEnv
from spidar_gym.envs.page import page, pages
from spidar_gym.envs.registry import ENVIRONMENTS, environment
from spidar_gym.envs.tasks import SEQUENCES, hover_height
from spidar_gym.errors import InvalidValueError, MissingDependencyError, SpidarError, StaleAssetError, UnknownNameError
from spidar_gym.robot import FORMS, ROBOT
from spidar_gym.sim.plant import Plant, scene

app = tyro.extras.SubcommandApp()
paper_app = tyro.extras.SubcommandApp()

PresetArg = Annotated[str, tyro.conf.arg(metavar="{" + ",".join(PRESETS) + "}")]
FormsArg = Annotated[str, tyro.conf.arg(metavar="{" + ",".join(SEQUENCES) + "}")]
CameraArg = Annotated[str, tyro.conf.arg(metavar="{" + ",".join(CAMERAS) + "}")]


@paper_app.command(is_default=True)
def flight(
    preset: PresetArg = "as_flown",
    out: Path = Path("out/flight"),
    camera: CameraArg = "chase",
    json: tyro.conf.FlagCreatePairsOff[bool] = False,
    video: bool = True,
) -> None:
    """Fly the paper's flight experiment (40 s, forms 1 to 2 to 3) and print our figures beside the paper's.

    Args:
        preset: Allocation that flies: as_flown is what the robot flew, paper is the paper's cost and rows.
        out: Folder for flight.json, flight.png and flight.mp4.
        camera: Camera of the video.
        json: Print one JSON object on stdout and nothing else there.
        video: Film the flight (about as long as the flight itself).
    """
    if preset not in PRESETS:
        raise UnknownNameError("preset", preset, PRESETS)
    if camera not in CAMERAS:
        raise UnknownNameError("camera", camera, CAMERAS)
    folder = viz.output_folder(out)
    remarks = []
    with tqdm(total=experiments.FLIGHT_TICKS, unit="tick", desc=f"flight, {preset}", file=sys.__stderr__) as bar:
        log = experiments.fly_paper(preset, on_tick=bar.update)
    figures = experiments.flight_figures(log)
    text = json_text({"flight": figures, "paper": {"flight": experiments.PAPER_FLIGHT}})
    write_text(folder / "flight.json", text)
    # After the flight, so that drawing does not disturb the times that it reports.
    for name, draw in (
        ("figure", lambda: viz.flight_figure(log, folder / "flight.png")),
        ("video", lambda: _film(log, folder / "flight.mp4", camera) if video else None),
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


def _film(log: experiments.FlightLog, path: Path, camera: str) -> None:
    """Draw a flight's video with a progress bar; an interrupted one leaves no file."""
    film = viz.FlightVideo(path, camera=camera)
    finished = False
    try:
        for tick in tqdm(range(len(log.qpos)), unit="tick", desc="video", file=sys.__stderr__):
            film.film(tick, log.qpos[tick], viz.flight_caption(tick))
        finished = True
    finally:
        film.close(keep=finished)


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
        preset: Allocation.
        joint_speed: Joint speed [rad/s].
        seconds: Length of an episode [s]; the environment's own if not given.
        camera: Camera of the video.
        out: Video file to write (.mp4).
        show: Open a window.
    """
    entry = environment(env_id)
    if episodes < 1:
        raise InvalidValueError("episodes", episodes, "a whole number of at least 1")
    if camera not in CAMERAS:
        raise UnknownNameError("camera", camera, CAMERAS)
    if seconds is not None and not 1.0 / CONTROL_RATE <= seconds < math.inf:
        raise InvalidValueError("seconds", seconds, f"at least one tick, {1 / CONTROL_RATE:g} s, and finite")
    if out is not None and (out.suffix != ".mp4" or out.is_dir()):
        raise InvalidValueError("out", str(out), "a path of a file that ends in .mp4")
    horizon = entry.horizon if seconds is None else round(seconds * CONTROL_RATE)
    env = gymnasium.make(
        env_id, forms=forms, preset=preset, joint_speed=joint_speed,
        horizon_s=horizon / CONTROL_RATE, max_episode_steps=horizon,
        render_mode="human" if show else None,
    )  # fmt: skip
    inner = env.unwrapped
    assert isinstance(inner, SpidarEnv)
    film = None
    if out is not None:
        viz.output_folder(out.parent)
        film = viz.FlightVideo(out, camera=camera)
    zero = np.zeros(env.action_space.shape or ())
    finished = False
    try:
        for episode in range(episodes):
            env.reset(seed=seed + episode)
            rewards, errors, ended, info = [], [], False, {}
            with tqdm(
                total=horizon, unit="tick", desc=f"episode {episode + 1}", file=sys.__stderr__, leave=False
            ) as bar:
                while not ended:
                    _, reward, terminated, truncated, info = env.step(zero)
                    ended = terminated or truncated
                    rewards.append(reward)
                    errors.append(np.concatenate([info["position_error"], info["attitude_error"]]))
                    bar.update()
                    if film is not None:
                        film.film(
                            len(rewards),
                            inner.plant.data.qpos,
                            f"{env_id}  {forms}  {len(rewards) / CONTROL_RATE:5.1f} s",
                        )
            rms = np.sqrt((np.array(errors) ** 2).sum(axis=0) / len(errors))
            print(
                f"episode {episode + 1} (seed {seed + episode}): {len(rewards) / CONTROL_RATE:.1f} s, "
                f"mean reward {np.mean(rewards):.3f}, RMS position {1e3 * np.linalg.norm(rms[:3]):.1f} mm, "
                f"attitude {1e3 * np.linalg.norm(rms[3:]):.1f} mrad, "
                + (f"failure: {info['failure']}" if info["failure"] else f"success: {info['is_success']}")
            )
        finished = True
    finally:
        if film is not None:
            film.close(keep=finished)
        env.close()


@app.command
def view(form: Annotated[str, tyro.conf.arg(metavar="{" + ",".join(FORMS) + "}")] = "form1") -> None:
    """Open MuJoCo's viewer on the robot in a form; needs a display.

    Args:
        form: Form that the robot starts in.
    """
    import mujoco
    import mujoco.viewer

    from spidar_gym.sim.renderer import require_display

    if form not in FORMS:
        raise UnknownNameError("form", form, FORMS)
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
    stale = [name for name, text in files.items() if not _same(root / name, text)]
    if check:
        if stale:
            raise StaleAssetError(", ".join(str(root / name) for name in stale))
        print(f"{len(files)} generated files in {root} are up to date")
        return
    for name in stale:
        write_text(root / name, files[name])
    print(f"{len(stale)} of {len(files)} files written to {root}")
    if pictures:
        folder = viz.output_folder(root / "pictures")
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
    with tqdm(total=10, unit="part", desc="bench", file=sys.__stderr__, leave=False) as bar:

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


def json_text(result: dict[str, Any]) -> str:
    """One JSON object as text."""
    return json.dumps(result, indent=2, ensure_ascii=False)


def write_text(path: Path, text: str) -> None:
    """Write a file whole or not at all."""
    viz.output_folder(path.parent)
    temporary = path.with_name(f".{path.name}.part")
    try:
        temporary.write_text(text if text.endswith("\n") else text + "\n", encoding="utf-8")
    except OSError as error:
        temporary.unlink(missing_ok=True)
        raise SpidarError(f"cannot write {path}: {error.strerror}; valid: a path in a writable folder") from error
    viz.replace_file(path, temporary)


def _same(path: Path, text: str) -> bool:
    return path.is_file() and path.read_text(encoding="utf-8") == text


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
