"""How much an adversary tries: a sample in CI, all of it with `pytest tests/adversary --whole`."""

from collections.abc import Callable

import jaxtyping
import numpy as np
import pytest

SAMPLE = 0.05
"""Share of the tries that CI makes; together the folder takes a minute and a half of one core there."""


@pytest.fixture(scope="session")
def tries(request) -> Callable[[int], int]:
    """How many of so many tries are made: all with `--whole`, else a sample, at least one."""
    whole = request.config.getoption("--whole")
    return lambda count: count if whole else max(1, round(SAMPLE * count))


@pytest.fixture
def rng(request) -> np.random.Generator:
    """A generator of each test's own, the same in every run."""
    return np.random.default_rng(list(request.node.nodeid.encode()))


@pytest.fixture
def unchecked(monkeypatch) -> None:
    """Users have no type checker, which would refuse on its own."""
    monkeypatch.setattr(jaxtyping.config, "jaxtyping_disable", True)
