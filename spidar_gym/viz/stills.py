"""Pictures of the robot: its forms, and a gait cycle."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from spidar_gym.control.flight.controller import FlightController
from spidar_gym.files import WholeFile
from spidar_gym.paper.crawl import LEGS_UP, TORSO_PHASES, CrawlLog
from spidar_gym.robot import FORMS
from spidar_gym.sim.plant import Plant
from spidar_gym.sim.stage import Stage, extent, standing
from spidar_gym.viz.film import font
from spidar_gym.viz.style import BLACK

WINDOW = 0.03, 0.97, 0.04, 0.88
"""Left, right, bottom, top of what holds the robot, as shares of a picture; above it are the words."""


def forms_picture(path: Path, *, size: tuple[int, int] = (560, 420)) -> None:
    """The robot in the paper's forms ①, ②, ③, hovering, side by side (`MissingDependencyError` without OpenGL)."""
    controller, plant, rows = FlightController(), Plant(), []
    for q in FORMS.values():
        plant.reset(np.array([0.0, 0.0, 1.3]), joint_position=q, vectoring=controller.rest_vectoring(q))
        rows.append(plant.data.qpos.copy())
    qpos = np.array(rows)
    stage = Stage(standing(extent(qpos), size[0] / size[1], WINDOW), *size)
    try:
        pictures = [stage.render(row) for row in qpos]
    finally:
        stage.close()
    write_strip(path, pictures, ["form ①", "form ②", "form ③"])


def crawl_strip(log: CrawlLog, path: Path, *, size: tuple[int, int] = (560, 360)) -> None:
    """One gait cycle as a strip of frames, the second cycle if there is one: the middle of each of its phases."""
    changes = np.flatnonzero(log.phase[1:] != log.phase[:-1]) + 1
    runs = [(str(log.phase[a]), int(a), int(b)) for a, b in zip(changes, [*changes[1:], len(log.phase)], strict=True)]
    starts = [k for k, run in enumerate(runs) if run[0] == "raise"]
    first = starts[min(1, len(starts) - 1)]
    cycle = [run for run in runs[first : first + 8] if run[0] in LEGS_UP + TORSO_PHASES][:6]
    ticks = [end - 1 if name in ("raise", "up") else (start + end) // 2 for name, start, end in cycle]
    stage = Stage(standing(extent(log.qpos[ticks]), size[0] / size[1], WINDOW), *size)
    try:
        pictures = [stage.render(log.qpos[t], thrust=log.thrust[t], contacts=log.contacts[t]) for t in ticks]
    finally:
        stage.close()
    write_strip(
        path, pictures, [f"{name}, {log.time[tick]:.1f} s" for (name, *_), tick in zip(cycle, ticks, strict=True)]
    )


def write_strip(path: Path, pictures: Sequence[np.ndarray], words: Sequence[str], columns: int = 3) -> None:
    """Pictures with words in their corners, so many in a row, as one file."""
    from PIL import Image, ImageDraw

    named = []
    for picture, text in zip(pictures, words, strict=True):
        image = Image.fromarray(picture)
        ImageDraw.Draw(image).text((12, 8), text, fill=BLACK, font=font(18))
        named.append(np.asarray(image))
    rows = [np.hstack(named[k : k + columns]) for k in range(0, len(named), columns)]
    with WholeFile(path) as target:
        Image.fromarray(np.vstack(rows)).save(target, optimize=True)
