"""Pins copies of robots and controllers of the library: each has its own memory."""

import copy
import pickle
from typing import Any

import numpy as np
import pytest
from support.episodes import same
from support.plants import ASKEW, HIGH, ODDITIES, witnessed
from support.states import resting, staying

from spidar_gym.control.course.gates import Course
from spidar_gym.control.course.pilot import Pilot
from spidar_gym.control.course.target import Target
from spidar_gym.control.crawl.controller import Crawler
from spidar_gym.control.crawl.footsteps import Lift, Move
from spidar_gym.control.crawl.pose2 import Pose2
from spidar_gym.control.flight.controller import FlightController
from spidar_gym.control.locomotion.commands import FlyTo, TakeOff
from spidar_gym.control.locomotion.manager import Manager
from spidar_gym.control.presets import controller_config
from spidar_gym.errors import SpidarError
from spidar_gym.native import library
from spidar_gym.native.core_crawler import CoreCrawler
from spidar_gym.native.core_flight import CoreFlightController
from spidar_gym.native.core_manager import CoreManager
from spidar_gym.native.plant import Plant
from spidar_gym.robot import FORMS, ROBOT
from spidar_gym.so3 import exp
from spidar_gym.state import RobotState

WAYS = [copy.deepcopy, lambda thing: pickle.loads(pickle.dumps(thing))]
FLIGHTS = [FlightController, CoreFlightController]
CRAWLERS = [Crawler, CoreCrawler]
MANAGERS = [Manager, CoreManager]


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("case", ODDITIES)
def test_a_copied_plant_continues_bit_for_bit_and_neither_affects_the_other(case, way):
    config, disturbances = ODDITIES[case]
    plant = Plant(config)
    plant.reset(np.array([0.0, 0.0, 0.37]), ASKEW, disturbances=disturbances, rng=np.random.default_rng(5))
    witnessed(plant, 6)
    other = way(plant)
    assert not np.shares_memory(other.record, plant.record)
    assert same(other.save(), plant.save())
    assert same(other.config, plant.config)
    for k in range(8):
        assert np.array_equal(witnessed(other, 1, seed=k), witnessed(plant, 1, seed=k))
    before = plant.save()
    witnessed(other, 3, seed=9)
    assert same(plant.save(), before)


def test_a_plant_that_was_never_reset_is_copied():
    plant = Plant(ODDITIES["everything"][0])
    for other in (plant, *(way(plant) for way in WAYS)):
        start = other.reset(HIGH, ASKEW, FORMS["form2"], rng=np.random.default_rng(1))
        assert same(start, plant.reset(HIGH, ASKEW, FORMS["form2"], rng=np.random.default_rng(1)))


def swaying(k: int) -> RobotState:
    """Return a state in the air that varies slightly from tick to tick."""
    rng = np.random.default_rng(k)
    return resting(FORMS["form1"] + rng.normal(0.0, 0.01, 16), exp(rng.normal(0.0, 0.02, 3)))


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("kind", FLIGHTS)
def test_a_copied_flight_controller_continues_bit_for_bit(kind, way):
    controller = kind(controller_config("retuned"))
    controller.reset(swaying(0))
    for k in range(5):
        controller.step(swaying(k), staying(swaying(k + 20)))
    other = way(controller)
    assert same(other.config, controller.config)
    for k in range(5, 12):
        first, second = (each.step(swaying(k), staying(swaying(k + 20))) for each in (controller, other))
        assert same(first, second)
    other.step(swaying(30), staying(swaying(31)))
    assert same(
        way(controller).step(swaying(12), staying(swaying(32))), controller.step(swaying(12), staying(swaying(32)))
    )


@pytest.mark.parametrize("kind", FLIGHTS)
def test_a_control_state_that_was_copied_with_its_controller_is_used(kind):
    """The given control state is used even if it was computed for another reference than the tick's."""
    commands = []
    for is_copied in (False, True):
        controller = kind(controller_config("tuned"))
        controller.reset(swaying(0))
        made = controller, controller.compute_state(swaying(1), staying(swaying(2)))
        controller, control_state = copy.deepcopy(made) if is_copied else made
        commands.append(controller.step(swaying(1), staying(swaying(3)), control_state=control_state))
    assert same(*commands)


def crawled(controller: Any, ticks: int, begin: int = 0) -> list[Any]:
    """Step a controller whose robot lies on the floor with its joints near the last command; return the commands."""
    commands = []
    for k in range(begin, begin + ticks):
        q = controller.memory.joint_position + np.random.default_rng(k).normal(0.0, 1e-3, 16)
        commands.append(controller.step(RobotState.at_rest(q, controller.memory.vectoring.copy())))
    return commands


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("order", [Move(Pose2(0.1)), Lift((0, 2), 0.2, 2.0)], ids=["move", "lift"])
@pytest.mark.parametrize("kind", CRAWLERS)
def test_a_copied_crawler_continues_bit_for_bit_in_every_phase(kind, order, way):
    controller = kind()
    controller.reset(RobotState.at_rest(np.zeros(16)), [order])
    phases = set()
    for k in range(0, 160, 32):
        crawled(controller, 28, k)
        other = way(controller)
        phases.add(other.gait.phase)
        assert same(crawled(controller, 4, k + 28), crawled(other, 4, k + 28))
    assert ("hold" if isinstance(order, Lift) else "swing") in phases


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("kind", MANAGERS)
def test_a_copied_manager_continues_bit_for_bit_and_its_pilot_commands_the_copy(kind, way):
    manager = kind()
    floor = RobotState.at_rest(manager.lying)
    manager.reset(floor, [TakeOff(1.0), FlyTo((0.5, 0.0, 1.5))])
    pilot = Pilot(manager)
    for _ in range(15):
        manager.step(floor)
    held, other = way((pilot, manager))
    assert held.manager is other
    assert (other.phase, other.done, other.last, other.floor) == (
        manager.phase,
        manager.done,
        manager.last,
        manager.floor,
    )
    for _ in range(5):
        assert same(manager.step(floor), other.step(floor))
    held.follow(Target(x=0.2), floor, Course(goal=Pose2(1.0)))
    assert same(other.last, manager.last) is False


@pytest.mark.parametrize("kind", [CoreFlightController, CoreCrawler, CoreManager])
def test_a_closed_controller_and_one_of_another_version_are_refused(kind, monkeypatch):
    packed = pickle.dumps(kind())
    with monkeypatch.context() as patch:
        patch.setattr(library.mujoco, "__version__", "5.0.0")
        with pytest.raises(SpidarError, match=r"copied controller .* another version: .*; valid here: .*5\.0\.0"):
            pickle.loads(packed)
    closed = kind()
    closed.close()
    with pytest.raises(SpidarError, match="closed; valid: a new one"):
        copy.deepcopy(closed)


def test_the_size_of_a_copy_is_limited():
    plant = Plant()
    plant.reset(np.array([0.0, 0.0, ROBOT.peg_depth]))
    assert len(pickle.dumps(plant)) < 0.2e6
