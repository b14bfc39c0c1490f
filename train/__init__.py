"""Learning on top of the allocator: training scripts, their presets, and what they share."""

import sys
from types import TracebackType

from spidar_gym.errors import MissingDependencyError

EXTRA = ("torch", "stable_baselines3", "tensorboard")
"""Modules of the extra `train`, which the scripts import before they can speak for themselves."""


def _say(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
    """What ends a script: one line where the extra is missing, else as Python has it."""
    if isinstance(error, ModuleNotFoundError) and (error.name or "").partition(".")[0] in EXTRA:
        print("train:", MissingDependencyError(str(error.name), "pip install -e '.[train]'"), file=sys.stderr)
    else:
        sys.__excepthook__(kind, error, trace)


sys.excepthook = _say
