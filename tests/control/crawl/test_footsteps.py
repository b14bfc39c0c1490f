"""Pins the footsteps: home positions on the floor, the longest strides in reach, the fewest cycles, refusals."""

import math
import re
from dataclasses import fields, replace

import numpy as np
import pytest
from support.states import model

from spidar_gym.control.crawl.footsteps import (
    STRIDES,
    GaitConfig,
    Move,
    largest_stride,
    lying_pose,
    plan_cycles,
    stride_fits,
)
from spidar_gym.control.crawl.kinematics import leg_angles
from spidar_gym.control.crawl.pose2 import Pose2
from spidar_gym.errors import InvalidValueError, UnknownNameError
from spidar_gym.robot import N_LEGS, ROBOT

NO_LENGTHS = ("inner", "outer", "stride", "corrections", "rolling", "robot")
LENGTHS = [f.name for f in fields(GaitConfig) if f.name not in NO_LENGTHS]
CONFIGS = [
    GaitConfig(),
    GaitConfig(stride="home"),
    GaitConfig(lift_height=0.2, press=0.0),
    GaitConfig(inner=-0.4, outer=1.2, max_distance=0.1, max_turn=0.2),
]


def ways(seed, n):
    """Straight displacements, turns on the spot and arcs in all directions."""
    rng = np.random.default_rng(seed)
    for k in range(n):
        bearing, length, yaw = rng.uniform((-math.pi, 0.1, 0.4), (math.pi, 2.5, 2.5)).tolist()
        yaw *= rng.choice([-1.0, 1.0])
        length, yaw = ((length, 0.0), (0.0, float(yaw)), (length, float(yaw)))[k % 3]
        yield Pose2(length * math.cos(bearing), length * math.sin(bearing), yaw)


def fits_by_hand(config, way):
    """Whether leg angles exist at both ends, torso lying and lifted, with the feet transformed into torso axes."""
    home = config.home_b
    if config.stride == "centred":
        # The feet stand around the middle of the displacement: half of it ahead of and half of it behind the torso.
        begin, middle, end = Pose2(), way.arc(0.5), way
    else:
        begin, middle, end = Pose2(), way, way
    for torso in (begin, end):
        for height in (-config.press, config.lift_height):
            yaw = middle.yaw - torso.yaw
            R_turn = np.array([[math.cos(yaw), -math.sin(yaw)], [math.sin(yaw), math.cos(yaw)]])
            c, s = math.cos(torso.yaw), math.sin(torso.yaw)
            apart = np.array([[c, s], [-s, c]]) @ (middle.x - torso.x, middle.y - torso.y)
            feet = np.column_stack([home[:, :2] @ R_turn.T + apart, home[:, 2] - height])
            if leg_angles(feet) is None:
                return False
    return True


@pytest.mark.parametrize("config", CONFIGS, ids=range(len(CONFIGS)))
def test_at_home_the_feet_touch_the_floor_that_the_torso_lies_on_where_the_start_pose_has_them(config):
    contacts = model().contacts(lying_pose(config))[0]
    feet, pegs = contacts[:N_LEGS], contacts[N_LEGS : 2 * N_LEGS]
    np.testing.assert_allclose(feet, config.home_b, atol=1e-9)
    np.testing.assert_allclose(pegs[:, 2], -ROBOT.peg_depth, atol=1e-9)
    np.testing.assert_allclose(feet[:, 2] - ROBOT.foot_radius, -ROBOT.peg_depth, atol=1e-9)
    start = model().contacts(np.tile([0.0, config.inner, 0.0, config.outer], N_LEGS))[0][:N_LEGS]
    np.testing.assert_allclose(feet[:, :2], start[:, :2], atol=1e-9)


@pytest.mark.parametrize("config", CONFIGS, ids=range(len(CONFIGS)))
def test_a_stride_fits_exactly_if_every_foot_is_in_reach_at_both_ends_lying_and_lifted(config):
    seen = {True: 0, False: 0}
    for way in ways(0, 150):
        for share in (0.05, 0.15, 0.5):
            stride = way.arc(share)
            seen[fits_by_hand(config, stride)] += 1
            assert stride_fits(config, stride) == fits_by_hand(config, stride)
    assert min(seen.values()) > 50


def test_the_height_of_a_stride_is_a_parameter():
    for height in (0.05, 0.2, 0.3):
        for way in ways(1, 60):
            config, stride = GaitConfig(lift_height=height), way.arc(0.15)
            assert stride_fits(GaitConfig(), stride, height) == fits_by_hand(config, stride)
    assert not stride_fits(GaitConfig(), Pose2(), 1.0)


@pytest.mark.parametrize("config", CONFIGS, ids=range(len(CONFIGS)))
def test_the_largest_stride_fits_and_one_a_hair_longer_does_not(config):
    for way in ways(2, 60):
        share = largest_stride(config, way)
        assert fits_by_hand(config, way.arc(share * (1.0 - 1e-9)))
        assert not fits_by_hand(config, way.arc(share * (1.0 + 1e-5)))
        for part in (0.25, 0.5, 0.9):
            assert fits_by_hand(config, way.arc(part * share))


def test_feet_placed_round_the_torso_stride_twice_as_far_as_feet_that_start_from_home_on_an_arc_at_most():
    for way in ways(3, 30):
        centred, home = (largest_stride(GaitConfig(stride=stride), way) for stride in STRIDES)
        assert centred <= 2.0 * home * (1.0 + 1e-6)
        if way.yaw == 0.0 or way.distance == 0.0:
            assert centred == pytest.approx(2.0 * home, rel=1e-6)


def test_the_reach_is_as_symmetric_as_the_robot():
    config = GaitConfig()
    for way in ways(4, 30):
        share = largest_stride(config, way)
        assert largest_stride(config, Pose2(-way.y, way.x, way.yaw)) == pytest.approx(share, rel=1e-6)
        assert largest_stride(config, Pose2(way.x, -way.y, -way.yaw)) == pytest.approx(share, rel=1e-6)
        assert largest_stride(config, way.inverse()) == pytest.approx(share, rel=1e-6)


@pytest.mark.parametrize("config", CONFIGS, ids=range(len(CONFIGS)))
def test_no_stride_of_a_plan_is_beyond_reach_or_longer_than_configured_and_there_are_as_few_as_possible(config):
    unlimited = replace(config, max_distance=9.0, max_turn=9.0)
    for way in ways(5, 90):
        cycles = plan_cycles(config, Move(way))
        assert fits_by_hand(config, way.arc(1.0 / cycles))
        assert abs(way.yaw) / cycles <= config.max_turn + 1e-6
        if way.yaw == 0.0:
            assert way.distance / cycles <= config.max_distance + 1e-6
        if cycles > 1:
            fewer = 1.0 / (cycles - 1)
            too_long = way.distance * fewer > config.max_distance or abs(way.yaw) * fewer > config.max_turn
            assert too_long or not fits_by_hand(config, way.arc(fewer))
        assert plan_cycles(unlimited, Move(way)) <= cycles


def test_a_zero_displacement_is_one_cycle():
    assert plan_cycles(GaitConfig(), Move(Pose2())) == 1


def test_the_requested_number_of_cycles_is_planned_where_the_reach_allows_it():
    config, refused = GaitConfig(), 0
    for way in ways(6, 60):
        for cycles in (1, 2, 5, 20):
            if fits_by_hand(config, way.arc(1.0 / cycles)):
                assert plan_cycles(config, Move(way, cycles)) == cycles
            else:
                refused += 1
                with pytest.raises(InvalidValueError, match="stride"):
                    plan_cycles(config, Move(way, cycles))
    assert refused > 30


def test_a_stride_out_of_reach_is_refused_with_the_one_that_is_in_reach():
    config = GaitConfig()
    for way in (Pose2(1.0, 0.4), Pose2(-1.0, 0.3, 0.7)):
        with pytest.raises(InvalidValueError) as refusal:
            plan_cycles(config, Move(way, 2))
        named, most, *turn = (float(v) for v in re.findall(r"(\d+\.\d+) (?:m|rad)", str(refusal.value)))
        assert named == pytest.approx(0.5 * way.distance, abs=1e-3)
        assert bool(turn) == bool(way.yaw)
        assert fits_by_hand(config, way.arc((most - 0.002) / way.distance))
        assert not fits_by_hand(config, way.arc((most + 0.002) / way.distance))
        for angle in turn:
            assert angle == pytest.approx(abs(way.yaw) * most / way.distance, abs=2e-3)


@pytest.mark.parametrize("cycles", [-1, -5])
def test_a_negative_number_of_cycles_is_refused(cycles):
    with pytest.raises(InvalidValueError, match="whole number"):
        plan_cycles(GaitConfig(), Move(Pose2(0.1), cycles))


@pytest.mark.parametrize("way", [Pose2(math.nan), Pose2(0.1, math.inf), Pose2(0.1, 0.0, -math.inf)])
def test_a_displacement_that_is_not_finite_is_refused(way):
    with pytest.raises(InvalidValueError, match="way"):
        plan_cycles(GaitConfig(), Move(way))


@pytest.mark.parametrize("name", LENGTHS)
@pytest.mark.parametrize("value", [-1e-6, math.nan, math.inf])
def test_a_negative_or_endless_length_or_time_is_refused(name, value):
    with pytest.raises(InvalidValueError, match=name):
        GaitConfig(**{name: value})


@pytest.mark.parametrize("name", ["max_distance", "max_turn", "lift_height", "timeout"])
def test_a_gait_that_would_not_move_is_refused(name):
    with pytest.raises(InvalidValueError, match=f"{name}.*above 0"):
        GaitConfig(**{name: 0.0})


def test_an_unknown_stride_scheme_is_refused_with_the_valid_ones():
    with pytest.raises(UnknownNameError, match="centred, home"):
        GaitConfig(stride="long")


@pytest.mark.parametrize(
    "pose",
    [{"inner": -1.5, "outer": 0.0}, {"inner": 0.0, "outer": 0.0, "lift_height": 0.9}, {"lift_height": 0.7}],
    ids=["feet in the air", "too high for straight legs", "too high"],
)
def test_a_start_pose_whose_feet_reach_no_floor_lying_or_lifted_is_refused(pose):
    with pytest.raises(InvalidValueError, match="feet reach the floor"):
        GaitConfig(**pose)
