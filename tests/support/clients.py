"""Shared by the tests of clients: the guide's code for each client, and the conditions for a skip."""

import re
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "environments" / "clients.md"
BLOCK = re.compile(r"^<!-- client: ([\w ]+) -->\n```(\w+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
STEPS = 60
"""Steps of an episode in all of the guide's code: 1.5 s, in which no form changes."""


def shown() -> dict[str, str]:
    """The guide's code, by client."""
    return {name: code for name, _, code in BLOCK.findall(PAGE.read_text(encoding="utf-8"))}


def run_shown(name: str) -> dict[str, Any]:
    """Run a client's code and return its namespace."""
    names: dict[str, Any] = {"__name__": name}
    exec(compile(shown()[name], f"{PAGE.name}: {name}", "exec"), names)
    return names


def needs(*modules: str) -> Any:
    """Marks for the tests of a client: skipped where one of its modules is missing; its warnings are no errors."""
    missing = [module for module in modules if find_spec(module) is None]
    reason = f"{', '.join(missing)} not installed; `python -m tests.clients` makes an environment for each client"
    return [pytest.mark.skipif(bool(missing), reason=reason), pytest.mark.filterwarnings("default")]


def assert_judged_at_the_end(successes: list[bool]) -> None:
    """Assert that `is_success` is true at the last step of an episode with zero actions, and at no other."""
    assert successes == [False] * (STEPS - 1) + [True]
