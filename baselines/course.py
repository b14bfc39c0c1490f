"""`course_rule`, which chooses its gait by the next gate; `course_fly` and `course_crawl`, one gait alone."""

from spidar_gym.benchmark import COURSE
from spidar_gym.control.course.rule import course_rule
from spidar_gym.control.course.target import Target
from spidar_gym.policies.course import CoursePolicy, Sight

PRESETS = {COURSE: {"action_mode": "waypoint"}}


class CourseRule(CoursePolicy):
    """Over walls and through slots in the air, under beams on the floor, to the goal by both; courses only."""

    name = "course_rule"
    presets = PRESETS


class CourseFly(CoursePolicy):
    """As the rule, but it never crawls: before a beam it waits, and it rests where it lands; courses only."""

    name = "course_fly"
    presets = PRESETS

    def choose(self, sight: Sight) -> Target:
        """Where to go from here."""
        return course_rule(sight.course, sight.position_w, sight.joint_position, sight.phase, crawls=False)


class CourseCrawl(CoursePolicy):
    """Crawls straight to the goal; courses only."""

    name = "course_crawl"
    presets = PRESETS

    def choose(self, sight: Sight) -> Target:
        """Where to go from here."""
        return course_rule(sight.course, sight.position_w, sight.joint_position, sight.phase, flies=False)
