"""Pins courses: refused maps, the conversion between targets and actions, the targets of the rule."""

import math
import re
from itertools import pairwise

import numpy as np
import pytest

from spidar_gym.control.course.gates import CEILING, GATES, HALF_WIDTH, ROOM, Course, Gate
from spidar_gym.control.course.rule import FLOWN, PASSED, course_rule
from spidar_gym.control.course.target import SWEEP, WAY, Target, take_target
from spidar_gym.control.crawl.pose2 import Pose2
from spidar_gym.control.locomotion.orders import form_radius
from spidar_gym.errors import InvalidValueError, UnknownNameError
from spidar_gym.model.dynamics import Model
from spidar_gym.robot import FORMS, ROBOT

WALL, BEAM, SLOT = Gate("wall", 3.0, 3.2, 0.8), Gate("beam", 6.5, 6.9, 0.6), Gate("slot", 10.0, 10.3, 1.5, 0.4)
WHOLE = Course((WALL, BEAM, SLOT, Gate("platform", 12.0, 15.5, 0.3)), Pose2(13.7, 0.2, 0.3))
LYING, NARROW = FORMS["form1"], FORMS["form3"]


@pytest.mark.parametrize(
    ("make", "word"),
    [
        (lambda: Gate("fence", 1.0, 2.0, 0.5), "gate"),
        (lambda: Gate("wall", 2.0, 1.0, 0.5), "end"),
        (lambda: Gate("wall", 1.0, 2.0, math.nan), "size"),
        (lambda: Gate("wall", 1.0, 2.0, -0.1), "size"),
        (lambda: Course((Gate("wall", 2.0, 2.2, CEILING + 0.1),), Pose2(5.0)), "size of a wall"),
        (lambda: Course((Gate("beam", 2.0, 2.4, 0.4),), Pose2(5.0)), "size of a beam"),
        (lambda: Course((Gate("beam", 2.0, 2.4, 0.0),), Pose2(5.0)), "size of a beam"),
        (lambda: Course((Gate("slot", 2.0, 2.4, 1.1),), Pose2(5.0)), "size of a slot"),
        (lambda: Course((Gate("slope", 2.0, 5.5, 0.5),), Pose2(4.0)), "size of a slope"),
        (lambda: Course((Gate("platform", 2.0, 5.5, 0.9),), Pose2(4.0)), "size of a platform"),
        (lambda: Course((Gate("slot", 2.0, 2.4, 1.6, 2.5),), Pose2(5.0)), "middle"),
        (lambda: Course((Gate("wall", 0.5, 0.7, 0.5),), Pose2(5.0)), "begin"),
        (lambda: Course((WALL, Gate("beam", 4.0, 4.4, 0.6)), Pose2(7.0)), "begin"),
        (lambda: Course((WALL, Gate("beam", 3.1, 3.5, 0.6)), Pose2(7.0)), "begin"),
        (lambda: Course((BEAM, WALL), Pose2(9.0)), "begin"),
        (lambda: Course((WALL,), Pose2(3.1)), "goal"),
        (lambda: Course((WALL,), Pose2(4.0)), "goal"),
        (lambda: Course((Gate("platform", 3.0, 6.0, 0.3),), Pose2(5.5)), "goal"),
        (lambda: Course((), Pose2(2.0, 2.5)), "y"),
        (lambda: Course((), Pose2(2.0, 0.0, 4.0)), "yaw"),
        (lambda: Course((SLOT,), Pose2(10.1, 1.5)), "goal"),
        (lambda: Course((), Pose2(math.nan)), "x"),
        (lambda: Course((), Pose2(-9.0)), "x"),
        (lambda: Course((Gate("tiles", 2.0, 5.5, 0.02),), Pose2(4.0)), "tiles"),
        (lambda: Course((Gate("tiles", 2.0, 2.5, 0.02),), Pose2(0.0), (0.01, 0.01, 0.03, 0.01)), "highest tile"),
        (lambda: Course((Gate("tiles", 2.0, 2.5, 0.02),), Pose2(0.0), (0.01, -0.01, 0.01, 0.01)), "lowest tile"),
        (lambda: Course((WALL,) * 9, Pose2(5.0)), "gates"),
    ],
)
def test_an_impassable_course_is_refused_in_one_line(make, word):
    with pytest.raises((InvalidValueError, UnknownNameError), match=word) as error:
        make()
    assert "\n" not in str(error.value)
    assert re.search(r"is not valid; expected .*\d|valid: wall, beam, slot, platform, tiles, slope", str(error.value))


def test_gates_that_are_too_small_are_accepted_on_request():
    assert Course((Gate("slot", 2.0, 2.4, 1.0),), Pose2(5.0), dares=True).gates[0].size == 1.0


def test_the_floor_height_is_that_of_slopes_and_platforms():
    slope = Course((Gate("slope", 3.0, 6.0, 0.1),), Pose2(4.5))
    assert slope.floor_at(2.9) == 0.0
    assert slope.floor_at(4.0) == pytest.approx(math.tan(0.1))
    assert WHOLE.floor_at(13.0) == 0.3
    assert WHOLE.floor_at(3.1) == 0.0  # a wall is no floor


# ---- targets ----


def test_a_target_survives_the_conversion_to_an_action_and_back():
    rng = np.random.default_rng(0)
    for _ in range(200):
        here = np.array([rng.uniform(0.0, 12.0), rng.uniform(-2.0, 2.0), 1.0])
        x, y = np.clip(here[:2] + rng.uniform(-WAY, WAY, 2), (-2.0, -2.6), (16.0, 2.6))
        target = Target(
            bool(rng.random() < 0.5), float(x), float(y), rng.uniform(0.0, CEILING), rng.uniform(-3.1, 3.1),
            rng.uniform(0.05, 1.5), rng.uniform(), rng.uniform(-SWEEP, SWEEP),
        )  # fmt: skip
        action = target.action(WHOLE, here)
        assert (np.abs(action) <= 1.0).all()
        back = take_target(action, WHOLE, here)
        for name in ("flies", "x", "y", "z", "yaw", "speed", "narrow", "sweep"):
            assert getattr(back, name) == pytest.approx(getattr(target, name), abs=1e-9), name


def test_every_action_is_a_target_inside_the_field():
    rng = np.random.default_rng(1)
    for action in rng.uniform(-1.0, 1.0, (500, 8)):
        here = rng.uniform((-2.5, -3.0, 0.0), (18.0, 3.0, 3.0))
        take_target(action, WHOLE, here).require_inside(WHOLE)


def test_a_displacement_that_is_too_long_is_shortened_in_its_direction():
    action = Target(x=12.0, y=1.0).action(WHOLE, np.zeros(3))
    back = take_target(action, WHOLE, np.zeros(3))
    assert back.x == pytest.approx(WAY)
    assert back.y / back.x == pytest.approx(1.0 / 12.0)


@pytest.mark.parametrize(
    ("values", "word"),
    [
        ({"speed": -0.1}, "speed"), ({"speed": 9.0}, "speed"), ({"speed": math.nan}, "speed"), ({"x": math.nan}, "x"),
        ({"z": math.inf}, "z"), ({"narrow": 1.5}, "narrow"), ({"sweep": 1.0}, "sweep"),
    ],
)  # fmt: skip
def test_an_invalid_target_is_refused(values, word):
    with pytest.raises(InvalidValueError, match=rf"^{word} = .* is not valid; expected a number within") as error:
        Target(**values)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    "place", [(-3.0, 0.0, 1.0), (30.0, 0.0, 1.0), (2.0, 3.5, 1.0), (2.0, -3.5, 1.0), (2.0, 0.0, 3.5), (2.0, 0.0, -0.5)]
)
def test_a_target_outside_the_field_is_refused(place):
    with pytest.raises(InvalidValueError, match=r"^target = .*; expected within x = .* m, y = ± 3 m, z = 0 … 3 m$"):
        Target(True, *place).action(WHOLE, np.zeros(3))


def test_the_forms_of_targets_are_the_papers_and_sweeping_makes_them_slimmer():
    np.testing.assert_allclose(Target().form, FORMS["form1"], atol=1e-12)
    np.testing.assert_allclose(Target(narrow=1.0).form, FORMS["form3"], atol=1e-12)
    model = Model()

    def width(target):
        q = target.form
        rotors = model.snapshot(q, np.eye(3), np.zeros((8, 2)))
        return float(np.abs((rotors.rotor_c + rotors.com_b)[:, 1]).max()), float(
            np.abs(model.contacts(q)[0][:, 1]).max()
        )

    stretched, swept = width(Target()), width(Target(sweep=SWEEP))
    assert swept[0] < stretched[0] - 0.1
    assert swept[1] < stretched[1] - 0.1
    np.testing.assert_allclose(Target(sweep=SWEEP).form + Target(sweep=-SWEEP).form, 2.0 * Target().form, atol=1e-12)
    assert (np.abs(Target(narrow=1.0, sweep=SWEEP).form) <= ROBOT.joint_limit).all()
    assert form_radius(model, Target(narrow=1.0).form) < form_radius(model, Target(narrow=0.5).form)


# ---- the rule ----


def rule(x, y=0.0, z=1.0, q=LYING, phase="fly", **options):
    return course_rule(WHOLE, np.array([x, y, z]), q, phase, **options)


def test_it_crawls_under_beams_and_flies_over_walls_and_through_slots():
    assert rule(0.0, z=0.15, phase="lie").flies
    before_beam = rule(WALL.end + PASSED + 0.2, z=0.15, phase="lie")
    assert not before_beam.flies
    assert before_beam.x > BEAM.end + 1.2
    before_slot = rule(BEAM.end + 1.3, z=0.15, phase="lie")
    assert before_slot.flies
    assert before_slot.narrow == 1.0


def test_a_robot_that_drifts_back_during_take_off_behind_a_beam_is_not_sent_back_through_it():
    behind = BEAM.end + PASSED - 0.02
    crawls_on = rule(behind, z=0.15, phase="lie")
    assert not crawls_on.flies
    assert crawls_on.x > behind
    for phase in ("spool", "climb", "hover", "fly"):
        target = rule(behind, z=0.15, phase=phase)
        assert target.flies
        assert target.x > behind
    assert rule(BEAM.begin - 0.5, z=1.0, phase="hover").x < BEAM.begin


def test_it_rises_before_it_flies_over_a_wall():
    low, high = rule(1.5, z=0.6), rule(1.5, z=1.8)
    assert low.x <= 1.5
    assert low.z == high.z > WALL.size + 0.5
    assert high.x > WALL.end + 1.0


def test_it_goes_through_a_slot_only_in_line_and_narrow():
    before = rule(8.3, z=1.4).x
    for y, q, goes in ((0.4, NARROW, True), (0.4, LYING, False), (0.0, NARROW, False)):
        target = rule(before, y, 1.4, q)
        assert (target.x > SLOT.end) == goes, (y, goes)
        assert target.y == SLOT.middle
    assert rule(before + 0.5, 0.4, 1.4, LYING).x == before


def test_it_lands_before_beams_and_over_the_goal():
    above = rule(BEAM.begin - 1.5, 0.0, 1.0)
    assert not above.flies
    assert not rule(4.8, 0.0, 0.4, phase="descend").flies
    assert not rule(13.7, 0.2, 1.3).flies
    far = rule(12.3, 0.0, 1.4)
    assert far.flies
    assert far.z == pytest.approx(1.3)


def test_a_take_off_behind_a_beam_that_drifts_back_goes_on_to_the_next_gate():
    assert rule(BEAM.end + PASSED - 0.05, z=0.15, phase="crawl").x > BEAM.end + PASSED
    for phase in ("spool", "climb", "hover", "form", "fly"):
        assert rule(BEAM.end + PASSED - 0.15, z=0.6, phase=phase).x == SLOT.begin - FLOWN


def test_on_the_goals_floor_it_crawls_to_the_goal():
    target = rule(13.2, 0.0, 0.45, phase="lie")
    assert (target.flies, target.x, target.y, target.yaw) == (False, 13.7, 0.2, 0.3)


def test_a_rule_restricted_to_one_gait_uses_that_gait_alone():
    assert not rule(0.0, z=0.15, phase="lie", flies=False).flies
    waits = rule(BEAM.begin - 1.5, 0.0, 1.0, crawls=False)
    assert waits.flies
    assert waits.x < BEAM.begin
    assert not rule(13.6, 0.0, 0.45, phase="lie", crawls=False).flies


def test_gates_leave_room_for_each_other():
    assert {gate.kind for gate in WHOLE.gates if gate.is_passed} == {*GATES}
    for before, after in pairwise(gate for gate in WHOLE.gates if gate.is_passed):
        assert after.begin - before.end >= ROOM
    assert WHOLE.is_inside(0.0, HALF_WIDTH, CEILING)
    assert not WHOLE.is_inside(WHOLE.end + 0.1, 0.0, 0.0)
