"""A policy's arguments of its environment as data: text, numbers (also by name), configurations of controllers."""

import json
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any

from spidar_gym.control.crawl.controller import CrawlerConfig
from spidar_gym.control.flight.controller import ControllerConfig
from spidar_gym.errors import InvalidValueError, SpidarError, require_name, shown

CONFIGS = {config.__name__: config for config in (ControllerConfig, CrawlerConfig)}
"""Configurations that may be chosen."""


def as_data(name: str, value: Any) -> Any:  # noqa: ANN401 - an argument of `gym.make`
    """Convert an argument to JSON; a configuration is reduced to the values that differ from its defaults.

    Raises:
        InvalidValueError: For an argument that is code, such as an allocator or a law.
    """
    try:
        if type(value) in CONFIGS.values():
            value = {type(value).__name__: _changed(value)}
        return json.loads(json.dumps(value, allow_nan=False))
    except (TypeError, ValueError) as error:
        raise InvalidValueError(
            name, value, "words, numbers and configurations, as code from outside the package acts by its actions alone"
        ) from error


def _changed(config: Any) -> dict[str, Any]:  # noqa: ANN401 - a dataclass
    usual, found = type(config)(), {}
    for name, value in ((field.name, getattr(config, field.name)) for field in fields(config)):
        if value != getattr(usual, name):
            found[name] = _changed(value) if is_dataclass(value) and not isinstance(value, type) else value
    return found


def from_data(name: str, value: Any) -> Any:  # noqa: ANN401 - JSON, and an argument of `gym.make`
    """Convert JSON back to an argument.

    Raises:
        SpidarError: For JSON that represents no argument.
    """
    if not isinstance(value, dict):
        return _tuples(value)
    if value and all(type(number) in (int, float) for number in value.values()):
        return value  # numbers by name, such as `action_scale`; the environment knows the names
    try:
        ((kind, changes),) = value.items()
        require_name(name, kind, CONFIGS)
        return _config(CONFIGS[kind](), changes)
    except SpidarError:
        raise
    except (TypeError, ValueError, AttributeError) as error:
        raise InvalidValueError(name, value, "a configuration: " + " or ".join(CONFIGS)) from error


def _config(usual: Any, changes: Mapping[str, Any]) -> Any:  # noqa: ANN401 - dataclasses
    """Return a configuration with some values changed."""
    found = {}
    for name, value in changes.items():
        before = getattr(usual, name)
        if is_dataclass(before):
            found[name] = _config(before, value)
        elif isinstance(value, dict) or (isinstance(before, str) and not isinstance(value, str)):
            raise InvalidValueError(name, shown(value), f"what {type(before).__name__} is")
        else:
            found[name] = _tuples(value)
    return type(usual)(**{field.name: getattr(usual, field.name) for field in fields(usual)} | found)


def _tuples(value: Any) -> Any:  # noqa: ANN401 - JSON
    return tuple(map(_tuples, value)) if isinstance(value, list) else value
