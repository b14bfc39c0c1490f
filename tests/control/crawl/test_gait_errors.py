"""Pins the gait under errors: lagging torso, slope, rolling feet, time-outs, commands out of reach."""

import copy
import inspect
import math
from dataclasses import replace

import numpy as np
import pytest
from support.gaits import DT, EXACT, FORWARD, SPEED, WAYS, World

from spidar_gym.control.crawl.footsteps import GaitConfig, Lift, Move, Stand, lying_pose
from spidar_gym.control.crawl.gait import MISSED, Gait
from spidar_gym.control.crawl.pose2 import Pose2
from spidar_gym.errors import InvalidValueError
from spidar_gym.robot import ROBOT
from spidar_gym.so3 import exp, rotation_z


class Lagging(World):
    """Joints with a lag of 70 ms, as the servos have."""

    def servo(self, plan):
        return self.q + (1.0 - math.exp(-DT / 0.07)) * (plan - self.q)


def test_touchdown_waits_until_the_torso_no_longer_sinks():
    slow = World(sink=0.02).run(FORWARD)
    (*_, last) = slow.during("down")
    assert last[3] == pytest.approx(0.0, abs=1e-9)
    assert len(slow.during("down")) * DT >= EXACT.lift_height / 0.02
    assert slow.gait.memory.timeouts == 0


def test_a_torso_held_up_in_the_air_has_not_touched_down_and_the_phase_times_out():
    for floor, timeouts in ((0.0, 0), (0.02, 0), (0.08, 1)):
        config = replace(EXACT, timeout=4.0)
        world = World(config, floor=floor).run(FORWARD)
        assert world.gait.memory.timeouts == timeouts
        times_out = len(world.during("down")) == pytest.approx(config.timeout / DT, abs=1)
        assert times_out == bool(timeouts)


@pytest.mark.parametrize(("down_at", "arrives"), [(1.0, True), (0.97, False)])
def test_a_torso_that_stays_behind_arrives_before_it_goes_down_unless_it_may_begin_on_the_way(down_at, arrives):
    config = replace(GaitConfig(), down_at=down_at)
    world = World(config, lost=0.1).run(FORWARD)
    assert (world.missed(FORWARD.way).max() <= config.arrival) == arrives
    assert world.gait.memory.timeouts == 0


def test_feet_have_not_touched_down_before_the_legs_are_still_and_where_they_should_be():
    class Sluggish(World):
        """Joints that move down at half the joint speed."""

        def servo(self, plan):
            return np.minimum(plan, self.q + 0.5 * SPEED * DT)

    world = Sluggish().run(Lift((0, 2), angle=0.4, seconds=0.1))
    lower = world.during("lower")
    planned = np.abs(lower[-1][1] - [row[1] for row in lower]).max(axis=1)
    arrived = int(np.argmax(planned < 1e-9)) * DT
    assert arrived < 0.45 / SPEED
    assert len(lower) * DT >= 0.4 / (0.5 * SPEED) + EXACT.leg_touch_time - 0.1
    np.testing.assert_allclose(lower[-1][2][:, 2], ROBOT.foot_radius, rtol=0, atol=2e-3)
    assert world.gait.memory.timeouts == 0


def test_a_leg_that_comes_to_rest_short_of_its_goal_does_not_hold_up_the_others():
    class Stuck(World):
        """A first leg whose inner pitch does not rise."""

        def servo(self, plan):
            q = plan.copy()
            q[1] = max(q[1], lying_pose(self.config)[1] - 0.02)
            return q

    world = Stuck().run(Lift((0, 1), angle=0.3, seconds=0.1))
    assert world.phases == ["spool", "raise", "hold", "lower", "settle", "done"]
    assert world.gait.memory.timeouts == 0
    raising = len(world.during("raise")) * DT
    assert 0.3 / SPEED + EXACT.stall_time <= raising < 0.3 / SPEED + EXACT.stall_time + 1.0


def test_a_phase_that_does_not_end_times_out():
    class Blocked(World):
        """Legs that never come down."""

        def servo(self, plan):
            return self.q if self.gait.memory.phase == "lower" else plan

    world = Blocked(replace(EXACT, timeout=3.0)).run(Lift((0,), angle=0.4, seconds=0.1))
    assert world.gait.memory.timeouts == 1
    assert len(world.during("lower")) == pytest.approx(3.0 / DT, abs=1)


def test_the_gait_receives_no_forces():
    """Neither feet nor torso have a touch sensor: the inputs are pose and joint angles."""
    assert list(inspect.signature(Gait.step).parameters) == ["self", "position_w", "R_wb", "q", "residual"]
    assert list(inspect.signature(Gait.reset).parameters) == ["self", "position_w", "R_wb", "q"]
    world = World()
    world.gait.command([FORWARD])
    for _ in range(150):
        world.tick()
    twin = copy.deepcopy(world.gait)
    np.testing.assert_array_equal(twin.step(*world.seen, world.q), world.gait.step(*world.seen, world.q))


@pytest.mark.parametrize("heading", [0.0, 0.8, -2.0])
@pytest.mark.parametrize("way", [Pose2(0.2), Pose2(-0.1, 0.25)])
def test_on_a_slope_the_torso_ends_at_the_commanded_pose_in_the_horizontal_plane(heading, way):
    R_wf = exp(0.25 * np.array([math.sin(heading), -math.cos(heading), 0.0]))
    world = World(R_wf=R_wf, start=(0.0, 0.0, 0.5)).run(Move(way))
    assert np.all(world.missed(way) < 1e-3)
    assert world.slip < 0.0015
    uphill = np.array([way.x, way.y]) @ rotation_z(world.start.yaw)[:2, :2].T @ (math.cos(heading), math.sin(heading))
    climbed = (R_wf @ world.position)[2] - (R_wf @ (0.0, 0.0, ROBOT.peg_depth))[2]
    assert climbed == pytest.approx(math.tan(0.25) * uphill, abs=1e-3)


def test_on_a_slope_a_displacement_with_a_turn_ends_at_the_commanded_pose_to_first_order_in_the_slope():
    way = Pose2(0.2, 0.1, 0.4)
    world = World(R_wf=exp(np.array([0.1, 0.1, 0.0]))).run(Move(way))
    assert np.all(world.missed(way) < (0.002, 0.002, 0.01))


@pytest.mark.parametrize(("gain", "most", "least"), [(0.0, 0.011, 0.009), (2.0, EXACT.arrival + 5e-4, 0.0)])
def test_the_trim_makes_up_for_a_torso_that_stays_behind_its_plan(gain, most, least):
    world = Lagging(replace(EXACT, trim_gain=gain), lost=0.05).run(FORWARD)
    assert least <= math.hypot(*world.missed(FORWARD.way)[:2]) <= most
    assert world.gait.memory.timeouts == 0


@pytest.mark.parametrize("gain", [0.0, 2.0])
def test_errors_of_earlier_cycles_are_made_up_for_by_later_ones(gain):
    way = Pose2(0.6, 0.0)
    world = World(replace(EXACT, trim_gain=gain), lost=0.05).run(Move(way, cycles=3))
    # Each cycle is lengthened by the shortfall of the one before, so only the last third loses 5 %.
    assert math.hypot(*world.missed(way)[:2]) < 0.0115


def test_the_trim_is_limited():
    world = Lagging(replace(EXACT, trim_gain=2.0, trim_limit=0.004), lost=0.05).run(FORWARD)
    # 4 mm more than planned, 5 % of it lost.
    assert world.missed(FORWARD.way)[0] == pytest.approx(0.2 - 0.95 * 0.204, abs=5e-4)


@pytest.mark.parametrize(
    ("corrections", "cycles", "missed"), [(0, 1, 0.04), (1, 2, 0.008), (2, 3, 0.0016), (5, 3, 0.0016)]
)
def test_cycles_are_added_until_the_goal_is_reached_or_none_is_left(corrections, cycles, missed):
    way = Pose2(0.2, 0.0)
    world = World(replace(EXACT, corrections=corrections), lost=0.2).run(Move(way))
    assert math.hypot(*world.missed(way)[:2]) == pytest.approx(missed, abs=1e-3)
    assert world.phases.count("forward") == cycles
    assert world.gait.memory.corrected == 0


def test_a_correction_moves_the_feet_only_where_the_miss_is_larger_than_the_trim():
    for lost, steps in ((0.1, 1), (0.2, 2)):  # of 0.2 m: 20 mm, and 40 mm
        world = World(replace(EXACT, corrections=1), lost=lost).run(FORWARD)
        assert world.phases.count("forward") == 2
        assert world.phases.count("swing") == steps
        assert math.hypot(*world.missed(FORWARD.way)[:2]) == pytest.approx(0.2 * lost**2, abs=1e-3)
        assert world.slip < 0.0015


@pytest.mark.parametrize(("corrections", "timeouts"), [(0, 1), (1, 0)])
def test_feet_that_swing_about_their_targets_do_not_hold_a_correcting_gait_up(corrections, timeouts):
    class Swinging(World):
        """Lowered legs that swing by 15 mrad at 2 Hz for ever, as servos that hardly damp do with a late feedback."""

        def servo(self, plan):
            if self.gait.memory.phase != "lower":
                return plan
            return plan + 0.015 * math.sin(4.0 * math.pi * self.gait.memory.time)

    world = Swinging(replace(EXACT, corrections=corrections, timeout=6.0)).run(Lift((0, 1), angle=0.3, seconds=0.1))
    assert world.gait.memory.timeouts == timeouts


def test_a_move_that_others_follow_is_corrected_by_them():
    way = Pose2(0.2, 0.0)
    world = World(replace(EXACT, corrections=5), lost=0.2).run(Move(way), Move(Pose2(0.1)))
    assert world.gait.done
    assert math.hypot(*world.missed(Pose2(0.3, 0.0))[:2]) < MISSED + 1e-3


def test_a_torso_that_is_stuck_does_not_wait_for_the_time_out_if_corrections_are_left():
    class Stuck(World):
        """A torso that stays where it is in the first cycle."""

        def _stand(self, before):
            here = self.position.copy()
            super()._stand(before)
            if self.gait.memory.corrected == 0:
                self.position[:2] = here[:2]

    times = {}
    for corrections in (0, 1):
        world = Stuck(replace(EXACT, corrections=corrections)).run(FORWARD)
        times[corrections] = len(world.during("forward")) * DT
        missed = math.hypot(*world.missed(FORWARD.way)[:2])
        assert missed == pytest.approx(0.0 if corrections else 0.2, abs=0.01)
    assert times[0] == pytest.approx(0.5 * EXACT.timeout, abs=0.1)
    assert times[1] < 2.0 * (times[0] - 1.0)  # in two cycles


@pytest.mark.parametrize("rolling", [False, True])
def test_a_gait_that_models_rolling_feet_needs_no_trim_where_feet_roll(rolling):
    way = Pose2(0.2, 0.0, 0.0)
    world = World(replace(EXACT, rolling=rolling), rolling=True).run(Move(way))
    error = math.hypot(*world.missed(way)[:2])
    assert error < 1e-3 if rolling else error > 0.004


@pytest.mark.parametrize("name", ["forward", "diagonal", "turn", "arc"])
def test_rolling_feet_stay_consistent_with_each_other(name):
    world = World(replace(EXACT, rolling=True), rolling=True).run(*(Move(way) for way in WAYS[name]))
    assert world.slip < 0.0015
    assert np.all(world.missed(*WAYS[name]) < 1e-3)


@pytest.mark.parametrize(
    "command",
    [
        Move(Pose2(1.0), cycles=2),
        Move(Pose2(yaw=4.0), cycles=1),
        Move(Pose2(math.nan)),
        Lift(()),
        Lift((0, 4)),
        Lift((-1,)),
        Lift(angle=-0.1),
        Lift(seconds=math.inf),
        Stand(height=1.0),
        Stand(height=-0.1),
        Stand(seconds=-1.0),
    ],
    ids=repr,
)
def test_a_command_out_of_reach_is_refused_and_none_of_the_list_is_taken(command):
    world = World()
    with pytest.raises(InvalidValueError):
        world.gait.command([FORWARD, command])
    assert world.gait.done
    before = world.q
    world.tick()
    np.testing.assert_array_equal(world.q, before)
    world.run(FORWARD)
    assert np.all(world.missed(FORWARD.way) < 1e-3)


def test_a_command_returns_its_number_of_steps():
    world = World()
    assert world.gait.command([Move(Pose2(0.3), cycles=2), Stand(), Lift()]) == 4
    assert world.gait.command([]) == 0
