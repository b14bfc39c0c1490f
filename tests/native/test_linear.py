"""Pins the linear model of a hover: small motions, and the gain at which they grow, are those of the simulator."""

import math
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from spidar_gym.cli.tables import RESULTS, read_result
from spidar_gym.control.estimator import Estimator
from spidar_gym.control.presets import controller_config
from spidar_gym.errors import SpidarError
from spidar_gym.margins import law_of, leg_margins, robots_of, with_damping
from spidar_gym.native.linear import (
    MEASURED,
    FlightController,
    LinearLaw,
    Loop,
    behind_encoders,
    linear_law,
    linear_robot,
    settle,
)
from spidar_gym.native.plant import Plant
from spidar_gym.robot import FORMS, N_JOINTS
from spidar_gym.sim.config import PlantConfig
from spidar_gym.so3 import log, quat_to_matrix
from spidar_gym.state import Measurement, RobotState
from spidar_gym.studies.margins import Case, cases, compare, summary

ROOT = Path(__file__).resolve().parents[2]


def loose(damping=0.8, **actuators):
    """Return a robot with badly damped joints, without air."""
    config = with_damping(PlantConfig(), damping)
    return replace(config, actuators=replace(config.actuators, **actuators))


def seen(state: RobotState, rest: RobotState) -> np.ndarray:
    """Return what the controller reads of a state, as differences from another one."""
    turn = log(quat_to_matrix(rest.quat_wb).T @ quat_to_matrix(state.quat_wb))
    return np.concatenate(
        [turn if name == "attitude" else (getattr(state, name) - getattr(rest, name)).reshape(-1) for name in MEASURED]
    )


@pytest.mark.parametrize("controller", ["retuned", "baselines.adrc:Adrc", "baselines.mpc:MPC"])
def test_small_motions_are_those_of_the_simulated_robot_with_its_controller(controller):
    law = law_of(controller)
    robot = loose(delay=0.0325, vectoring_delay=0.0075, thrust_lag=0.05)  # neither is a whole number of ticks
    hover = settle(law, FORMS["form2"], robot)
    model = linear_robot(hover)
    step = linear_law(hover)
    plant, start = Plant(hover.config), hover.state
    plant.reset(start.position_w, start.quat_wb, start.joint_position, start.vectoring, start.thrust)
    plant.data.qpos[:], plant.data.act[:], plant.data.ctrl[:] = hover.qpos, hover.act, hover.act
    still = plant.data.qvel.copy()
    plant.data.qvel[:] = still + 1e-4 * np.random.default_rng(1).standard_normal(len(still))
    moved = plant.data.qvel - still
    T = Loop(model, step).transition()
    x = np.zeros(len(T))
    x[len(moved) : 2 * len(moved)] = moved
    ends = np.cumsum(list(MEASURED.values()))
    first = dict(zip(MEASURED, np.split(model.C @ x[: len(model.A)], ends[:-1]), strict=True))
    rates = "velocity_w", "omega_b", "joint_velocity"
    state = replace(start, **{name: getattr(start, name) + first[name] for name in rates})
    expected, found = [], []
    for _ in range(60):
        state = plant.step(law.step(state, hover.reference))
        x = T @ x
        found.append(seen(state, start))
        expected.append(model.C @ x[: len(model.A)])
    found, expected = np.array(found), np.array(expected)
    scale = np.abs(expected).max(axis=0)
    for name, own in zip(MEASURED, np.split(np.arange(ends[-1]), ends[:-1]), strict=True):
        assert np.abs(found - expected)[:, own].max() < 0.01 * scale[own].max(), name
    assert np.abs(expected[-1]).max() > 0.01 * np.abs(expected[0]).max(), "something still moves at the end"


def test_a_controller_is_as_it_was_after_its_linearisation():
    law = law_of("retuned")
    hover = settle(law, FORMS["form1"], PlantConfig())
    memory, step = law.memory, law.last_step
    command = law.step(hover.state, hover.reference)
    law.memory, law.last_step = memory, step
    linear_law(hover)
    again = law.step(hover.state, hover.reference)
    for name in ("thrust", "vectoring", "joint_position"):
        assert getattr(again, name).tobytes() == getattr(command, name).tobytes()


def test_the_filter_of_the_encoders_is_the_estimators():
    size, first = sum(MEASURED.values()), 12
    read = np.zeros((2 * N_JOINTS, size))
    read[:, first : first + 2 * N_JOINTS] = np.eye(2 * N_JOINTS)
    law = LinearLaw(np.zeros((0, 0)), np.zeros((0, size)), np.zeros((2 * N_JOINTS, 0)), read)
    estimator = Estimator()
    behind = behind_encoders(law, estimator.config.joint_bandwidth, 0.025)
    state = settle(law_of("paper"), FORMS["form1"], PlantConfig()).state
    state = replace(state, time=0.0, joint_position=np.zeros(N_JOINTS))
    estimator.reset(state)
    x, rng = np.zeros(len(behind.A)), np.random.default_rng(3)
    empty = {"imu_time": np.zeros(0), "gyro_b": np.zeros((0, 3)), "specific_force_b": np.zeros((0, 3))}
    empty |= {"pose_time": np.zeros(0), "pose_position_w": np.zeros((0, 3)), "pose_quat_wb": np.zeros((0, 4))}
    for k in range(1, 20):
        q, y = rng.standard_normal(N_JOINTS), np.zeros(size)
        y[first : first + N_JOINTS] = q
        measured = Measurement(
            time=0.025 * k, imu_count=0, pose_count=0, encoder_time=0.025 * k, joint_position=q,
            joint_torque=np.zeros(N_JOINTS), vectoring=state.vectoring, **empty,
        )  # fmt: skip
        estimate = estimator.update(measured, state.thrust)
        found, x = behind.C @ x + behind.D @ y, behind.A @ x + behind.B @ y
        np.testing.assert_allclose(found[:N_JOINTS], estimate.joint_position, atol=1e-12)
        np.testing.assert_allclose(found[N_JOINTS:], estimate.joint_velocity, atol=1e-10)


def test_margins_end_where_a_mode_begins_to_grow():
    hover = settle(law_of("as_flown"), FORMS["form2"], PlantConfig())
    loop = Loop(linear_robot(hover, loose(delay=0.03)), linear_law(hover))
    gain, frequency = loop.gain_margin()
    assert loop.growing(0.99 * gain) < 0.0 < loop.growing(1.01 * gain) == pytest.approx(frequency, rel=0.02)
    delay = loop.delay_margin()
    steps = round(delay / 0.0025)
    assert 0.05 < delay < 0.2
    assert loop.growing(delay=steps) < 0.0 <= loop.growing(delay=steps + 1)
    later = Loop(linear_robot(hover, loose(delay=0.03 + delay)), loop.law)
    assert later.growing() < 0.0, "a further delay is a longer delay"


def test_modes_that_move_only_legs_and_servos_ring_and_do_not_throw_the_robot_over():
    folded, stretched = (settle(law_of("tuned"), FORMS[form], PlantConfig()) for form in ("form3", "form2"))
    rings, throws = (
        Loop(linear_robot(hover, loose(0.55, delay=0.03, thrust_lag=0.04)), linear_law(hover))
        for hover in (folded, stretched)
    )
    assert rings.growing() == -1.0
    assert rings.growing(rings=True) == pytest.approx(math.pi / 0.025), "from tick to tick"
    assert throws.growing() == throws.growing(rings=True) == pytest.approx(15.0, abs=1.0)


def test_a_hover_that_swings_with_well_damped_joints_has_no_margins():
    config = controller_config("paper")
    gains = replace(config.centroidal, attitude_gains=((2000.0, 1.0, 60.0),) * 3)
    with pytest.raises(SpidarError, match="does not come to rest"):
        settle(FlightController(replace(config, centroidal=gains)), FORMS["form1"], PlantConfig())


@pytest.mark.slow
def test_robots_fall_at_the_gain_of_the_model():
    found = compare(Case("tuned", "form2", 1.4, 0.03))
    assert math.log(found["falls"] / found["model"]) == pytest.approx(0.0, abs=0.1)
    assert found["swings"] <= 1.03 * found["falls"]


def test_the_committed_comparison_is_summarised_by_its_note():
    content = read_result(ROOT / RESULTS / "leg_falls.json")
    rows = content["result"]["leg_falls"]
    assert [Case(*(row[f.name] for f in fields(Case))) for row in rows] == cases()
    assert content["notes"] == [f"{summary(rows)}."]


@pytest.mark.slow
def test_badly_damped_robots_have_the_worst_margins_and_gentle_controllers_the_best():
    robots = robots_of("calibrated_1", 2)
    assert [kind for kind, _ in robots] == ["wake-described", "wake-damped"]
    gentle, fast = (leg_margins(law_of(name), robots) for name in ("as_flown", "retuned"))
    assert "damped" in fast.gain_at
    assert fast.gain < gentle.gain
    assert fast.delay < gentle.delay
    assert all(found.ringing <= found.gain for found in (gentle, fast))
