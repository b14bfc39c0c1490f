"""Pins the core's manager of both gaits to the Python manager: the same phases, the same commands."""

import numpy as np
import pytest

from spidar_gym.control.crawl.pose2 import Pose2
from spidar_gym.control.locomotion.commands import CrawlTo, FlyTo, Land, TakeOff
from spidar_gym.control.locomotion.manager import Manager
from spidar_gym.errors import InvalidValueError
from spidar_gym.native.constants import MAX_WAYPOINTS
from spidar_gym.native.core_manager import CoreManager
from spidar_gym.robot import FORMS
from spidar_gym.sim.randomize import Randomization
from spidar_gym.studies.hops import HOP, Trip, manager_config

COURSE = (
    CrawlTo(Pose2(0.2, 0.1, 0.4)), TakeOff(1.0), FlyTo((1.0, 0.5, 1.5), FORMS["form3"], 0.8, along=True),
    FlyTo((1.0, 1.0, 1.3), FORMS["form2"]), Land(), CrawlTo(Pose2(1.1, 1.1, 0.6)),
)  # fmt: skip
MISSIONS = {
    "up and down": (HOP, None, {"sense": True}),
    "a randomised robot in wind": (HOP, None, {"sense": True, "strength": 1.0, "wind": 2.0}),
    "land now": (HOP, (2.5, [Land()]), {}),
    "not now": (HOP, (0.7, []), {}),
    "stop": (HOP, (4.0, []), {}),
    "climb now": ([CrawlTo(Pose2(0.3, 0.0, 0.0))], (2.0, [TakeOff(0.4), Land()]), {}),
    "go there at once": (
        HOP,
        (3.0, [FlyTo((1.0, 0.5, 1.4), FORMS["form2"], 0.8, along=True, at_once=True), Land()]),
        {"sense": True},
    ),
    "not before the legs are clear": (HOP, (1.8, [FlyTo((1.0, 0.5, 1.4), at_once=True), Land()]), {}),
    "go there at once, in a row": (
        [TakeOff(0.6), *(FlyTo((0.5 * k, 0.3, 1.2), at_once=True) for k in range(3)), Land()],
        None,
        {},
    ),
    "no floor": ([TakeOff(1.6), Land(floor=0.9)], None, {}),
}


class Both:
    """The Python manager; the core's receives the same calls and is compared with it."""

    def __init__(self, preset="tuned"):
        self.readable, self.core = Manager(manager_config(preset)), CoreManager(manager_config(preset))
        self.worst = {"thrust": 0.0, "vectoring": 0.0, "joint_position": 0.0}

    def __getattr__(self, name):
        return getattr(self.readable, name)

    def reset(self, state, commands):
        for each in (self.readable, self.core):
            each.reset(state, commands)

    def interrupt(self, commands):
        for each in (self.readable, self.core):
            each.interrupt(commands)

    def step(self, state):
        wanted, found = (each.step(state) for each in (self.readable, self.core))
        for name in ("phase", "done", "airborne"):
            assert getattr(self.core, name) == getattr(self.readable, name), name
        assert self.core.floor == pytest.approx(self.readable.floor, abs=1e-9)
        for name in self.worst:
            off = np.abs(getattr(found, name) - getattr(wanted, name))
            if name == "vectoring":
                off = off[wanted.thrust > 1.0]
            self.worst[name] = max(self.worst[name], float(off.max(initial=0.0)))
        return wanted


def flown(commands, seconds=60.0, *, interrupt=None, preset="tuned", **robot):
    both = Both(preset)
    seen = Trip(3, manager=both, **robot).fly(commands, seconds, interrupt=interrupt)
    assert seen.done is not None
    assert both.worst["thrust"] < 1e-9
    assert both.worst["vectoring"] < 1e-9
    assert both.worst["joint_position"] < 1e-9
    return seen


@pytest.mark.parametrize("name", MISSIONS)
def test_a_mission_is_that_of_the_python_manager(name):
    commands, interrupt, robot = MISSIONS[name]
    flown(commands, interrupt=interrupt, **robot)


def test_a_hop_with_observed_motion_and_legs_that_ring_is_that_of_the_python_manager():
    strength = Randomization.parse("calibrated_1:build-damped")
    flown(HOP, preset="steady", strength=strength, sense=True)


@pytest.mark.slow
def test_a_whole_course_is_that_of_the_python_manager():
    assert flown(COURSE, 90.0, sense=True, strength=0.5).phase[-1] == "lie"


def test_the_core_refuses_invalid_sequences_and_too_many_commands():
    manager = CoreManager(manager_config("tuned"))
    manager.reset(Trip(0).state, [TakeOff()])
    with pytest.raises(InvalidValueError, match="Land first"):
        manager.command([TakeOff()])
    manager.command([Land()])
    with pytest.raises(InvalidValueError, match="TakeOff first"):
        manager.command([Land()])
    assert isinstance(manager.last, Land)
    with pytest.raises(InvalidValueError, match=f"at most {MAX_WAYPOINTS}"):
        manager.command([TakeOff(), Land()] * MAX_WAYPOINTS)
    with pytest.raises(InvalidValueError, match=r"z = 0\.2"):
        manager.interrupt([TakeOff(), FlyTo((0.0, 0.0, 0.2))])
