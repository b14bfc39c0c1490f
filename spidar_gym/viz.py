"""Figures and videos of experiments."""

import math
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from spidar_gym.benchmark.leaderboard import GROUPS, Board
from spidar_gym.control.controller import CONTROL_RATE, Controller
from spidar_gym.crawl_experiment import LEGS_UP, TORSO_PHASES, CrawlLog
from spidar_gym.errors import MissingDependencyError
from spidar_gym.experiments import FLIGHT_SECONDS, UNRESTRICTED, FlightLog
from spidar_gym.files import replace_file
from spidar_gym.robot import FORMS
from spidar_gym.sim.ground import GroundConfig
from spidar_gym.sim.plant import Plant
from spidar_gym.sim.renderer import OffscreenRenderer

INSTALL_VIZ = "pip install 'spidar-gym[viz]'"


def flight_figure(log: FlightLog, path: Path) -> None:
    """The six panels of the paper's flight figure: errors, joints, torques, vectoring angles and thrusts of leg 1."""
    plt = _pyplot()
    panels: list[tuple[str, str, np.ndarray, list[str]]] = [
        ("A  CoG position error", "[m]", log.position_error, ["x", "y", "z"]),
        ("B  attitude error", "[rad]", log.attitude_error, ["x", "y", "z"]),
        ("C  joint angles, leg 1", "[rad]", log.joint_position[:, :4], ["q₁", "q₂", "q₃", "q₄"]),
        ("D  allocated joint torques, leg 1", "[Nm]", log.joint_torque[:, :4], ["τ₁", "τ₂", "τ₃", "τ₄"]),
        ("E  vectoring angles, leg 1", "[rad]", log.vectoring[:, :2].reshape(-1, 4), ["φ₁", "θ₁", "φ₂", "θ₂"]),
        ("F  thrust, leg 1", "[N]", log.thrust[:, :2], ["λ₁", "λ₂"]),
    ]
    figure, axes = plt.subplots(3, 2, figsize=(12, 9), sharex=True, constrained_layout=True)
    for axis, (title, unit, values, labels) in zip(axes.flat, panels, strict=True):
        for label, column in zip(labels, values.T, strict=True):
            axis.plot(log.time, column, label=label, linewidth=1.2)
        for edge in (4.0, 12.0):
            axis.axvline(edge, color="0.75", linewidth=0.8, linestyle="--")
        for start, end in UNRESTRICTED:
            axis.axvspan(start, end, color="tab:red", alpha=0.12, linewidth=0)
        axis.set_title(title, loc="left", fontsize=10)
        axis.set_ylabel(unit)
        axis.grid(alpha=0.3)
        axis.legend(loc="center left", fontsize=8)
        axis.margins(x=0)
    for axis in axes[-1]:
        axis.set_xlabel("time [s]")
    # The paper's own bands make the scale of the errors readable.
    for axis, band in ((axes[0, 0], 0.05), (axes[0, 1], 0.05)):
        axis.axhspan(-band, band, color="0.92", zorder=0)
    figure.suptitle(
        f"Flight with joint motion, forms ① → ② → ③, preset {log.preset}{', with noise' if log.noise else ''}\n"
        "grey: the paper's ± 0.05 band; red: interference rows dropped, 28.5–30 s and 35–36.5 s",
        fontsize=11,
    )
    _save(figure, path)


def speed_figure(rows: list[dict[str, Any]], path: Path) -> None:
    """Errors against joint speed, `paper` beside `tuned`, nominal and randomised: interquartile means."""
    plt = _pyplot()
    conditions = list(dict.fromkeys(row["condition"] for row in rows))
    figure, axes = plt.subplots(2, len(conditions), figsize=(11, 7), sharex=True, sharey="row", constrained_layout=True)
    for column, condition in enumerate(conditions):
        for axis, key, label in zip(
            axes[:, column],
            ("position_mm", "attitude_mrad"),
            ("position error [mm]", "attitude error [mrad]"),
            strict=True,
        ):
            for name in dict.fromkeys(row["controller"] for row in rows):
                own = [row for row in rows if row["controller"] == name and row["condition"] == condition]
                axis.plot([row["joint_speed"] for row in own], [row[key] for row in own], marker="o", label=name)
            axis.set_ylabel(label if column == 0 else "")
            axis.grid(alpha=0.3)
            axis.legend()
        axes[0, column].set_title(condition, loc="left")
        axes[1, column].set_xlabel("joint speed [rad/s]")
    for row_axes, key in zip(axes, ("position_mm", "attitude_mrad"), strict=True):
        row_axes[0].set_ylim(0.0, 1.08 * max(row[key] for row in rows))
    figure.suptitle("Random asymmetric forms: RMS norm a flight, first second left out, interquartile mean")
    _save(figure, path)


def _pyplot() -> Any:  # noqa: ANN401 - a module
    """Matplotlib without a screen (`MissingDependencyError` says what to install)."""
    try:
        import matplotlib

        matplotlib.use("Agg")
        from matplotlib import pyplot as plt
    except ImportError as error:
        raise MissingDependencyError("matplotlib", INSTALL_VIZ) from error
    return plt


def _save(figure: Any, path: Path) -> None:  # noqa: ANN401 - a figure
    from matplotlib import pyplot as plt

    temporary = path.with_name(f".{path.name}.part.png")
    figure.savefig(temporary, dpi=110)
    plt.close(figure)
    replace_file(path, temporary)


def forms_picture(path: Path, *, size: tuple[int, int] = (480, 400)) -> None:
    """The robot in the paper's forms ①, ②, ③, hovering, side by side (`MissingDependencyError` without OpenGL)."""
    from PIL import Image

    renderer = OffscreenRenderer("chase", *size)
    controller, plant, pictures = Controller(), Plant(), []
    try:
        for q in FORMS.values():
            plant.reset(np.array([0.0, 0.0, 1.3]), joint_position=q, vectoring=controller.rest_vectoring(q))
            pictures.append(renderer.render(plant.data.qpos))
    finally:
        renderer.close()
    temporary = path.with_name(f".{path.name}.part.png")
    Image.fromarray(np.hstack(pictures)).save(temporary, optimize=True)
    replace_file(path, temporary)


class VideoWriter:
    """Writes frames to an MP4; the file appears under its name only when it is complete."""

    def __init__(self, path: Path, fps: int) -> None:
        """Open the encoder (`MissingDependencyError` says what to install)."""
        try:
            import imageio.v2 as imageio

            self._temporary = path.with_name(f".{path.name}.part.mp4")
            self._writer: Any = imageio.get_writer(self._temporary, fps=fps, macro_block_size=8, quality=7)
        except ImportError as error:
            raise MissingDependencyError("imageio with ffmpeg", INSTALL_VIZ) from error
        self._path = path

    def add(self, frame: np.ndarray, caption: str = "") -> None:
        """Append a picture (height, width, 3), with a caption in its corner."""
        if caption:
            from PIL import Image, ImageDraw, ImageFont

            image = Image.fromarray(frame)
            draw = ImageDraw.Draw(image)
            draw.text((12, 8), caption, fill=(20, 24, 32), font=ImageFont.load_default(18))
            frame = np.asarray(image)
        self._writer.append_data(frame)

    def close(self, *, keep: bool = True) -> None:
        """Finish the file, or throw it away."""
        self._writer.close()
        if keep:
            replace_file(self._path, self._temporary)
        else:
            self._temporary.unlink(missing_ok=True)


class FlightVideo:
    """Films the robot, every `stride`-th tick."""

    def __init__(
        self,
        path: Path,
        *,
        camera: str = "chase",
        stride: int = 4,
        size: tuple[int, int] = (720, 544),
        ground: GroundConfig | None = None,
    ) -> None:
        """Open renderer and encoder (`MissingDependencyError` says what to install)."""
        self._renderer = OffscreenRenderer(camera, *size, ground)
        try:
            self._writer = VideoWriter(path, fps=round(CONTROL_RATE / stride))
        except BaseException:
            self._renderer.close()
            raise
        self._stride = stride

    def film(
        self,
        tick: int,
        qpos: np.ndarray,
        caption: str = "",
        thrust: np.ndarray | None = None,
        contacts: np.ndarray | None = None,
    ) -> None:
        """Add a frame of a configuration with its thrusts [N], wakes and contact forces, if this tick has one."""
        if tick % self._stride == 0:
            self._writer.add(self._renderer.render(qpos, thrust=thrust, contacts=contacts), caption)

    def lay(self, ground: GroundConfig) -> None:
        """Draw another floor of the same kind from now on."""
        self._renderer.lay(ground)

    def close(self, *, keep: bool = True) -> None:
        """Finish the video, or throw it away."""
        self._writer.close(keep=keep)
        self._renderer.close()


def film_flight(
    log: FlightLog, path: Path, *, camera: str = "chase", ticks: Callable[[Iterable[int]], Iterable[int]] = iter
) -> None:
    """Draw a flight's video; an interrupted one leaves no file. `ticks` may wrap the ticks, to show progress."""
    film = FlightVideo(path, camera=camera)
    finished = False
    try:
        for tick in ticks(range(len(log.qpos))):
            film.film(tick, log.qpos[tick], flight_caption(tick), log.thrust[tick])
        finished = True
    finally:
        film.close(keep=finished)


def flight_caption(tick: int) -> str:
    """Time and form of the flight experiment at a tick."""
    t = tick / CONTROL_RATE
    form = "form 1" if t < 4.0 else "form 1 to 2 to 3" if t < 11.9 else "form 3"
    if any(start <= t < end for start, end in UNRESTRICTED):
        form += ", constraint dropped"
    return f"{t:5.1f} s of {FLIGHT_SECONDS:.0f} s   {form}"


def crawl_figure(log: CrawlLog, path: Path) -> None:
    """The six panels of the paper's crawl figure: torso pose, joints, torques, vectoring and thrusts of leg 1."""
    plt = _pyplot()
    panels: list[tuple[str, str, np.ndarray, list[str]]] = [
        ("A  torso position", "[m]", log.position_w, ["x", "y", "z"]),
        ("B  torso attitude", "[rad]", log.euler, ["roll", "pitch", "yaw"]),
        ("C  joint angles, leg 1", "[rad]", log.joint_position[:, :4], ["q₁", "q₂", "q₃", "q₄"]),
        ("D  servo torques, leg 1", "[Nm]", log.joint_torque[:, :4], ["τ₁", "τ₂", "τ₃", "τ₄"]),
        ("E  vectoring angles, leg 1", "[rad]", log.vectoring[:, :2].reshape(-1, 4), ["φ₁", "θ₁", "φ₂", "θ₂"]),
        ("F  thrust, leg 1, and Σλ / 8", "[N]", np.column_stack((log.thrust[:, :2], log.thrust.mean(axis=1))),
         ["λ₁", "λ₂", "Σλ / 8"]),
    ]  # fmt: skip
    figure, axes = plt.subplots(3, 2, figsize=(12, 9), sharex=True, constrained_layout=True)
    for axis, (title, unit, values, labels) in zip(axes.flat, panels, strict=True):
        for label, column in zip(labels, values.T, strict=True):
            axis.plot(log.time, column, label=label, linewidth=1.2)
        for phases, color in ((LEGS_UP, "tab:blue"), (TORSO_PHASES, "tab:orange")):
            edges = np.flatnonzero(np.diff(np.concatenate(([0], np.isin(log.phase, phases), [0])).astype(int)))
            for start, end in edges.reshape(-1, 2).tolist():
                axis.axvspan(
                    log.time[start], log.time[min(end, len(log.time) - 1)], color=color, alpha=0.08, linewidth=0
                )
        axis.set_title(title, loc="left", fontsize=10)
        axis.set_ylabel(unit)
        axis.grid(alpha=0.3)
        axis.legend(loc="center left", fontsize=8)
        axis.margins(x=0)
    for axis in axes[-1]:
        axis.set_xlabel("time [s]")
    figure.suptitle(
        f"Crawl, preset {log.preset}, {log.joint_speed:g} rad/s{', with noise' if log.noise else ''}\n"
        "blue: all legs lifted; orange: the legs carry the torso",
        fontsize=11,
    )
    _save(figure, path)


def film_crawl(
    log: CrawlLog, path: Path, *, camera: str = "chase", ticks: Callable[[Iterable[int]], Iterable[int]] = iter
) -> None:
    """Draw a crawl's video with thrusts and contact forces; an interrupted one leaves no file."""
    film = FlightVideo(path, camera=camera)
    finished = False
    try:
        for tick in ticks(range(len(log.qpos))):
            caption = f"{log.time[tick]:5.1f} s   {log.phase[tick]}"
            film.film(tick, log.qpos[tick], caption, log.thrust[tick], log.contacts[tick])
        finished = True
    finally:
        film.close(keep=finished)


def crawl_strip(log: CrawlLog, path: Path, *, size: tuple[int, int] = (800, 600)) -> None:
    """One gait cycle as a strip of frames, the second cycle if there is one: the middle of each of its phases."""
    from PIL import Image, ImageDraw, ImageFont

    changes = np.flatnonzero(log.phase[1:] != log.phase[:-1]) + 1
    runs = [(str(log.phase[a]), int(a), int(b)) for a, b in zip(changes, [*changes[1:], len(log.phase)], strict=True)]
    starts = [k for k, run in enumerate(runs) if run[0] == "raise"]
    first = starts[min(1, len(starts) - 1)]
    cycle = [run for run in runs[first : first + 8] if run[0] in LEGS_UP + TORSO_PHASES][:6]
    renderer = OffscreenRenderer("chase", *size)
    pictures = []
    try:
        for name, start, end in cycle:
            tick = end - 1 if name in ("raise", "up") else (start + end) // 2
            frame = renderer.render(log.qpos[tick], thrust=log.thrust[tick], contacts=log.contacts[tick])
            width, height = size
            # The camera is meant for flight; a crawling robot fills the middle.
            image = Image.fromarray(frame).crop((width // 5, height // 4, width - width // 5, height - height // 7))
            draw = ImageDraw.Draw(image)
            draw.text((10, 8), f"{name}, {log.time[tick]:.1f} s", fill=(20, 24, 32), font=ImageFont.load_default(18))
            pictures.append(np.asarray(image))
    finally:
        renderer.close()
    rows = [np.hstack(pictures[k : k + 3]) for k in range(0, len(pictures), 3)]
    temporary = path.with_name(f".{path.name}.part.png")
    Image.fromarray(np.vstack(rows)).save(temporary, optimize=True)
    replace_file(path, temporary)


def leaderboard_picture(board: Board, path: Path) -> None:
    """Scores with their intervals, a panel a group of tracks, written as a picture."""
    plt = _pyplot()
    groups = {group: [t for t in tracks if t in board.tracks] for group, tracks in GROUPS.items()}
    groups = {group: tracks for group, tracks in groups.items() if tracks}
    heights = [len(tracks) for tracks in groups.values()]
    figure, axes = plt.subplots(
        len(groups), 1, figsize=(9.0, 0.8 + 0.25 * math.ceil(len(board.names) / 4) + 0.75 * sum(heights)),
        squeeze=False, gridspec_kw={"height_ratios": heights}, layout="constrained",
    )  # fmt: skip
    palette = plt.get_cmap("tab10" if len(board.names) <= 10 else "tab20")
    colors = {name: palette(k % palette.N) for k, name in enumerate(board.names)}
    for ax, tracks in zip(axes[:, 0], groups.values(), strict=True):
        for y, track in enumerate(tracks):
            own = [name for name in board.names if (name, track) in board.cells]
            for k, name in enumerate(own):
                score = board.cells[name, track].score
                place = y + 0.7 * ((k + 0.5) / len(own) - 0.5)
                ax.plot([score.low, score.high], [place, place], color=colors[name], linewidth=2)
                ax.plot([score.value], [place], "o", color=colors[name], markersize=5)
            if y:
                ax.axhline(y - 0.5, color="0.85", linewidth=0.8)
        ax.axvline(1.0, color="0.4", linewidth=1, linestyle="--")
        ax.set_xscale("log")
        ax.set_yticks(range(len(tracks)), tracks)
        ax.set_ylim(len(tracks) - 0.5, -0.5)
        low, high = ax.get_xlim()
        wide = (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0)
        fine = (0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0, 1.2, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0)
        ticks = [t for t in (wide if high > 8.0 * low else fine) if low <= t <= high]
        ax.set_xticks(ticks, [f"{t:g}" for t in ticks])
        ax.minorticks_off()
        ax.grid(axis="x", color="0.92")
        ax.set_axisbelow(True)
    axes[-1, 0].set_xlabel("score: mean error of qp over one's own, 95 % interval (log scale)")
    handles = [plt.Line2D([], [], color=colors[name], marker="o", label=name) for name in board.names]
    figure.legend(handles=handles, loc="outside upper center", ncols=4, frameon=False)
    _save(figure, path)


AXES = {
    "position_rms_m": ("position RMS [mm]", 1e3), "attitude_rms_rad": ("attitude RMS [mrad]", 1e3),
    "duration_s": ("time [s]", 1.0), "energy_wh": ("energy [Wh]", 1.0), "error": ("error", 1.0),
}  # fmt: skip
"""Label and factor of metrics of learning curves."""


def learning_curves(
    panels: Mapping[str, Mapping[str, list[tuple[list[float], list[float]]]]],
    lines: Mapping[str, Mapping[str, float]],
    title: str,
    path: Path,
) -> None:
    """Learning curves of all runs, a panel a metric, with classical controllers as lines, written as a picture.

    Args:
        panels: Metric → row → for each run its steps and values.
        lines: Row → metric → value.
        title: Title.
        path: Where it goes.
    """
    plt = _pyplot()
    figure, axes = plt.subplots(1, len(panels), figsize=(5.2 * len(panels), 4.2), squeeze=False)
    rows = list(dict.fromkeys(row for runs in panels.values() for row in runs))
    for ax, (metric, runs) in zip(axes[0], panels.items(), strict=True):
        label, factor = AXES[metric]
        for row, curves in runs.items():
            for k, (steps, values) in enumerate(curves):
                ax.plot(
                    np.array(steps) / 1e6, factor * np.array(values), color=f"C{rows.index(row) % 10}", linewidth=1.2,
                    alpha=0.8, label=row if k == 0 else None, marker=".", markersize=3,
                )  # fmt: skip
        for k, (row, values) in enumerate(lines.items()):
            style = ("-", "--", ":", "-.")[k % 4]
            ax.axhline(factor * values[metric], color="0.35", linewidth=1.0, linestyle=style, label=row)
        ax.set_yscale("log")
        low, high = ax.get_ylim()
        # Beyond a decade not every line has room for its number.
        digits = "125" if high > 12.0 * low else "123456789"
        for axis in (ax.yaxis.set_major_formatter, ax.yaxis.set_minor_formatter):
            axis(lambda value, _, digits=digits: f"{value:g}" if f"{value:e}"[0] in digits else "")
        ax.set_xlabel("control ticks [million]")
        ax.set_ylabel(label)
        ax.grid(color="0.92", which="both")
        ax.set_axisbelow(True)
    axes[0, 0].legend(frameon=False, fontsize=8)
    figure.suptitle(title)
    figure.tight_layout()
    _save(figure, path)
