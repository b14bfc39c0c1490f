"""Pins the manager of both gaits: take-off, flight, landing, crawl, transitions, refusals."""

import math
from dataclasses import replace

import numpy as np
import pytest
from support.states import model, resting, staying

from spidar_gym.control.crawl.pose2 import Pose2
from spidar_gym.control.flight.controller import FlightController
from spidar_gym.control.locomotion.commands import CrawlTo, FlyTo, Land, TakeOff
from spidar_gym.control.locomotion.manager import Manager
from spidar_gym.control.locomotion.orders import PHASES, ManagerConfig, form_radius
from spidar_gym.control.presets import controller_config
from spidar_gym.errors import InvalidValueError
from spidar_gym.model.rotor import thrust_map
from spidar_gym.robot import FORMS, ROBOT
from spidar_gym.sim.ground import TILES, GroundConfig
from spidar_gym.so3 import exp
from spidar_gym.state import NO_RESIDUAL, Command
from spidar_gym.studies.hops import HAND_OVERS, HOP, Trip, manager_config

FLOORS = {
    "flat": GroundConfig(),
    "a slope of 10 degrees": GroundConfig(slope=math.radians(10.0), heading=0.8),
    "tiles": GroundConfig(tiles=np.random.default_rng(1).uniform(0.0, 0.02, (TILES, TILES))),
}


def landed(seen):
    """Assert the requirements of a landing."""
    assert seen.phase[-1] == "lie"
    assert 0.0 < seen.touchdown < 0.35
    assert seen.slip < 0.05
    thrust, turn = seen.steps(*HAND_OVERS)
    assert thrust.max() <= 5.0 + 1e-9
    assert turn.max() <= ROBOT.max_vectoring_speed / 40.0 + 1e-9
    assert seen.thrust[-1] == 0.0


# ---- what the floor carries ----


def test_what_the_floor_carries_is_a_share_of_the_whole():
    """The forces are scaled alike; integrals and observer are frozen meanwhile."""
    state = resting(np.zeros(16), exp(np.array([0.02, -0.01, 0.3])))
    controller = FlightController(controller_config("tuned"), model())
    answers = {}
    for support in (0.0, 0.3, 1.0):
        controller.reset(state)
        off = staying(state, support=support)
        off = type(off)(**{f: getattr(off, f) for f in off.__slots__} | {"position_w": off.position_w + 0.05})
        for _ in range(3):
            command = controller.step(state, off)
        answers[support] = command.thrust, controller.memory
    (whole, learned), (most, kept), (none, _) = answers.values()
    assert np.abs(learned.integrals.position_w).max() > 0.0
    assert not kept.integrals.position_w.any()
    assert not kept.compensation.external_w.any()
    np.testing.assert_allclose(none, 0.0, atol=1e-12)
    assert most.sum() == pytest.approx(0.7 * whole.sum(), rel=0.02)


# ---- up and down ----


@pytest.mark.parametrize("floor", FLOORS)
def test_up_and_down_again_on_any_floor(floor):
    mission = Trip(0, sense=True, ground=FLOORS[floor])
    seen = mission.fly(HOP)
    assert seen.phases() == ["spool", "climb", "hover", "form", "descend", "unload", "lie"]
    landed(seen)
    assert seen.done < 15.0
    in_air = seen.during("hover", "descend")
    assert np.array(seen.tilt)[in_air].max() < 0.1
    assert seen.against_floor[-1] < 0.06  # a peg or a foot on a tile
    risen = np.array(seen.position_w)[:, 2].max() - seen.position_w[0][2]
    assert risen == pytest.approx(1.0, abs=0.03)
    assert np.hypot(*(seen.position_w[-1] - seen.position_w[0])[:2]) < 0.08


def test_the_observer_of_the_motion_knows_the_limited_thrusts():
    limited = []

    class Watched(Manager):
        def step(self, state, residual=NO_RESIDUAL):
            command, memory = super().step(state, residual), self.flight.memory
            if self.phase == "descend":
                allocated = self.flight.last_step.allocation
                limited.append(float(allocated.thrust.sum() - command.thrust.sum()))
                np.testing.assert_allclose(np.linalg.norm(memory.forces_l, axis=1), command.thrust, rtol=1e-9)
                snapshot = self.flight.last_step.control_state.snapshot
                Q = thrust_map(snapshot.R_bl, snapshot.rotor_c)
                np.testing.assert_allclose(Q @ memory.forces_l.reshape(-1), allocated.wrench, atol=1e-6)
            return command

    Trip(1, strength=1.0, sense=True, wind=2.0, manager=Watched(manager_config("steady"))).fly(HOP)
    assert np.abs(limited).max() > 1.0


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(6))
def test_drawn_robots_in_wind_take_off_and_land(seed):
    seen = Trip(seed, strength=1.0, sense=True, wind=2.0, push=10.0).fly(HOP)
    landed(seen)
    assert np.array(seen.tilt).max() < 0.1


@pytest.mark.slow
def test_a_whole_course():
    """Crawl, fly in two forms, land, and crawl from there, with smooth transitions."""
    way = (
        CrawlTo(Pose2(0.2, 0.0, 0.0)), TakeOff(1.0), FlyTo((2.0, 1.0, 1.6), FORMS["form3"], 0.8, along=True),
        FlyTo((2.0, 2.0, 1.4), FORMS["form2"]), Land(), CrawlTo(Pose2(2.1, 2.2, 1.0)),
    )  # fmt: skip
    mission = Trip(2, sense=True, strength=0.3)
    seen = mission.fly(way, 90.0)
    order = ["crawl", "lie", "spool", "climb", "hover", "form", "fly", "hover", "form", "fly", "hover", "form",
             "descend", "unload", "lie", "crawl", "lie"]  # fmt: skip
    assert [p for p in seen.phases() if p != "lie"] == [p for p in order if p != "lie"]
    landed(seen)
    np.testing.assert_allclose(mission.state.position_w[:2], [2.1, 2.2], atol=0.01)
    assert np.array(seen.tilt)[seen.during("fly", "hover", "form")].max() < 0.05
    assert seen.steps(*PHASES)[0].max() < 40.0


# ---- interruptions ----


@pytest.mark.parametrize("at", [0.7, 2.5, 7.5])
def test_it_lands_at_once_on_command(at):
    seen = Trip(0).fly(HOP, interrupt=(at, [Land()]))
    assert seen.phase[-1] == "lie"
    assert seen.done < 12.0
    assert seen.steps(*HAND_OVERS)[0].max() <= 5.0 + 1e-9
    if at == 0.7:
        assert seen.phases() == ["spool", "unload", "lie"]


def test_a_climb_that_ends_in_a_landing_is_not_flown_again_while_the_legs_move():
    """The robot brakes, holds the position at which it comes to rest, and descends from there."""
    mission = Trip(0)
    mission.manager.reset(mission.seen, [TakeOff(1.0)])
    mission.until("climb", 60)
    mission.manager.interrupt([Land()])
    asked = []
    while mission.manager.phase != "unload":
        mission.tick()
        if mission.manager.phase in ("hover", "form", "descend"):
            asked.append(float(mission.manager.reference(mission.state).position_w[2]))
        assert len(asked) < 1000
    assert np.abs(np.diff(asked)).max() < 0.45 / 40.0, "no faster than the climb"
    assert np.array(mission.seen_so_far.tilt).max() < 0.05
    assert mission.seen_so_far.touchdown < 0.35


def test_a_stuck_leg_does_not_prevent_a_landing():
    """The manager waits two seconds for a form that a joint does not reach, then lands in the present form."""
    mission = Trip(0)
    mission.manager.reset(mission.seen, [TakeOff(0.6), Land()])
    mission.until("form")
    ticks = 0
    while mission.manager.phase == "form":
        q = mission.state.joint_position.copy()
        q[3] += 0.2
        mission.seen = replace(mission.state, joint_position=q)
        mission.tick()
        ticks += 1
        assert ticks < 400
    assert mission.manager.phase == "descend"
    assert ticks >= 80


def test_evening_out_of_the_thrust_demands_no_more_than_a_rotor_has():
    manager = Trip(0).manager
    manager.commands = [Land()]
    manager.memory.phase, manager.memory.thrust = "descend", 8.0 * ROBOT.max_thrust
    thrust = np.full(8, 10.0)
    thrust[0] = ROBOT.max_thrust
    command = manager._limited(Command(thrust, np.zeros((8, 2)), np.zeros(16), np.zeros(16)))
    assert command.thrust.max() <= ROBOT.max_thrust
    assert command.thrust[1:].min() > 10.0


@pytest.mark.slow
@pytest.mark.parametrize("at", [1.0, 2.6, 4.2, 6.0])
def test_it_takes_off_from_the_middle_of_a_crawl(at):
    seen = Trip(0, sense=True).fly([CrawlTo(Pose2(0.3, 0.0, 0.0))], interrupt=(at, HOP))
    assert seen.phases()[:3] == ["crawl", "spool", "climb"]
    landed(seen)
    first = seen.phase.index("spool")
    assert abs(seen.thrust[first] - seen.thrust[first - 1]) <= 5.0 + 1e-9
    assert np.array(seen.tilt).max() < 0.1


def test_it_climbs_again_while_the_load_moves_to_the_floor():
    mission = Trip(0)
    mission.manager.reset(mission.seen, HOP)
    mission.until("unload", 16)
    mission.manager.interrupt([TakeOff(0.5), Land()])
    seen = mission.seen_so_far
    while not mission.manager.done:
        mission.tick()
        assert len(seen.time) < 1200
    assert seen.phases() == [
        "spool", "climb", "hover", "form", "descend", "unload", "spool", "climb", "hover", "form", "descend", "unload",
        "lie",
    ]  # fmt: skip
    assert seen.steps(*HAND_OVERS)[0].max() <= 5.0 + 1e-9
    np.testing.assert_allclose(mission.state.position_w[:2], 0.0, atol=0.02)


@pytest.mark.slow
def test_a_crawl_that_is_interrupted_ends_with_its_cycle():
    mission = Trip(0)
    seen = mission.fly([CrawlTo(Pose2(0.6, 0.0, 0.0))], 60.0, interrupt=(1.0, []))
    assert seen.phase[-1] == "lie"
    assert seen.done < 12.0
    assert 0.05 < mission.state.position_w[0] < 0.4


# ---- where a landing goes wrong ----


@pytest.mark.parametrize("expected", [-0.3, -3.0])
def test_a_floor_higher_than_expected_is_detected(expected):
    seen = Trip(0).fly([TakeOff(1.0), Land(floor=expected)])
    assert seen.phase[-1] == "lie"


def test_a_descent_that_finds_no_floor_is_repeated_once_and_then_aborted():
    seen = Trip(0).fly([TakeOff(2.0), Land(floor=0.95)], 60.0)
    assert seen.phases() == ["spool", "climb", "hover", "form", "descend", "fly", "hover", "form", "descend", "hover"]
    heights = np.array(seen.position_w)[:, 2]
    assert heights[seen.during("descend")].min() < 0.95 + ROBOT.peg_depth - 0.4
    assert heights.min() > 0.1


def falling(manager, state, **changes):
    return manager.step(type(state)(**{f: getattr(state, f) for f in state.__slots__} | changes))


def test_a_descent_is_resumed_when_a_detected_floor_gives_way():
    """A robot held up by a gust detects a floor, and resumes its descent when it falls."""
    mission = Trip(0, manager=Manager(manager_config("tuned")))
    mission.manager.reset(mission.seen, HOP)
    mission.until("descend", 60)
    state, manager = mission.state, mission.manager
    for _ in range(12):
        falling(manager, state, velocity_w=np.zeros(3))
    assert manager.phase == "unload"
    falling(manager, state, velocity_w=np.array([0.0, 0.0, -0.3]))
    assert manager.phase == "descend"
    seen = mission.seen_so_far
    while not manager.done:
        mission.tick()
        assert len(seen.time) < 1200
    assert seen.phase[-1] == "lie"
    assert 0.0 < seen.touchdown < 0.35


def test_a_robot_that_tips_over_cuts_its_thrust():
    mission = Trip(0)
    mission.manager.reset(mission.seen, HOP)
    mission.until("hover")
    state = mission.state
    tipped = np.array([math.cos(0.5), math.sin(0.5), 0.0, 0.0])
    command = falling(mission.manager, state, quat_wb=tipped)
    assert mission.manager.phase == "cut"
    assert not command.thrust.any()
    assert mission.manager.done
    assert not mission.manager.airborne


def test_a_state_that_is_not_finite_changes_nothing_and_gets_the_last_command():
    mission = Trip(0)
    mission.manager.reset(mission.seen, HOP)
    for _ in range(100):
        mission.tick()
    phase, time = mission.manager.phase, mission.manager.memory.time
    before = mission.seen_so_far.thrust[-1]
    command = falling(mission.manager, mission.state, position_w=np.full(3, np.nan))
    assert (mission.manager.phase, mission.manager.memory.time) == (phase, time)
    assert command.thrust.sum() == pytest.approx(before)


# ---- what cannot be done ----


@pytest.mark.parametrize(
    ("build", "words"),
    [
        (lambda: Land(slope=math.radians(30.0)), "slope = 0.52.* within 0 … 0.209 rad"),
        (lambda: Land(floor=math.inf), "floor = inf"),
        (lambda: TakeOff(-1.0), r"height = -1.0 .* 0.1 … 10 \[m\]"),
        (lambda: FlyTo((0.0, math.nan, 1.0)), "y = nan"),
        (lambda: FlyTo((0.0, 0.0, 1e9)), "z = 1000000000.0"),
        (lambda: FlyTo((0.0, 0.0, 1.0), speed=-1.0), "speed = -1.0"),
        (lambda: FlyTo((0.0, 0.0, 1.0), form=np.full(16, 9.0)), "16 angles within"),
        (lambda: FlyTo((0.0, 0.0, 1.0), room=-1.0), "room = -1.0"),
        (lambda: CrawlTo(Pose2(math.nan, 0.0, 0.0)), "x = nan"),
        (lambda: ManagerConfig(descent_speed=0.0), "descent_speed = 0.0"),
    ],
)
def test_an_invalid_command_is_refused_in_one_line(build, words):
    with pytest.raises(InvalidValueError, match=words):
        build()


@pytest.mark.parametrize(
    ("commands", "words"),
    [
        ([Land()], "TakeOff first"),
        ([FlyTo((0.0, 0.0, 1.0))], "TakeOff first"),
        ([TakeOff(), TakeOff()], "Land first"),
        ([TakeOff(), CrawlTo(Pose2(1.0, 0.0, 0.0))], "Land first"),
        ([TakeOff(), FlyTo((0.0, 0.0, 0.3), FORMS["form3"])], "z = 0.3 .* in this form"),
        ([TakeOff(), FlyTo((0.0, 0.0, 1.5), FORMS["form1"], room=2.0)], r"room = 2.0 .* at least 3.0\d m"),
        ([TakeOff(), FlyTo((0.0, 0.0, 1.5), FORMS["form3"], room=1.2)], "room = 1.2"),
    ],
)
def test_what_cannot_follow_is_refused_and_nothing_has_changed(commands, words):
    manager = Manager(manager_config("tuned"))
    manager.reset(Trip(0).state, [CrawlTo(Pose2(0.1, 0.0, 0.0))])
    for tell in (manager.command, manager.interrupt):
        with pytest.raises(InvalidValueError, match=words):
            tell(commands)
        assert manager.commands == [CrawlTo(Pose2(0.1, 0.0, 0.0))]
        assert manager.phase == "lie"


def test_the_width_of_a_form_is_that_of_the_paper():
    """Form ① is 2.7 m wide, form ③ less than half of that."""
    assert 2.0 * form_radius(model(), FORMS["form1"]) == pytest.approx(2.7, abs=0.02)
    assert 2.0 * form_radius(model(), FORMS["form3"]) < 1.35


def test_a_flight_that_is_interrupted_brakes_as_softly_as_a_path_does():
    """From 1 m/s to rest without a jump in the reference."""
    mission = Trip(0)
    mission.manager.reset(mission.seen, [TakeOff(1.0), FlyTo((4.0, 0.0, 1.2), speed=1.0)])
    asked = []
    for _ in range(1200):
        mission.tick()
        if mission.manager.phase == "fly" and mission.manager.memory.time > 3.0:
            mission.manager.interrupt([])
        if mission.manager.phase in ("fly", "hover") and mission.manager.path is not None:
            asked.append(mission.manager.reference(mission.state))
        if mission.manager.phase == "hover" and mission.manager.done:
            break
    assert mission.manager.phase == "hover"
    velocity = np.array([each.velocity_w for each in asked])
    assert velocity[:, 0].max() > 0.95
    assert np.abs(np.diff(velocity, axis=0)).max() < 2.0 / 40.0
    np.testing.assert_allclose(velocity[-1], 0.0, atol=1e-9)
    assert 1.0 < mission.state.position_w[0] < 3.9


@pytest.mark.slow
def test_steered_twice_a_second_it_flies_a_curve_without_a_jolt():
    """As a policy does: a target a metre ahead on a circle, updated every half second while the legs move."""
    mission = Trip(0, sense=True)
    manager = mission.manager
    manager.reset(mission.seen, [TakeOff(0.8)])
    asked, tick = [], 0
    for tick in range(1000):
        mission.tick()
        if manager.phase in ("hover", "fly") and tick % 20 == 0:
            angle = 0.25 * (tick / 40.0)
            place = (2.0 * math.sin(angle), 2.0 - 2.0 * math.cos(angle), 1.3)
            form = FORMS["form2"] if tick % 400 < 200 else FORMS["form1"]
            manager.interrupt([FlyTo(place, form, 0.8, at_once=True)])
        if manager.phase == "fly":
            asked.append(manager.reference(mission.state))
    velocity = np.array([each.velocity_w for each in asked])
    assert np.abs(np.diff(velocity, axis=0)).max() < 4.0 / 40.0
    seen = mission.seen_so_far
    assert np.array(seen.tilt)[seen.during("fly")].max() < 0.06
    where = np.array(seen.position_w)[-200:, :2] - [0.0, 2.0]
    assert np.abs(np.hypot(*where.T) - 2.0).max() < 0.4
