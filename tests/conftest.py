"""The option `--whole`, which tests run unchecked, and the compiled runner, made and flown once a process."""

import signal
from pathlib import Path

import pytest

UNCHECKED = ("adversary", "cli", "meta", "onboard", "paper", "policies", "sitl", "tune", "viz")
"""Folders whose tests run whole programs: with shapes and types checked they would take a quarter longer, and the parts
are checked in their own tests."""

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    # A shell starts what goes on in its background so, and then no test of Ctrl-C would end.
    signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_addoption(parser):
    """`--whole`: every try of the adversaries and every mission through ROS, not CI's sample."""
    parser.addoption(
        "--whole",
        action="store_true",
        help="adversaries make all of their tries, and all missions are flown through ROS",
    )


def pytest_collection_modifyitems(items):
    """Mark what runs whole programs."""
    tests = Path(__file__).parent
    for item in items:
        if item.path.relative_to(tests).parts[0] in UNCHECKED:
            item.add_marker("unchecked")


@pytest.fixture(scope="session")
def onboard():
    """The module, imported late: a package that a conftest imports escapes the checks of shapes and types."""
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
