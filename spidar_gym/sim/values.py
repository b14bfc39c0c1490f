"""Array defaults, and the check that the configurations of the simulated robot share."""

import math
from dataclasses import fields
from typing import Any

import numpy as np

from spidar_gym.errors import InvalidValueError


def check_arrays(config: Any) -> None:  # noqa: ANN401 - any dataclass
    """Refuse a dataclass of numbers with one that is not finite, or an array of another shape than its default."""
    for f in fields(config):
        value = getattr(config, f.name)
        if isinstance(value, bool):
            continue
        shape = f.default_factory().shape if callable(f.default_factory) else ()
        try:
            array = np.asarray(value, float)
        except (TypeError, ValueError):
            array = np.array(math.nan)
        if array.shape != shape or not np.isfinite(array).all():
            what = f"finite numbers of shape {shape}" if shape else "a finite number"
            raise InvalidValueError(f.name, value.tolist() if isinstance(value, np.ndarray) else value, what)


def constant(value: float, *shape: int) -> np.ndarray:
    """An array of one number that nobody can write: a default for dataclasses."""
    array = np.full(shape, value)
    array.flags.writeable = False
    return array
