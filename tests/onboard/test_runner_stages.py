"""Pins the runner's stages: when it drives, when it hands the robot back, and the reaction to every fault."""

import numpy as np
import pytest
from support.needs import needs_compiler
from support.runner import (
    BAD_COMMAND,
    CONTENDED,
    DRIVING,
    FINE,
    FORCE_LANDING,
    HOLD,
    HOLDING,
    JUMPED,
    LAND,
    LANDING,
    LATE,
    NO_ALLOCATION,
    NO_IMU,
    NO_JOINTS,
    NO_POSE,
    NO_STATE,
    NOT_FINITE,
    OUT_OF_ORDER,
    OUT_OF_RANGE,
    OUTSIDE,
    PUBLISH,
    RELEASED,
    SILENT,
    TILTED,
    WAITING,
    Loop,
    check_bounds,
    nan_pose,
    played,
)

from spidar_gym.sitl.missions import hover_mission

pytestmark = needs_compiler


@pytest.fixture(scope="module")
def driving(library, hover):
    """Return a loop that has driven for 0.75 s, and the inputs that follow; tests must copy the loop."""
    loop = Loop(library, hover.mission)
    last = loop.run(hover.inputs[: hover.drives + 30])[-1]
    assert last["stage"] == DRIVING
    return loop, hover.inputs[hover.drives + 30 :]


# When it drives.


def test_it_drives_after_good_samples_for_settle_seconds_and_publishes_nothing_before(library, stream):
    out = Loop(library, stream.mission).run(stream.inputs)
    times = stream.inputs["time"]
    assert times[stream.drives] - times[stream.hovers] == pytest.approx(1.0, abs=0.026)
    assert (out["stage"][: stream.drives] == WAITING).all()
    assert (out["action"][: stream.drives] == SILENT).all()
    assert (out["action"][stream.drives : stream.drives + 80] == PUBLISH).all()
    np.testing.assert_array_equal(out["mission_time"][: stream.drives], 0.0)
    on = np.flatnonzero(out["stage"] == DRIVING)
    np.testing.assert_allclose(out["mission_time"][on], times[on] - times[stream.drives], atol=1e-9)


@pytest.mark.parametrize("state", [*range(18), 255, -1])
def test_no_other_flight_state_is_driven_in(library, stream, state):
    inputs = stream.inputs[stream.hovers : stream.hovers + 60].copy()
    inputs["flight_state"] = state
    out = Loop(library, stream.mission).run(inputs)
    assert (out["action"] == SILENT).all() == (state != stream.wanted)
    assert (out["stage"] == WAITING).all() == (state != stream.wanted)


@pytest.mark.parametrize("state", [*range(5), *range(6, 18), 255, -1])
def test_what_takes_the_robot_back_has_it_for_good(driving, state):
    loop, inputs = driving
    loop, inputs = loop.copy(), inputs[:60].copy()
    inputs["flight_state"][10:12] = state
    out = loop.run(inputs)
    assert (out["action"][:10] == PUBLISH).all()
    assert (out["action"][10:] == SILENT).all()
    assert (out["stage"][10:] == RELEASED).all()


def test_a_fault_during_the_wait_restarts_it(library, hover):
    for at in (0, 20, 38):
        inputs = hover.inputs[hover.hovers - 5 :].copy()
        nan_pose(inputs[5 + at], 0)
        out = Loop(library, hover.mission).run(inputs)
        first = int(np.argmax(out["stage"] == DRIVING))
        assert inputs["time"][first] - inputs["time"][5 + at] == pytest.approx(1.0, abs=1e-6)
        assert out["fault"][5 + at] == NOT_FINITE


def test_settle_is_the_missions(library, hover):
    mission = hover.mission.copy()
    mission["limits"]["settle"] = 0.25
    out = Loop(library, mission).run(hover.inputs[: hover.drives])
    assert int(np.argmax(out["stage"] == DRIVING)) - hover.hovers == pytest.approx(10, abs=1)


def test_a_runner_that_is_started_in_hover_waits_too(library, stream):
    out = Loop(library, stream.mission).run(stream.inputs[stream.hovers + 4 :][:60])
    assert (out["action"][:39] == SILENT).all()
    assert out["stage"][42] == DRIVING


@pytest.mark.parametrize("at", [-10, 10], ids=["before", "in the wait"])
@pytest.mark.parametrize("time", [np.nan, np.inf, -np.inf])
def test_a_clock_that_is_no_number_starts_no_drive(library, stream, time, at):
    inputs = stream.inputs[: stream.hovers + 25].copy()
    inputs["time"][stream.hovers + at] = time
    out = Loop(library, stream.mission).run(inputs)
    assert (out["action"] == SILENT).all()
    assert (out["stage"] == WAITING).all()


# Faults.


def put(field, value, of=slice(None)):
    def spoil(record, k):
        target = record["measurement"][field]
        if np.ndim(target):
            target[of] = value
        else:
            record["measurement"][field] = value

    return spoil


def move(field, by):
    def spoil(record, k):
        record["measurement"][field] += by

    return spoil


def tell(**values):
    def spoil(record, k):
        for name, value in values.items():
            record[name] = value

    return spoil


def tip(record, k):
    q = record["measurement"]["pose_quat_wb"].reshape(4, 4)
    w, x, y, z = q.T.copy()
    c, s = np.cos(0.5), np.sin(0.5)  # by 1 rad about x
    q[...] = np.stack([c * w - s * x, c * x + s * w, c * y - s * z, c * z + s * y], 1)


def drift(record, k):
    record["measurement"]["pose_position_w"].reshape(4, 3)[:, 0] += 0.08 * k + 0.04 * np.arange(1, 5)


def old_state(record, k):
    record["flight_state_time"] = record["time"] - 0.51


AT_ONCE = {
    **{
        f"{name} {value}": (put(name, value, of), NOT_FINITE)
        for name, of in {
            "pose_position_w": 1, "pose_quat_wb": 3, "pose_time": 0, "gyro_b": 2, "specific_force_b": 14, "imu_time": 4,
            "encoder_time": 0, "joint_position": 15, "vectoring": 0,
        }.items()
        for value in (np.nan, np.inf, -np.inf)
    },
    "time nan": (tell(time=np.nan), NOT_FINITE),
    "time inf": (tell(time=np.inf), NOT_FINITE),
    "pose far": (put("pose_position_w", 101.0, 0), OUT_OF_RANGE),
    "pose far below": (put("pose_position_w", -1e300, 0), OUT_OF_RANGE),
    "attitude of zeros": (put("pose_quat_wb", 0.0), OUT_OF_RANGE),
    "attitude too long": (put("pose_quat_wb", 1.1), OUT_OF_RANGE),
    "gyro": (put("gyro_b", 35.1, 0), OUT_OF_RANGE),
    "accelerometer": (put("specific_force_b", -201.0, 3), OUT_OF_RANGE),
    "joint": (put("joint_position", 3.31, 7), OUT_OF_RANGE),
    "vectoring": (put("vectoring", -40.1, 7), OUT_OF_RANGE),
    **{f"{name} back": (move(name, -0.5), OUT_OF_ORDER) for name in ("pose_time", "imu_time", "encoder_time")},
    **{f"{name} ahead": (move(name, 0.5), OUT_OF_ORDER) for name in ("pose_time", "imu_time", "encoder_time")},
    "state stale": (old_state, NO_STATE),
    "state never": (tell(flight_state_time=-np.inf), NO_STATE),
    "state time nan": (tell(flight_state_time=np.nan), NO_STATE),
    "state ahead": (tell(flight_state_time=1e6), NO_STATE),
    "pose jumps": (move("pose_position_w", 0.5), JUMPED),
    "contended": (tell(has_thrust=1), CONTENDED),
}  # fmt: skip
IN_TIME = {
    "pose stale": (put("pose_count", 0), NO_POSE, 0.2),
    "imu stale": (put("imu_count", 0), NO_IMU, 0.06),
    "joints stale": (put("encoder_time", 0.0), NO_JOINTS, 0.15),
    "joints told no more": (None, NO_JOINTS, 0.15),
    "tips over": (tip, TILTED, 1.5),
    "leaves the fence": (drift, OUTSIDE, 1.2),
}
"""Function that spoils inputs, fault, time until it is detected [s]."""


def spoilt(inputs, spoil):
    inputs = inputs.copy()
    for k, record in enumerate(inputs):
        spoil(record, k)
    return inputs


def check_landing(out, before, fault):
    """Check the sequence from the first tick of `out` on: hold, force the landing, publish nothing."""
    stages = [HOLDING] * HOLD + [LANDING] * LAND + [RELEASED] * (len(out) - HOLD - LAND)
    assert out["stage"].tolist() == stages
    actions = {HOLDING: PUBLISH, LANDING: FORCE_LANDING, RELEASED: SILENT}
    assert out["action"].tolist() == [actions[stage] for stage in stages]
    assert set(out["fault"].tolist()) == {fault}
    assert all(command.tobytes() == before.tobytes() for command in out["command"][:HOLD])


@pytest.mark.parametrize(("spoil", "fault"), AT_ONCE.values(), ids=AT_ONCE)
def test_a_fault_is_held_then_landed_then_silence(driving, spoil, fault):
    loop, inputs = driving
    loop = loop.copy()
    before = loop.run(inputs[:2])[-1]
    out = loop.run(spoilt(inputs[2:22], spoil))
    check_landing(out, before["command"], fault)
    out = loop.run(inputs[22:40])
    assert (out["action"] == SILENT).all(), "for good"


@pytest.mark.parametrize(("spoil", "fault", "seconds"), IN_TIME.values(), ids=IN_TIME)
def test_what_goes_stale_or_drifts_away_lands(driving, spoil, fault, seconds):
    loop, inputs = driving
    loop, inputs = loop.copy(), inputs.copy()
    if spoil is None:  # the last message is repeated
        for name in ("encoder_time", "joint_position", "vectoring"):
            inputs["measurement"][name] = inputs["measurement"][name][0]
    else:
        inputs = spoilt(inputs, spoil)
    out = loop.run(inputs[:80])
    first = int(np.argmax(out["stage"] != DRIVING))
    assert 0 < first <= np.ceil(seconds * 40.0) + 1
    if seconds < 0.5:
        assert first >= seconds * 40.0 - 2
    check_landing(out[first : first + 20], out["command"][first - 1], fault)


@pytest.mark.parametrize("ticks", [1, HOLD])
@pytest.mark.parametrize(("spoil", "fault"), AT_ONCE.values(), ids=AT_ONCE)
def test_a_short_fault_is_survived_and_forgotten(driving, spoil, fault, ticks):
    loop, inputs = driving
    loop = loop.copy()
    second = 2 * ticks + 2
    for start in (0, second):  # after enough good ticks the second fault is held as long as the first
        inputs = inputs.copy()
        for k in range(ticks):
            spoil(inputs[start + k], k)
    out = loop.run(inputs[:30])
    bad = [k for k in range(30) if k < ticks or second <= k < second + ticks]
    assert np.flatnonzero(out["stage"] == HOLDING).tolist() == bad
    assert (np.delete(out["stage"], bad) == DRIVING).all()
    assert set(out["fault"][bad].tolist()) == {fault}
    assert (np.delete(out["fault"], bad) == FINE).all()
    assert (out["action"] == PUBLISH).all()
    commands = out["command"]["thrust"][second + ticks :]
    assert (np.abs(np.diff(commands, axis=0)).max(1) > 0.0).all(), "it goes on"


def test_ticks_that_come_late_are_faults(driving):
    loop, inputs = driving
    one = loop.copy()
    out = one.run(np.delete(inputs, slice(10, 14))[:30])  # 125 ms
    assert np.flatnonzero(out["stage"] == HOLDING).tolist() == [10]
    assert out["fault"][10] == LATE
    # Old commands stay in force between late ticks: two such ticks make 150 ms.
    many = loop.copy()
    many(inputs[0])
    out = many.run(inputs[5::5][:16])
    assert out["stage"][:2].tolist() == [HOLDING, LANDING]
    assert out["fault"][0] == LATE
    assert out["stage"][-1] == RELEASED


def test_a_fault_that_comes_and_goes_ends_in_the_landing_too(driving):
    loop, inputs = driving
    loop, inputs = loop.copy(), inputs[:60].copy()
    inputs["measurement"]["joint_position"][np.arange(60) % 3 < 2, 0] = np.nan
    out = loop.run(inputs)
    assert (out["stage"] == LANDING).any()
    assert out["stage"][-1] == RELEASED


@pytest.mark.parametrize(("field", "value"), [("joint_position", np.nan), ("vectoring", 1e4), ("joint_position", 7.0)])
def test_a_command_out_of_bounds_never_leaves(driving, field, value):
    loop, inputs = driving
    loop = loop.copy()
    before = loop(inputs[0])
    loop.record["flight"]["memory"][field] = value
    out = loop.run(inputs[1:21])
    check_bounds(out)
    if value != 7.0:
        check_landing(out, before["command"], BAD_COMMAND)


def test_without_an_allocation_it_holds_and_lands(driving):
    loop, inputs = driving
    loop = loop.copy()
    loop.record["flight"]["memory"]["position_integral_w"] = np.nan
    out = loop.run(inputs[:20])
    check_bounds(out)
    assert out["stage"].tolist() == [HOLDING] * HOLD + [LANDING] * LAND + [RELEASED] * 6
    assert set(out["fault"].tolist()) == {NO_ALLOCATION}


def test_contention_is_ignored_right_after_the_take_over(library, hover):
    inputs = hover.inputs[: hover.drives + 30].copy()
    inputs["has_thrust"][hover.drives :] = 1
    out = Loop(library, hover.mission).run(inputs)[hover.drives :]
    assert (out["fault"][:21] == FINE).all()
    assert (out["fault"][22:] == CONTENDED).all()


@pytest.mark.parametrize("thrust", [np.nan, np.inf, -5.0, 1e6])
def test_invalid_thrust_commands_of_others_are_never_taken_over(library, hover, thrust):
    inputs = hover.inputs[: hover.drives + 30].copy()
    inputs["thrust"][hover.drives - 20 :, 3] = thrust
    out = Loop(library, hover.mission).run(inputs)
    check_bounds(out)
    assert not (out["action"] == FORCE_LANDING).any()
    told = hover.inputs["thrust"][hover.drives].sum()
    assert out["command"]["thrust"][out["stage"] == DRIVING][0].sum() == pytest.approx(told, rel=0.02)


# The thrust that it takes over.


@pytest.mark.parametrize("share", [0.9, 1.0, 1.05, 1.1])
def test_it_takes_over_with_the_thrust_that_the_robots_own_stack_commanded(library, hover, share):
    inputs = hover.inputs[: hover.drives + 1].copy()
    inputs["thrust"] *= share
    told = inputs["thrust"][-1].sum()
    out = Loop(library, hover.mission).run(inputs)[-1]
    assert out["stage"] == DRIVING
    assert out["command"]["thrust"].sum() == pytest.approx(told, rel=0.02)


# The lab's own estimate.


@pytest.mark.slow
def test_with_the_labs_estimate_it_sees_the_robot_where_it_is(library, runner, folder):
    stream = played(library, runner, folder, "odometry", hover_mission(seconds=1.5, odometry=True))
    assert stream.mission["odometry"] == 1
    truth = {round(row.time, 6): row.state for row in stream.run.rows}
    on = np.flatnonzero(stream.played.outputs["stage"] == DRIVING)
    assert len(on) > 50
    where, fast = [], []
    for tick in on:
        seen, state = stream.played.outputs["state"][tick], truth[round(float(stream.inputs["time"][tick]), 6)]
        where.append(np.abs(seen["position_w"] - state.position_w).max())
        fast.append(np.abs(seen["velocity_w"] - state.velocity_w).max())
    assert max(where) < 0.02
    assert max(fast) < 0.1
