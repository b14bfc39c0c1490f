"""The animation of README and the guide: cuts of a flight through the forms, a crawl, a course and a grasp."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from spidar_gym.errors import MissingDependencyError
from spidar_gym.files import whole_file
from spidar_gym.sim.stage import Stage, extent, standing
from spidar_gym.viz.film import SAMPLED, Take, font, picture
from spidar_gym.viz.style import BLACK, INSTALL_VIZ

SIZE = 432, 243
"""Width and height [px]."""
FPS = 10.0
"""Frames per second; GIF stores durations in hundredths of a second."""
WINDOW = 0.04, 0.96, 0.04, 0.86
"""Left, right, bottom, top of the region that contains the robot, as shares of a picture; the caption is above."""
COLORS = 48
"""Number of colours."""


@dataclass(frozen=True)
class Cut:
    """Part of a take."""

    words: str
    """Caption."""
    take: Take
    """Take."""
    start: float
    """Start [s]."""
    end: float
    """End [s]."""
    pace: float
    """Speed as a multiple of real time."""
    camera: str = ""
    """Camera that follows the robot; if empty, a fixed camera that shows the whole cut."""


def write_reel(cuts: Sequence[Cut], path: Path) -> None:
    """Write cuts of takes, one after the other, as an animated GIF that loops.

    Raises:
        MissingDependencyError: Without Pillow or OpenGL.
    """
    try:
        from PIL import Image
    except ImportError as error:
        raise MissingDependencyError("Pillow", INSTALL_VIZ) from error
    frames = [Image.fromarray(frame) for cut in cuts for frame in _frames(cut)]
    # One palette for all cuts, since the background would flicker otherwise.
    sample = Image.fromarray(np.vstack([np.asarray(frame) for frame in frames[:: max(1, len(frames) // 12)]]))
    palette = sample.quantize(COLORS, method=Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE)
    pictures = [frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames]
    with whole_file(path) as draft:
        pictures[0].save(
            draft, format="GIF", save_all=True, append_images=pictures[1:], duration=round(1000.0 / FPS), loop=0,
            optimize=True,
        )  # fmt: skip


def _frames(cut: Cut) -> list[np.ndarray]:
    from PIL import Image, ImageDraw

    take, times = cut.take, np.arange(cut.start, cut.end, cut.pace / FPS)
    camera: Any = cut.camera
    if not camera:
        shown = (take.time >= cut.start) & (take.time <= cut.end)
        camera = standing(extent(take.qpos[shown][::SAMPLED], take.robot), SIZE[0] / SIZE[1], WINDOW)
    stage = Stage(camera, *SIZE, take.ground, take.robot, take.thing)
    try:
        found = []
        for time in times.tolist():
            image = Image.fromarray(picture(take, stage, time))
            words = f"{cut.words}   × {cut.pace:g}"
            ImageDraw.Draw(image).text((12, 9), words, fill=BLACK, font=font(15, bold=True))
            found.append(np.asarray(image))
        return found
    finally:
        stage.close()
