"""Pins the upper bound of a residual with a memory: laws with the exact wrench, and their paired comparison."""

import gymnasium
import numpy as np
import pytest

pytest.importorskip("stable_baselines3", reason="the extra `train` is not installed")

from spidar_gym.benchmark.track import HOVER
from spidar_gym.robot import GRAVITY, ROBOT
from spidar_gym.sim.body import BodyConfig
from spidar_gym.sim.config import PlantConfig
from train import ceiling
from train.ceiling import LAWS, TRACKS, Args, ceiling_lines, measure
from train.lib.evaluate import Verdict

pytestmark = pytest.mark.train


@pytest.mark.parametrize("law", LAWS.values())
def test_a_law_with_the_exact_wrench_compensates_an_undescribed_weight(law):
    plant = PlantConfig(body=BodyConfig(total_mass=1.05 * ROBOT.total_mass))
    env = gymnasium.make(HOVER, forms="form2", plant=plant, law=law, horizon_s=6.0)
    env.reset(seed=0)
    pulls = []
    for _ in range(240):
        *_, info = env.step(np.zeros(env.action_space.shape))
        pulls.append(env.unwrapped.controller.pull_w.copy())
    env.close()
    weight = 0.05 * ROBOT.total_mass * GRAVITY
    assert np.mean(pulls[-80:], axis=0)[:3] == pytest.approx([0.0, 0.0, -weight], abs=0.02 * weight)
    assert info["position_error"] == pytest.approx(np.zeros(3), abs=5e-3)


def test_gains_are_paired_differences_and_the_table_lists_all_laws(monkeypatch):
    monkeypatch.setattr(ceiling, "TRACKS", ("flight-wind",))
    verdicts = measure(Args(scenarios=1, workers=1))
    assert list(verdicts) == list(LAWS)
    cell = verdicts["knows what pulls, a tick late"].cells["flight-wind"]
    assert cell["position_rms_m"] < -0.1
    assert all(isinstance(verdict, Verdict) for verdict in verdicts.values())
    lines = ceiling_lines(verdicts)
    assert [line[0] for line in lines[1:]] == list(LAWS)
    assert f"{100.0 * cell['position_rms_m']:+.0f} %" in lines[1][1]
    assert len(TRACKS) == 2
