"""Pins the controller: residuals, synchronised joints, rate limits, memory, motion errors, form three."""

from dataclasses import fields, replace

import jaxtyping
import numpy as np
import pytest
from support.parts import segments
from support.states import model, random_joints, random_pose, resting, staying, upright

from spidar_gym.control.allocation.allocator import AllocationStatus, AllocatorConfig
from spidar_gym.control.flight.centroidal import CentroidalConfig, Integrals, MotionError, integrate
from spidar_gym.control.flight.controller import ControllerConfig, FlightController, motion_error
from spidar_gym.control.presets import PRESETS, TUNED, controller_config
from spidar_gym.errors import InvalidValueError, UnknownNameError
from spidar_gym.robot import FORMS, ROBOT
from spidar_gym.so3 import exp, matrix_to_quat, quat_to_matrix
from spidar_gym.state import NO_RESIDUAL, Residual

REACH = ROBOT.joint_speed / 40.0
"""Largest step of a joint command in one tick [rad]."""
HOVER = resting(FORMS["form2"])


def controller_at(state, **config):
    controller = FlightController(ControllerConfig(**config), model())
    controller.reset(state)
    return controller


def shaken(rng, state):
    """The state with small random errors in every measured quantity."""
    return replace(
        state,
        position_w=state.position_w + rng.normal(scale=0.02, size=3),
        quat_wb=matrix_to_quat(quat_to_matrix(state.quat_wb) @ exp(rng.normal(scale=0.02, size=3))),
        velocity_w=rng.normal(scale=0.05, size=3),
        omega_b=rng.normal(scale=0.05, size=3),
        joint_position=state.joint_position + rng.normal(scale=0.01, size=16),
        joint_velocity=rng.normal(scale=0.05, size=16),
        vectoring=state.vectoring + rng.normal(scale=0.02, size=(8, 2)),
    )


def same(a, b):
    return all(np.array_equal(getattr(a, f.name), getattr(b, f.name)) for f in fields(a))


def commands(controller, states, reference, *residual):
    return [controller.step(state, reference, *residual) for state in states]


def flight(seed, n):
    """States of `n` ticks around a hover, and a reference that changes the form."""
    rng = np.random.default_rng(seed)
    return [shaken(rng, HOVER) for _ in range(n)], staying(HOVER, joint_target=FORMS["form3"])


def test_a_residual_of_zeros_changes_no_bit():
    states, reference = flight(0, 15)
    omitted = commands(controller_at(HOVER), states, reference)
    for residual in (NO_RESIDUAL, Residual(), Residual(forces_l=np.zeros((8, 3)))):
        assert all(map(same, omitted, commands(controller_at(HOVER), states, reference, residual)))


def test_a_residual_changes_the_command():
    states, reference = flight(0, 3)
    plain = commands(controller_at(HOVER), states, reference)[-1]
    for residual, name in (
        (Residual(wrench=np.full(6, 0.1)), "thrust"),
        (Residual(joint_offset=np.linspace(0.01, 0.02, 16)), "joint_position"),
        (Residual(joint_speed_scale=0.5), "joint_position"),
        (Residual(forces_l=np.full((8, 3), 0.1)), "thrust"),
    ):
        changed = commands(controller_at(HOVER), states, reference, residual)[-1]
        assert not np.array_equal(getattr(changed, name), getattr(plain, name))


def test_residual_wrench_shifts_the_desired_wrench_exactly():
    rng = np.random.default_rng(1)
    for _ in range(10):
        state, added = shaken(rng, HOVER), rng.uniform(-5.0, 5.0, 6)
        plain, shifted = controller_at(HOVER), controller_at(HOVER)
        plain.step(state, staying(HOVER))
        shifted.step(state, staying(HOVER), Residual(wrench=added))
        np.testing.assert_array_equal(shifted.last_step.wrench_desired, plain.last_step.wrench_desired + added)


def test_a_hover_without_error_demands_the_weight_alone():
    for form in FORMS.values():
        state = resting(form)
        controller = controller_at(state)
        controller.step(state, staying(state))
        np.testing.assert_allclose(controller.last_step.wrench_desired, [0, 0, ROBOT.weight, 0, 0, 0], atol=1e-9)


def joint_motion(target, speed_scale, ticks, start=None):
    """Commanded joint angles of `ticks` ticks towards `target`, preceded by the start."""
    state = resting(FORMS["form1"] if start is None else start)
    controller, path = controller_at(state), [state.joint_position]
    reference, residual = staying(state, joint_target=target), Residual(joint_speed_scale=speed_scale)
    for _ in range(ticks):
        path.append(controller.step(state, reference, residual).joint_position)
        np.testing.assert_allclose(controller.last_step.joint_velocity / 40.0, path[-1] - path[-2], atol=1e-15)
    return np.array(path)


@pytest.mark.parametrize("scale", [0.5, 1.0])
def test_joints_move_on_a_straight_line_at_the_planned_speed_and_arrive_together(scale):
    rng = np.random.default_rng(2)
    start, target = rng.uniform(-0.2, 0.2, (2, 16))
    arrival = int(np.ceil(np.abs(target - start).max() / (scale * REACH)))
    path = joint_motion(target, scale, arrival + 5, start)
    share = (path - start) / (target - start)
    uniform = np.minimum(1.0, share[1, 0] * np.arange(arrival + 6))
    np.testing.assert_allclose(share, np.tile(uniform, (16, 1)).T, atol=1e-9)
    np.testing.assert_allclose(np.abs(np.diff(path[:arrival], axis=0)).max(axis=1), scale * REACH, rtol=1e-9)
    assert not np.array_equal(path[arrival - 1], path[arrival])
    np.testing.assert_allclose(path[arrival:], np.tile(target, (6, 1)), atol=1e-12)


@pytest.mark.parametrize("scale", [-2.0, 0.0, 0.3, 1.0, 1.5, 50.0])
def test_no_speed_scale_makes_a_joint_command_faster_than_the_joint_speed(scale):
    path = joint_motion(np.linspace(-1.4, 1.4, 16), scale, 20)
    assert np.abs(np.diff(path, axis=0)).max() <= REACH * (1.0 + 1e-9)
    assert np.abs(path[-1]).max() == pytest.approx(20 * REACH * min(1.0, abs(scale)))


def test_joint_commands_end_at_a_quarter_turn_whatever_the_target():
    near = np.tile([1.55, -1.55], 8)
    path = joint_motion(np.tile([3.0, -3.0], 8), 1.0, 10, near)
    np.testing.assert_allclose(path[-1], np.tile([np.pi / 2, -np.pi / 2], 8), atol=1e-12)
    assert np.abs(path).max() <= np.pi / 2


def test_vectoring_commands_never_move_faster_than_the_servos_and_always_move_on_from_the_last_one():
    rng = np.random.default_rng(3)
    state = resting(FORMS["form1"])
    controller, previous, fastest = controller_at(state), state.vectoring, 0.0
    for _ in range(50):
        q, R_wb = random_pose(rng)
        residual = Residual(wrench=rng.uniform(-60.0, 60.0, 6), forces_l=rng.uniform(-5.0, 5.0, (8, 3)))
        state = resting(q, R_wb, previous)
        vectoring = controller.step(state, staying(state), residual).vectoring
        fastest = max(fastest, np.abs(vectoring - previous).max())
        previous = vectoring
    assert 0.2 < fastest <= ROBOT.max_vectoring_speed / 40.0 + 1e-12


def spoiled(struct, name, value):
    array = getattr(struct, name).copy()
    array.flat[-1] = value
    return replace(struct, **{name: array})


def holds_and_forgets(spoil):
    """Assert that the last command is repeated while `spoil` changes (state, reference), without later effects."""
    states, reference = flight(4, 6)
    controller, undisturbed = controller_at(HOVER), controller_at(HOVER)
    last = commands(controller, states[:3], reference)[-1]
    for _ in range(3):
        held = controller.step(*spoil(states[3], reference))
        for f in fields(last):
            np.testing.assert_allclose(getattr(held, f.name), getattr(last, f.name), rtol=1e-14)
        assert controller.last_step.allocation.status == AllocationStatus.HELD
        assert not controller.last_step.joint_velocity.any()
    expected = commands(undisturbed, states, reference)[3:]
    assert all(map(same, commands(controller, states[3:], reference), expected))
    assert controller.last_step.allocation.status != AllocationStatus.HELD


NOT_FINITE = pytest.mark.parametrize("value", [np.nan, np.inf])


@NOT_FINITE
@pytest.mark.parametrize(
    "name", ["position_w", "quat_wb", "velocity_w", "omega_b", "joint_position", "joint_velocity", "vectoring"]
)
def test_a_state_that_is_not_finite_repeats_the_last_command_and_leaves_no_trace(name, value):
    holds_and_forgets(lambda state, reference: (spoiled(state, name, value), reference))


def test_a_reference_that_goes_bad_in_place_is_noticed_as_well():
    states, reference = flight(5, 2)
    controller = controller_at(HOVER)
    controller.step(states[0], reference)
    reference.position_w[2] = np.nan
    controller.step(states[1], reference)
    assert controller.last_step.allocation.status == AllocationStatus.HELD


@NOT_FINITE
@pytest.mark.parametrize("name", ["position_w", "quat_wb", "velocity_w", "omega_b", "joint_target"])
def test_a_reference_that_is_not_finite_repeats_the_last_command_and_leaves_no_trace(name, value):
    holds_and_forgets(lambda state, reference: (state, spoiled(reference, name, value)))


@NOT_FINITE
@pytest.mark.parametrize("name", ["wrench", "joint_offset", "joint_speed_scale", "forces_l"])
def test_a_residual_that_is_not_finite_is_left_out(name, value):
    states, reference = flight(4, 5)
    residual = Residual(wrench=np.ones(6), joint_offset=np.full(16, 0.01), forces_l=np.ones((8, 3)))
    residual = replace(residual, **{name: value}) if name == "joint_speed_scale" else spoiled(residual, name, value)
    controller, plain = controller_at(HOVER), controller_at(HOVER)
    given = commands(controller, states[:3], reference, residual) + commands(controller, states[3:], reference)
    assert all(map(same, given, commands(plain, states, reference)))


def test_a_missing_force_freezes_the_integral_along_its_world_axis():
    state = resting(FORMS["form1"], exp(np.array([0.0, 0.0, np.pi / 2])))  # the torso's x axis is the world's y axis
    controller, reference = controller_at(state), staying(state, quat_wb=state.quat_wb)
    reference = replace(reference, position_w=reference.position_w + np.array([0.0, 0.1, -0.1]))
    controller.step(state, reference, Residual(wrench=np.array([1000.0, 0.0, 0.0, 0.0, 0.0, 0.0])))
    assert controller.last_step.allocation.unallocated_wrench[0] > 100.0
    before = controller.memory.integrals.position_w
    controller.step(state, reference)
    _, y, z = controller.memory.integrals.position_w - before
    assert y == 0.0
    assert z == pytest.approx(-0.1 / 40.0)  # lift is missing too, but the reference is below the robot
    controller.step(state, reference)
    assert controller.memory.integrals.position_w[1] > before[1]


def test_reset_forgets():
    states, reference = flight(5, 10)
    used, fresh = controller_at(HOVER), controller_at(HOVER)
    commands(used, states, replace(reference, position_w=reference.position_w + 0.3))
    used.reset(HOVER)
    assert used.last_step is None
    assert all(map(same, commands(used, states, reference), commands(fresh, states, reference)))


def test_a_controller_without_reset_remembers():
    states, reference = flight(5, 3)
    used, fresh = controller_at(HOVER), controller_at(HOVER)
    commands(used, states, replace(reference, position_w=reference.position_w + 0.3))
    assert not same(used.step(states[0], reference), fresh.step(states[0], reference))


def test_two_controllers_on_one_model_do_not_disturb_each_other():
    states, reference = flight(6, 8)
    alone = commands(controller_at(HOVER), states, reference)
    one, other, other_state = controller_at(HOVER), controller_at(resting(FORMS["form1"])), resting(FORMS["form1"])
    for state, command in zip(states, alone, strict=True):
        other.step(other_state, staying(other_state))
        assert same(one.step(state, reference), command)


@pytest.mark.parametrize("name", ["joint_speed", "joint_torque_limit", "rate_hz"])
@pytest.mark.parametrize("value", [0.0, -1.0, np.nan, np.inf])
def test_speeds_and_limits_that_are_not_positive_are_refused_with_what_was_expected(name, value):
    with pytest.raises(InvalidValueError, match=f"{name}.*above 0"):
        ControllerConfig(**{name: value})


@pytest.mark.parametrize("value", [True, "", None, "whole"])
def test_an_unknown_motion_is_refused_with_the_valid_ones(value, monkeypatch):
    monkeypatch.setattr(jaxtyping.config, "jaxtyping_disable", True)  # users have no type checker
    with pytest.raises(UnknownNameError, match=r"complete, quasi_static, observed"):
        ControllerConfig(motion=value)


def test_unknown_names_are_refused_with_the_valid_ones():
    with pytest.raises(UnknownNameError, match=r"as flown.*paper, as_flown"):
        FlightController(ControllerConfig(allocation="as flown"), model())
    with pytest.raises(InvalidValueError, match="at least 1"):
        FlightController(ControllerConfig(allocator=AllocatorConfig(max_iter=0)), model())
    controller = controller_at(HOVER)
    with pytest.raises(UnknownNameError, match=r"walk.*flight"):
        controller.step(HOVER, staying(HOVER, mode="walk"))


def moving(t, q0, dq, R0, omega_b, velocity_w):
    """A state on a trajectory of moving joints and a turning, travelling torso."""
    q, R_wb = q0 + t * dq + 0.1 * t**2, R0 @ exp(t * omega_b)
    state = resting(q, R_wb, upright(q0, R0))
    return replace(state, position_w=t * velocity_w, velocity_w=velocity_w, omega_b=omega_b, joint_velocity=dq)


def error_at(state, reference):
    R_wb = quat_to_matrix(state.quat_wb)
    return motion_error(state, reference, model().snapshot(state.joint_position, R_wb, state.vectoring), R_wb)


def test_velocity_error_is_the_rate_of_the_position_error_along_a_trajectory_with_moving_joints():
    rng, h = np.random.default_rng(7), 1e-5
    for _ in range(10):
        q0, R0 = random_pose(rng)
        motion = (q0, rng.uniform(-1, 1, 16), R0, rng.uniform(-1, 1, 3), rng.uniform(-1, 1, 3))
        reference = staying(resting(q0))
        after, before = (error_at(moving(t, *motion), reference).position_w for t in (h, -h))
        velocity = error_at(moving(0.0, *motion), reference).velocity_w
        np.testing.assert_allclose((after - before) / (2 * h), velocity, atol=1e-7)


def test_a_quasi_static_controller_uses_the_velocity_error_of_a_robot_whose_joints_rest():
    rng = np.random.default_rng(17)
    for preset in ("paper", "retuned"):
        config = replace(controller_config(preset), motion="quasi_static")
        for _ in range(5):
            q, R_wb = random_pose(rng)
            state = resting(q, R_wb, omega_b=rng.normal(size=3), joint_velocity=rng.normal(size=16))
            controller, reference = FlightController(config, model()), staying(state)
            controller.reset(state)
            controller.step(state, reference)
            used, whole = controller.last_step.control_state.error, error_at(state, reference)
            rigid = error_at(replace(state, joint_velocity=np.zeros(16)), reference)
            np.testing.assert_allclose(used.velocity_w, rigid.velocity_w, rtol=0, atol=1e-14)
            assert np.abs(used.velocity_w - whole.velocity_w).max() > 1e-3
            for name in ("position_w", "attitude", "omega_b"):
                np.testing.assert_array_equal(getattr(used, name), getattr(whole, name))
            np.testing.assert_array_equal(controller.compute_state(state, reference).error.velocity_w, whole.velocity_w)


@pytest.mark.parametrize("preset", PRESETS)
def test_while_the_joints_rest_a_quasi_static_controller_computes_the_same_bits(preset):
    rng, config = np.random.default_rng(18), controller_config(preset)
    states = [replace(shaken(rng, HOVER), joint_velocity=np.zeros(16)) for _ in range(10)]
    answers = []
    for motion in ("complete", "quasi_static"):
        controller = FlightController(replace(config, motion=motion), model())
        controller.reset(HOVER)
        answers.append(commands(controller, states, staying(HOVER)))
    assert all(same(a, b) for a, b in zip(*answers, strict=True))


def test_an_observer_of_a_quasi_static_controller_sees_the_legs_momentum_as_a_force():
    rates = np.zeros((2, 16))
    rates[1, 1::4] = 0.5  # the inner pitch of every leg begins to turn
    forces, moved = [], 0.0
    for motion in ("complete", "quasi_static"):
        controller = FlightController(replace(TUNED, motion=motion), model())
        controller.reset(HOVER)
        for k in (0, 0, 1):
            state = replace(HOVER, joint_velocity=rates[k])
            controller.step(state, staying(HOVER))
        forces.append(controller.memory.compensation.external_w[2])
        snapshot = controller.last_step.control_state.snapshot
        moved = (snapshot.momentum_map[2] @ rates[1]) * 40.0
    share = 1.0 - np.exp(-1.0 / 40.0 / TUNED.compensation.observer_time)
    assert forces[0] - forces[1] == pytest.approx(share * moved, rel=1e-9)
    assert abs(moved) > 1.0


def test_position_error_is_that_of_the_centre_of_gravity_not_of_the_torso():
    rng = np.random.default_rng(8)
    for _ in range(5):
        state = resting(random_joints(rng), exp(rng.uniform(-0.5, 0.5, 3)), position_w=rng.uniform(-1, 1, 3))
        masses, centres_b, _ = segments(model(), state.joint_position, state.vectoring)
        com_w = state.position_w + quat_to_matrix(state.quat_wb) @ (masses @ centres_b) / masses.sum()
        error = error_at(state, staying(HOVER, position_w=np.array([1.0, 2.0, 3.0])))
        np.testing.assert_allclose(error.position_w, np.array([1.0, 2.0, 3.0]) - com_w, atol=1e-12)


def test_attitude_error_is_the_small_rotation_to_the_desired_attitude_in_torso_axes():
    rng = np.random.default_rng(9)
    for _ in range(10):
        R_wb, turn = exp(rng.uniform(-1, 1, 3)), rng.uniform(-0.01, 0.01, 3)
        state = resting(FORMS["form1"], R_wb, omega_b=rng.uniform(-1, 1, 3))
        desired = staying(HOVER, quat_wb=matrix_to_quat(R_wb @ exp(turn)), omega_b=rng.uniform(-1, 1, 3))
        error = error_at(state, desired)
        np.testing.assert_allclose(error.attitude, turn, atol=1e-6)
        rotated_w = R_wb @ exp(turn) @ desired.omega_b - R_wb @ state.omega_b
        np.testing.assert_allclose(R_wb @ error.omega_b, rotated_w, atol=1e-12)


def settled(form, preset):
    """Last tick, its command and the vectoring before it, of a hover whose rotors reach their commanded angles."""
    q, controller = FORMS[form], FlightController(ControllerConfig(allocation=preset), model())
    state = resting(q, vectoring=controller.rest_vectoring(q))
    controller.reset(state)
    for _ in range(30):
        last, command = state.vectoring, controller.step(state, staying(state))
        state = replace(state, vectoring=command.vectoring, thrust=command.thrust)
    return controller.last_step, command, last


def test_form_three_restricts_the_inner_rotors_and_tilts_them_by_four_tenths_of_a_radian():
    tick, command, _ = settled("form3", "as_flown")
    np.testing.assert_array_equal(np.flatnonzero(tick.demand.restricted) + 1, [1, 3, 5, 7])
    np.testing.assert_allclose(command.vectoring[::2, 0], 0.0, atol=0.01)
    np.testing.assert_allclose(command.vectoring[::2, 1], -0.403, atol=0.01)
    np.testing.assert_allclose(tick.allocation.joint_torques[1::4], 1.9, atol=0.15)


def test_form_three_costs_a_few_percent_more_thrust_than_the_flat_form():
    flat, stacked = (settled(form, "as_flown")[1].thrust.sum() for form in ("form1", "form3"))
    assert flat == pytest.approx(ROBOT.weight, rel=1e-3)
    assert 1.02 < stacked / flat < 1.06


@pytest.mark.parametrize("preset", ["paper", "as_flown"])
@pytest.mark.parametrize("form", FORMS)
def test_a_hover_in_each_form_of_the_paper_is_allocated_whole_and_comes_to_rest(form, preset):
    tick, command, last = settled(form, preset)
    assert tick.allocation.status in (AllocationStatus.CLOSED_FORM, AllocationStatus.SOLVED)
    assert np.abs(tick.allocation.unallocated_wrench).max() < 2e-3
    np.testing.assert_allclose(command.vectoring, last, atol=1e-4)


@pytest.mark.parametrize("form", FORMS)
def test_every_form_of_the_paper_can_exert_a_torque_about_every_axis(form):
    q = FORMS[form]
    for torque in np.vstack([np.eye(3), -np.eye(3)]):
        controller = FlightController(model=model())
        state = resting(q, vectoring=controller.rest_vectoring(q))
        controller.reset(state)
        controller.step(state, staying(state), Residual(wrench=np.concatenate([np.zeros(3), torque])))
        np.testing.assert_allclose(controller.last_step.allocation.unallocated_wrench, np.zeros(6), atol=2e-3)


# Lost rotors


def with_lost(form, preset, rotor, fault, turned=(0.0, 0.0), added=None):
    """Controller, command and state after a tick of a hover with a lost rotor; `turned` offsets its vectoring [rad]."""
    q, controller = FORMS[form], FlightController(controller_config(preset), model())
    vectoring = controller.rest_vectoring(q)
    vectoring[rotor] += turned
    state = resting(q, vectoring=vectoring)
    controller.reset(state)
    residual = NO_RESIDUAL if added is None else Residual(wrench=added)
    command = controller.step(state, staying(state, **{fault: np.arange(8) == rotor}), residual)
    return controller, command, state


def wrench_of(forces_l, state):
    """Force and torque about the CoG of forces at the rotors, torso axes, summed one by one."""
    snapshot = model().snapshot(state.joint_position, quat_to_matrix(state.quat_wb), state.vectoring)
    forces_b = [R @ f for R, f in zip(snapshot.R_bl, forces_l, strict=True)]
    torques = [np.cross(r, f) for r, f in zip(snapshot.rotor_c, forces_b, strict=True)]
    return np.concatenate([np.sum(forces_b, axis=0), np.sum(torques, axis=0)])


@pytest.mark.parametrize("preset", PRESETS)
@pytest.mark.parametrize("rotor", range(8))
def test_a_lost_rotor_has_no_thrust_and_the_other_seven_carry_form_two_with_torques_about_every_axis(rotor, preset):
    for added in (np.zeros(6), np.array([3.0, -3.0, 3.0, 0.5, 0.5, -0.5])):
        controller, command, state = with_lost("form2", preset, rotor, "lost_thrust", added=added)
        allocation = controller.last_step.allocation
        assert command.thrust[rotor] < 1e-9
        assert allocation.status in (AllocationStatus.CLOSED_FORM, AllocationStatus.SOLVED)
        wanted = np.array([0.0, 0.0, ROBOT.weight, 0.0, 0.0, 0.0]) + added
        np.testing.assert_allclose(wrench_of(allocation.forces_l, state), wanted, rtol=0, atol=2e-3)
        assert command.thrust.max() <= ROBOT.max_thrust
        assert np.abs(allocation.joint_torques).max() <= ROBOT.max_joint_torque + 1e-6 or preset == "as_flown"


def test_the_force_of_a_lost_rotor_is_exactly_zero():
    for form in FORMS:
        for rotor in range(8):
            controller, command, _ = with_lost(form, "paper", rotor, "lost_thrust")
            assert not controller.memory.forces_l[rotor].any(), (form, rotor)
            assert command.thrust[rotor] == 0.0


def test_a_lost_rotor_has_no_thrust_even_where_the_demand_cannot_be_met():
    controller, command, _ = with_lost("form2", "paper", 3, "lost_thrust", added=np.array([0, 0, 300.0, 0, 0, 0]))
    assert controller.last_step.allocation.status == AllocationStatus.SOFTENED
    assert command.thrust[3] < 1e-9
    assert np.delete(command.thrust, 3).min() > 10.0


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("rotor", range(8))
@pytest.mark.parametrize("turned", [(0.0, 0.0), (0.1, -0.15), (-0.2, 0.1)])
def test_a_stuck_rotor_thrusts_along_the_direction_in_which_it_is_stuck(turned, rotor, form):
    controller, command, state = with_lost(form, "paper", rotor, "lost_vectoring", turned)
    allocation = controller.last_step.allocation
    phi, theta = state.vectoring[rotor]
    stuck = np.array([np.sin(theta), -np.sin(phi) * np.cos(theta), np.cos(phi) * np.cos(theta)])
    force = allocation.forces_l[rotor]
    assert force @ stuck > 5.0
    # The stuck direction is a wedge of ± 0.01 rad.
    assert np.linalg.norm(np.cross(stuck, force)) <= 0.0101 * np.linalg.norm(force)
    np.testing.assert_allclose(command.vectoring[rotor], (phi, theta), rtol=0, atol=0.0101)
    assert allocation.status in (AllocationStatus.CLOSED_FORM, AllocationStatus.SOLVED)
    wanted = np.array([0.0, 0.0, ROBOT.weight, 0.0, 0.0, 0.0])
    np.testing.assert_allclose(wrench_of(allocation.forces_l, state), wanted, rtol=0, atol=2e-3)


def test_a_declared_fault_of_no_rotor_changes_no_bit():
    states, reference = flight(7, 5)
    none = replace(reference, lost_thrust=np.zeros(8, bool), lost_vectoring=np.zeros(8, bool))
    plain, declared = (commands(controller_at(HOVER), states, r) for r in (reference, none))
    assert all(map(same, plain, declared))


# Integrals


def moving_error(speed):
    return MotionError(np.array([0.3, -0.2, 0.1]), np.asarray(speed, float), np.array([0.1, 0.2, -0.3]), np.ones(3))


@pytest.mark.parametrize(
    ("speed", "held"),
    [((0.0, 0.0, 0.0), (False, False, False)), ((0.11, 0.0, 0.0), (True, False, False)),
     ((0.0, -0.11, 0.09), (False, True, False)), ((0.1, -0.1, 0.1), (False, False, False)),
     ((-5.0, 5.0, -0.2), (True, True, True))],
)  # fmt: skip
def test_a_position_axis_faster_than_the_limit_does_not_integrate_and_the_others_and_the_attitude_do(speed, held):
    before, none = Integrals(np.array([1.0, 2.0, 3.0]), np.array([4.0, 5.0, 6.0])), np.zeros(3)
    error = moving_error(speed)
    after = integrate(before, error, none, none, dt=0.025, max_speed=0.1)
    step = np.where(held, 0.0, 0.025 * error.position_w)
    np.testing.assert_allclose(after.position_w - before.position_w, step, rtol=0, atol=1e-12)
    np.testing.assert_allclose(after.attitude - before.attitude, 0.025 * error.attitude, rtol=0, atol=1e-12)


def test_without_a_limit_every_axis_integrates_however_fast_it_is():
    before, none = Integrals(np.zeros(3), np.zeros(3)), np.zeros(3)
    after = integrate(before, moving_error((9.0, -9.0, 9.0)), none, none, dt=0.025)
    np.testing.assert_allclose(after.position_w, [0.0075, -0.005, 0.0025], rtol=0, atol=1e-12)


@pytest.mark.parametrize(("limit", "held"), [(0.1, True), (0.3, False)])
def test_the_controller_integrates_no_axis_that_is_faster_than_its_configured_limit(limit, held):
    assert CentroidalConfig().max_integration_speed == 0.1
    state = resting(FORMS["form1"], velocity_w=np.array([0.2, 0.05, 0.0]))
    controller = controller_at(state, centroidal=CentroidalConfig(max_integration_speed=limit))
    reference = staying(state)
    controller.step(state, replace(reference, position_w=reference.position_w + 0.1))
    x, y, z = controller.memory.integrals.position_w
    assert x == pytest.approx(0.0 if held else 0.0025)
    assert (y, z) == pytest.approx((0.0025, 0.0025))
