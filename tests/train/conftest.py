"""Short flights, and a finished tiny run, for files that skip without the extra `train`."""

from dataclasses import replace

import pytest


@pytest.fixture(scope="module")
def short():
    """Flights of two seconds: what is pinned with them does not need longer ones."""
    from spidar_gym.benchmark.track import TRACKS

    track = TRACKS["flight-fast3"]
    TRACKS["flight-fast3"] = replace(track, seconds=2.0)
    yield
    TRACKS["flight-fast3"] = track


@pytest.fixture(scope="module")
def done(short, tmp_path_factory):
    """A finished run: its folder."""
    from support.training import TINY

    from train.lib.config import override
    from train.residual import learn

    return learn(override(TINY, out=tmp_path_factory.mktemp("runs"))).parent
