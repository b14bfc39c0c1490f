"""Pins the interface of controllers: Python and C ones meet it, and no environment depends on a concrete one."""

import ast
import inspect
import subprocess
import sys
from pathlib import Path

import pytest

import spidar_gym
from spidar_gym.control.crawl.controller import Crawler
from spidar_gym.control.flight.controller import FlightController
from spidar_gym.control.interface import CrawlControl, FlightControl
from spidar_gym.native.core_crawler import CoreCrawler
from spidar_gym.native.core_flight import CoreFlightController

PACKAGE = Path(spidar_gym.__file__).parent
PAIRS = [
    (FlightController, FlightControl),
    (CoreFlightController, FlightControl),
    (Crawler, CrawlControl),
    (CoreCrawler, CrawlControl),
]
COMPILED = ("spidar_gym.native.core_crawler", "spidar_gym.native.library")
ENVIRONMENTS = ("envs/env.py", "envs/hover_env.py", "envs/crawl_env.py")
CONCRETE = {kind.__name__ for kind, _ in PAIRS} | {"Core", "Any"}


def methods(protocol) -> dict:
    """Name → function of all public methods of a protocol."""
    found = {name: member for base in protocol.__mro__ for name, member in vars(base).items()}
    return {n: found[n] for n in found if not n.startswith("_") and inspect.isfunction(found[n])}


def parameters(function) -> list:
    """Names, kinds and defaults."""
    return [(p.name, p.kind, p.default) for p in inspect.signature(function).parameters.values()]


@pytest.mark.parametrize(("kind", "protocol"), PAIRS, ids=lambda kind: kind.__name__)
def test_every_controller_has_the_signatures_of_the_interface(kind, protocol):
    asked = methods(protocol)
    assert {"reset", "step", "observe", "set_last_command", "close"} <= set(asked)
    for name, function in asked.items():
        assert parameters(getattr(kind, name)) == parameters(function), name


CLAIMS = """
from spidar_gym.control.crawl.controller import Crawler
from spidar_gym.control.flight.controller import FlightController
from spidar_gym.control.interface import CrawlControl, FlightControl
from spidar_gym.native.core_crawler import CoreCrawler
from spidar_gym.native.core_flight import CoreFlightController

flight: list[FlightControl] = [FlightController(), CoreFlightController()]
crawl: list[CrawlControl] = [Crawler(), CoreCrawler()]
wrong: FlightControl = Crawler()
"""


@pytest.mark.slow
def test_the_types_of_every_controller_are_those_of_the_interface(tmp_path):
    file = tmp_path / "claims.py"
    file.write_text(CLAIMS)
    done = subprocess.run(
        [sys.executable, "-m", "pyright", "--pythonpath", sys.executable, str(file)],
        cwd=PACKAGE.parent, capture_output=True, text=True, check=False,
    )  # fmt: skip
    errors = [line for line in done.stdout.splitlines() if " error: " in line]
    assert len(errors) == 1, done.stdout
    assert f":{len(CLAIMS.splitlines())}:" in errors[0], "a crawler is no flight controller; all else is valid"


@pytest.mark.parametrize("file", ENVIRONMENTS)
def test_an_environment_refers_to_no_concrete_controller(file):
    for node in ast.walk(ast.parse((PACKAGE / file).read_text())):
        if isinstance(node, ast.ImportFrom):
            assert node.module not in COMPILED, ast.unparse(node)
            assert not CONCRETE & ({alias.name for alias in node.names} - {"Any"}), ast.unparse(node)
        elif isinstance(node, ast.Call) and ast.unparse(node.func) == "isinstance":
            assert "controller" not in ast.unparse(node), ast.unparse(node)
        elif isinstance(node, ast.Compare):
            assert "core" not in [getattr(part, "value", None) for part in (node.left, *node.comparators)]
        elif isinstance(node, ast.AnnAssign) and ast.unparse(node.target).endswith(("controller", "task")):
            assert ast.unparse(node.annotation) not in CONCRETE, ast.unparse(node)
