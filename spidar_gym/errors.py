"""Every error that the tools raise: one base class, each message says what would have been valid."""

import math
from collections.abc import Iterable
from numbers import Real


class SpidarError(Exception):
    """Base of every error that this package raises on purpose."""

    def __reduce__(self) -> tuple[object, ...]:
        """Cross processes with the finished message, which the classes below compose."""
        return _with_message, (type(self), str(self))


def _with_message(kind: type[SpidarError], message: str) -> SpidarError:
    error = kind.__new__(kind, message)
    error.args = (message,)
    return error


class UnknownNameError(SpidarError, ValueError):
    """A name (form, preset, action mode, camera, id) that does not exist."""

    def __init__(self, kind: str, name: object, valid: Iterable[str]) -> None:
        """Say which `kind` of name is unknown and list the `valid` ones."""
        super().__init__(f"unknown {kind} {name!r}; valid: {', '.join(valid)}")


class InvalidValueError(SpidarError, ValueError):
    """A value outside its range, or an array of the wrong shape."""

    def __init__(self, name: str, value: object, expected: str) -> None:
        """Say which argument has which `value` and what was `expected`."""
        super().__init__(f"{name} = {value!r} is not valid; expected {expected}")


class StaleAssetError(SpidarError, RuntimeError):
    """A generated file that differs from what the robot description generates."""

    def __init__(self, path: object, command: str = "spidar assets") -> None:
        """Name the file and the command that writes it anew."""
        super().__init__(
            f"{path} is missing or differs from what the code generates (edited by hand, or written by "
            f"another version); valid: the file that `{command}` writes"
        )


class MissingDependencyError(SpidarError, ImportError):
    """An optional package or system library that is not installed."""

    def __init__(self, what: str, install: str) -> None:
        """Say `what` is missing and how to `install` it."""
        super().__init__(f"{what} is not available; install it with: {install}")


def require_name(kind: str, name: str, valid: Iterable[str]) -> None:
    """Raise `UnknownNameError` unless `name` is one of the valid ones."""
    if name not in valid:
        raise UnknownNameError(kind, name, valid)


def require_not_negative(**numbers: float) -> None:
    """Raise `InvalidValueError` for the first of the named numbers that is negative or not finite."""
    for name, value in numbers.items():
        if not (isinstance(value, Real) and 0.0 <= float(value) < math.inf):
            raise InvalidValueError(name, value, "a number of at least 0")


def require_least(least: int, **numbers: int) -> None:
    """Raise `InvalidValueError` for the first of the named numbers that is below `least`."""
    for name, value in numbers.items():
        if value < least:
            raise InvalidValueError(name, value, f"a whole number of at least {least}")
