"""Arrays from outside: what becomes one, defaults, and the check that the robot's configurations share."""

from dataclasses import fields
from typing import Any

import numpy as np

from spidar_gym.errors import InvalidValueError

_REAL = "?bBhHiIlLqQefd"
"""Kinds of array that a float64 can hold: no text, no objects, nothing complex, nothing longer."""


def real_array(name: str, value: object, expected: str) -> np.ndarray:
    """A copy of the value as float64 (`InvalidValueError` where it is none, with what was `expected`)."""
    try:
        array = np.asarray(value)
    except Exception:  # `__array__` is foreign code
        array = np.array(None)
    if array.dtype.char not in _REAL:
        raise InvalidValueError(name, value, expected)
    return array.astype(float)


def check_arrays(config: Any) -> None:  # noqa: ANN401 - any dataclass
    """Refuse a dataclass of numbers with one that is not finite, or an array of another shape than its default."""
    for f in fields(config):
        value = getattr(config, f.name)
        if isinstance(value, bool):
            continue
        shape = f.default_factory().shape if callable(f.default_factory) else ()
        what = f"finite numbers of shape {shape}" if shape else "a finite number"
        array = real_array(f.name, value, what)
        if array.shape != shape or not np.isfinite(array).all():
            raise InvalidValueError(f.name, value.tolist() if isinstance(value, np.ndarray) else value, what)


def constant(value: float, *shape: int) -> np.ndarray:
    """An array of one number that nobody can write: a default for dataclasses."""
    array = np.full(shape, value)
    array.flags.writeable = False
    return array
