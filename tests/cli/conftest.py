"""Fixtures: an empty working folder, and instant versions of the paper's experiments."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch) -> Path:
    """Return an empty working folder; no display is available."""
    folder = tmp_path / "here"
    folder.mkdir()
    monkeypatch.chdir(folder)
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    return folder


@pytest.fixture
def short_crawl(monkeypatch):
    """Replace the crawl experiment by one fast cycle."""
    from spidar_gym.paper import crawl as crawl_experiment

    crawl = crawl_experiment.crawl_paper

    def short(preset, on_tick=None, **options):
        return crawl(preset, **options | {"distance": 0.1, "joint_speed": 0.6})

    monkeypatch.setattr(crawl_experiment, "crawl_paper", short)


@pytest.fixture
def still(monkeypatch):
    """Replace the flight experiment by the log of a motionless robot, 40 s long."""
    from spidar_gym.paper import flight as experiments
    from spidar_gym.paper.flight import FlightLog

    n = 1600
    log = FlightLog(
        "as_flown", time=np.arange(1, n + 1) / 40, position_error=np.zeros((n, 3)), attitude_error=np.zeros((n, 3)),
        joint_position=np.zeros((n, 16)), joint_torque=np.zeros((n, 16)), vectoring=np.zeros((n, 8, 2)),
        thrust=np.full((n, 8), 19.62), solve_time=np.full(n, 1e-4), status=np.full(n, "solved"),
        air_force=np.zeros((n, 3)), power=np.full(n, 3e3), qpos=np.zeros((n, 39)),
    )  # fmt: skip
    monkeypatch.setattr(
        experiments,
        "fly_paper",
        lambda preset, noise=False, seed=0, on_tick=None: dataclasses.replace(log, preset=preset, noise=noise),
    )
