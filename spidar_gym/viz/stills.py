"""Pictures of the robot: strips of snapshots, its forms, and a gait cycle."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from spidar_gym.control.flight.controller import FlightController
from spidar_gym.errors import MissingDependencyError
from spidar_gym.files import whole_file
from spidar_gym.native.plant import Plant
from spidar_gym.paper.crawl import LEGS_UP, TORSO_PHASES, CrawlLog
from spidar_gym.robot import FORMS
from spidar_gym.sim.ground import GroundConfig
from spidar_gym.sim.stage import Stage, extent, standing
from spidar_gym.viz.film import font
from spidar_gym.viz.style import BLACK, INSTALL_VIZ

WINDOW = 0.03, 0.97, 0.04, 0.88
"""Left, right, bottom, top of the region that contains the robot, as shares of a picture; the caption is above."""


@dataclass(frozen=True)
class Shot:
    """Snapshot of the robot for a picture."""

    words: str
    """Caption."""
    qpos: np.ndarray
    """Configuration of the simulated robot, (39,)."""
    thrust: np.ndarray | None = None
    """Thrust, drawn as arrows, (8,) [N]."""
    contacts: np.ndarray | None = None
    """Contact points and forces, drawn as arrows, world: (k, 6) [m, N]."""


def forms_picture(path: Path) -> None:
    """Draw the robot in a hover in the paper's forms ①, ②, ③ side by side (`MissingDependencyError` without OpenGL)."""
    controller, plant, shots = FlightController(), Plant(), []
    for mark, q in zip("①②③", FORMS.values(), strict=True):
        plant.reset(np.array([0.0, 0.0, 1.3]), joint_position=q, vectoring=controller.rest_vectoring(q))
        shots.append(Shot(f"form {mark}", plant.data.qpos.copy()))
    strip(shots, path, size=(560, 420))


def crawl_strip(log: CrawlLog, path: Path, *, size: tuple[int, int] = (560, 360)) -> None:
    """Draw one gait cycle as a strip with a picture of each phase; the second cycle if there is one."""
    changes = np.flatnonzero(log.phase[1:] != log.phase[:-1]) + 1
    runs = [(str(log.phase[a]), int(a), int(b)) for a, b in zip(changes, [*changes[1:], len(log.phase)], strict=True)]
    starts = [k for k, run in enumerate(runs) if run[0] == "raise"]
    first = starts[min(1, len(starts) - 1)]
    cycle = [run for run in runs[first : first + 8] if run[0] in LEGS_UP + TORSO_PHASES][:6]
    shots = []
    for name, start, end in cycle:
        t = end - 1 if name in ("raise", "up") else (start + end) // 2
        shots.append(Shot(f"{name}, {log.time[t]:.1f} s", log.qpos[t], log.thrust[t], log.contacts[t]))
    strip(shots, path, size=size)


def strip(shots: Sequence[Shot], path: Path, *, size: tuple[int, int], ground: GroundConfig | None = None) -> None:
    """Draw snapshots side by side, each of `size` [px], from one camera that shows all of them."""
    stage = Stage(standing(extent(np.array([shot.qpos for shot in shots])), size[0] / size[1], WINDOW), *size, ground)
    try:
        pictures = [stage.render(shot.qpos, thrust=shot.thrust, contacts=shot.contacts) for shot in shots]
    finally:
        stage.close()
    write_strip(path, pictures, [shot.words for shot in shots])


def write_strip(path: Path, pictures: Sequence[np.ndarray], words: Sequence[str], columns: int = 3) -> None:
    """Write pictures of one size with captions as one file, with `columns` per row; the last row is filled with white.

    Raises:
        MissingDependencyError: Without Pillow, which is part of the extra `viz`.
    """
    try:
        from PIL import Image, ImageDraw
    except ImportError as error:
        raise MissingDependencyError("Pillow", INSTALL_VIZ) from error

    named = []
    for picture, text in zip(pictures, words, strict=True):
        image = Image.fromarray(picture)
        ImageDraw.Draw(image).text((12, 8), text, fill=BLACK, font=font(18))
        named.append(np.asarray(image))
    columns = min(columns, len(named))
    named += [np.full_like(named[0], 255)] * (-len(named) % columns)
    rows = [np.hstack(named[k : k + columns]) for k in range(0, len(named), columns)]
    with whole_file(path) as target:
        Image.fromarray(np.vstack(rows)).save(target, optimize=True)
