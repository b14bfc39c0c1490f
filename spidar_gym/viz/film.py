"""Videos of flights and crawls in real time, and of courses faster: one robot, or several side by side, above plots."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from spidar_gym.errors import MissingDependencyError
from spidar_gym.files import whole_file
from spidar_gym.paper.crawl import CrawlLog
from spidar_gym.paper.flight import FORM_CHANGE, UNRESTRICTED, FlightLog
from spidar_gym.robot import ROBOT, RobotSpec
from spidar_gym.sim.ground import GroundConfig
from spidar_gym.sim.object import ObjectConfig
from spidar_gym.sim.renderer import require_pictures
from spidar_gym.sim.stage import FIXED, Stage, between, cog, extent, standing
from spidar_gym.so3 import quat_to_matrix
from spidar_gym.viz.style import BLACK, BLUE, INSTALL_VIZ, VERMILLION, pyplot, spans

FPS = 30
"""Frames per second."""
SIZE = 1280, 720
"""Width and height [px]."""
STRIP = 178
"""Height of the strip of plots [px]."""
TOP = 70
"""Height of the captions [px]."""
SAMPLED = 10
"""Interval of the ticks from which the position of a fixed camera is computed."""
COLORS = (BLUE, VERMILLION)
"""Colours of the takes of a video."""
STROKES = ("-", "--")
DPI = 100
OPACITY = 0.86
"""Opacity of the strip over the picture."""


@dataclass(frozen=True)
class Take:
    """Data of one flight, crawl or course for a video, with one row per tick."""

    title: str
    """Title: name of the policy or preset."""
    time: np.ndarray
    """Time, (n,) [s]."""
    qpos: np.ndarray
    """Configuration of the simulated robot, (n, 39), or with an object (n, 46)."""
    thrust: np.ndarray
    """Thrust, (n, 8) [N]."""
    phase: Sequence[str]
    """Phase, (n,)."""
    traces: Mapping[str, np.ndarray]
    """Title with unit → values that are plotted over time, (n,)."""
    contacts: Sequence[np.ndarray | None] | None = None
    """Contact points and forces of each tick, world: (k, 6) [m, N]."""
    ground: GroundConfig = field(default_factory=GroundConfig)
    """Floor."""
    pace: float = 1.0
    """Speed of the video as a multiple of real time."""
    robot: RobotSpec = ROBOT
    """Robot."""
    thing: ObjectConfig | None = None
    """Object, if there is one."""


def tick_at(take: Take, time: float) -> int:
    """Return the tick that is nearest to a time [s]; the last one after the end."""
    return round(float(np.interp(time, take.time, np.arange(len(take.time)))))


class Strip:
    """Plots of the traces of some takes; the past is opaque, the future pale."""

    def __init__(self, takes: Sequence[Take], width: int, height: int) -> None:
        """Draw the strip once opaque and once pale; each frame of the video is composed of both.

        Args:
            takes: One or two takes; two share their plots.
            width: Width [px].
            height: Height [px].
        """
        end = max(float(take.time[-1]) for take in takes)
        drawn = [_draw_strip(takes, end, width, height, alpha) for alpha in (1.0, 0.28)]
        (self._past, self._boxes), (self._coming, _) = drawn
        self._takes, self._end = takes, end

    def over(self, frame: np.ndarray, time: float) -> None:
        """Draw the strip over the lower end of a frame (height, width, 3) at a time [s]."""
        strip = self._coming.copy()
        for left, right, top, bottom in self._boxes:
            now = left + round((right - left) * min(time / self._end, 1.0))
            strip[:, left - 4 : now] = self._past[:, left - 4 : now]
            strip[top:bottom, now - 1 : now + 1] = 40.0
        below = frame[-len(strip) :]
        below[:] = (1.0 - OPACITY) * below + OPACITY * strip

    def values(self, time: float) -> list[tuple[int, int, list[str]]]:
        """Return for each plot its right and top [px, from the strip's corner], and the present value of each take."""
        found = []
        for (_, right, top, _), name in zip(self._boxes, self._takes[0].traces, strict=True):
            largest = max(float(np.abs(take.traces[name]).max()) for take in self._takes)
            digits = 2 if largest < 5.0 else 1 if largest < 50.0 else 0
            numbers = [f"{take.traces[name][tick_at(take, time)]:.{digits}f}" for take in self._takes]
            found.append((right, top, numbers))
        return found


class Film:
    """MP4 video of takes, one after the other; the file appears under its name only when it is complete."""

    def __init__(self, path: Path, *, camera: str = FIXED) -> None:
        """Open the encoder; raises `MissingDependencyError` without imageio or OpenGL, before any episode is run.

        Args:
            path: File of the video.
            camera: One of `VIEWS`: `fixed` shows all of a take, the others follow the robot.
        """
        try:
            import imageio.v2 as imageio
        except ImportError as error:
            raise MissingDependencyError("imageio with ffmpeg", INSTALL_VIZ) from error
        require_pictures()
        self._camera = camera
        with ExitStack() as stack:
            part = stack.enter_context(whole_file(path))
            self._writer: Any = imageio.get_writer(
                part, fps=FPS, quality=7, macro_block_size=8, output_params=["-preset", "veryfast"]
            )
            stack.callback(self._writer.close)
            self._stack = stack.pop_all()

    def shoot(self, *takes: Take, frames: Callable[[Iterable[int]], Iterable[int]] = iter) -> None:
        """Append a take to the video, or several takes side by side, at the pace of the first one.

        Args:
            takes: Takes; the longest one sets the length.
            frames: Optional wrapper of the frames' numbers, for progress bars.
        """
        width, height = SIZE[0] // len(takes), SIZE[1]
        strip = Strip(takes, *SIZE[:1], STRIP)
        camera: Any = self._camera
        if camera == FIXED:
            points = np.concatenate([extent(take.qpos[::SAMPLED], take.robot) for take in takes])
            window = 0.04, 0.96, (STRIP + 10) / height, 1.0 - TOP / height
            camera = standing(points, width / height, window)
        stages: list[Stage] = []
        try:
            for take in takes:
                stages.append(Stage(camera, width, height, take.ground, take.robot, take.thing))
            for number in frames(range(length(takes))):
                time = takes[0].pace * (number + 1) / FPS
                frame = np.hstack([picture(take, stage, time) for take, stage in zip(takes, stages, strict=True)])
                strip.over(frame, time)
                self._writer.append_data(_write(frame, takes, strip, time))
        finally:
            for stage in stages:
                stage.close()

    def __enter__(self) -> "Film":
        """Return the video."""
        return self

    def __exit__(self, *raised: Any) -> None:  # noqa: ANN401 - the error, where there is one
        """Complete the file, or discard it after an error."""
        self._stack.__exit__(*raised)


def film_take(
    take: Take, path: Path, *, camera: str = FIXED, frames: Callable[[Iterable[int]], Iterable[int]] = iter
) -> None:
    """Write the video of one take; an interruption leaves no file. `frames` can wrap the frames' numbers for a bar."""
    with Film(path, camera=camera) as reel:
        reel.shoot(take, frames=frames)


def length(takes: Sequence[Take]) -> int:
    """Return the number of frames of takes at the pace of the first one."""
    return max(1, max(round(FPS * float(take.time[-1]) / takes[0].pace) for take in takes))


def flight_take(log: FlightLog) -> Take:
    """Build the take of the paper's flight."""
    title = f"preset {log.preset}{', with noise' if log.noise else ''}"
    phases = [flight_phase(time) for time in log.time.tolist()]
    traces = flight_traces(log.qpos, log.position_error, log.attitude_error)
    return Take(title, log.time, log.qpos, log.thrust, phases, traces)


def flight_phase(time: float) -> str:
    """Return the phase of the paper's flight at a time [s]."""
    start, end = FORM_CHANGE
    if any(first < time <= last for first, last in UNRESTRICTED):
        return "form ③, constraint dropped"
    return "hover in form ①" if time <= start else "① → ② → ③" if time <= end else "hover in form ③"


def flight_traces(
    qpos: np.ndarray, position_error: np.ndarray, attitude_error: np.ndarray, robot: RobotSpec = ROBOT
) -> dict[str, np.ndarray]:
    """Compute height and errors of a flight, with one row per tick.

    Args:
        qpos: Configurations (n, 39).
        position_error: Position errors, (n, 3) [m].
        attitude_error: Attitude errors, (n, 3) [rad].
        robot: Robot.
    """
    return {
        "height of the CoG [m]": cog(qpos, robot)[:, 2],
        "position error [mm]": 1e3 * np.linalg.norm(position_error, axis=1),
        "attitude error [mrad]": 1e3 * np.linalg.norm(attitude_error, axis=1),
    }


def crawl_take(log: CrawlLog) -> Take:
    """Build the take of a crawl."""
    title = f"preset {log.preset}, {log.joint_speed:g} rad/s{', with noise' if log.noise else ''}"
    phases = [str(phase) for phase in log.phase]
    return Take(title, log.time, log.qpos, log.thrust, phases, crawl_traces(log.qpos), log.contacts)


def crawl_traces(qpos: np.ndarray) -> dict[str, np.ndarray]:
    """Compute height, displacement and tilt of a crawling torso from configurations (n, 39)."""
    tilt = [np.arccos(np.clip(quat_to_matrix(row)[2, 2], -1.0, 1.0)) for row in qpos[:, 3:7]]
    return {
        "height of the torso [m]": qpos[:, 2],
        "distance from the start [m]": np.linalg.norm(qpos[:, :2] - qpos[0, :2], axis=1),
        "tilt of the torso [mrad]": 1e3 * np.array(tilt),
    }


def course_traces(qpos: np.ndarray, thrust_fraction: np.ndarray, charge: np.ndarray) -> dict[str, np.ndarray]:
    """Compute height of the torso, thrust and charge on a course, with one row per step.

    Args:
        qpos: Configurations (n, 39).
        thrust_fraction: Commanded Σλ over the weight, (n,).
        charge: Charge of the battery, (n,), 0 … 1.
    """
    return {
        "height of the torso [m]": qpos[:, 2],
        "thrust over weight": thrust_fraction,
        "charge [%]": 100.0 * charge,
    }


def grasp_traces(qpos: np.ndarray, grip: np.ndarray, force: np.ndarray, thrust: np.ndarray) -> dict[str, np.ndarray]:
    """Compute the height of the object, forces and thrust of a grasp, with one row per step.

    Args:
        qpos: Configurations (n, 46).
        grip: Planned force of a foot, (n,) [N].
        force: Largest force of a foot on the object, (n,) [N].
        thrust: Commanded Σλ over the weight, (n,).
    """
    return {
        "height of the object [m]": qpos[:, 41],
        "planned grip of a foot [N]": grip,
        "largest force of a foot [N]": force,
        "thrust over weight": thrust,
    }


def picture(take: Take, stage: Stage, time: float) -> np.ndarray:
    """Render the robot at a time [s], interpolated between ticks; after the end of the take, in its last state."""
    place = float(np.interp(time, take.time, np.arange(len(take.time))))
    first = math.floor(place)
    second, share = min(first + 1, len(take.time) - 1), place - first
    qpos = between(take.qpos[first], take.qpos[second], share)
    thrust = (1.0 - share) * take.thrust[first] + share * take.thrust[second]
    contacts = None if take.contacts is None else take.contacts[tick_at(take, time)]
    return stage.render(qpos, thrust=thrust, contacts=contacts)


def _write(frame: np.ndarray, takes: Sequence[Take], strip: Strip, time: float) -> np.ndarray:
    """Write title, time, phase and present values on a frame."""
    from PIL import Image, ImageDraw

    image = Image.fromarray(frame)
    draw = ImageDraw.Draw(image)
    width, height = image.width // len(takes), image.height
    for k, take in enumerate(takes):
        color = COLORS[k] if len(takes) > 1 else BLACK
        draw.text((k * width + 20, 14), take.title, fill=color, font=font(22, bold=True))
        end = float(take.time[-1])
        pace = f"× {take.pace:g}" if take.pace != 1.0 else ""
        ended = "" if time < end + take.pace / FPS else "ended"
        words = [f"{min(time, end):.1f} s", pace, take.phase[tick_at(take, time)], ended]
        draw.text((k * width + 20, 44), "   ".join(word for word in words if word), fill=BLACK, font=font(18))
        if k:
            draw.line([(k * width, 0), (k * width, height - STRIP)], fill="white", width=3)
    for right, top, values in strip.values(time):
        x = right
        for color, value in reversed(list(zip(COLORS, values, strict=False))):
            draw.text((x, height - STRIP + top - 7), value, fill=color, font=font(15, bold=True), anchor="rs")
            x -= draw.textlength(value, font=font(15, bold=True)) + 12
    return np.asarray(image)


@cache
def font(size: int, *, bold: bool = False) -> Any:  # noqa: ANN401 - a font
    """Load the figures' font for Pillow."""
    from matplotlib import font_manager
    from PIL import ImageFont

    found = font_manager.findfont(
        font_manager.FontProperties(family="DejaVu Sans", weight="bold" if bold else "normal")
    )
    return ImageFont.truetype(found, size)


def _draw_strip(
    takes: Sequence[Take], end: float, width: int, height: int, alpha: float
) -> tuple[np.ndarray, list[tuple[int, int, int, int]]]:
    """Draw the strip (height, width, 3); return it with each plot's left, right, top, bottom [px]."""
    plt = pyplot()
    names = list(takes[0].traces)
    figure, axes = plt.subplots(1, len(names), figsize=(width / DPI, height / DPI), dpi=DPI, layout="none")
    figure.subplots_adjust(left=0.045, right=0.985, bottom=0.22, top=0.80, wspace=0.16)
    for axis, name in zip(axes, names, strict=True):
        for take, color, stroke in zip(takes, COLORS, STROKES, strict=False):
            axis.plot(take.time, take.traces[name], color=color, linestyle=stroke, alpha=alpha, linewidth=1.6)
        dropped = np.array(["dropped" in phase for phase in takes[0].phase])
        for start, last in spans(takes[0].time, dropped):
            axis.axvspan(start, last, color=VERMILLION, alpha=0.12, linewidth=0)
        axis.set_title(name, fontsize=9, fontweight="normal", pad=6)
        axis.tick_params(labelsize=8)
        axis.set_xlim(0.0, end)
        axis.margins(y=0.12)
        axis.locator_params(axis="y", nbins=4)
        if axis is axes[-1]:
            axis.set_xlabel("time [s]", fontsize=8, loc="right", labelpad=1)
    figure.canvas.draw()
    image: Any = np.asarray(figure.canvas.buffer_rgba())[:, :, :3].astype(np.float32)
    boxes = []
    for axis in axes:
        box = axis.get_window_extent()
        boxes.append((round(box.x0), round(box.x1), round(height - box.y1), round(height - box.y0)))
    plt.close(figure)
    return image, boxes
