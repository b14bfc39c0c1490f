"""`steady_rule`, `steady_planner`: rule and planner with recommended presets, which stay where they have arrived."""

from baselines.course_planner import CoursePlanner
from spidar_gym.benchmark import COURSE
from spidar_gym.policies.course import Arriving

PRESETS = {COURSE: {"action_mode": "waypoint", "preset": "steady", "gait": "steady_crawl"}}


class SteadyRule(Arriving):
    """Chooses its gait by the next gate, with `steady` in the air; courses only."""

    name = "steady_rule"
    presets = PRESETS


class SteadyPlanner(Arriving, CoursePlanner):
    """Plans the cheapest way over gaits, forms and places, with `steady` in the air; courses only."""

    name = "steady_planner"
    presets = PRESETS
