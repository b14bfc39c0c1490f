"""Pins the checks of the robot's health: every limit in every kind of mission, and λ̄ that follows the voltage."""

from contextlib import closing

import numpy as np
import pytest
from support.needs import needs_compiler
from support.runner import (
    BENCH,
    COURSE,
    CRAWL,
    DRIVING,
    ENDING,
    FINE,
    FORCE_LANDING,
    HEALTH_INVALID,
    HEALTH_STALE,
    HOLD,
    LANDING,
    MOTOR_LIMIT,
    PUBLISH,
    RESTING,
    SERVO_ERROR,
    SERVO_HOT,
    SERVO_LOADED,
    VOLTAGE_CRITICAL,
    VOLTAGE_LOW,
    WAITING,
    Loop,
    played,
    read_mission,
    said,
)

from spidar_gym.logs.runner_log import read_runner_log, runner_record
from spidar_gym.native.formulas import max_thrust
from spidar_gym.onboard.health import (
    HEALTH_TOPICS,
    MOTOR_FULL,
    N_SERVOS,
    SERVO_OVERLOAD,
    SERVO_STALL,
    HealthLimits,
)
from spidar_gym.onboard.messages import Message
from spidar_gym.robot import N_ROTORS, ROBOT
from spidar_gym.sitl.link_socket import SocketLink
from spidar_gym.sitl.missions import HANGING, Mission, hover_mission
from spidar_gym.sitl.play import play

pytestmark = needs_compiler
LIMITS = HealthLimits()


@pytest.fixture(scope="module")
def bench(library, runner, tmp_path_factory):
    text = "bench\nform 0 " + " ".join(f"{angle:.4f}" for angle in HANGING) + "\nend 6\n"
    mission = Mission("bench", "", text, 6.0, on_stand=True)
    return played(library, runner, tmp_path_factory.mktemp("bench") / "x", "bench", mission)


@pytest.fixture(params=["hover", "crawl", "course", "bench"])
def driven(request, library):
    """A loop that has driven for half a second, and 2.4 s of the inputs that follow."""
    stream = request.getfixturevalue(request.param)
    loop = Loop(library, stream.mission)
    assert loop.run(stream.inputs[: stream.drives + 20])[-1]["stage"] == DRIVING
    return stream, loop, stream.inputs[stream.drives + 20 :][:96].copy()


# What the limits are, by the word that the runner says: a function that spoils the health of inputs from a tick on,
# whether the mission ends with the robot controlled, and the largest time until the fault [s].


def voltage(volts):
    return lambda health: health.__setitem__("voltage", volts)


def every(name, value):
    return lambda health: health[name].__setitem__(slice(None), value)


def one(name, value):
    return lambda health: health[name].__setitem__((..., 7), value)


CASES = {
    "low": (VOLTAGE_LOW, voltage(20.5), True, 1.3),
    "critical": (VOLTAGE_CRITICAL, voltage(12.0), False, 0.6),
    "hot": (SERVO_HOT, one("servo_temperature", 58), True, 1.1),
    "loaded": (SERVO_LOADED, one("servo_load", -SERVO_STALL), True, 1.1),
    "error": (SERVO_ERROR, one("servo_error", 0x04), False, 0.05),
    "motor": (MOTOR_LIMIT, one("motor_output", 1840), True, 2.2),
    "nan": (HEALTH_INVALID, voltage(np.nan), True, 1.2),
    "far": (HEALTH_INVALID, voltage(40.0), True, 1.2),
    "no temperature": (HEALTH_INVALID, every("servo_temperature", 255), True, 1.2),
    "servos missing": (HEALTH_INVALID, lambda health: health.__setitem__("servo_count", N_SERVOS - 4), True, 1.2),
    "no output": (HEALTH_INVALID, every("motor_output", 2001), True, 1.2),
}


def spoilt(inputs, spoil, limits=None):
    inputs = inputs.copy()
    spoil(inputs["health"])
    return inputs


def quick(mission, name):
    """The mission with limits that are exceeded within the test."""
    mission = mission.copy()
    mission["limits"]["health"]["load_time"] = 1.0
    if name == "critical":  # without the end of the mission on the way
        mission["limits"]["health"]["voltage_low"] = mission["limits"]["health"]["voltage_critical"]
    return mission


@pytest.mark.parametrize("name", CASES)
def test_every_limit_has_its_fault_and_reaction_in_every_kind_of_mission(driven, name):
    stream, loop, inputs = driven
    fault, spoil, ends, seconds = CASES[name]
    loop = loop.copy()
    loop.record["mission"] = quick(stream.mission, name)
    out = loop.run(spoilt(inputs, spoil))
    kind = stream.mission["kind"]
    first = int(np.argmax(out["fault"] == fault))
    assert out["fault"][first] == fault
    assert (out["fault"][:first] == FINE).all()
    assert (first + 1) / 40.0 <= seconds + 0.05
    assert set(out["fault"][first:].tolist()) <= {fault, FINE}
    assert np.isfinite(out["command"]["thrust"]).all()
    if kind == BENCH:
        assert out["stage"][first + HOLD + 1] == RESTING
        assert (out["action"] == PUBLISH).all()
    elif kind == COURSE and (ends or name == "error"):  # the robot lies or has just begun to rise: it rests
        assert set(out["stage"][first + HOLD + 1 :].tolist()) <= {ENDING, RESTING}
        assert (out["action"] == PUBLISH).all()
    elif kind == COURSE:
        assert out["stage"][first + HOLD + 1] in (RESTING, LANDING)
    elif ends:
        assert (out["stage"][first:] == ENDING).all()
        assert (out["action"] == PUBLISH).all()
        assert (out["fault"][first:] == fault).all()
        assert kind == CRAWL or out["finished"][first]
    else:
        assert (out["action"][first + HOLD + 1 :][:8] == FORCE_LANDING).all()


def test_a_flight_that_ends_early_hovers_in_the_form_that_it_has(library, hover):
    mission = read_mission(library, "flight paper\nform 0 " + "0.3 " * 16 + "\nform 1 " + "0 " * 16 + "\nend 60\n")
    loop = Loop(library, mission)
    inputs = hover.inputs[: hover.drives + 120].copy()
    inputs["health"]["servo_temperature"][hover.drives + 20 :, 3] = 60
    out = loop.run(inputs)
    over = int(np.argmax(out["stage"] == ENDING))
    held = out["command"]["joint_position"][over:]
    assert np.abs(held - held[0]).max() < 1e-12
    assert np.abs(out["reference"]["joint_target"][over:] - held[0]).max() < 1e-12
    assert np.abs(held[0]).max() > 1e-3, "it was on its way"


def test_a_crawl_that_ends_early_completes_its_cycle_and_has_then_finished(library, crawl):
    inputs = crawl.inputs.copy()
    inputs["health"]["servo_temperature"][crawl.drives + 10 :, 3] = 60
    loop = Loop(library, crawl.mission)
    out = loop.run(inputs)
    assert (out["stage"][crawl.drives + 60 :][:40] == ENDING).all()
    assert loop.record["crawl"]["gait"]["count"] <= 1
    assert len(set(out["phase"][out["stage"] == ENDING].tolist())) > 1, "the gait goes on"


@pytest.mark.parametrize("time", ["voltage_time", "servo_time", "motor_time"])
def test_a_topic_that_stops_is_a_fault_and_one_that_never_came_is_none(library, hover, time):
    inputs = hover.inputs[: hover.drives + 100].copy()
    stop = hover.drives + 20
    inputs["health"][time][stop:] = inputs["health"][time][stop]
    out = Loop(library, hover.mission).run(inputs)
    first = int(np.argmax(out["fault"] == HEALTH_STALE))
    assert inputs["time"][first] - inputs["health"][time][stop] == pytest.approx(LIMITS.age, abs=0.03)
    assert out["stage"][first] == ENDING
    inputs["health"][time] = -np.inf
    assert (Loop(library, hover.mission).run(inputs)["fault"][hover.drives :] == FINE).all()


@pytest.mark.parametrize("name", ["low", "error", "hot"])
def test_it_does_not_take_over_a_robot_that_is_not_healthy(library, stream, name):
    fault, spoil, *_ = CASES[name]
    out = Loop(library, stream.mission).run(spoilt(stream.inputs[: stream.drives + 40], spoil))
    assert (out["stage"] == WAITING).all()
    assert out["fault"][-1] == fault


def test_short_excesses_single_bad_messages_and_overloads_are_no_faults(library, hover):
    inputs = hover.inputs[: hover.drives + 100].copy()
    health, k = inputs["health"], hover.drives + 20
    health["voltage"][k : k + 4] = 19.0  # one message
    health["servo_temperature"][k : k + 20, 0] = 80
    health["servo_load"][k : k + 40, 1] = SERVO_STALL
    health["motor_output"][k : k + 60, 2] = 1840
    health["voltage"][k + 30 : k + 40] = np.nan
    health["servo_error"][:, 3] = SERVO_OVERLOAD
    out = Loop(library, hover.mission).run(inputs)
    assert (out["fault"][hover.drives :] == FINE).all()
    assert (out["stage"][hover.drives :] == DRIVING).all()


# λ̄ follows the voltage.


def test_the_thrust_limit_is_that_of_the_filtered_voltage_and_without_it_the_robots(library, hover):
    loop, inputs = Loop(library, hover.mission), hover.inputs[: hover.drives + 100].copy()
    inputs["health"]["voltage"] = 22.2
    loop.run(inputs)
    assert loop.record["health"]["thrust_limit"] == pytest.approx(max_thrust(22.2), abs=1e-9)
    assert loop.record["flight"]["thrust_limit"] == loop.record["health"]["thrust_limit"]
    assert loop.record["manager"]["crawl"]["thrust_limit"] == loop.record["health"]["thrust_limit"]
    inputs["health"]["voltage"] = 29.0
    other = Loop(library, hover.mission)
    other.run(inputs)
    assert other.record["health"]["thrust_limit"] == ROBOT.max_thrust
    inputs["health"]["voltage_time"] = -np.inf
    without = Loop(library, hover.mission)
    out = without.run(inputs)
    assert without.record["flight"]["thrust_limit"] == np.inf
    assert (
        out["command"].tobytes() == Loop(library, hover.mission).run(hover.inputs[: len(inputs)])["command"].tobytes()
    )


def test_commands_stay_below_it_with_a_binding_limit(library, hover):
    loop, inputs = Loop(library, hover.mission), hover.inputs[: hover.drives + 40].copy()
    inputs["health"]["voltage"] = 20.2
    loop.record["mission"]["limits"]["health"]["voltage_low"] = 15.0
    loop.record["mission"]["limits"]["fence_low"][2] = -50.0
    loop.run(inputs)
    loop.record["reference"]["position_w"][2] += 3.0  # far above: it climbs with all it has
    out = loop(hover.inputs[hover.drives + 40])
    most = float(loop.record["health"]["thrust_limit"])
    assert most < 27.0
    assert most - 1e-3 < out["command"]["thrust"].max() <= most


# Missions, contract and logs.


def test_the_defaults_are_those_of_python_and_lines_change_them(library):
    plain = read_mission(library, "flight paper\n")["limits"]["health"]
    assert {name: float(plain[name]) for name in plain.dtype.names} == vars(LIMITS)
    text = "flight paper\nvoltage 22 21.5\nservos 50 0.5 3\nmotors 0.8 1.5\nhealth 2\n"
    own = read_mission(library, text)["limits"]["health"]
    assert own.tolist() == (22.0, 21.5, 50.0, 0.5, 3.0, 0.8, 1.5, 2.0)


@pytest.mark.parametrize(
    ("line", "valid"),
    [
        ("voltage 21", "voltage LOW CRITICAL"),
        ("voltage 20 21", "the critical one at most the low one"),
        ("voltage 40 20", "10 … 30"),
        ("voltage nan 20", "voltage LOW CRITICAL"),
        ("servos 200 1 1", "at most 120"),
        ("servos 50 0 1", "above 0"),
        ("motors 1.5 1", "within 0 … 1"),
        ("motors 0.9", "SECONDS"),
        ("health 0", "above 0"),
        ("health inf x", "health SECONDS"),
    ],
)
def test_limits_out_of_range_are_refused_with_what_is_valid(library, line, valid):
    assert valid in read_mission(library, f"flight paper\n{line}\n")


def test_a_robot_without_health_topics_flies_and_one_line_says_which_are_absent(runner, tmp_path):
    silent = [name for name, _ in HEALTH_TOPICS.values()][:2]
    short = hover_mission(seconds=1.0)
    done = play(short, runner=runner, log=tmp_path / "run.log", silent=silent)
    lines = [line for line in done.run.words if "health" in line]
    assert lines == [f"runner: the robot's health is not checked: nothing comes on {', '.join(silent)}"]
    assert done.run.status == 0
    record = runner_record(read_runner_log(tmp_path / "run.log"))
    assert "motor_pwms" in record
    assert not set(silent) & set(record.series)


def test_logs_replay_bit_for_bit_with_these_inputs_and_records_hold_them(runner, tmp_path):
    log, again = tmp_path / "run.log", tmp_path / "again.log"
    done = play(hover_mission(seconds=6.0), runner=runner, log=log, fault="servo_hot")
    assert (done.log.outputs["fault"] == SERVO_HOT).any()
    answer = said(runner, "replay", log, again)
    assert ", 0 with other answers" in answer.stdout, answer.stderr
    assert log.read_bytes() == again.read_bytes()
    record = runner_record(read_runner_log(log))
    volts, servos, motors = (record[name] for name, _ in HEALTH_TOPICS.values())
    for series, rate in ((volts, 10.0), (servos, 40.0), (motors, 10.0)):  # of 50 Hz, a tick keeps the last one
        assert len(series) / (record.end - record.start) == pytest.approx(rate, rel=0.1)
    assert servos.values["temperature"].shape[1] == N_SERVOS
    assert servos.values["temperature"].max() == 58
    assert (servos.values["index"] == np.arange(N_SERVOS)).all()
    assert motors.values["motor_value"].shape[1] == N_ROTORS
    flying = motors.values["motor_value"][motors.time > float(done.run.first_driven)] / MOTOR_FULL
    assert (flying.min() > 0.6) & (flying.max() < 0.92), "hovering takes three quarters of the duty"
    assert 23.0 < volts.values["data"].min() < volts.values["data"].max() < 25.3


def test_more_motors_or_servos_than_there_are_do_no_harm_to_the_link(tmp_path):
    with closing(SocketLink()) as link:
        link.publish(Message("motor_pwms", 1.0, {"motor_value": np.arange(12)}))
        link.publish(
            Message("servo/states", 1.0, {name: [40, 3] for name in ("index", "angle", "temp", "load", "error")})
        )
        health = link._input["health"]
        assert health["motor_count"] == 12
        assert health["servo_count"] == 1
        assert health["servo_temperature"][3] == 3
