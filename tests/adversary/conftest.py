"""Number of tries of the adversary tests: a sample in CI, all with `pytest tests/adversary --whole`."""

from collections.abc import Callable

import jaxtyping
import numpy as np
import pytest

SAMPLE = 0.05
"""Fraction of the tries made in CI, where the whole folder takes 1.5 min on one core."""


@pytest.fixture(scope="session")
def tries(request) -> Callable[[int], int]:
    """Map a full number of tries to the number to make: all with `--whole`, else a sample of at least one."""
    whole = request.config.getoption("--whole")
    return lambda count: count if whole else max(1, round(SAMPLE * count))


@pytest.fixture
def rng(request) -> np.random.Generator:
    """A generator seeded by the test's id, the same in every run."""
    return np.random.default_rng(list(request.node.nodeid.encode()))


@pytest.fixture
def unchecked(monkeypatch) -> None:
    """Disable the type checker, which users do not have and which would refuse input first."""
    monkeypatch.setattr(jaxtyping.config, "jaxtyping_disable", True)
