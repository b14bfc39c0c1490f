"""Pins courses: the manager's exact bytes, orders during a run, reactions to faults in each phase, refusals."""

import re
from contextlib import closing

import numpy as np
import pytest
from support.needs import needs_compiler
from support.runner import (
    CONTENDED,
    COURSE,
    DRIVING,
    ENDING,
    FINE,
    FORCE_LANDING,
    HOLD,
    HOLDING,
    LAND,
    LANDING,
    LOW,
    LOW_BATTERY,
    NO_POSE,
    NO_STATE,
    NOT_FINITE,
    OUTSIDE,
    PUBLISH,
    REFUSED,
    RELEASED,
    RESTING,
    SHORT,
    SILENT,
    TAKEN,
    Loop,
    check_bounds,
    nan_pose,
    played,
    read_mission,
    said,
)

from spidar_gym.control.course.gates import KINDS, POSSIBLE, Course, Gate
from spidar_gym.control.crawl.pose2 import Pose2
from spidar_gym.control.locomotion.commands import CrawlTo, FlyTo, Land, TakeOff
from spidar_gym.control.locomotion.orders import PHASES
from spidar_gym.errors import InvalidValueError
from spidar_gym.native.core_manager import CoreManager, waypoint
from spidar_gym.native.course_records import write_course
from spidar_gym.native.plant import read_state
from spidar_gym.onboard.messages import ORDERS, Message
from spidar_gym.onboard.runner_structs import ORDER_TEXT, log_layouts
from spidar_gym.robot import FORMS
from spidar_gym.sitl.course_drive import Guide, manager_config
from spidar_gym.sitl.faults import FLOOR_PHASES
from spidar_gym.sitl.link_socket import SocketLink
from spidar_gym.sitl.missions import course_mission, drawn_course, map_mission, order_line

pytestmark = needs_compiler
FRONT = "course tuned robust\n"


HURDLE = Course((Gate("wall", 2.3, 2.5, 0.5),), Pose2(4.1, 0.05, 0.1))
"""A short course by a map."""


def phases(outputs):
    """Return the sequence of phases while the runner drove."""
    names = [PHASES[k] for k in outputs["manager_phase"][outputs["stage"] == DRIVING]]
    return [p for k, p in enumerate(names) if k == 0 or names[k - 1] != p]


# The same manager.


def check_manager(mission, log, interrupts=()):
    """Check that the core's manager, with the same inputs, commands exactly the bytes that the runner sent."""
    outputs = log.outputs
    driving = np.flatnonzero(outputs["stage"] == DRIVING)
    manager, interrupts = CoreManager(manager_config(mission)), list(interrupts)
    manager.reset(read_state(outputs["state"][driving[0]]), mission.commands)
    for tick in driving:
        if outputs["heard"][tick] == TAKEN:
            manager.interrupt(interrupts.pop(0))
        command = manager.step(read_state(outputs["state"][tick]))
        sent = outputs["command"][tick]
        assert PHASES[outputs["manager_phase"][tick]] == manager.phase
        assert command.thrust.tobytes() == sent["thrust"].tobytes()
        assert command.vectoring.tobytes() == sent["vectoring"].tobytes()
        assert command.joint_position.tobytes() == sent["joint_position"].tobytes()
        assert command.joint_torque_limit.tobytes() == sent["joint_torque_limit"].tobytes()
    assert not interrupts
    return manager


def test_the_runner_commands_what_the_manager_does_byte_for_byte(course):
    manager = check_manager(course_mission(SHORT), course.played)
    assert manager.done
    assert phases(course.played.outputs) == [
        "spool", "climb", "hover", "form", "fly", "hover", "form", "descend", "unload", "lie", "crawl", "lie"
    ]  # fmt: skip
    check_bounds(course.played.outputs)
    end = course.run.rows[-1].state
    np.testing.assert_allclose(end.position_w[:2], [0.5, 0.0], atol=0.03)
    assert course.run.board == ""
    assert course.run.status == 0


@pytest.fixture(scope="module")
def hurdle(library, runner, folder):
    return played(library, runner, folder, "hurdle", map_mission(HURDLE))


@pytest.mark.slow
def test_by_a_map_the_runner_decides_as_the_rule_does_byte_for_byte(hurdle):
    outputs, mission = hurdle.played.outputs, map_mission(HURDLE)
    driving = np.flatnonzero(outputs["stage"] == DRIVING)
    manager = CoreManager(manager_config(mission))
    manager.reset(read_state(outputs["state"][driving[0]]))
    guide = Guide(manager, HURDLE)
    for tick in driving:
        seen, sent = read_state(outputs["state"][tick]), outputs["command"][tick]
        assert guide.decide(seen) == bool(outputs["finished"][tick])
        command = manager.step(seen)
        assert command.thrust.tobytes() == sent["thrust"].tobytes()
        assert command.joint_position.tobytes() == sent["joint_position"].tobytes()
    assert guide.decide(seen)


@pytest.mark.slow
def test_by_a_map_it_flies_over_the_wall_and_lies_at_the_goal_in_the_end(hurdle):
    rows, end = hurdle.run.rows, hurdle.run.rows[-1].state
    assert hurdle.run.board == ""
    assert hurdle.run.status == 0
    assert max(row.hit for row in rows) == 0.0
    over = [row.state.position_w[2] for row in rows if 2.3 < row.state.position_w[0] < 2.5]
    assert min(over) > 1.2
    np.testing.assert_allclose(end.position_w[:2], [4.1, 0.05], atol=0.03)
    said = phases(hurdle.played.outputs)
    assert said[:3] == ["spool", "climb", "hover"]
    assert said[-1] == "lie"
    check_bounds(hurdle.played.outputs)


def by_map(library, course, ticks):
    """Return a loop that drives by a map, some ticks after the take-over, with the inputs of another drive."""
    mission = read_mission(library, map_mission(HURDLE).text)
    assert not isinstance(mission, str), mission
    loop = Loop(library, mission)
    first = course.drives + ticks
    out = loop.run(course.inputs[:first])[-1]
    assert out["stage"] == DRIVING
    return loop, course.inputs[first:]


def test_the_map_decides_twice_a_second_and_from_the_first_tick(library, course):
    loop, inputs = by_map(library, course, 1)
    assert (loop.record["by_map"], loop.record["told"]) == (1, 0)
    assert PHASES[loop.record["manager"]["memory"]["phase"]] == "spool"
    left = [int(loop.record["undecided"])]
    for record in inputs[:40]:
        loop(record)
        left.append(int(loop.record["undecided"]))
    assert left == [19 - k % 20 for k in range(41)]


def test_accepted_orders_replace_the_map(library, course):
    loop, inputs = by_map(library, course, 10)
    other = loop.copy()
    out, reason = told(other, inputs[0], "now\nland\nland")
    assert (out["heard"], other.record["by_map"]) == (REFUSED, 1), reason
    out, _ = told(loop, inputs[0], "now")
    assert (out["heard"], loop.record["by_map"]) == (TAKEN, 0)
    assert loop.run(inputs[1:80])[-1]["finished"]
    assert PHASES[loop.record["manager"]["memory"]["phase"]] == "lie"


def test_a_fault_that_ends_a_course_ends_the_map_too(library, course):
    loop, inputs = by_map(library, course, 10)
    out = loop.run(spoilt(inputs[:80], low))
    assert RESTING in out["stage"]
    assert loop.record["by_map"] == 0


# Orders while it runs.


@pytest.mark.parametrize(
    ("commands", "seconds", "text", "orders", "expected"),
    [
        ((TakeOff(0.5),), 2.5, "now\nland", [Land()], ["spool", "climb", "hover", "form", "descend", "unload", "lie"]),
        (
            (CrawlTo(Pose2(0.3, 0.0, 0.0)),), 2.0, "now # climb\n\ntake_off 0.4\n", [TakeOff(0.4)],
            ["crawl", "spool", "climb", "hover"],
        ),
        ((TakeOff(0.5), Land()), 0.7, "now", [], ["spool", "unload", "lie"]),
    ],
    ids=["land now", "climb now", "not now"],
)  # fmt: skip
def test_it_is_interrupted_as_the_manager_is(library, runner, folder, commands, seconds, text, orders, expected):
    mission = course_mission(commands, orders=((seconds, text),), seconds=12.0)
    stream = played(library, runner, folder, "orders", mission)
    assert any("orders taken" in line for line in stream.run.words)
    check_manager(mission, stream.played, [orders])
    assert phases(stream.played.outputs) == expected


def told(loop, record, text):
    """Run a tick with orders; return the loop's answer and reason."""
    record = record.copy()
    data = text if isinstance(text, bytes) else text.encode()
    record["orders"][: len(data)] = list(data)
    out = loop(record)
    return out, bytes(loop.record["reason"]).split(b"\0")[0].decode()


def at_phase(library, course, name, ticks=4):
    """Return a loop some ticks into a phase, and the inputs that follow."""
    outputs = course.played.outputs
    inside = (outputs["manager_phase"] == PHASES.index(name)) & (outputs["stage"] == DRIVING)
    first = int(np.argmax(inside)) + ticks
    loop = Loop(library, course.mission)
    last = loop.run(course.inputs[:first])[-1]
    assert PHASES[last["manager_phase"]] == name
    return loop, course.inputs[first:]


TOLD = {
    "now\ntake_off 1": ("fly", "land first: the robot is in the air there"),
    "now\ncrawl_to 1 0 0": ("fly", "land first"),
    "land": ("fly", "take_off first: the robot is on the floor there"),
    "now\nfly_to 1 0 0.1 0.5": ("fly", "a fly_to higher above the floor"),
    "land 0 0.3": ("fly", "land on a slope within 0 … 0.209 rad"),
    "now\nnow": (
        "fly",
        "now as the first line, then crawl_to, take_off, fly_to, land, grasp, carry_to, place, release",
    ),
    "form 0": ("fly", "now as the first line"),
    "land\nnow": ("fly", "now as the first line"),
    "now\nland\ncrawl_to 90 0 0": ("fly", "a crawl_to within reach"),
    "now\nland 0 0 0": ("fly", "land [FLOOR"),
    "now\nland\nland": ("fly", "take_off first"),
    "now\nfly_to 1 0 1 0.5": ("crawl", "take_off first"),
    b"\xff" * ORDER_TEXT: ("crawl", "now as the first line"),
    b"land " + b"x " * 500: ("fly", "fewer words"),
}


@pytest.mark.parametrize("text", TOLD, ids=range(len(TOLD)))
def test_orders_that_cannot_be_done_are_refused_and_nothing_has_changed(library, course, text):
    phase, words = TOLD[text]
    loop, inputs = at_phase(library, course, phase)
    other = loop.copy()
    out, reason = told(loop, inputs[0], text)
    assert out["heard"] == REFUSED
    assert words in reason
    expected = other(inputs[0])
    assert out["command"].tobytes() == expected["command"].tobytes()
    assert loop.record["manager"].tobytes() == other.record["manager"].tobytes()


def test_more_orders_are_done_behind_the_others_and_64_are_enough(library, course):
    loop, inputs = at_phase(library, course, "crawl")
    eight = "take_off 1\nland\n" * 8
    for k, to_do in enumerate((17, 33, 49)):
        out, reason = told(loop, inputs[k], eight)
        assert (out["heard"], out["to_do"], reason) == (TAKEN, to_do, "")
    out, reason = told(loop, inputs[3], eight)
    assert (out["heard"], out["to_do"], reason) == (REFUSED, 49, "at most 64 orders at once")
    out, reason = told(loop, inputs[4], eight + "take_off 1")
    assert (out["heard"], reason) == (REFUSED, "at most 16 orders in a message")
    out, _ = told(loop, inputs[5], "now\n" + eight)
    assert (out["heard"], out["to_do"]) == (TAKEN, 16)


@pytest.mark.parametrize("mission", ["hover", "course"])
def test_orders_before_the_course_or_for_another_mission_are_refused(library, request, mission):
    stream = request.getfixturevalue(mission)
    loop = Loop(library, stream.mission)
    out, reason = told(loop, stream.inputs[0], "now")
    assert (out["heard"], reason) == (REFUSED, "orders while the runner drives a course")


def test_a_link_does_not_cut_orders_that_are_too_long():
    with closing(SocketLink()) as link, pytest.raises(InvalidValueError, match="at most 1023"):
        link.publish(Message(ORDERS.name, 0.0, {"data": "x" * ORDER_TEXT}))


# Faults.


def low(record, k):
    record["flight_state"] = LOW


def stale(record, k):
    record["flight_state_time"] = record["time"] - 0.51


def blind(record, k):
    record["measurement"]["pose_count"] = 0


def contend(record, k):
    record["has_thrust"] = 1


def spoilt(inputs, spoil):
    inputs = inputs.copy()
    for k, record in enumerate(inputs):
        spoil(record, k)
    return inputs


EVERY = ("crawl", "spool", "climb", "form", "fly", "descend", "unload")


@pytest.mark.parametrize("phase", EVERY)
@pytest.mark.parametrize(("spoil", "fault"), [(low, LOW_BATTERY), (stale, NO_STATE)])
def test_where_it_sees_it_goes_on_to_control_and_ends_the_course(library, course, phase, spoil, fault):
    loop, inputs = at_phase(library, course, phase)
    out = loop.run(spoilt(inputs[: HOLD + 4], spoil))
    assert out["stage"].tolist() == [DRIVING] * HOLD + [ENDING] * 4
    assert set(out["fault"].tolist()) == {fault}
    assert (out["action"] == PUBLISH).all()
    assert (np.diff(out["command"]["thrust"].sum(1)) != 0.0).any(), "no old command"
    if phase == "crawl":
        assert out["manager_phase"][-1] == PHASES.index("crawl"), "to the end of the cycle"
    else:
        commands = loop.record["manager"]["commands"]
        assert (loop.record["manager"]["count"], commands[0]["kind"]) == (1, waypoint(Land())["kind"])
    out, reason = told(loop, inputs[HOLD + 4], "now")
    assert (out["heard"], reason) == (REFUSED, "no orders after a fault that ends the course")


def test_outside_its_fence_it_lands_there(library, course):
    mission = course.mission.copy()
    mission["limits"]["fence_high"][0] = 0.15
    out = Loop(library, mission).run(course.inputs)
    first = int(np.argmax(out["stage"] == ENDING))
    assert PHASES[out["manager_phase"][first - 1]] == "fly"
    assert set(out["fault"][first : first + 20].tolist()) == {OUTSIDE}


@pytest.mark.parametrize("phase", EVERY)
def test_without_a_valid_state_it_rests_on_the_floor_and_the_board_lands_it_in_the_air(library, course, phase):
    loop, inputs = at_phase(library, course, phase)
    before = loop.copy()(inputs[0])["command"]
    out = loop.run(spoilt(inputs[:60], nan_pose))
    assert set(out["fault"].tolist()) == {NOT_FINITE}
    assert out["stage"][:HOLD].tolist() == [HOLDING] * HOLD
    if phase not in FLOOR_PHASES:
        rest = len(out) - HOLD - LAND
        assert out["stage"][HOLD:].tolist() == [LANDING] * LAND + [RELEASED] * rest
        assert (out["action"][HOLD + LAND :] == SILENT).all()
        return
    assert (out["stage"][HOLD:] == RESTING).all()
    assert (out["action"] == PUBLISH).all()
    total = out["command"]["thrust"].sum(1)
    assert (np.diff(total) <= 0.0).all()
    assert np.abs(np.diff(total)).max() <= max(before["thrust"].sum() / 40.0 * 1.1, 1e-9) + 0.1
    assert total[-1] == 0.0
    joints = out["command"]["joint_position"]
    assert np.abs(joints - joints[0]).max() == 0.0
    inputs = inputs[60:62].copy()
    inputs["flight_state"] = 0
    assert (loop.run(inputs)["stage"] == RELEASED).all(), "until the robot is disarmed"


@pytest.mark.parametrize("phase", ["crawl", "fly", "unload"])
def test_where_another_commands_the_rotors_the_board_lands(library, course, phase):
    loop, inputs = at_phase(library, course, phase, 8)
    out = loop.run(spoilt(inputs[: HOLD + LAND + 2], contend))
    assert out["stage"].tolist() == [HOLDING] * HOLD + [LANDING] * LAND + [RELEASED] * 2
    assert set(out["fault"].tolist()) == {CONTENDED}


def test_another_node_that_commands_the_rotors_during_a_landing_is_detected(library, course):
    loop, inputs = at_phase(library, course, "fly")
    assert loop.run(spoilt(inputs[:8], low))[-1]["stage"] == ENDING
    out = loop.run(spoilt(spoilt(inputs[8:20], low), contend))
    assert set(out["fault"].tolist()) == {CONTENDED}
    assert (out["action"] == FORCE_LANDING).any()


def test_losing_the_pose_during_another_landing_forces_the_boards_landing(library, course):
    loop, inputs = at_phase(library, course, "fly")
    assert loop.run(spoilt(inputs[:8], low))[-1]["stage"] == ENDING
    out = loop.run(spoilt(spoilt(inputs[8:40], low), blind))
    assert (out["action"] == FORCE_LANDING).sum() == LAND
    assert set(out["fault"][out["stage"] == LANDING].tolist()) == {NO_POSE}


@pytest.mark.parametrize("phase", EVERY)
def test_a_short_fault_is_survived(library, course, phase):
    loop, inputs = at_phase(library, course, phase)
    spoilt_ = inputs[:12].copy()
    for k in range(HOLD - 1):
        nan_pose(spoilt_[k], k)
    out = loop.run(spoilt_)
    assert out["stage"].tolist() == [HOLDING] * (HOLD - 1) + [DRIVING] * (12 - HOLD + 1)
    assert out["fault"][-1] == FINE


def test_a_battery_that_is_low_before_the_start_prevents_it(library, course):
    inputs = course.inputs[: course.drives + 20].copy()
    inputs["flight_state"] = LOW
    assert (Loop(library, course.mission).run(inputs)["action"] == SILENT).all()


# Missions.


def test_every_order_is_read(library):
    form = FORMS["form2"]
    commands = (
        CrawlTo(Pose2(0.1, -0.2, 0.3)), TakeOff(0.8),
        FlyTo((1.0, 0.5, 1.5), form, 0.8, along=True, at_once=True, room=2.5), FlyTo((1.0, 0.5, 1.2)),
        Land(-0.1, 0.1), CrawlTo(Pose2(1.2, 0.5, 0.0)),
    )  # fmt: skip
    m = read_mission(library, course_mission(commands).text)
    assert not isinstance(m, str), m
    assert (m["kind"], m["order_count"]) == (COURSE, len(commands))
    for record, command in zip(m["orders"], commands, strict=False):
        assert record.tobytes() == waypoint(command).tobytes(), command
    assert (m["controller"]["joint_speed"], m["crawler"]["joint_speed"]) == (0.6, 0.2)
    assert [order_line(c).split()[0] for c in commands] == [
        "crawl_to", "take_off", "fly_to", "fly_to", "land", "crawl_to"
    ]  # fmt: skip


@pytest.mark.parametrize("seed", [0, 1, 7])
def test_every_gate_is_read_and_the_goal(library, seed):
    course = drawn_course(3, seed)
    m, wanted = read_mission(library, map_mission(course).text), np.zeros((), log_layouts()["course"])
    assert not isinstance(m, str), m
    write_course(wanted, course)
    wanted["tiles"] = 0.0  # the rule does not use them
    assert (m["kind"], m["order_count"], m["has_goal"]) == (COURSE, 0, 1)
    assert m["map"].tobytes() == wanted.tobytes()
    assert (m["controller"]["joint_speed"], m["crawler"]["joint_speed"]) == (0.6, 0.4)


def test_of_gates_the_runner_refuses_what_a_course_does(library):
    """The runner and `Course` are compared on random gates and goals, at the bounds and beyond."""
    rng, agreed = np.random.default_rng(3), {True: 0, False: 0}
    for _ in range(600):
        gates, x = [], 0.0
        for _ in range(int(rng.integers(0, 4))):
            kind = str(rng.choice([k for k in KINDS if k != "tiles"]))
            low, high, _ = POSSIBLE[kind]
            begin = x + float(rng.choice([1.1, 1.2, 2.3, 2.4, 3.0]))
            x = begin + float(rng.choice([0.2, 3.0, 3.0, 3.0]))
            size = low + (high - low) * float(rng.choice([0.01, 0.5, 0.99, 1.05]))
            gates.append((kind, begin, x, size, float(rng.choice([0.0, 0.0, 0.5, 2.0])) if kind == "slot" else 0.0))
        goal = (x + float(rng.choice([-1.5, -1.1, 1.1, 1.3, 2.0])), float(rng.choice([0.0, 1.7, 1.9])), 0.1)
        lines = [" ".join(("gate", kind, *map(repr, numbers))) for kind, *numbers in gates]
        text = FRONT + "\n".join([*lines, "goal " + " ".join(map(repr, goal))])
        try:
            Course(tuple(Gate(*gate) for gate in gates), Pose2(*goal))
        except InvalidValueError:
            possible = False
        else:
            possible = True
        found = read_mission(library, text)
        assert isinstance(found, str) != possible, (text, found)
        agreed[possible] += 1
    assert min(agreed.values()) > 50


UP = FRONT + "take_off 1\n"
WALL = "gate wall 2.3 2.5 0.5\n"
BAD = {
    "course tuned": "line 1; valid: course, one of paper, as_flown, as_flown_quasi, tuned",
    "course robust tuned": "course, one of paper, as_flown, as_flown_quasi, tuned",
    "flight tuned\ntake_off 1": "crawl_to, take_off, fly_to, land, grasp, carry_to, place, release for a course",
    "crawl robust\nland": "line 2; valid: crawl_to, take_off, fly_to, land, grasp, carry_to, place",
    FRONT + "move 0.1 0 0 0": "move for a crawl",
    FRONT + "end 3": "form, end for a flight or a bench test; unrestricted for a flight",
    FRONT + "take_off": "line 2; valid: take_off HEIGHT, by which it rises, within 0.1 … 10 m",
    FRONT + "take_off 0.05": "within 0.1 … 10 m",
    FRONT + "take_off nan": "take_off HEIGHT",
    FRONT + "land": "line 2; valid: take_off first: the robot is on the floor there",
    FRONT + "fly_to 1 0 1 0.5": "take_off first",
    UP + "take_off 1": "line 3; valid: land first: the robot is in the air there",
    UP + "crawl_to 1 0 0": "land first",
    UP + "land 101": "land [FLOOR, its height [m] [SLOPE [rad]]]",
    UP + "land 0 -0.1": "land on a slope within",
    UP + "fly_to 1 0 1": "fly_to X Y Z [m] SPEED [m/s] [along] [at_once] [room WIDTH [m]] [form and 16 angles [rad]]",
    UP + "fly_to 1 0 1 2": "fly_to with a speed within 0.05 … 1.5 m/s",
    UP + "fly_to 101 0 1 0.5": "fly_to X Y Z [m]",
    UP + "fly_to 1 0 1 0.5 at_once along": "along, at_once, room, form, in this order",
    UP + "fly_to 1 0 1 0.5 room": "room and a width within 0 … 100 m",
    UP + "fly_to 1 0 1 0.5 form 0 0": "form and 16 angles within ± 90 degrees",
    UP + "fly_to 1 0 1 0.5 form 2" + " 0" * 15: "form and 16 angles within ± 90 degrees",
    UP + "fly_to 1 0 1 0.5 room 1.0": "a wider room: the form does not fit with its clearance",
    UP + "fly_to 1 0 1 0.5 room 2.9 form" + " 0" * 16: "a wider room",
    FRONT + "take_off 1\nland\n" * 32 + "take_off 1": "line 66; valid: at most 64 orders at once",
    FRONT + "crawl_to 1 0": "crawl_to X Y [m] YAW [rad], where the torso comes to lie, within ± 100 m",
    FRONT + "now": "flight, crawl, course",
    FRONT + "gate fence 2 3 1": "gate, one of wall, beam, slot, platform, tiles, slope",
    FRONT + "gate wall 2 3": "then BEGIN END SIZE [m, rad] and a slot's MIDDLE [m]",
    FRONT + "gate wall 2 nan 1": "gate, one of wall",
    FRONT + "gate wall 3 2 1": "a gate that ends behind its begin, within ± 60 m",
    FRONT + "gate beam 2 3 0.4": "gate beam with a clearance of 0.5 … 3 m",
    FRONT + "gate slot 2 3 2 2.5": "a slot between the field's sides at ± 3 m",
    FRONT + WALL + "gate wall 4 5 1": "line 3; valid: gates in their order, with 2.4 m between two",
    FRONT + "".join(f"gate wall {3 * k}.3 {3 * k}.5 1\n" for k in range(1, 10)): "at most 8 gates",
    FRONT + WALL: "a goal behind the gates",
    FRONT + "goal 1 0": "goal X Y [m] YAW [rad]",
    FRONT + "goal 1 2 0": "1.2 m from the field's sides",
    FRONT + "goal 1 0 0\ngoal 1 0 0": "one goal",
    FRONT + WALL + "goal 2.6 0 0": "a goal 1.2 m from walls, slots, and edges of floors",
    UP + "goal 1 0 0": "orders, or a goal with gates, not both",
    "flight tuned\n" + WALL: "gate and goal for a course",
    "crawl robust\ngoal 1 0 0": "gate and goal for a course",
}  # fmt: skip


@pytest.mark.parametrize("text", BAD, ids=range(len(BAD)))
def test_a_wrong_course_is_refused_with_what_would_be_valid(library, text):
    reason = read_mission(library, text)
    assert isinstance(reason, str)
    assert re.match(r"mission, line \d+; valid: ", reason)
    assert BAD[text] in reason


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (UP + "fly_to 1 0 0.1 0.5", "a fly_to higher above the floor: the form would touch it"),
        (UP + "fly_to 1 0 0.6 0.5 form" + " 0 0.785 0 1.57" * 4, "a fly_to higher above the floor"),
        (FRONT + "crawl_to 90 0 0", "a crawl_to within reach: a shorter distance"),
        (UP + "residual on", "there is no residual for this mission"),
    ],
)  # fmt: skip
def test_a_course_that_cannot_be_done_is_refused_before_connecting(runner, tmp_path, text, words):
    (tmp_path / "mission").write_text(text)
    done = said(runner, "sim", "127.0.0.1:1", tmp_path / "mission")
    assert done.returncode == 2
    assert words in done.stderr
    assert "no simulator" not in done.stderr
    assert done.stderr.count("\n") == 1


def test_a_course_that_has_no_order_yet_waits_for_one(library, course):
    mission = course.mission.copy()
    mission["order_count"] = 0
    loop = Loop(library, mission)
    out = loop.run(course.inputs[: course.drives + 20])[-1]
    assert (out["stage"], out["finished"], out["manager_phase"]) == (DRIVING, 0, PHASES.index("lie"))
    out, _ = told(loop, course.inputs[course.drives + 20], "take_off 0.5")
    assert (out["heard"], PHASES[out["manager_phase"]]) == (TAKEN, "spool")
