"""Pins the baselines of courses: where they crawl or fly, and that the planner's sequence is the cheapest."""

import importlib
import itertools
import sys
from pathlib import Path

import numpy as np
import pytest

from spidar_gym.control.course.gates import Course, Gate
from spidar_gym.control.course.rule import course_rule
from spidar_gym.control.course.target import Target
from spidar_gym.control.crawl.pose2 import Pose2
from spidar_gym.policies.course import DONE, DONE_TURN, HERE, Sight, has_arrived

ROOT = Path(__file__).resolve().parents[2]
BEAM, WALL, SLOT = (Gate(kind, 3.0, 3.3, size) for kind, size in (("beam", 0.6), ("wall", 0.8), ("slot", 1.5)))


@pytest.fixture(autouse=True)
def checkout(monkeypatch):
    """Make the baselines importable, as in a checkout."""
    monkeypatch.setattr(sys, "path", [str(ROOT), *sys.path])
    monkeypatch.chdir(ROOT)


@pytest.fixture
def planner():
    return importlib.import_module("baselines.course_planner")


class Seen(Sight):
    """A constructed observation of a course, on the ground or in the air."""

    def __init__(self, course, x=0.0, y=0.0, z=0.15, phase="lie", narrow=0.0, target=None, yaw=0.0):
        self.yaw = yaw
        self.course, self.phase, self.target = course, phase, target
        self.position_w, self.joint_position = np.array([x, y, z]), Target(narrow=narrow).form


def modes_of(planner, course, now):
    stations = course.goal.x - planner.STEP * np.arange(round(course.goal.x / planner.STEP), -1, -1)
    return stations, planner.cheapest(course, stations, now)


def test_under_a_beam_it_crawls_over_a_wall_it_flies_stretched_out_and_through_a_slot_narrow(planner):
    goal = Pose2(8.0)
    for gate, mode in ((BEAM, planner.LIES), (WALL, planner.WIDE), (SLOT, planner.NARROW)):
        stations, way = modes_of(planner, Course((gate,), goal), planner.LIES)
        there = way[np.abs(stations[way[:, 0]] - 3.15) < 0.5, 1]
        assert set(there) == {mode}
        assert tuple(way[0]) == (0, planner.LIES)
        assert tuple(way[-1]) == (len(stations) - 1, planner.LIES)


def test_what_is_near_is_crawled_to_and_what_is_far_is_flown_to(planner):
    for far, flies in ((0.4, False), (6.0, True)):
        _, way = modes_of(planner, Course((), Pose2(far)), planner.LIES)
        assert (planner.WIDE in way[:, 1]) == flies


def test_no_way_with_one_flight_or_none_is_cheaper(planner):
    """Compare with all sequences that take off at one station and land at another."""
    course = Course((Gate("beam", 2.0, 2.4, 0.6),), Pose2(6.0))
    stations, way = modes_of(planner, course, planner.LIES)

    def cost(steps):
        total = 0.0
        for (i, a), (j, b) in itertools.pairwise(steps):
            seconds = planner.STEP * (j - i) / planner.SPEED[a] if a == b else planner.CHANGE[a, b]
            power = planner.POWER[a] if a == b else planner.POWER[planner.WIDE]
            total += seconds / planner.WHOLE_TIME + seconds * power / 3600.0 / planner.WHOLE_ENERGY
        return total

    found, n, ways = cost(way.tolist()), len(stations), []
    for up in range(n):
        if stations[up] < 2.4 + planner.CLEAR[planner.WIDE]:
            continue
        for down in range(up + 1, n):
            flat = [(k, planner.LIES) for k in range(up + 1)] + [(k, planner.WIDE) for k in range(up, down + 1)]
            ways.append(cost([*flat, *((k, planner.LIES) for k in range(down, n))]))
    ways.append(cost([(k, planner.LIES) for k in range(n)]))
    assert found <= min(ways) + 1e-9


def test_the_planner_lands_at_its_target_and_does_not_revise_a_started_change(planner):
    own, course = planner.CoursePlanner(), Course((), Pose2(HERE + 6.0))
    up = own.choose(Seen(course, x=HERE))
    assert up.flies
    assert up.narrow == 0.0
    assert own.choose(Seen(course, x=HERE + 0.1, z=0.5, phase="climb", target=up)) is up
    landing = Seen(course, x=HERE + 5.0, z=0.4, phase="descend", target=Target(x=HERE + 5.0))
    down = own.choose(landing)
    assert (down.flies, down.x, down.y) == (False, HERE + 5.0, 0.0)


@pytest.mark.parametrize("phase", ["lie", "hover"])
def test_the_flying_baseline_waits_before_a_beam_and_the_crawling_one_goes_straight_to_the_goal(phase):
    module = importlib.import_module("baselines.course")
    course = Course((BEAM,), Pose2(8.0, 0.3, 0.2))
    fly, crawl, rule = module.CourseFly(), module.CourseCrawl(), module.CourseRule()
    seen = Seen(course, x=1.5, z=0.15 if phase == "lie" else 1.0, phase=phase)
    assert fly.choose(seen).flies
    assert fly.choose(seen).x < BEAM.begin
    straight = crawl.choose(seen)
    assert (straight.flies, straight.x, straight.y, straight.yaw) == (False, 8.0, 0.3, 0.2)
    assert rule.choose(seen) == course_rule(course, seen.position_w, seen.joint_position, phase)
    assert not rule.choose(seen).flies


def test_a_robot_that_has_arrived_stays_and_one_that_has_not_been_there_goes_on(monkeypatch):
    goal = Pose2(5.0, 0.2, 0.1)
    course, meant = Course((), goal), Target(x=goal.x, y=goal.y, yaw=goal.yaw)
    there = {"x": goal.x - 0.6 * DONE, "y": goal.y + 0.6 * DONE, "yaw": goal.yaw + 0.9 * DONE_TURN, "target": meant}
    assert has_arrived(Seen(course, **there))
    for change in (
        {"x": goal.x - 1.1 * DONE}, {"yaw": goal.yaw - 1.1 * DONE_TURN}, {"target": None}, {"phase": "crawl"},
        {"phase": "hover"}, {"target": Target(flies=True, x=goal.x, y=goal.y)}, {"target": Target(x=goal.x - 0.5)},
    ):  # fmt: skip
        assert not has_arrived(Seen(course, **{**there, **change}))
    module = importlib.import_module("baselines.course_steady")
    for policy in (module.SteadyRule(), module.SteadyPlanner()):
        seen = Seen(course, **there)
        acted = []
        for arrived in (True, False):
            monkeypatch.setattr("spidar_gym.policies.course.Sight", lambda _, sight=seen: sight)
            monkeypatch.setattr("spidar_gym.policies.course.has_arrived", lambda _, arrived=arrived: arrived)
            acted.append(policy.act(np.zeros(0)))
        stay = Target(x=there["x"], y=there["y"], yaw=there["yaw"]).action(course, seen.position_w)
        np.testing.assert_array_equal(acted[0], stay)
        np.testing.assert_array_equal(acted[1], policy.choose(seen).action(course, seen.position_w))
        assert not np.array_equal(*acted)
