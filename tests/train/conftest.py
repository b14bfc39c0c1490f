"""Fixtures of short flights and a completed tiny run; files that use them skip without the extra `train`."""

from dataclasses import replace

import pytest


@pytest.fixture(scope="module")
def short():
    """Shorten the flights of `flight-fast3` to two seconds."""
    from spidar_gym.benchmark.track import TRACKS

    track = TRACKS["flight-fast3"]
    TRACKS["flight-fast3"] = replace(track, seconds=2.0)
    yield
    TRACKS["flight-fast3"] = track


@pytest.fixture(scope="module")
def done(short, tmp_path_factory):
    """Return the folder of a completed run."""
    from support.training import TINY

    from train.lib.config import override
    from train.residual import learn

    return learn(override(TINY, out=tmp_path_factory.mktemp("runs"))).parent
