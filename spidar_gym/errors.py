"""Error classes with one base class, and checks of arguments; each message is one line that names valid input."""

import difflib
import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import fields
from numbers import Integral
from typing import Any, TypeGuard

import numpy as np

SHOWN = 200
"""Largest number of characters of a refused value in a message."""
REAL = "?bBhHiIlLqQefd"
"""Type codes of arrays that convert to float64: no text, objects, complex numbers or longer floats."""


class SpidarError(Exception):
    """Base of every error that this package raises on purpose."""

    def __reduce__(self) -> tuple[object, ...]:
        """Pickle the finished message, because the constructors of the subclasses take other arguments."""
        return _with_message, (type(self), str(self))


def closed() -> SpidarError:
    """Return the error for any call on a closed environment, vector or controller."""
    return SpidarError("this environment is closed; valid: a new one")


def _with_message(kind: type[SpidarError], message: str) -> SpidarError:
    error = kind.__new__(kind, message)
    error.args = (message,)
    return error


class UnknownNameError(SpidarError, ValueError):
    """A name (form, preset, action mode, camera, id) that does not exist."""

    def __init__(self, kind: str, name: object, valid: Iterable[str]) -> None:
        """State the `kind` of the unknown name, list the `valid` names, and suggest the most similar one."""
        valid = list(valid)
        alike = difflib.get_close_matches(name, valid, n=1) if isinstance(name, str) and len(name) < SHOWN else []
        meant = f"; did you mean {alike[0]}?" if alike else ""
        super().__init__(f"unknown {kind} {shown(name)}; valid: {', '.join(valid)}{meant}")


class UnknownArgumentError(UnknownNameError, TypeError):
    """A keyword argument that does not exist; worded like Python's own error, which clients parse."""

    def __init__(self, name: str, valid: Iterable[str] | None = None, why: str = "") -> None:
        """State that `name` is no argument, list the `valid` ones, suggest the most similar one, and append `why`.

        Gymnasium re-creates such an error from its message and appends all arguments of the environment. That part is
        removed, because it may be long and span many lines.
        """
        if valid is None:
            SpidarError.__init__(self, name.partition(" was raised from the environment creator for ")[0])
            return
        super().__init__("keyword argument", name, valid)
        words = f"got an unexpected {str(self).removeprefix('unknown ')}"
        self.args = (f"{words}; {why}" if why else words,)


class InvalidValueError(SpidarError, ValueError):
    """A value outside its range, or an array of the wrong shape."""

    def __init__(self, name: str, value: object, expected: str) -> None:
        """State the argument's name, its `value` and what was `expected`."""
        super().__init__(f"{name} = {shown(value)} is not valid; expected {expected}")


class NoGoalError(SpidarError, AttributeError):
    """A goal function of an environment without goals; an `AttributeError`, so that `hasattr` returns False."""


class StaleAssetError(SpidarError, RuntimeError):
    """A generated file that differs from what the robot description generates."""

    def __init__(self, path: object, command: str = "spidar assets", cause: str = "") -> None:
        """Name the file, the command that regenerates it, and the `cause` if it is known."""
        cause = (
            cause
            or "is missing or differs from what the code generates (edited by hand, or written by another version)"
        )
        super().__init__(f"{path} {cause}; valid: the file that `{command}` writes")


class MissingDependencyError(SpidarError, ImportError):
    """An optional package or system library that is not installed."""

    def __init__(self, what: str, install: str) -> None:
        """State `what` is missing and how to `install` it."""
        super().__init__(f"{what} is not available; install it with: {install}")


def shown(value: object) -> str:
    """Format any value in one line of at most `SHOWN` characters."""
    try:
        text = " ".join(repr(value).split())
    except Exception:  # `__repr__` may be foreign code
        text = f"<{type(value).__name__}>"
    return text if len(text) <= SHOWN else f"{text[: SHOWN - 1]}…"


def is_finite(value: object) -> TypeGuard[float]:
    """Whether the value is a finite number that a float can hold."""
    try:
        return isinstance(value, int | float | np.integer | np.floating) and math.isfinite(value)
    except OverflowError:
        return False


def require_name(kind: str, name: object, valid: Iterable[str]) -> None:
    """Raise `UnknownNameError` unless `name` is one of the valid ones."""
    if not (isinstance(name, str) and name in valid):
        raise UnknownNameError(kind, name, valid)


def require_arguments(given: Iterable[str], valid: Iterable[str]) -> None:
    """Raise `UnknownArgumentError` for the first of the given keyword arguments that is not one of the valid ones."""
    valid = list(valid)
    for name in given:
        if name not in valid:
            raise UnknownArgumentError(name, valid)


def require_keys(argument: str, kind: str, value: object, valid: Iterable[str]) -> Mapping[str, Any]:
    """Return an argument's value after checking that it is a mapping with valid keys.

    Args:
        argument: Name of the argument.
        kind: Kind of the keys, for messages.
        value: Value of the argument.
        valid: The allowed keys.

    Raises:
        InvalidValueError: When the value is no mapping.
        UnknownNameError: For the first key that is not valid.
    """
    valid = list(valid)
    if not isinstance(value, Mapping):
        raise InvalidValueError(argument, value, f"a dictionary with any of {', '.join(valid)}")
    for name in value:
        require_name(kind, name, valid)
    return value


def require_array(name: str, value: object, expected: str) -> np.ndarray:
    """Return a copy of the value as float64 (`InvalidValueError` with what was `expected` if it cannot be one)."""
    try:
        array = np.asarray(value)
    except Exception:  # `__array__` may be foreign code
        array = np.array(None)
    if array.dtype.char not in REAL:
        raise InvalidValueError(name, value, expected)
    return array.astype(float)


def require_windows(name: str, value: object) -> tuple[tuple[float, float], ...]:
    """Return time windows as a tuple of pairs; tuples and, from JSON, lists are accepted.

    Raises:
        InvalidValueError: When the value is not a list of valid windows.
    """
    expected = "pairs (start, end) of times [s], 0 ≤ start < end"
    windows = require_array(name, value, expected)
    if windows.size == 0:
        return ()
    paired = windows.ndim == 2 and windows.shape[1] == 2
    if not (paired and np.isfinite(windows).all() and ((windows[:, 0] >= 0.0) & (windows[:, 0] < windows[:, 1])).all()):
        raise InvalidValueError(name, value, expected)
    return tuple((start, end) for start, end in windows.tolist())


def require_arrays(config: Any) -> None:  # noqa: ANN401 - any dataclass
    """Raise `InvalidValueError` if a number of a dataclass is not finite or has a wrong shape; words are ignored."""
    for f in fields(config):
        value = getattr(config, f.name)
        if isinstance(value, bool) or isinstance(f.default, str):
            continue
        shape = f.default_factory().shape if callable(f.default_factory) else ()
        what = f"finite numbers of shape {shape}" if shape else "a finite number"
        array = require_array(f.name, value, what)
        if array.shape != shape or not np.isfinite(array).all():
            raise InvalidValueError(f.name, value.tolist() if isinstance(value, np.ndarray) else value, what)


def _require(values: Mapping[str, Any], fits: Callable[[Any], bool], expected: str) -> None:
    for name, value in values.items():
        if not fits(value):
            raise InvalidValueError(name, value, expected)


def require_within(low: float, high: float, unit: str = "1", **numbers: object) -> None:
    """Raise `InvalidValueError` for the first of the named numbers that is not within low … high [unit]."""
    expected = f"a number within {low:.6g} … {high:.6g} [{unit}]"
    _require(numbers, lambda value: is_finite(value) and low <= value <= high, expected)


def require_flag(**flags: object) -> None:
    """Raise `InvalidValueError` for the first of the named values that is neither true nor false."""
    _require(flags, lambda value: isinstance(value, Integral | np.bool_) and value in (0, 1), "True or False")


def require_instance(kind: type, **values: object) -> None:
    """Raise `InvalidValueError` for the first of the named values that is not an instance of `kind`."""
    _require(values, lambda value: isinstance(value, kind), f"a {kind.__name__}")


def require_not_negative(**numbers: object) -> None:
    """Raise `InvalidValueError` for the first of the named numbers that is negative or not finite."""
    _require(numbers, lambda value: is_finite(value) and value >= 0.0, "a number of at least 0")


def require_above(unit: str = "s", **numbers: object) -> None:
    """Raise `InvalidValueError` for the first of the named numbers that is not above 0 [unit]."""
    _require(numbers, lambda value: value > 0.0, f"a number above 0 [{unit}]")


def require_least(least: int, **numbers: object) -> None:
    """Raise `InvalidValueError` for the first of the named numbers that is not a whole number or is below `least`."""
    expected = f"a whole number of at least {least}"
    _require(numbers, lambda value: isinstance(value, Integral) and int(value) >= least, expected)
