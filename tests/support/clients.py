"""What tests of clients share: the code that the guide shows of each, and when it is skipped."""

import re
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "environments" / "clients.md"
BLOCK = re.compile(r"^<!-- client: ([\w ]+) -->\n```(\w+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
STEPS = 60
"""Steps of an episode in all of the guide's code: one and a half seconds, in which no form changes."""


def shown() -> dict[str, str]:
    """The code that the guide shows of each client."""
    return {name: code for name, _, code in BLOCK.findall(PAGE.read_text(encoding="utf-8"))}


def run_shown(name: str) -> dict[str, Any]:
    """What the names of a client's code hold after it has run."""
    names: dict[str, Any] = {"__name__": name}
    exec(compile(shown()[name], f"{PAGE.name}: {name}", "exec"), names)
    return names


def needs(*modules: str) -> Any:
    """Marks of tests of a client: skipped where one of its modules is missing, and its own warnings are its own."""
    missing = [module for module in modules if find_spec(module) is None]
    reason = f"{', '.join(missing)} not installed; `python -m tests.clients` makes an environment for each client"
    return [pytest.mark.skipif(bool(missing), reason=reason), pytest.mark.filterwarnings("default")]


def assert_judged_at_the_end(successes: list[bool]) -> None:
    """Of an episode without an action: `is_success` at its last step, and at no other."""
    assert successes == [False] * (STEPS - 1) + [True]
