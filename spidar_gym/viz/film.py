"""Films of flights and crawls in real time: one robot, or two side by side, over what happens in time."""

import math
from collections.abc import Callable, Iterable, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from spidar_gym.errors import MissingDependencyError
from spidar_gym.files import WholeFile
from spidar_gym.sim.opengl import require_opengl
from spidar_gym.sim.stage import FIXED, Stage, between, extent, standing
from spidar_gym.viz.strip import COLORS, Strip
from spidar_gym.viz.style import BLACK, INSTALL_VIZ
from spidar_gym.viz.take import Take, tick_at

FPS = 30
"""Pictures a second."""
SIZE = 1280, 720
"""Width and height [px]."""
STRIP = 178
"""Height of the strip [px]."""
TOP = 70
"""Height of the captions [px]."""
SAMPLED = 10
"""Every so many ticks are looked at for where the camera must stand."""


class Film:
    """An MP4 of takes, one after the other; the file appears under its name only when it is complete."""

    def __init__(self, path: Path, *, camera: str = FIXED) -> None:
        """Open the encoder (`MissingDependencyError` says what to install, of OpenGL too: before anything is played).

        Args:
            path: The film's.
            camera: One of `VIEWS`: `fixed` stands where it sees all of a take, the others follow the robot.
        """
        try:
            import imageio.v2 as imageio
        except ImportError as error:
            raise MissingDependencyError("imageio with ffmpeg", INSTALL_VIZ) from error
        require_opengl()
        self._camera, self._file = camera, WholeFile(path)
        try:
            self._writer: Any = imageio.get_writer(
                self._file.path, fps=FPS, quality=7, macro_block_size=8, output_params=["-preset", "veryfast"]
            )
        except BaseException:
            self._file.discard()
            raise

    def shoot(self, *takes: Take, frames: Callable[[Iterable[int]], Iterable[int]] = iter) -> None:
        """Film a take, or several that happen at once, each in a panel of its own, in real time.

        Args:
            takes: What happens; the film ends with the longest.
            frames: May wrap the frames' numbers, to show progress.
        """
        width, height = SIZE[0] // len(takes), SIZE[1]
        strip = Strip(takes, *SIZE[:1], STRIP)
        camera: Any = self._camera
        if camera == FIXED:
            points = np.concatenate([extent(take.qpos[::SAMPLED]) for take in takes])
            window = 0.04, 0.96, (STRIP + 10) / height, 1.0 - TOP / height
            camera = standing(points, width / height, window)
        stages: list[Stage] = []
        try:
            for take in takes:
                stages.append(Stage(camera, width, height, take.ground))
            for number in frames(range(length(takes))):
                time = (number + 1) / FPS
                frame = np.hstack([_picture(take, stage, time) for take, stage in zip(takes, stages, strict=True)])
                strip.over(frame, time)
                self._writer.append_data(_write(frame, takes, strip, time))
        finally:
            for stage in stages:
                stage.close()

    def close(self, *, keep: bool = True) -> None:
        """Finish the film, or throw it away."""
        try:
            self._writer.close()
        except BaseException:
            self._file.discard()
            raise
        if keep:
            self._file.keep()
        else:
            self._file.discard()

    def __enter__(self) -> "Film":
        """Itself."""
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        """Keep the film, unless something was raised."""
        self.close(keep=kind is None)


def film_take(
    take: Take, path: Path, *, camera: str = FIXED, frames: Callable[[Iterable[int]], Iterable[int]] = iter
) -> None:
    """Film one take; an interrupted film leaves no file. `frames` may wrap the frames' numbers, to show progress."""
    with Film(path, camera=camera) as reel:
        reel.shoot(take, frames=frames)


def length(takes: Sequence[Take]) -> int:
    """Frames of a film in real time."""
    return max(1, max(round(FPS * float(take.time[-1])) for take in takes))


def _picture(take: Take, stage: Stage, time: float) -> np.ndarray:
    """The robot at a time [s], between two ticks if need be; after its end it stays where it was."""
    place = float(np.interp(time, take.time, np.arange(len(take.time))))
    first = math.floor(place)
    second, share = min(first + 1, len(take.time) - 1), place - first
    qpos = between(take.qpos[first], take.qpos[second], share)
    thrust = (1.0 - share) * take.thrust[first] + share * take.thrust[second]
    contacts = None if take.contacts is None else take.contacts[tick_at(take, time)]
    return stage.render(qpos, thrust=thrust, contacts=contacts)


def _write(frame: np.ndarray, takes: Sequence[Take], strip: Strip, time: float) -> np.ndarray:
    """A frame with who flies, the time, the phase, and the present values."""
    from PIL import Image, ImageDraw

    image = Image.fromarray(frame)
    draw = ImageDraw.Draw(image)
    width, height = image.width // len(takes), image.height
    for k, take in enumerate(takes):
        color = COLORS[k] if len(takes) > 1 else BLACK
        draw.text((k * width + 20, 14), take.title, fill=color, font=font(22, bold=True))
        end = float(take.time[-1])
        words = [f"{min(time, end):.1f} s", take.phase[tick_at(take, time)], "" if time < end + 1.0 / FPS else "ended"]
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
    """The figures' letters, for pictures."""
    from matplotlib import font_manager
    from PIL import ImageFont

    found = font_manager.findfont(
        font_manager.FontProperties(family="DejaVu Sans", weight="bold" if bold else "normal")
    )
    return ImageFont.truetype(found, size)
