"""Fixtures for the tests of learned policies."""

import pytest
from support.artifacts import flier

from spidar_gym.policies.artifact import write_artifact


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    path = tmp_path_factory.mktemp("artifacts") / "net.npz"
    write_artifact(flier(), path)
    return path
