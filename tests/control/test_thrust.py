"""Pins the allocator as a library: the wrench of its answer in MuJoCo, its limits, the controller's own bits."""

import math
import subprocess
import sys
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from support.states import random_joints, resting, staying

from spidar_gym.control import ThrustAllocator
from spidar_gym.control.allocation.blocks import JointTorqueEffort, JointTorqueLimit
from spidar_gym.control.allocation.modes import find_allocation
from spidar_gym.control.flight.controller import FlightController
from spidar_gym.control.presets import controller_config
from spidar_gym.errors import InvalidValueError, UnknownNameError
from spidar_gym.robot import FORMS, N_ROTORS, ROBOT
from spidar_gym.robot.description import mjcf_path
from spidar_gym.state import RobotState

HOVER = np.array([0.0, 0.0, ROBOT.weight, 0.0, 0.0, 0.0])


@pytest.fixture(scope="module")
def engine():
    """MuJoCo's model of the robot, independent of the controller's model."""
    return mujoco.MjModel.from_xml_path(str(mjcf_path()))


def delivered(engine, q, thrust, vectoring):
    """Force and torque of MuJoCo's rotors about the CoG for thrusts and vectoring angles, torso axes."""
    data = mujoco.MjData(engine)
    for i in range(engine.njnt):
        name = engine.joint(i).name
        if name != "root":
            number, axis = int("".join(c for c in name if c.isdigit())) - 1, name.split("_")[1]
            angles = vectoring[number] if name.startswith("gimbal") else q[2 * number : 2 * number + 2]
            data.qpos[engine.joint(i).qposadr[0]] = angles[0 if axis in ("yaw", "roll") else 1]
            if axis == "pitch" and name.startswith("joint"):
                assert angles[1] == q[2 * number + 1]
    data.qpos[3:7] = [1.0, 0.0, 0.0, 0.0]
    data.act[:N_ROTORS] = thrust
    mujoco.mj_forward(engine, data)
    force, torque = data.qfrc_actuator[:3], data.qfrc_actuator[3:6]
    com = data.subtree_com[engine.body("torso").id] - data.body("torso").xpos
    return np.concatenate([force, torque - np.cross(com, force)])


def settled(allocator, q, wrench):
    """Answer after the servos have reached it, because the rotors' centres move with the vectoring angles."""
    state = RobotState.at_rest(q)
    for _ in range(8):
        answer = allocator.allocate(state, wrench)
        state = replace(state, vectoring=answer[1])
    return answer


def test_a_level_hover_of_the_flat_robot_is_an_eighth_of_its_weight_each_upright():
    # The least-thrust cost shares thrust almost equally; the paper's cost trades some thrust for less joint torque.
    for preset, off in (("as_flown", 0.005), ("paper", 0.03)):
        thrust, vectoring, allocation = settled(ThrustAllocator(preset, period=math.inf), FORMS["form1"], HOVER)
        assert allocation.status == "closed_form"
        np.testing.assert_allclose(thrust, ROBOT.hover_thrust, rtol=off)
        np.testing.assert_allclose(thrust.sum(), ROBOT.weight, rtol=1e-4)
        np.testing.assert_allclose(vectoring, 0.0, atol=off)


@pytest.mark.parametrize("preset", ["paper", "as_flown"])
def test_thrusts_and_angles_make_the_demanded_wrench_in_another_engine_within_the_limits(preset, engine):
    rng = np.random.default_rng(1)
    optimal = 0
    for _ in range(12):
        q = random_joints(rng)
        wrench = HOVER + rng.uniform(-1.0, 1.0, 6) * [15.0, 15.0, 15.0, 2.0, 2.0, 2.0]
        allocator = ThrustAllocator(preset, period=math.inf)
        thrust, vectoring, allocation = settled(allocator, q, wrench)
        assert 0.0 <= thrust.min() <= thrust.max() <= ROBOT.max_thrust
        made = delivered(engine, q, thrust, vectoring)
        np.testing.assert_allclose(made + allocation.unallocated_wrench, wrench, atol=2e-2)
        if allocation.status in ("closed_form", "solved"):
            optimal += 1
            np.testing.assert_allclose(made, wrench, atol=2e-2)
            if preset == "paper":
                assert np.abs(allocation.joint_torques).max() <= ROBOT.max_joint_torque + 1e-3
    assert optimal >= 10


@pytest.mark.parametrize("preset", ["paper", "as_flown"])
@pytest.mark.parametrize("mode", ["flight", "flight_unrestricted"])
def test_it_answers_as_the_controller_does_tick_by_tick(preset, mode):
    rng = np.random.default_rng(2)
    controller, allocator = FlightController(controller_config(preset)), ThrustAllocator(preset)
    lost, stuck = np.zeros((2, N_ROTORS), bool)
    state = resting(FORMS["form2"])
    controller.reset(state)
    statuses = set()
    for k in range(60):
        if k == 40:
            lost, stuck = np.arange(N_ROTORS) == 3, np.arange(N_ROTORS) == 6
        q = FORMS["form2"] + min(1.0, k / 30.0) * (FORMS["form3"] - FORMS["form2"])
        state = replace(state, joint_position=q + rng.normal(0.0, 0.01, 16), position_w=rng.normal(0.0, 0.05, 3))
        reference = staying(resting(q), mode=mode, lost_thrust=lost, lost_vectoring=stuck)
        command = controller.step(state, reference)
        tick = controller.last_step
        thrust, vectoring, allocation = allocator.allocate(
            state, tick.wrench_desired, avoid_interference=mode == "flight", lost_thrust=lost, lost_vectoring=stuck
        )
        np.testing.assert_array_equal(thrust, command.thrust)
        np.testing.assert_array_equal(vectoring, command.vectoring)
        assert allocation.status == tick.allocation.status
        statuses.add(str(allocation.status))
        state = replace(state, vectoring=vectoring, thrust=thrust)
    if mode == "flight":
        assert len(statuses) > 1


def test_no_angle_turns_farther_than_its_servo_in_a_period_and_a_reset_starts_over():
    allocator = ThrustAllocator(period=0.01)
    state, sideways = resting(FORMS["form1"]), HOVER + [20.0, 0.0, 0.0, 0.0, 0.0, 3.0]
    angles = [state.vectoring] + [allocator.allocate(state, sideways)[1] for _ in range(30)]
    turns = np.abs(np.diff(angles, axis=0))
    assert turns.max() == pytest.approx(0.01 * ROBOT.max_vectoring_speed)
    assert turns[-1].max() < 1e-9
    allocator.reset()
    np.testing.assert_array_equal(allocator.allocate(state, sideways)[1], angles[1])


@pytest.mark.parametrize("poison", [math.nan, math.inf, 1e200])
@pytest.mark.parametrize("what", ["wrench", "joint_position", "quat_wb", "vectoring"])
def test_what_is_not_finite_is_answered_with_the_last_answer_and_spoils_no_later_one(what, poison):
    allocator, untouched = ThrustAllocator(), ThrustAllocator()
    state, more = resting(FORMS["form2"]), HOVER + [3.0, 0.0, 0.0, 0.0, 0.0, 1.0]
    last = allocator.allocate(state, more)
    untouched.allocate(state, more)
    spoilt, wrench = state, more.copy()
    if what == "wrench":
        wrench[4] = poison
    else:
        spoilt = replace(state, **{what: np.full_like(getattr(state, what), poison)})
    with np.errstate(over="ignore"):
        thrust, vectoring, allocation = allocator.allocate(spoilt, wrench)
    assert allocation.status == "held"
    np.testing.assert_array_equal(thrust, last[0])
    np.testing.assert_array_equal(vectoring, last[1])
    np.testing.assert_array_equal(allocator.allocate(state, HOVER)[0], untouched.allocate(state, HOVER)[0])


def test_an_invalid_wrench_period_or_preset_is_refused():
    allocator, state = ThrustAllocator(), resting(FORMS["form1"])
    for wrench in (np.zeros(5), np.zeros((6, 1)), [], list("abcdef")):
        with pytest.raises(InvalidValueError, match="6 numbers"):
            allocator.allocate(state, wrench)
    with pytest.raises(InvalidValueError, match="finite numbers"):
        allocator.allocate(state, np.full(6, np.nan))
    for period in (0.0, -1.0, math.nan):
        with pytest.raises(InvalidValueError, match="above 0"):
            ThrustAllocator(period=period)
    with pytest.raises(UnknownNameError, match="paper, as_flown"):
        ThrustAllocator("mine")


def test_allocation_imports_neither_a_simulator_nor_gymnasium():
    code = (
        "import sys\nfrom spidar_gym.control import ThrustAllocator\nfrom spidar_gym.state import RobotState\n"
        "import numpy as np\nThrustAllocator().allocate(RobotState.at_rest(np.zeros(16)), np.zeros(6))\n"
        "print(*sorted({'gymnasium', 'mujoco', 'torch'} & sys.modules.keys()), end='.')"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "."


def with_blocks(change):
    """The paper's modes with `change` applied to every block."""
    return {
        name: replace(mode, costs=tuple(map(change, mode.costs)), constraints=tuple(map(change, mode.constraints)))
        for name, mode in find_allocation("paper").items()
    }


def test_a_custom_weight_trades_thrust_for_torque_and_a_custom_limit_is_kept():
    q, wrench = FORMS["form3"], HOVER + [0.0, 0.0, 0.0, 0.0, 0.0, 1.5]
    heavy = with_blocks(lambda block: JointTorqueEffort(10.0) if isinstance(block, JointTorqueEffort) else block)
    tight = with_blocks(lambda block: JointTorqueLimit(1.0) if isinstance(block, JointTorqueLimit) else block)
    answers = [settled(ThrustAllocator(period=math.inf, modes=modes), q, wrench) for modes in (None, heavy, tight)]
    (thrust, torque), (_, dear), (_, bounded) = (
        (float((t**2).sum()), np.abs(allocation.joint_torques)) for t, _, allocation in answers
    )
    assert np.linalg.norm(dear) < 0.8 * np.linalg.norm(torque)
    assert float((answers[1][0] ** 2).sum()) > thrust
    assert torque.max() > 1.2
    assert bounded.max() == pytest.approx(1.0, abs=1e-6)
    for _, _, allocation in answers:
        np.testing.assert_allclose(allocation.wrench, wrench, atol=1e-6)
    with pytest.raises(InvalidValueError, match="flight and flight_unrestricted among them"):
        ThrustAllocator(modes={"flight": heavy["flight"]})
