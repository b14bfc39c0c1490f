"""Pins the gait's phases, speeds, footsteps and touchdowns in a world of kinematics alone, and where the torso ends."""

import copy
import inspect
import math
from dataclasses import replace
from functools import cache
from itertools import groupby

import numpy as np
import pytest
from support.states import model

from spidar_gym.control.crawl.footsteps import GaitConfig, Lift, Move, Stand, lying_pose
from spidar_gym.control.crawl.gait import Gait, nominal_time
from spidar_gym.control.crawl.pose2 import Pose2
from spidar_gym.errors import InvalidValueError
from spidar_gym.robot import N_LEGS, ROBOT
from spidar_gym.so3 import exp, rotation_z
from spidar_gym.state import NO_RESIDUAL, Residual

DT, SPEED = 0.025, 0.2
CYCLE = ["spool", "raise", "swing", "lower", "brace", "up", "forward", "down", "settle"]
ON_FEET = ("brace", "up", "forward", "down")
FORWARD = Move(Pose2(0.2))
LEVEL = np.eye(3)
EXACT = GaitConfig(trim_gain=0.0)
"""Nothing but the plan itself: no feedback makes up for its errors."""


def feet_of(q):
    """Centres of the feet, torso axes, by Pinocchio."""
    return model().contacts(q)[0][:N_LEGS]


class World:
    """Joints that do as they are told, feet that stay where they stand, a torso that the floor stops; floor axes."""

    def __init__(
        self, config=EXACT, *, R_wf=LEVEL, start=(0.0, 0.0, 0.0), lost=0.0, rolling=False, floor=0.0, sink=9.0
    ):
        """`lost` is the share of every way that the torso stays behind, `sink` the fastest it sinks [m/s]."""
        self.config, self.R_wf, self.lost, self.rolling, self.floor, self.sink = (
            config,
            R_wf,
            lost,
            rolling,
            floor,
            sink,
        )
        self.gait = Gait(config, joint_speed=SPEED, dt=DT)
        self.q, self.slip, self.rows = lying_pose(config), 0.0, []
        self.lying = floor + ROBOT.peg_depth
        self.position, self.R = np.array([start[0], start[1], ROBOT.peg_depth]), rotation_z(start[2])
        self.origin = self.position
        self.gait.reset(*self.seen, self.q)
        self.start = self.planar

    @property
    def seen(self):
        """What the gait sees of the torso."""
        return self.R_wf @ self.position, self.R_wf @ self.R

    @property
    def planar(self):
        position_w, R_wb = self.seen
        return Pose2(float(position_w[0]), float(position_w[1]), math.atan2(R_wb[1, 0], R_wb[0, 0]))

    @property
    def feet(self):
        return self.position + feet_of(self.q) @ self.R.T

    def servo(self, plan):
        return plan

    def tick(self, residual=NO_RESIDUAL):
        gait = self.gait
        standing = gait.mode == "stance"
        plan = gait.step(*self.seen, self.q, residual)
        if gait.mode == "stance" and not standing:
            self.stance, self.origin = self.feet, self.position
        before, self.q = self.q, self.servo(plan)
        if gait.mode == "stance":
            self._stand(before)
        height = self.position[2] - ROBOT.peg_depth
        self.rows.append((gait.memory.phase, plan.copy(), self.feet, height, self.planar, gait.mode, gait.lifted))

    def _stand(self, before):
        """The torso goes where the feet, which stand still or roll, allow it: least squares over all four."""
        if self.rolling:
            turned = (self.q - before).reshape(N_LEGS, 4)[:, (1, 3)].sum(axis=1)
            hips = ROBOT.yaw_axis_xy * np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])
            out = (feet_of(self.q)[:, :2] - hips) @ self.R[:2, :2].T
            self.stance[:, :2] += (ROBOT.foot_radius * turned / np.linalg.norm(out, axis=1))[:, None] * out
        feet_b = feet_of(self.q)
        centre_b, centre = feet_b.mean(axis=0), self.stance.mean(axis=0)
        U, _, Vt = np.linalg.svd((self.stance - centre).T @ (feet_b - centre_b))
        self.R = U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt
        position = centre - self.R @ centre_b
        self.slip = max(self.slip, float(np.abs(position + feet_b @ self.R.T - self.stance).max()))
        position[:2] -= self.lost * (position - self.origin)[:2]
        low = self.lying if self.gait.memory.phase == "down" else ROBOT.peg_depth
        position[2] = max(position[2], low, self.position[2] - self.sink * DT)
        self.position = position

    def run(self, *commands, residual=NO_RESIDUAL, ticks=20000):
        self.gait.command(commands)
        while not self.gait.done:
            self.tick(residual)
            ticks -= 1
            assert ticks > 0, f"stuck in {self.gait.memory.phase}"
        return self

    @property
    def phases(self):
        return [phase for phase, _ in groupby(row[0] for row in self.rows)]

    def during(self, *phases):
        return [row for row in self.rows if row[0] in phases]

    def missed(self, *ways):
        """How far the torso lies from where these ways lead: x, y [m], yaw [rad]."""
        goal = self.start
        for way in ways:
            goal = goal @ way
        here = self.planar
        return np.abs([here.x - goal.x, here.y - goal.y, math.remainder(here.yaw - goal.yaw, 2.0 * math.pi)])


class Lagging(World):
    """Joints that follow 70 ms behind, as the servos do."""

    def servo(self, plan):
        return self.q + (1.0 - math.exp(-DT / 0.07)) * (plan - self.q)


WAYS = {
    "forward": [Pose2(0.2)],
    "backward": [Pose2(-0.45)],
    "sideways": [Pose2(0.0, 0.3)],
    "diagonal": [Pose2(0.15, -0.25)],
    "turn": [Pose2(yaw=0.9)],
    "back turn": [Pose2(yaw=-0.4)],
    "arc": [Pose2(0.4, 0.2, 0.8)],
    "path": [Pose2(0.25, 0.1), Pose2(yaw=-0.5), Pose2(0.2, 0.0, 0.4), Pose2(-0.1, -0.2)],
}


@cache
def crawl(name):
    """One world that a robot has gone some ways in, from a start that is not the origin."""
    world = World(start=(0.7, -0.4, 2.0))
    return world.run(*(Move(way) for way in WAYS[name]))


@pytest.mark.parametrize("name", WAYS)
def test_the_torso_ends_where_the_command_said(name):
    world = crawl(name)
    assert np.all(world.missed(*WAYS[name]) < 1e-3)
    assert world.gait.memory.timeouts == 0
    assert abs(world.position[2] - ROBOT.peg_depth) < 1e-9


@pytest.mark.parametrize("name", WAYS)
def test_every_cycle_goes_through_the_papers_phases_in_order(name):
    phases = crawl(name).phases
    cycles = len(phases) // len(CYCLE)
    assert cycles >= len(WAYS[name])
    assert phases == CYCLE * cycles + ["done"]


@pytest.mark.parametrize("name", WAYS)
def test_no_joint_is_told_to_move_faster_than_the_joint_speed(name):
    plans = np.array([row[1] for row in crawl(name).rows])
    speeds = np.abs(np.diff(plans, axis=0)).max(axis=1) / DT
    assert speeds.max() <= SPEED * (1.0 + 1e-9)
    assert np.mean(speeds > 0.99 * SPEED) > 0.2, "the gait is as fast as it may be"


@pytest.mark.parametrize("name", WAYS)
def test_feet_stay_where_they_stand_while_the_torso_moves(name):
    assert crawl(name).slip < 0.0015


@pytest.mark.parametrize("name", WAYS)
def test_feet_are_off_the_floor_while_they_swing_and_on_it_while_the_torso_moves(name):
    swinging, standing = (
        [row[2][:, 2] - ROBOT.foot_radius for row in crawl(name).during(*p)] for p in (["swing"], ON_FEET)
    )
    assert np.min(swinging) > 0.02
    standing = np.array(standing)
    assert standing.max() < 0.0015
    assert standing.min() > -EXACT.press - 0.0015


@pytest.mark.parametrize("name", WAYS)
def test_the_torso_goes_its_way_at_its_height_and_rises_and_sinks_on_the_spot(name):
    world = crawl(name)
    heights = np.array([row[3] for row in world.during("forward")])
    np.testing.assert_allclose(heights, EXACT.lift_height, rtol=0, atol=1e-3)
    for phase in ("up", "down"):
        for _, rows in groupby(world.rows, key=lambda row: row[0]):
            rows = list(rows)
            if rows[0][0] == phase:
                ends = [(row[4].x, row[4].y, row[4].yaw) for row in (rows[0], rows[-1])]
                np.testing.assert_allclose(ends[0], ends[1], rtol=0, atol=2e-3)
                assert abs(abs(rows[-1][3] - rows[0][3]) - EXACT.lift_height) < 0.01


def test_each_cycle_goes_the_same_share_of_the_way_along_the_arc():
    way = Pose2(0.5, 0.3, 1.2)
    world = World().run(Move(way, cycles=4))
    ends = [list(rows)[-1][4] for phase, rows in groupby(world.rows, key=lambda row: row[0]) if phase == "settle"]
    assert len(ends) == 4
    for k, end in enumerate(ends, 1):
        goal = way.arc(0.25 * k)
        np.testing.assert_allclose((end.x, end.y, end.yaw), (goal.x, goal.y, goal.yaw), rtol=0, atol=1e-3)


@pytest.mark.parametrize("stride", ["centred", "home"])
def test_feet_end_a_stride_where_the_scheme_says_round_the_torso(stride):
    config = replace(EXACT, stride=stride)
    world = World(config).run(Move(Pose2(0.12), cycles=1))
    behind = {"centred": 0.06, "home": 0.0}[stride]
    feet_b = feet_of(world.q)
    np.testing.assert_allclose(feet_b[:, :2], config.home_b[:, :2] - (behind, 0.0), rtol=0, atol=1e-3)


def test_lifting_legs_raises_them_alone_by_the_angle_for_the_time_and_lowers_them():
    for legs in ((0,), (3, 1), (0, 1, 2, 3)):
        world = World().run(Lift(legs, angle=0.25, seconds=1.5))
        assert world.phases == ["spool", "raise", "hold", "lower", "settle", "done"]
        still = np.setdiff1d(np.arange(N_LEGS), legs)
        start = lying_pose(EXACT).reshape(N_LEGS, 4)
        for row in world.during("hold"):
            plan = row[1].reshape(N_LEGS, 4)
            np.testing.assert_allclose(plan[list(legs), 1], start[list(legs), 1] - 0.25, atol=1e-6)
        plans = np.array([row[1] for row in world.rows]).reshape(-1, N_LEGS, 4)
        assert np.abs(plans[:, still] - start[still]).max(initial=0.0) < 1e-9
        assert np.abs(plans[:, :, (0, 2, 3)] - start[:, (0, 2, 3)]).max() < 1e-9
        assert np.abs(plans[-1] - start).max() < 1e-3
        assert len(world.during("hold")) == pytest.approx(1.5 / DT, abs=1)


def test_standing_lifts_the_torso_to_the_height_holds_it_for_the_time_and_puts_it_down():
    world = World().run(Stand(height=0.14, seconds=1.5))
    assert world.phases == ["brace", "up", "hold", "down", "settle", "done"]
    heights = np.array([row[3] for row in world.during("hold")])
    np.testing.assert_allclose(heights, 0.14, rtol=0, atol=1e-3)
    assert len(heights) == pytest.approx(1.5 / DT, abs=1)
    assert max(row[3] for row in world.rows) < 0.141
    assert np.all(world.missed() < 1e-3)
    assert abs(world.position[2] - ROBOT.peg_depth) < 1e-9


def test_commands_are_carried_out_one_after_the_other_also_if_they_come_later():
    world = World()
    world.run(Stand(seconds=0.1), Move(Pose2(0.1, 0.0, 0.3)), Lift((2,), seconds=0.1))
    first = world.phases
    assert first == [
        "brace",
        "up",
        "hold",
        "down",
        "settle",
        *CYCLE,
        "spool",
        "raise",
        "hold",
        "lower",
        "settle",
        "done",
    ]
    world.run(Move(Pose2(-0.05, 0.1)))
    assert world.phases == [*first, *CYCLE, "done"]
    assert np.all(world.missed(Pose2(0.1, 0.0, 0.3), Pose2(-0.05, 0.1)) < 1e-3)


def test_a_command_that_comes_while_the_robot_is_under_way_waits_for_its_turn():
    world = World()
    world.gait.command([Move(Pose2(0.1))])
    for _ in range(200):
        world.tick()
    assert world.gait.memory.phase != "done"
    world.run(Move(Pose2(0.0, 0.1)))
    assert world.phases == [*CYCLE, *CYCLE, "done"]
    assert np.all(world.missed(Pose2(0.1), Pose2(0.0, 0.1)) < 1e-3)


def test_thrust_has_longer_to_come_from_rest_than_from_another_mode_and_time_to_fade():
    config = replace(EXACT, start_time=0.8, spool_time=0.3, settle_time=0.6)
    moves, stand = World(config).run(Move(Pose2(0.1), cycles=2)), World(config).run(Stand(seconds=0.1))
    for world, phase, seconds in (
        (moves, "spool", 2 * 0.8),
        (moves, "brace", 2 * 0.3),
        (moves, "settle", 2 * 0.6),
        (stand, "brace", 0.8),
    ):
        assert len(world.during(phase)) * DT == pytest.approx(seconds, abs=2 * DT)
    restless = World(replace(config, settle_time=0.0)).run(Move(Pose2(0.1), cycles=2))
    assert len(restless.during("spool")) * DT == pytest.approx(0.8 + 0.3, abs=2 * DT)


def test_allocation_modes_and_lifted_legs_follow_the_phases():
    world = World().run(Move(Pose2(0.05)), Lift((1,), seconds=0.1), Stand(seconds=0.1))
    phases, modes = [row[0] for row in world.rows], [row[5] for row in world.rows]
    steps = [mode for mode, _ in groupby(modes)]
    assert steps == ["legs", "stance", "rest", "leg", "rest", "stance", "rest"]
    for phase, mode, lifted in zip(phases, modes, (row[6] for row in world.rows), strict=True):
        assert (mode == "stance") >= (phase in ON_FEET)
        assert (mode == "rest") == (phase in ("settle", "done"))
        expected = {"legs": [1, 1, 1, 1], "stance": [1, 1, 1, 1], "leg": [0, 1, 0, 0], "rest": [0, 0, 0, 0]}[mode]
        np.testing.assert_array_equal(lifted, np.array(expected, bool))


def test_without_a_settling_time_cycles_follow_each_other_without_a_rest():
    world = World(replace(EXACT, settle_time=0.0)).run(Move(Pose2(0.3), cycles=2))
    assert world.phases == [*CYCLE[:-1], *CYCLE, "done"]
    assert np.all(world.missed(Pose2(0.3)) < 1e-3)


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
        """Inner pitches that go down at half the joint speed."""

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


def test_the_gait_is_told_of_no_force():
    """Neither feet nor torso have a touch sensor: pose and joint angles are all there is."""
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
def test_on_a_slope_the_torso_ends_where_the_command_said_seen_from_above(heading, way):
    R_wf = exp(0.25 * np.array([math.sin(heading), -math.cos(heading), 0.0]))
    world = World(R_wf=R_wf, start=(0.0, 0.0, 0.5)).run(Move(way))
    assert np.all(world.missed(way) < 1e-3)
    assert world.slip < 0.0015
    uphill = np.array([way.x, way.y]) @ rotation_z(world.start.yaw)[:2, :2].T @ (math.cos(heading), math.sin(heading))
    climbed = (R_wf @ world.position)[2] - (R_wf @ (0.0, 0.0, ROBOT.peg_depth))[2]
    assert climbed == pytest.approx(math.tan(0.25) * uphill, abs=1e-3)


def test_on_a_slope_a_way_with_a_turn_ends_where_the_command_said_but_for_the_slopes_second_order():
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
    # Each way is longer by what the last one lacked: in a series of thirds only the last 5 % are lost.
    assert math.hypot(*world.missed(way)[:2]) < 0.0115


def test_the_trim_is_limited():
    world = Lagging(replace(EXACT, trim_gain=2.0, trim_limit=0.004), lost=0.05).run(FORWARD)
    # 4 mm more than planned, 5 % of it lost.
    assert world.missed(FORWARD.way)[0] == pytest.approx(0.2 - 0.95 * 0.204, abs=5e-4)


@pytest.mark.parametrize("rolling", [False, True])
def test_a_gait_that_knows_that_feet_roll_arrives_without_a_trim_where_they_do(rolling):
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


def test_a_command_says_in_how_many_steps_it_is_carried_out():
    world = World()
    assert world.gait.command([Move(Pose2(0.3), cycles=2), Stand(), Lift()]) == 4
    assert world.gait.command([]) == 0


def test_residuals_scale_stride_height_raise_and_speed():
    half = World().run(FORWARD, residual=Residual(stride_scale=0.5))
    np.testing.assert_allclose((half.planar.x, half.planar.y), (0.1, 0.0), rtol=0, atol=1e-3)
    behind = EXACT.home_b[:, :2] - (0.05, 0.0)
    np.testing.assert_allclose(feet_of(half.q)[:, :2], behind, rtol=0, atol=1e-3)
    low = World().run(FORWARD, residual=Residual(lift_scale=0.5))
    assert max(row[3] for row in low.rows) == pytest.approx(0.5 * EXACT.lift_height, abs=1e-3)
    slow = World().run(FORWARD, residual=Residual(joint_speed_scale=0.5))
    assert np.abs(np.diff([row[1] for row in slow.rows], axis=0)).max() <= 0.5 * SPEED * DT * (1.0 + 1e-9)
    raised = [World().run(FORWARD, residual=Residual(raise_scale=scale)) for scale in (1.0, 2.0)]
    inner = [min(row[1][1::4].min() for row in world.during("raise", "swing")) for world in raised]
    assert inner[0] - inner[1] == pytest.approx(EXACT.raise_angle, abs=1e-6)


@pytest.mark.parametrize("name", ["forward", "turn", "path"])
def test_the_nominal_time_is_what_a_perfect_world_takes(name):
    moves = [Move(way) for way in WAYS[name]]
    time = nominal_time(EXACT, moves, joint_speed=SPEED, dt=DT)
    assert time == pytest.approx(len(crawl(name).rows) * DT, abs=0.02 * len(crawl(name).rows) * DT)


def test_phases_that_overlap_take_less_time_and_end_in_the_same_place():
    overlapped = replace(
        EXACT, swing_at=0.5, lower_at=0.2, forward_at=0.5, down_at=0.6, settle_time=0.0, spool_time=0.1
    )
    moves = [Move(Pose2(0.3, 0.1), cycles=2)]
    times = [nominal_time(config, moves, joint_speed=SPEED, dt=DT) for config in (overlapped, EXACT)]
    assert times[0] < 0.85 * times[1]
    world = World(overlapped).run(*moves)
    assert np.all(world.missed(moves[0].way) < 1e-3)
    assert world.slip < 0.0015
    assert nominal_time(EXACT, moves, joint_speed=2.0 * SPEED, dt=DT) < 0.8 * times[1]
