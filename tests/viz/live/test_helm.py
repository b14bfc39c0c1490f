"""Pins the helm: the reference moves to the user's goal within its speed and acceleration, and returns home."""

import math

import numpy as np
import pytest

from spidar_gym.control.flight.controller import CONTROL_RATE
from spidar_gym.so3 import exp, log, matrix_to_quat, quat_to_matrix
from spidar_gym.state import Reference
from spidar_gym.viz.live.helm import (
    ACCELERATION,
    AHEAD,
    ANGULAR_ACCELERATION,
    FARTHEST,
    HIGHEST,
    LOWEST,
    RATE,
    SPEED,
    Helm,
)

DT = 1.0 / CONTROL_RATE
YAWED = matrix_to_quat(exp(np.array([0.0, 0.0, 0.4])))
REFERENCE = Reference(np.array([1.0, 2.0, 3.0]), YAWED, np.array([0.1, 0.0, 0.0]), np.zeros(3), np.zeros(16))


def gone(helm, ticks):
    """Advance some ticks; return offset, velocity, yaw and rate at each."""
    rows = []
    for _ in range(ticks):
        helm.advance(helm.ticks + 1)
        rows.append([*helm.place, *helm.velocity, helm.yaw, helm.rate])
    return np.array(rows)


def test_without_inputs_the_reference_is_the_tasks_own_object():
    helm = Helm()
    helm.advance(100)
    assert helm.applied(REFERENCE) is REFERENCE


def test_speed_and_acceleration_stay_within_their_limits():
    helm = Helm()
    rows = []
    for _ in range(40):
        helm.nudge(forward=0.1, left=0.1, up=0.05, turn=0.2)
        rows.append(gone(helm, 5))
    rows = np.vstack(rows)
    speeds = np.linalg.norm(rows[:, 3:6], axis=1)
    changes = np.linalg.norm(np.diff(rows[:, 3:6], axis=0), axis=1) / DT
    assert 0.98 * SPEED < speeds.max() <= SPEED + 1e-9
    assert 0.98 * ACCELERATION < changes.max() <= ACCELERATION + 1e-6
    assert 0.98 * RATE < np.abs(rows[:, 7]).max() <= RATE + 1e-9
    assert np.abs(np.diff(rows[:, 7])).max() / DT <= ANGULAR_ACCELERATION + 1e-6


def test_velocity_and_acceleration_are_those_of_the_place():
    helm = Helm()
    helm.nudge(forward=0.5, turn=0.3)
    before = np.zeros(3)
    for _ in range(60):
        place, yaw = helm.place, helm.yaw
        helm.advance(helm.ticks + 1)
        assert (helm.place - place) / DT == pytest.approx(helm.velocity, abs=0.005)
        assert (helm.yaw - yaw) / DT == pytest.approx(helm.rate, abs=0.005)
        assert (helm.velocity - before) / DT == pytest.approx(helm.acceleration, abs=1e-9)
        before = helm.velocity


def test_it_comes_to_rest_where_it_was_sent_without_going_beyond():
    helm = Helm()
    helm.nudge(forward=0.3, up=0.2, turn=0.25)
    rows = gone(helm, 400)
    assert helm.place.tolist() == [0.3, 0.0, 0.2]
    assert helm.yaw == 0.25
    assert not helm.velocity.any()
    assert helm.rate == 0.0
    assert rows[:, 0].max() <= 0.3 + 1e-9
    assert rows[:, 6].max() <= 0.25 + 1e-9


def test_forward_is_where_the_reference_looks():
    helm = Helm()
    helm.goal_yaw = 0.5 * math.pi
    gone(helm, 400)
    helm.nudge(forward=0.2)
    assert helm.goal == pytest.approx([0.0, 0.2, 0.0], abs=1e-9)
    helm.nudge(left=0.1)
    assert helm.goal == pytest.approx([-0.1, 0.2, 0.0], abs=1e-9)


def test_a_goal_is_never_far_ahead_so_that_letting_go_of_a_key_soon_stops():
    helm = Helm()
    for _ in range(100):
        helm.nudge(forward=0.05, turn=0.05)
    assert np.linalg.norm(helm.goal - helm.place) == pytest.approx(AHEAD)
    assert helm.goal_yaw - helm.yaw == pytest.approx(AHEAD)


def test_it_stays_between_the_floor_and_its_ceiling_and_near_where_it_began():
    for way, end in (({"up": -0.4}, LOWEST), ({"up": 0.4}, HIGHEST)):
        helm = Helm()
        for _ in range(40):
            helm.nudge(**way)
            gone(helm, 40)
        assert helm.place[2] == pytest.approx(end)
    helm = Helm()
    for _ in range(60):
        helm.nudge(forward=0.5)
        gone(helm, 60)
    assert helm.place[0] == pytest.approx(FARTHEST)


def test_home_is_where_the_task_has_it_by_the_shorter_turn():
    helm = Helm()
    for _ in range(20):
        helm.nudge(forward=0.4, turn=0.4)
        gone(helm, 60)
    assert helm.yaw > 6.5
    helm.home()
    gone(helm, 2000)
    assert not helm.place.any()
    assert helm.yaw == pytest.approx(math.tau)
    assert log(quat_to_matrix(YAWED).T @ quat_to_matrix(helm.applied(REFERENCE).quat_wb)) == pytest.approx(
        0.0, abs=1e-9
    )


def test_what_is_applied_is_the_tasks_reference_moved_and_turned():
    helm = Helm()
    helm.nudge(left=0.4, turn=0.3)
    gone(helm, 10)
    found = helm.applied(REFERENCE)
    assert found.position_w == pytest.approx(REFERENCE.position_w + helm.place)
    assert found.velocity_w == pytest.approx(REFERENCE.velocity_w + helm.velocity)
    assert found.acceleration_w == pytest.approx(helm.acceleration)
    assert log(quat_to_matrix(found.quat_wb)) == pytest.approx([0.0, 0.0, 0.4 + helm.yaw])
    assert found.omega_b == pytest.approx([0.0, 0.0, helm.rate])
    assert found.alpha_b == pytest.approx([0.0, 0.0, helm.angular_acceleration])
    assert found.joint_target is REFERENCE.joint_target
