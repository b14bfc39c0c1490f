"""Tiny runs of `train.residual` and the parameters of a checkpoint; for files that skip without the extra `train`."""

from pathlib import Path

import numpy as np

from spidar_gym.border import unpack
from train.lib.config import override
from train.lib.run import TITLE
from train.residual import PRESETS

TINY = override(
    PRESETS["hover-paper-ppo"], tracks=("flight-fast3",), steps=192, segment=96, envs=3, n_steps=16, batch_size=24,
    epochs=2, hidden=8, critic_hidden=8, scenarios=1, scaling_ticks=40, critic_first=0, select=False,
    sees=(), hold=1,
)  # fmt: skip
"""Two segments of some seconds each."""


def parameters(folder: Path) -> dict[str, np.ndarray]:
    """All parameters of a run's learner."""
    _, arrays = unpack(TITLE, (folder / "checkpoint.npz").read_bytes(), sealed=True)
    return {name: array for name, array in arrays.items() if name.startswith("learner/")}


def same(mine: dict[str, np.ndarray], theirs: dict[str, np.ndarray]) -> bool:
    """Whether two learners are the same, bit for bit."""
    return mine.keys() == theirs.keys() and all(mine[k].tobytes() == theirs[k].tobytes() for k in mine)
