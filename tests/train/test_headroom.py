"""Pins the headroom of the action's channels: actions of the rules, paired comparison, and the table."""

import subprocess
import sys

import gymnasium
import numpy as np
import pytest

pytest.importorskip("stable_baselines3", reason="the extra `train` is not installed")

from spidar_gym.benchmark.track import HOVER
from spidar_gym.envs.actions import ACTION_MODES, CRAWL_MODES
from spidar_gym.robot import N_JOINTS
from train import headroom
from train.headroom import IN_FLIGHT, ON_THE_GROUND, Args, Rule, headroom_table, joint_speed, measure
from train.lib import envs
from train.lib.config import CONTROL

pytestmark = pytest.mark.train


def test_a_rule_reads_the_pieces_of_the_observation_by_their_names():
    env = gymnasium.make(HOVER, forms="independent", joint_speed=1.0, action_mode="residual_joint").unwrapped
    rule = Rule("paper", *IN_FLIGHT["joint targets 20 ms ahead"])
    observation, _ = env.reset(seed=35)
    for _ in range(60):
        observation = env.step(rule.act(observation))[0]
    speed = (rule.act(observation) * 0.1 / 0.02)[:N_JOINTS]
    assert np.abs(speed).max() > 0.5
    measured = env.plant.state().joint_velocity
    assert np.corrcoef(speed, measured)[0, 1] > 0.9
    env.close()


@pytest.mark.parametrize(("rules", "preset", "modes"), [(IN_FLIGHT, "paper", ACTION_MODES),
                                                        (ON_THE_GROUND, "robust", CRAWL_MODES)])  # fmt: skip
def test_every_rule_returns_an_action_of_its_mode_within_its_bounds(rules, preset, modes):
    for mode, action in rules.values():
        rule = Rule(preset, mode, action)
        for observation in np.random.default_rng(1).normal(scale=10.0, size=(5, 400)):
            found = rule.act(observation)
            assert found.shape == (modes[mode].size,)
            assert np.abs(found).max() <= 1.0


def test_the_action_of_a_rule_matches_its_name():
    def residual(rules, name, seen=None):
        mode, action = rules[name]
        return CRAWL_MODES[mode].residual(action(seen or {}))

    assert residual(IN_FLIGHT, "joint speed × 0.8").joint_speed_scale == pytest.approx(0.8)
    gait = {"phase rate": "joint_speed_scale", "raise": "raise_scale", "stride": "stride_scale",
            "lift height": "lift_scale"}  # fmt: skip
    for name, field in gait.items():
        for scale in (1.1, 0.9):
            found = residual(ON_THE_GROUND, f"{name} × {scale:g}")
            assert {other: getattr(found, other) for other in gait.values()} == pytest.approx(
                {other: scale if other == field else 1.0 for other in gait.values()}
            )
    np.testing.assert_allclose(residual(ON_THE_GROUND, "legs pulled by -2 N").leg_forces_b, [[0.0, 0.0, -2.0]] * 4)
    moving = {"joint_command_velocity": np.full(N_JOINTS, 0.6)}
    np.testing.assert_allclose(residual(IN_FLIGHT, "joint targets 50 ms behind", moving).joint_offset, -0.03)
    turning = {"leg_momentum_rate": np.array([1.0, -2.0, 3.0])}
    np.testing.assert_allclose(
        residual(IN_FLIGHT, "torque of 0.25 ḣ of the legs", turning).wrench, [0.0, 0.0, 0.0, 0.25, -0.5, 0.75]
    )
    form, now = np.linspace(0.0, 0.05, N_JOINTS), np.full(N_JOINTS, 0.02)
    for left, offset in ((0.15, form - now), (0.25, np.zeros(N_JOINTS))):
        seen = {"next_form": form, "joint_position": now, "time_to_next_form": np.array([left])}
        np.testing.assert_allclose(residual(IN_FLIGHT, "next form 0.2 s early", seen).joint_offset, offset, atol=1e-12)


def test_rules_are_compared_with_the_base_in_pairs(monkeypatch):
    rules = {"nothing": joint_speed(1.0), **{k: IN_FLIGHT[f"torque of {k} ḣ of the legs"] for k in ("0.25", "-0.25")}}
    monkeypatch.setattr(headroom, "IN_FLIGHT", rules)
    monkeypatch.setattr(envs, "FLIGHTS", ("flight-fast3",))
    found = measure(Args("paper", scenarios=1, workers=1, control=CONTROL))
    attitude = {name: verdict.cells["flight-fast3"]["attitude_rms_rad"] for name, verdict in found.items()}
    assert list(found["nothing"].cells["flight-fast3"].values()) == [0.0, 0.0]
    # The paper's controller does not compensate the torque of its moving legs: a part of it helps, its opposite harms.
    assert attitude["0.25"] < -0.05
    assert attitude["-0.25"] > 0.05
    lines = headroom_table("paper", found).splitlines()
    assert lines[0].startswith("change of position_rms_m, attitude_rms_rad")
    assert [line.split("  ")[0] for line in lines[4:]] == list(rules)


def test_an_unknown_controller_is_refused_in_one_line():
    command = [sys.executable, "-m", "train.headroom", "mine"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    assert "paper, as_flown, as_flown_quasi, tuned" in line
