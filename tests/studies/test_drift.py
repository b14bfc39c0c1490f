"""Drift of the capture: odometry of feet that stand, and what counts as a success without drift."""

from dataclasses import replace

import numpy as np
import pytest

from spidar_gym.control.crawl.kinematics import feet_at, leg_angles
from spidar_gym.control.presets import CRAWL_PRESETS
from spidar_gym.errors import UnknownNameError
from spidar_gym.robot import N_JOINTS, N_ROTORS, ROBOT
from spidar_gym.so3 import matrix_to_quat, rotation_z
from spidar_gym.state import RobotState
from spidar_gym.studies.__main__ import main
from spidar_gym.studies.drift import drift_lines, drift_study, moved


def standing(position: np.ndarray, yaw: float, feet_w: np.ndarray) -> RobotState:
    """State of a robot whose feet stand at `feet_w` (4, 3) [m]."""
    R = rotation_z(yaw)
    q = leg_angles((feet_w - position) @ R, ROBOT)
    assert q is not None
    return RobotState(
        0.0, position, matrix_to_quat(R), np.zeros(3), np.zeros(3), q, np.zeros(N_JOINTS), np.zeros((N_ROTORS, 2)),
        np.zeros((N_ROTORS, 2)), np.zeros(N_ROTORS), np.zeros(N_JOINTS),
    )  # fmt: skip


def test_feet_that_stand_and_roll_measure_the_way_of_the_torso():
    gait = CRAWL_PRESETS["robust_retuned"].gait
    here, yaw = np.array([0.3, -0.2, 0.2]), 0.4
    feet = gait.home_b @ rotation_z(yaw).T + here
    before = standing(here, yaw, feet)
    np.testing.assert_allclose(feet_at(before.joint_position, ROBOT) @ rotation_z(yaw).T + here, feet, atol=1e-9)
    way = np.array([0.04, 0.03, 0.0])
    # Balls that do not roll would stay; the kinematics of rolling feet shifts each outwards by what it turns.
    for _ in range(20):
        after = standing(here + way, yaw + 0.02, feet)
        turned = after.joint_position - before.joint_position
        out = ROBOT.foot_radius * (turned[1::4] + turned[3::4])
        heading = np.array([ROBOT.leg_azimuth(leg) for leg in range(4)]) + after.joint_position[::4] + yaw + 0.02
        feet = gait.home_b @ rotation_z(yaw).T + here
        feet[:, :2] += out[:, None] * np.stack((np.cos(heading), np.sin(heading)), axis=1)
    after = standing(here + way, yaw + 0.02, feet)
    np.testing.assert_allclose(moved(before, after), way[:2], atol=1e-5)
    np.testing.assert_allclose(moved(before, replace(before, time=1.0)), 0.0, atol=1e-12)


def test_a_crawl_succeeds_without_drift_where_only_the_goal_is_missed_and_the_robot_lies_on_it(monkeypatch):
    seen = {"seen_m": 0.002, "seen_yaw": 0.001, "true_m": 0.012, "true_yaw": 0.001, "legs_m": 0.02, "seconds": 9.0}
    crawls = [
        {**seen, "failure": "", "missed": []},
        {**seen, "failure": "", "missed": ["position"]},
        {**seen, "failure": "", "missed": ["position"], "seen_m": 0.011},
        {**seen, "failure": "", "missed": ["position", "slip"]},
        {**seen, "failure": "tilt", "missed": []},
        {**seen, "failure": "", "missed": ["yaw"], "legs_m": 0.001},
    ]
    monkeypatch.setattr("spidar_gym.studies.drift.finish", lambda *_, **__: crawls)
    *mixtures, whole = drift_study("robust", "test", 6)
    assert [row["mixture"] for row in mixtures] == ["wake", "capture", "build"]
    assert [row["crawls"] for row in mixtures] == [2, 2, 2]
    assert (whole["succeeded"], whole["without_drift"], whole["beyond_by_legs"]) == (1, 3, 5)
    assert whole["true_m"][0] == pytest.approx(0.012)
    assert len(drift_lines([*mixtures, whole])) == 5


def test_unknown_presets_and_counts_are_refused(capfd, tmp_path):
    with pytest.raises(UnknownNameError):
        drift_study("trot", "test", 1)
    with pytest.raises(SystemExit):
        main(["drift", "--scenarios", "51", "--out", str(tmp_path)])
    assert "1 … 50" in capfd.readouterr().err
