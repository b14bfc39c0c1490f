"""The option `--whole`, the marker `unchecked`, and fixtures of the compiled runner, built once a process."""

import signal
from pathlib import Path

import pytest

UNCHECKED = ("adversary", "cli", "identify", "logs", "meta", "onboard", "paper", "policies", "sitl", "tune", "viz")
"""Folders whose tests run whole programs, marked `unchecked`: checks of shapes and types would add a quarter to their
time, and the parts are checked in their own tests."""

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    # A shell ignores SIGINT in background jobs; tests of Ctrl-C would never end.
    signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_addoption(parser):
    """Add `--whole`: every attempt of the adversaries, every mission through ROS, the way to the tuned flight."""
    parser.addoption(
        "--whole",
        action="store_true",
        help="run every attempt of the adversaries, every mission through ROS, and the way to the tuned flight",
    )


def pytest_collection_modifyitems(items):
    """Mark tests that run whole programs as `unchecked`."""
    tests = Path(__file__).parent
    for item in items:
        if item.path.relative_to(tests).parts[0] in UNCHECKED:
            item.add_marker("unchecked")


@pytest.fixture(scope="session")
def onboard():
    """`support.runner`, imported late: a conftest's imports are not instrumented with checks of shapes and types."""
    from support import runner as onboard

    return onboard


@pytest.fixture(scope="session")
def folder(onboard, tmp_path_factory):
    return onboard.export(tmp_path_factory.mktemp("runner") / "onboard")


@pytest.fixture(scope="session")
def runner(onboard, folder):
    return onboard.compile_as_shipped(folder)


@pytest.fixture(scope="session")
def checked(onboard, folder):
    """The runner with sanitizers, not optimised."""
    return onboard.compile_(folder, folder.parent / "checked", *onboard.CHECKED)


@pytest.fixture(scope="session")
def library(onboard, folder):
    return onboard.load(onboard.compile_(folder, folder.parent / "librunner.so", "-O1", "-fPIC", "-shared"))


@pytest.fixture(scope="session")
def hover(onboard, library, runner, folder):
    return onboard.fly(library, runner, folder)


@pytest.fixture(scope="session")
def crawl(onboard, library, runner, folder):
    return onboard.walk(library, runner, folder)


@pytest.fixture(scope="session")
def course(onboard, library, runner, folder):
    return onboard.go(library, runner, folder)


@pytest.fixture(params=["hover", "crawl", "course"])
def stream(request):
    return request.getfixturevalue(request.param)
