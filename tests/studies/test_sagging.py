"""Pins the study of a nearly empty battery: λ̄ that follows the voltage keeps up a robot that falls without it."""

import pytest
from support.needs import needs_compiler

from spidar_gym.studies.sagging import Sagging, play_sagging, sagging_courses, sagging_lines

pytestmark = needs_compiler


@pytest.mark.slow
def test_a_loaded_robot_with_an_empty_battery_completes_its_course_only_with_a_limit_that_follows():
    with_voltage, without = (play_sagging(Sagging(2.5, follows, 0)) for follows in (True, False))
    assert with_voltage["completed"]
    assert with_voltage["most_m"] < 0.1
    assert not without["completed"]
    assert without["scaled"] > 5 * with_voltage["scaled"]
    assert [line[2] for line in sagging_lines([with_voltage, without])] == ["completed", "1 of 1", "0 of 1"]


def test_every_robot_flies_with_and_without_the_voltage():
    courses = sagging_courses((0.0, 2.0), 3)
    assert len(set(courses)) == 12
    assert sum(course.follows for course in courses) == 6
