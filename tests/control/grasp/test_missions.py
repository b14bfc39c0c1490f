"""Pins whole missions with an object: grasp, test lift, carry, place, release; losses, refusals and interruptions."""

from dataclasses import replace

import numpy as np
import pytest
from support.grasps import BOX, Manager, Mission, whole

from spidar_gym.control.crawl.pose2 import Pose2
from spidar_gym.control.grasp.phases import GRASP_PHASES, PRESSING, heading_of
from spidar_gym.control.locomotion.commands import CarryTo, CrawlTo, FlyTo, Grasp, Land, Place, Release, TakeOff
from spidar_gym.control.locomotion.orders import ManagerConfig
from spidar_gym.errors import InvalidValueError, SpidarError
from spidar_gym.native.core_manager import CoreManager
from spidar_gym.sim.object import ObjectConfig

SMOOTH = ["rise", "over", "down", "close", "grip", "load", "test", "settle", "lift", "hold", "carry", "hold", "lower",
          "feel", "hold", "unload", "let_go", "open", "leave", "none"]  # fmt: skip
THINGS = {
    "box": BOX,
    "narrow cylinder": ObjectConfig(shape="cylinder", half_size=np.array([0.18, 0.18, 0.25]), mass=0.6),
    "wide box": ObjectConfig(shape="box", half_size=np.array([0.36, 0.36, 0.2]), mass=2.5),
}
HANGS = ("settle", "lift", "hold", "carry", "lower")


@pytest.mark.parametrize("name", THINGS)
def test_it_is_lifted_carried_turned_and_placed(name):
    thing = THINGS[name]
    mission = Mission(thing).fly(whole(thing))
    assert [phase for phase in mission.phases if phase != "none"] == SMOOTH[:-1]
    assert mission.manager.phase == "hover"
    end = mission.plant.object()
    assert max(tick.thing.position_w[2] for tick in mission.log) > thing.scale[2] + 0.65
    np.testing.assert_allclose(end.position_w, [3.0, 0.8, thing.scale[2]], atol=0.015)
    if thing.shape == "box":
        assert heading_of(end.quat_wo) == pytest.approx(0.8, abs=0.03)
    assert mission.is_clean
    assert mission.tilt < 0.06


def test_the_core_is_the_python_manager():
    """From the same states; the setpoints that lead by the torques return rounding errors to the allocation."""
    mission = Mission(kind=Manager)
    twin = CoreManager(mission.manager.config)
    twin.reset(mission.state)
    commands = whole(BOX)
    mission.manager.command(commands)
    twin.command(commands)
    while not mission.manager.done:
        seen = mission.look()
        command, other = mission.manager.step(mission.state, seen=seen), twin.step(mission.state, seen=seen)
        assert (twin.phase, twin.grasp_phase) == (mission.manager.phase, mission.manager.grasp_phase)
        assert twin.situation == mission.manager.situation
        for value in ("thrust", "vectoring", "joint_position"):
            np.testing.assert_allclose(getattr(other, value), getattr(command, value), atol=1e-7)
        mission.state = mission.plant.step(command)
    assert twin.done


def test_the_test_lift_measures_the_mass_and_grips_harder_where_feet_slip():
    thing = replace(BOX, mass=2.5, friction=0.25)
    mission = Mission(thing).fly(whole(thing))
    memory = mission.manager.whole.record["grasper"]["memory"]
    assert mission.phases.count("test") >= 2
    assert float(memory["mass"]) == pytest.approx(2.5, abs=0.5)
    assert 25.0 <= float(memory["force"]) <= 33.0
    np.testing.assert_allclose(mission.plant.object().position_w[:2], [3.0, 0.8], atol=0.03)


def first_force(kind=CoreManager, **options):
    """Return the force of the first grip of an order to grasp with these options [N]."""
    mission = Mission(kind=kind)
    commands = whole(BOX)
    commands[2] = replace(commands[2], **options)
    mission.fly(commands, until=lambda: mission.manager.grasp_phase == "rise")
    assert mission.manager.grasp_phase == "rise"
    if kind is Manager:
        return mission.manager.grasper.memory.force
    return float(mission.manager.whole.record["grasper"]["memory"]["force"])


@pytest.mark.parametrize(("mass", "friction"), [(2.0, 0.8), (2.0, 0.4), (1.0, 0.4)])
def test_a_known_friction_sets_the_first_grip_in_both_managers(mass, friction):
    """The least force that holds the object, by Coulomb's law with four feet, half as much again, and 5 N."""
    expected = 1.5 * mass * 9.81 / (4.0 * friction) + 5.0
    for kind in (CoreManager, Manager):
        assert first_force(kind, mass=mass, friction=friction) == pytest.approx(expected, rel=2e-3)


@pytest.mark.parametrize(("options", "force"), [({"most_force": 9.0}, 9.0), ({"force": 14.0}, 14.0)])
def test_an_object_that_bears_less_and_a_given_force_go_before_the_friction(options, force):
    for kind in (CoreManager, Manager):
        assert first_force(kind, mass=3.0, friction=0.3, **options) == force


@pytest.mark.parametrize("thing", [replace(BOX, mass=9.0), replace(BOX, friction=0.05)], ids=["heavy", "slippery"])
def test_what_cannot_be_held_is_left_where_it_stands(thing):
    mission = Mission(thing).fly(whole(thing))
    assert "lift" not in mission.phases
    assert mission.manager.phase == "hover"
    assert mission.manager.last is None
    assert mission.manager.whole.record["grasper"]["memory"]["refused"]
    np.testing.assert_allclose(mission.plant.object().position_w, [1.5, 0.3, 0.25], atol=0.02)
    assert mission.is_clean


def test_a_fragile_object_is_not_pressed_harder_than_it_bears():
    mission = Mission(replace(BOX, mass=2.0))
    commands = whole(BOX)
    commands[2] = replace(commands[2], most_force=12.0)
    mission.fly(commands)
    force = np.array([np.linalg.norm(tick.thing.foot_force_w[:, :2], axis=1).max() for tick in mission.log])
    assert np.percentile(force[force > 0.0], 99) < 13.0


@pytest.mark.parametrize("phase", HANGS)
def test_a_lost_object_ends_grip_and_payload_at_once(phase):
    mission = Mission().reach(phase)
    mission.loosen()
    mission.fly(until=lambda: mission.manager.grasp_phase == "leave")
    before, _ = mission.log[-2:]
    assert before.grasp_phase in PRESSING
    grip = mission.manager.whole.record["grasper"]["grip"]
    assert (float(grip["force"]), float(grip["payload"])) == (0.0, 0.0)
    assert mission.manager.whole.record["grasper"]["memory"]["lost"]
    mission.fly()
    assert mission.manager.phase == "hover"
    assert mission.manager.last is None
    assert mission.tilt < 0.3
    assert not mission.plant.violated & 2  # no duct
    mission.fly([Land()])
    assert mission.manager.phase == "lie"


def test_an_object_out_of_sight_is_carried_on():
    mission = Mission().reach("carry")
    mission.is_seen = False
    mission.fly(until=lambda: mission.manager.grasp_phase == "leave")
    np.testing.assert_allclose(mission.plant.object().position_w, [3.0, 0.8, 0.25], atol=0.03)


def test_the_robot_waits_for_a_view_of_the_object():
    mission = Mission()
    mission.is_seen = False
    mission.fly(whole(BOX), seconds=20.0)
    assert mission.manager.phase == "hover"
    mission.is_seen = True
    mission.fly(until=lambda: mission.manager.grasp_phase == "over")
    mission.is_seen = False
    mission.fly(seconds=10.0)
    assert mission.manager.grasp_phase == "over"


@pytest.mark.parametrize("kind", [Manager, CoreManager])
def test_a_carry_is_interrupted_and_goes_elsewhere(kind):
    mission = Mission(kind=kind).reach("carry")
    mission.fly(seconds=2.0)
    mission.manager.interrupt([CarryTo((1.0, -0.5, 0.9)), Place(), Release(), FlyTo((0.0, 0.0, 1.5)), Land()])
    mission.fly()
    assert mission.manager.phase == "lie"
    np.testing.assert_allclose(mission.plant.object().position_w, [1.0, -0.5, 0.25], atol=0.02)
    assert mission.is_clean


@pytest.mark.parametrize("kind", [Manager, CoreManager])
def test_an_approach_is_interrupted_by_a_flight(kind):
    mission = Mission(kind=kind).reach("down")
    mission.fly(seconds=2.0)
    mission.manager.interrupt([FlyTo((0.0, 0.0, 1.5)), Land()])
    mission.fly()
    assert mission.manager.phase == "lie"
    np.testing.assert_allclose(mission.plant.object().position_w, [1.5, 0.3, 0.25], atol=2e-3)
    assert mission.is_clean


ORDERS = {
    "grasp on the floor": ([Grasp()], "TakeOff first"),
    "two grasps": ([TakeOff(), Grasp(), Grasp()], "Release first"),
    "landing with it": ([TakeOff(), Grasp(), Land()], "Release first"),
    "carrying nothing": ([TakeOff(), CarryTo((1.0, 0.0, 1.0))], "Grasp first"),
    "placing twice": ([TakeOff(), Grasp(), Place(), Place()], "Release first"),
    "carrying what stands": ([TakeOff(), Grasp(), Place(), CarryTo((1.0, 0.0, 1.0))], "Release first"),
    "crawling after": ([TakeOff(), Grasp(), Release(), CrawlTo(Pose2())], "Land first"),
    "too wide": ([TakeOff(), Grasp("ball", np.full(3, 0.6))], "half a width within"),
}


@pytest.mark.parametrize("kind", [Manager, CoreManager])
@pytest.mark.parametrize("name", ORDERS)
def test_orders_that_cannot_follow_are_refused_in_one_line(name, kind):
    mission = Mission(kind=kind)
    orders, reason = ORDERS[name]
    with pytest.raises(InvalidValueError, match=reason) as refusal:
        mission.manager.command(orders)
    assert "\n" not in str(refusal.value)
    assert mission.manager.last is None


def test_a_hold_refuses_a_flight():
    mission = Mission().reach("carry")
    with pytest.raises(InvalidValueError, match="Release first"):
        mission.manager.interrupt([FlyTo((0.0, 0.0, 1.5))])
    assert mission.manager.grasp_phase == "carry"


@pytest.mark.parametrize(
    ("order", "reason"),
    [
        (lambda: Grasp("cone"), "box"), (lambda: Grasp(half_size=np.zeros(3)), "0.05 … 2 m"),
        (lambda: Grasp(most_force=0.0), r"1 … 1000 \[N\]"), (lambda: Grasp(mass=-1.0), r"0 … 20 \[kg\]"),
        (lambda: Grasp(friction=-0.1), "0 … 10"),
        (lambda: Grasp(height=20.0), r"0.1 … 10 \[m\]"), (lambda: CarryTo((500.0, 0.0, 0.0)), r"-100 … 100 \[m\]"),
        (lambda: CarryTo((0.0, 0.0, 1.0), speed=9.0), "m/s"), (lambda: Place(float("nan")), r"-100 … 100 \[m\]"),
    ],
)  # fmt: skip
def test_numbers_out_of_range_are_refused(order, reason):
    with pytest.raises(SpidarError, match=reason):
        order()


def test_phases_of_the_core_have_the_same_names():
    assert CoreManager(ManagerConfig()).grasp_phase == GRASP_PHASES[0] == "none"
