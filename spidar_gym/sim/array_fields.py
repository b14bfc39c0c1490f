"""Array fields of the robot's configurations: the check of shape and size."""

from dataclasses import fields
from typing import Any

import numpy as np

from spidar_gym.errors import InvalidValueError, require_array


def check_arrays(config: Any) -> None:  # noqa: ANN401 - any dataclass
    """Refuse a dataclass of numbers with one that is not finite, or an array of another shape than its default."""
    for f in fields(config):
        value = getattr(config, f.name)
        if isinstance(value, bool):
            continue
        shape = f.default_factory().shape if callable(f.default_factory) else ()
        what = f"finite numbers of shape {shape}" if shape else "a finite number"
        array = require_array(f.name, value, what)
        if array.shape != shape or not np.isfinite(array).all():
            raise InvalidValueError(f.name, value.tolist() if isinstance(value, np.ndarray) else value, what)
