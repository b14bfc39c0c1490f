"""Pins the paths: shape, consistent derivatives, rest at both ends."""

import math
from itertools import pairwise

import numpy as np
import pytest

from spidar_gym.control.flight.path import EASE, REST, TURN_RATE, Path, from_motion, legs, lemniscate, spline, wrap
from spidar_gym.errors import InvalidValueError
from spidar_gym.so3 import exp, log, quat_to_matrix

SQUARE = [(0.0, 0.0, 1.0), (1.0, 0.0, 1.0), (1.0, 1.0, 1.5), (0.2, 0.1, 1.5)]
ROUND = [(math.sin(t), 1.0 - math.cos(t), 1.0 + 0.1 * t) for t in np.arange(0.0, 6.0, 0.8)]
AT = np.array([0.5, -0.3, 1.2])


def eight(**changes):
    return lemniscate(2.0, 1.0, 30.0, **{"position_w": AT, "begin": 1.0, **changes})


def paths():
    """Examples of every kind of path."""
    rng = np.random.default_rng(0)
    yield from (eight(along=along, direction=direction) for along in (False, True) for direction in (0.0, 2.0))
    for along in (False, True):
        yield legs(SQUARE, 0.8, along=along, begin=0.5)
        yield spline(ROUND, 1.2, along=along)
        yield spline([tuple(p) for p in rng.uniform(-2.0, 2.0, (6, 3))], 0.5, along=along)


PATHS = list(paths())


def sampled(path, step=0.01):
    """Times (T,), and pose, rate and acceleration at these times (T, 3, 4)."""
    times = np.arange(path.times[0], path.seconds, step)
    return times, np.array([path.at(t) for t in times])


@pytest.mark.parametrize("path", PATHS)
def test_rates_are_those_of_the_pose_and_nothing_jumps(path):
    h = 1e-4
    for t in np.random.default_rng(1).uniform(path.times[0] - 0.5, path.seconds + 0.5, 200):
        if np.abs(path.times - t).min() < 2 * h:
            continue
        before, now, after = (np.array(path.at(t + k * h)) for k in (-1, 0, 1))
        np.testing.assert_allclose((after[:2] - before[:2]) / (2 * h), now[1:], atol=1e-6)
    for knot in path.times:
        before, after = (np.array(path.at(knot + k * 1e-9)) for k in (-1, 1))
        np.testing.assert_allclose(before, after, atol=1e-6)


@pytest.mark.parametrize("path", PATHS)
def test_it_begins_and_ends_at_rest_and_stays(path):
    for t, knot in ((path.times[0], 0), (path.times[0] - 3.0, 0), (path.seconds, -1), (path.seconds + 3.0, -1)):
        pose, rate, acceleration = path.at(t)
        np.testing.assert_allclose(pose, path.pose_w[knot], atol=1e-12)
        np.testing.assert_allclose([rate, acceleration], 0.0, atol=1e-9)


def test_a_lemniscate_is_one_at_constant_speed():
    times, rows = sampled(eight(direction=0.7, along=True))
    x, y = (rows[:, 0, :2] - AT[:2] @ np.eye(2)).T
    turn = 0.7 + math.pi / 4  # the axis is 45° from the tangent at the crossing
    u, v = math.cos(turn) * x + math.sin(turn) * y, math.cos(turn) * y - math.sin(turn) * x
    np.testing.assert_allclose((u * u + v * v) ** 2, 4.0 * (u * u - v * v), atol=2e-4)
    assert np.ptp(u) == pytest.approx(4.0, abs=1e-3)
    cruise = (times > 1.3 + 1.0 / EASE) & (times < 30.7 - 1.0 / EASE)
    np.testing.assert_allclose(np.linalg.norm(rows[cruise, 1, :3], axis=1), 1.0, atol=1e-5)
    ahead = np.arctan2(rows[cruise, 1, 1], rows[cruise, 1, 0])
    np.testing.assert_allclose([wrap(a - b) for a, b in zip(ahead, rows[cruise, 0, 3], strict=True)], 0.0, atol=1e-5)
    assert rows[0, 0, 3] == pytest.approx(0.7)
    # Curvature 3 / a at both ends.
    assert np.linalg.norm(rows[cruise, 2, :3], axis=1).max() == pytest.approx(1.5, rel=1e-3)


@pytest.mark.parametrize("along", [False, True])
def test_legs_are_straight_at_their_speed_and_rest_between(along):
    path = legs(SQUARE, 0.8, along=along, yaw=0.4)
    _, rows = sampled(path, 0.005)
    speed = np.linalg.norm(rows[:, 1, :3], axis=1)
    assert speed.max() == pytest.approx(0.8)
    for p, q in pairwise(SQUARE):
        way = (np.array(q) - p) / math.dist(p, q)
        mine = rows[(np.cross(rows[:, 0, :3] - p, way) ** 2).sum(axis=1) < 1e-18]
        share = (mine[:, 0, :3] - p) @ way / math.dist(p, q)
        assert share.min() < 0.01
        assert share.max() > 0.99
    resting = (speed < 1e-9).sum() * 0.005
    assert resting >= 3 * REST - 0.05
    assert np.abs(rows[:, 1, 3]).max() <= TURN_RATE + 1e-9
    flying = speed > 1e-3
    if along:
        flat = np.hypot(rows[:, 1, 0], rows[:, 1, 1]) > 1e-3
        off = np.arctan2(rows[flat, 1, 1], rows[flat, 1, 0]) - rows[flat, 0, 3]
        np.testing.assert_allclose(np.sin(off), 0.0, atol=1e-9)
        np.testing.assert_array_equal(rows[flying, 1, 3], 0.0)
    else:
        np.testing.assert_allclose(rows[:, 0, 3], 0.4, rtol=0, atol=1e-15)


def test_a_leg_too_short_for_its_speed_is_flown_slower():
    path = legs([(0.0, 0.0, 0.0), (0.1, 0.0, 0.0)], 1.5)
    _, rows = sampled(path, 0.001)
    assert rows[:, 1, 0].max() == pytest.approx(math.sqrt(0.1 * EASE), rel=1e-4)
    assert path.pose_w[-1, 0] == pytest.approx(0.1)


@pytest.mark.parametrize("along", [False, True])
def test_a_spline_goes_through_its_points_near_its_speed(along):
    path = spline(ROUND, 1.2, along=along, yaw=0.3)
    np.testing.assert_allclose(path.pose_w[:, :3], ROUND)
    _, rows = sampled(path)
    assert 0.9 < np.linalg.norm(rows[:, 1, :3], axis=1).max() / 1.2 < 1.4
    if along:
        moving = np.hypot(rows[:, 1, 0], rows[:, 1, 1]) > 0.6
        off = np.arctan2(rows[moving, 1, 1], rows[moving, 1, 0]) - rows[moving, 0, 3]
        assert np.abs([wrap(each) for each in off]).max() < 0.3
        ahead = np.arctan2(path.rate_w[1:-1, 1], path.rate_w[1:-1, 0])
        np.testing.assert_allclose(np.sin(ahead - path.pose_w[1:-1, 3]), 0.0, atol=1e-12)
        before, after = (np.array(path.at(t)[1]) for t in (path.times[0] + 1e-4, path.seconds - 1e-4))
        for rate, yaw in ((before, path.pose_w[0, 3]), (after, path.pose_w[-1, 3])):
            assert abs(wrap(math.atan2(rate[1], rate[0]) - yaw)) < 1e-2
    else:
        np.testing.assert_array_equal(rows[:, 0, 3], 0.3)


@pytest.mark.parametrize("path", PATHS)
def test_the_reference_turns_as_its_heading_does(path):
    """R_d is a rotation about the vertical; ω and its rate are in the rotated axes, as the controller expects."""
    q, h = np.linspace(-0.5, 0.5, 16), 1e-4
    for t in np.linspace(path.times[0], path.seconds, 23)[1:-1]:
        now, after = path.reference(t, q), path.reference(t + h, q)
        pose, rate, acceleration = path.at(t)
        R = quat_to_matrix(now.quat_wb)
        np.testing.assert_allclose(R, exp(np.array([0.0, 0.0, pose[3]])), atol=1e-12)
        np.testing.assert_allclose(log(R.T @ quat_to_matrix(after.quat_wb)) / h, now.omega_b, atol=1e-3)
        np.testing.assert_array_equal([now.position_w, now.velocity_w, now.acceleration_w], [x[:3] for x in path.at(t)])
        assert (now.omega_b[2], now.alpha_b[2]) == (rate[3], acceleration[3])
        assert now.joint_target is q


@pytest.mark.parametrize(
    ("build", "match"),
    [
        (lambda: legs([(0.0, 0.0, 0.0)], 1.0), "two points"),
        (lambda: legs([(0.0, 0.0, 0.0), (0.0, 0.0, 0.0)], 1.0), "no two in a row alike"),
        (lambda: spline([(0.0, 0.0, 0.0), (math.nan, 0.0, 0.0)], 1.0), "two points"),
        (lambda: spline([(0.0, 0.0, 0.0), (1.0, 0.0, 0.0)], -1.0), r"speed = -1.0 .* above 0 \[m/s\]"),
        (lambda: eight(along=False, begin=math.nan), "finite times"),
        (lambda: lemniscate(0.0, 1.0, 30.0, position_w=AT), r"half_width = 0.0"),
        (lambda: lemniscate(2.0, 1.0, 1.0, position_w=AT), "2.67 s or more"),
        (lambda: Path(np.zeros(2), *np.zeros((3, 2, 4))), "each after the one before"),
        (lambda: Path(np.arange(2.0), *np.zeros((3, 2, 3))), r"shape \(2, 4\)"),
        (lambda: Path(np.arange(2.0), *np.full((3, 2, 4), np.inf)), "finite numbers"),
    ],
)
def test_what_is_no_path_is_refused(build, match):
    with pytest.raises(InvalidValueError, match=match):
        build()


# ---- from motion to rest ----


def motions(n=60):
    """Random poses, rates, accelerations, ends and speeds in the ranges of steered flights."""
    rng = np.random.default_rng(4)
    for _ in range(n):
        pose, end = rng.uniform(-2.0, 2.0, 4), rng.uniform(-5.0, 5.0, 4) * rng.choice([0.02, 1.0], 4)
        end[3] = pose[3] + rng.uniform(-3.0, 3.0) * rng.choice([0.0, 1.0])
        yield pose, rng.uniform(-0.6, 0.6, 4), rng.uniform(-1.2, 1.2, 4), end, rng.uniform(0.3, 1.5)


def test_from_rest_it_is_straight():
    path = from_motion(np.zeros(4), np.zeros(4), np.zeros(4), np.array([4.0, -2.0, 1.0, 0.5]), 0.8)
    rows = np.array([path.at(t)[0] for t in np.linspace(0.0, path.seconds, 50)])
    np.testing.assert_allclose(rows[:, 1:], rows[:, :1] * [-0.5, 0.25, 0.125], atol=1e-12)
    fastest = max(np.linalg.norm(path.at(t)[1][:3]) for t in np.linspace(0.0, path.seconds, 200))
    assert fastest <= 0.8 + 1e-9


@pytest.mark.parametrize("length", [0.05, 0.3, 1.0, 5.0])
@pytest.mark.parametrize("speed", [0.3, 1.2, 1.5])
def test_from_rest_and_from_a_slow_flight_the_acceleration_is_bounded(length, speed):
    """With a bound on speed alone, 0.3 m would be flown in half a second at 6 m/s²."""
    for fast in (0.0, 0.2):
        for way in np.eye(3):
            begin, rate = np.zeros(4), np.array([fast, 0.0, 0.0, 0.0])
            path = from_motion(begin, rate, np.zeros(4), np.array([*(length * way), 0.0]), speed)
            found = max(np.linalg.norm(path.at(t)[2][:3]) for t in np.linspace(0.0, path.seconds, 400))
            assert found < 1.95 * EASE + 6.0 * fast


def test_it_begins_as_it_moves_ends_at_rest_and_nothing_jumps():
    for pose, rate, acceleration, end, speed in motions():
        path = from_motion(pose, rate, acceleration, end, speed)
        for found, given in zip(path.at(0.0), (pose, rate, acceleration), strict=True):
            np.testing.assert_allclose(found, given, atol=1e-9)
        np.testing.assert_allclose(path.at(path.seconds)[0], end, atol=1e-9)
        rows = np.array([path.at(t) for t in np.arange(0.0, path.seconds, 0.005)])
        assert np.abs(np.diff(rows[:, 2], axis=0)).max() < 0.2
        np.testing.assert_allclose(np.diff(rows[:, 0], axis=0), 0.005 * rows[1:, 1], atol=3e-4)


def test_the_path_overshoots_by_no_more_than_the_braking_distance():
    """One quintic for all coordinates would overshoot by metres: a redirected climb would end on the floor."""
    worst = 0.0
    for pose, rate, acceleration, end, speed in motions():
        path = from_motion(pose, rate, acceleration, end, speed)
        rows = np.array([path.at(t)[0] for t in np.linspace(0.0, path.seconds, 300)])
        low, high = np.minimum(pose, end), np.maximum(pose, end)
        worst = max(worst, float(np.maximum(low - rows, rows - high)[:, :3].max()))
    assert worst < 0.6  # braking distance from 0.6 m/s
    climbing = np.zeros(4), np.array([0.0, 0.0, 0.3, 0.0]), np.array([0.0, 0.0, 1.5, 0.0])
    path = from_motion(*climbing, np.array([9.0, 0.0, 0.05, 0.0]), 1.2)
    heights = [path.at(t)[0][2] for t in np.linspace(0.0, path.seconds, 300)]
    assert min(heights) > -0.05
    assert max(heights) < 0.35
