"""Pins servos and delays with non-nominal parameters, the values written into the model, and refusals."""

import math

import gymnasium
import mujoco
import numpy as np
import pytest
from support.plants import HIGH, VACUUM, command, floating, tumbled

from spidar_gym.errors import InvalidValueError
from spidar_gym.native.draws import to_numpy
from spidar_gym.native.plant import Plant
from spidar_gym.robot import JOINT_NAMES, ROBOT
from spidar_gym.sim.actuators import STICKING, ActuatorConfig
from spidar_gym.sim.config import PlantConfig
from spidar_gym.sim.disturbances import Disturbances
from spidar_gym.sim.randomize import randomize
from spidar_gym.sim.scene import TIMESTEP
from spidar_gym.sim.sensors import ENCODER_STEPS, SensorConfig
from spidar_gym.state import Command

OUTER_YAW = JOINT_NAMES.index("joint2_yaw")
SPIN = 0.3
"""A joint angle within its range [rad]."""


def loaded(plant: Plant, servo: str, torque: float, commanded: Command, seconds: float = 2.0):
    """State after a torque at one joint for `seconds`; the torque is internal, so the robot does not fly away."""
    dof = plant.model.joint(servo).dofadr[0]
    for _ in range(round(seconds / plant.period)):
        plant.data.qfrc_applied[dof] = torque
        state = plant.step(commanded)
    plant.data.qfrc_applied[dof] = 0.0
    return state


def setpoints(plant: Plant) -> np.ndarray:
    """Thrusts, and setpoints of joint and vectoring servos."""
    return plant.data.act.copy()


@pytest.mark.parametrize(
    ("substeps", "delay", "ticks"), [(1, 0.005, 2), (1, 0.040, 16), (1, 0.0262, 10), (1, 0.001, 0), (10, 0.05, 2)]
)
def test_a_delay_shifts_the_whole_motion_bit_for_bit_and_nothing_moves_before(substeps, delay, ticks):
    prompt = tumbled(floating(substeps=substeps), 30, 1)
    late = floating(substeps=substeps, delay=delay)
    rest = np.concatenate([late.data.qpos, late.data.qvel, late.data.act])
    motion = tumbled(late, 30, 1)
    assert np.array_equal(motion[:ticks], [rest] * ticks)
    assert np.array_equal(motion[ticks:], prompt[: 30 - ticks])
    assert not np.array_equal(prompt[0], prompt[1])


@pytest.mark.parametrize("delay", [0.0075, 0.0175])
def test_a_delay_within_a_control_period_arrives_within_it(delay):
    plant = floating(thrust_lag=0.03, delay=delay)
    thrust = plant.step(command(20.0)).thrust
    np.testing.assert_allclose(thrust, 20.0 * (1.0 - math.exp(-(0.025 - delay) / 0.03)), rtol=1e-9)


@pytest.mark.parametrize("common", [0.0, 0.01])
def test_the_vectoring_delay_comes_on_top_and_delays_the_vectoring_servos_alone(common):
    prompt, late = floating(substeps=1, delay=common), floating(substeps=1, delay=common, vectoring_delay=0.015)
    first, second = [], []
    for plant, kept in ((prompt, first), (late, second)):
        rng = np.random.default_rng(5)
        for _ in range(30):
            plant.step(command(rng.uniform(0, 15, 8), rng.uniform(-1, 1, 16), rng.uniform(-1, 1, (8, 2))))
            kept.append(setpoints(plant))
    first, second = np.array(first), np.array(second)
    assert np.array_equal(first[:, :24], second[:, :24])
    assert np.array_equal(first[:-6, 24:], second[6:, 24:])
    assert not second[:6, 24:].any()
    assert np.ptp(first[:, 24:], axis=0).min() > 0.01


def test_a_robot_with_a_delay_executes_every_command_in_turn():
    plant, commanded = floating(substeps=2, delay=0.0225), np.random.default_rng(6).uniform(0, 40, (40, 8))
    given = []
    for thrust in commanded:
        plant.step(command(thrust))
        given.append(plant.data.ctrl[:8].copy())
    # A delay of 9 physics steps: a command reaches the rotors in the middle of the fifth period.
    assert np.array_equal(given[4:], commanded[:-4])
    assert not np.any(given[:4])


@pytest.mark.parametrize("joint", ["joint1_pitch", "joint2_yaw"])
@pytest.mark.parametrize(("kp", "torque"), [(80.0, 1.0), (175.0, -2.0), (300.0, 3.0)])
def test_a_joint_under_a_torque_sags_by_the_torque_over_the_stiffness(joint, kp, torque):
    state = loaded(floating(joint_kp=kp), joint, torque, command())
    sag = state.joint_position[JOINT_NAMES.index(joint)]
    np.testing.assert_allclose(sag, torque / kp, rtol=2e-3)
    np.testing.assert_allclose(state.joint_torque[JOINT_NAMES.index(joint)], -torque, rtol=2e-3)


def test_the_stiffness_of_each_servo_has_its_own_factor():
    factors = np.linspace(0.85, 1.15, 16)
    for k in (0, 7, 15):
        state = loaded(floating(joint_kp=150.0, servo_stiffness=factors), JOINT_NAMES[k], 1.5, command())
        np.testing.assert_allclose(state.joint_position[k], 1.5 / (150.0 * factors[k]), rtol=5e-3)


@pytest.mark.parametrize("kp", [11.0, 15.0, 19.0])
def test_a_vectoring_angle_under_a_torque_sags_by_the_torque_over_its_stiffness(kp):
    for axis, name in enumerate(("gimbal3_roll", "gimbal3_pitch")):
        state = loaded(floating(vectoring_kp=kp), name, 0.5, command(), 1.0)
        np.testing.assert_allclose(state.vectoring[2, axis], 0.5 / kp, rtol=1e-3)


@pytest.mark.parametrize("factor", [0.9, 1.0, 1.1])
def test_the_setpoints_of_the_joints_move_faster_by_the_speed_factor(factor):
    plant = floating(joint_speed=0.5, joint_speed_factor=factor)
    for k in range(1, 41):
        state = plant.step(command(joints=1.0))
        np.testing.assert_allclose(setpoints(plant)[8:24], 0.5 * factor * 0.025 * k, rtol=1e-9)
    np.testing.assert_allclose(state.joint_velocity[OUTER_YAW], 0.5 * factor, rtol=0.01)


def test_servos_of_unequal_speeds_arrive_at_unequal_times():
    factors = np.linspace(0.6, 1.4, 16)
    plant, way = floating(substeps=1, joint_speed=0.5, joint_speed_factor=0.9, servo_speed=factors), 0.4
    arrivals = np.zeros(16)
    for k in range(1, 800):
        plant.step(command(joints=way))
        arrivals[(arrivals == 0) & (setpoints(plant)[8:24] >= way)] = k
    expected = way / (0.5 * 0.9 * factors) / TIMESTEP
    assert np.all((arrivals >= expected - 1e-6) & (arrivals < expected + 1.0 + 1e-6))
    assert arrivals.max() / arrivals.min() == pytest.approx(1.4 / 0.6, rel=0.01)


@pytest.mark.parametrize(("most", "limit", "reached"), [(5.5, 99.0, 5.5), (8.0, 99.0, 8.0), (5.5, 3.0, 3.0)])
def test_a_joint_servo_reaches_its_torque_and_no_more_and_obeys_a_lower_limit(most, limit, reached):
    plant = floating(joint_speed=10.0, substeps=1, max_joint_torque=most)
    torques = [plant.step(command(joints=1.0, limit=limit)).joint_torque for _ in range(100)]
    assert abs(np.abs(torques).max() - reached) < 1e-12


# Jitter and loss of commands.


def numbered(k: int) -> Command:
    """The k-th of different commands."""
    return command(1.0 + 0.01 * k, 1e-4 * k, 2e-4 * k, 5.0 + 1e-3 * k)


def executed(plant: Plant) -> np.ndarray:
    """Numbers of the commands that thrusts, joints, vectoring axes and torque limits execute; −1 before the first."""
    ctrl = plant.data.ctrl
    numbers = (ctrl[:8] - 1.0) / 0.01, ctrl[8:24] / 1e-4, ctrl[24:40] / 2e-4
    assert all(np.ptp(each) < 1e-6 for each in numbers)
    return np.rint([each[0] for each in numbers])


def test_a_lost_command_leaves_thrusts_joints_vectoring_and_torque_limits_as_they_were():
    plant, rng, last = floating(loss=0.3), np.random.default_rng(0), 0
    held = 0
    for k in range(1, 400):
        plant.step(numbered(k))
        lost = rng.random() < 0.3  # one draw for each command, from the plant's generator
        last, held = (last, held + 1) if lost else (k, held)
        if last:
            assert executed(plant).tolist() == [last] * 3
            assert plant.record["torque_limit"] == pytest.approx(np.full(16, 5.0 + 1e-3 * last), abs=1e-12)
    assert 80 < held < 160
    deaf = floating(loss=1.0)
    rest = setpoints(deaf)
    deaf.step(numbered(9))
    assert np.array_equal(setpoints(deaf), rest)


@pytest.mark.parametrize("vectoring_delay", [0.0, 0.0075])
def test_commands_with_jitter_arrive_in_order_within_their_bounds_and_none_overtakes_another(vectoring_delay):
    plant = floating(substeps=1, delay=0.01, jitter=0.02, vectoring_delay=vectoring_delay)
    shown, rng, dues = [], np.random.default_rng(0), [0]
    for k in range(600):
        plant.step(numbered(k))
        shown.append(executed(plant))
        # A command waits for the one before it, and acts from the physics step on at which it is due.
        dues.append(max(dues[-1], k + 4 + round(rng.uniform(0.0, 0.02) / TIMESTEP)))
        arrived = np.searchsorted(dues[1:], k + 1, side="right") - 1
        assert k < 40 or shown[-1][0] == arrived
    thrust, joints, vectoring = np.array(shown[40:]).T
    age = np.arange(40, 600) - thrust
    assert np.array_equal(thrust, joints)
    shift = round(vectoring_delay / TIMESTEP)
    assert np.array_equal(vectoring[shift:], thrust[: len(thrust) - shift])
    for order in (thrust, vectoring):
        assert np.all(np.diff(order) >= 0)
    # Delays of 10 … 30 ms, read after the step in which a command arrives.
    assert age.min() >= 3
    assert 9 < age.max() <= 11
    assert np.ptp(np.diff(thrust)) > 2


def test_the_mean_of_the_jitter_is_half_its_largest_value():
    """A period begins at the thrust x₀ and ends at x₁: the command c came T + τ log((x₁ − c) / (x₀ − c)) late."""
    lag, period = 0.03, 0.025
    plant = floating(thrust_lag=lag, jitter=0.02)
    late, before = [], plant.step(command(10.0)).thrust[0]
    for k in range(600):
        sent = 10.0 + 10.0 * (k % 2)
        after = plant.step(command(sent)).thrust[0]
        old = 10.0 + 10.0 * ((k - 1) % 2)  # the command before acts until this one arrives
        share = math.exp(-period / lag)
        # x₁ = c + (old − c) e^{−(T − d) / τ} + (x₀ − old) e^{−T / τ}
        late.append(period + lag * math.log((after - sent - (before - old) * share) / (old - sent)))
        before = after
    steps = np.array(late[1:]) / TIMESTEP
    np.testing.assert_allclose(steps, np.rint(steps), atol=1e-6)
    assert set(np.rint(steps)) == set(range(9))
    assert abs(steps.mean() * TIMESTEP - 0.01) < 0.001


def test_only_jitter_and_loss_draw_numbers_and_they_need_a_generator():
    for actuators, draws in (({}, 0), ({"jitter": 0.01}, 1), ({"loss": 0.1}, 1), ({"jitter": 0.01, "loss": 0.1}, 2)):
        plant, rng = floating(**actuators), np.random.default_rng(0)
        for _ in range(5):
            plant.step(command())
        rng.random(5 * draws)
        assert to_numpy(plant.record["generator"]).random() == rng.random()
    with pytest.raises(InvalidValueError, match=r"rng = None .* jitter or loss"):
        Plant(PlantConfig(actuators=ActuatorConfig(loss=0.1))).reset(HIGH)


@pytest.mark.parametrize("delays", [{"jitter": 0.8}, {"delay": 0.4, "vectoring_delay": 0.3, "jitter": 0.06}])
def test_a_jitter_with_more_pending_commands_than_fit_is_refused_also_as_a_range(delays):
    with pytest.raises(InvalidValueError, match=r"delay = .* and the jitter at most 0.75 s"):
        Plant(PlantConfig(actuators=ActuatorConfig(**delays)))
    ranges = {f"actuators.{name}": (0.0, value) for name, value in delays.items()}
    with pytest.raises(InvalidValueError, match=r"delay = .* and the jitter at most 0.75 s"):
        gymnasium.make("spidar_gym/Hover-v0", randomization=ranges)


# Play and friction of the vectoring axes.


@pytest.mark.parametrize(("axis", "name"), list(enumerate(["gimbal3_roll", "gimbal3_pitch"])))
def test_an_alternating_load_turns_a_vectoring_axis_through_its_play_where_the_servo_exerts_no_torque(axis, name):
    play, load = 0.02, 0.15
    plant, servo = floating(substeps=1, vectoring_backlash=play), mujoco_actuator(name)
    dof, angle, extremes, inside = plant.model.joint(name).dofadr[0], 0.0, [], 0
    for torque in (load, -load, load):
        for _ in range(400):
            plant.data.qfrc_applied[dof] = torque
            before, angle = angle, plant.step(command()).vectoring[2, axis]
            force = plant.data.actuator_force[servo]  # at the start of the step
            inside += abs(before) < play
            assert abs(force) < 1e-12 if abs(before) < play else abs(force) > 0.0
        extremes.append(angle)
    edge = play + load / ROBOT.vectoring_kp
    np.testing.assert_allclose(extremes, [edge, -edge, edge], rtol=2e-3)
    assert inside > 20


def mujoco_actuator(name: str) -> int:
    """Index of an actuator."""
    return Plant().model.actuator(name).id


def swung(refined: int, axis: int, name: str) -> np.ndarray:
    """Angles after every tick of an axis with play under a torque of 3 Hz, with smaller physics steps [mrad]."""
    plant, angles = floating(substeps=10 * refined, vectoring_backlash=0.01), []
    plant.model.opt.timestep = TIMESTEP / refined
    dof = plant.model.joint(name).dofadr[0]
    for k in range(80):
        plant.data.qfrc_applied[dof] = 0.1 * math.sin(2.0 * math.pi * 3.0 * k * 0.025)
        angles.append(plant.step(command()).vectoring[2, axis])
    return 1e3 * np.array(angles)


@pytest.mark.parametrize(("axis", "name"), list(enumerate(["gimbal3_roll", "gimbal3_pitch"])))
def test_the_motion_of_an_axis_with_play_hardly_depends_on_the_physics_step(axis, name):
    coarse, fine = swung(1, axis, name), swung(20, axis, name)
    assert np.ptp(fine) > 30.0
    # Play that is updated every 12.5 ms deviates by 2.1 mrad.
    assert np.sqrt(np.mean((coarse - fine) ** 2)) < 1.0


@pytest.mark.parametrize(("axis", "name"), list(enumerate(["gimbal3_roll", "gimbal3_pitch"])))
def test_dry_friction_holds_a_vectoring_axis_below_its_breakaway_torque(axis, name):
    friction, kp = 0.1, ROBOT.vectoring_kp
    held, moved = (
        loaded(floating(vectoring_friction=friction), name, torque, command(), 1.0).vectoring[2, axis]
        for torque in (0.08, 0.13)
    )
    assert held == pytest.approx(0.08 / (kp + STICKING), rel=1e-3)
    # Beyond the friction the servo's spring carries the rest; an axis with momentum stops a little farther.
    assert (0.13 - friction) / kp < moved < 0.4 * 0.13 / kp
    plant = floating(vectoring_friction=friction)
    for wanted, least in ((0.9 * friction / kp, 0.0), (3.0 * friction / kp, 2.0 * friction / kp)):
        for _ in range(40):
            reached = plant.step(command(vectoring=wanted)).vectoring[2, axis]
        # An axis with momentum stops beyond the edge of the band in which friction holds it.
        assert least - 0.05 * friction / kp < reached < least + 0.3 * friction / kp


@pytest.mark.parametrize(("axis", "name"), list(enumerate(["gimbal3_roll", "gimbal3_pitch"])))
def test_an_axis_held_by_friction_inside_its_play_does_not_ring_after_a_step_of_the_load(axis, name):
    plant, load, angles = floating(substeps=1, vectoring_backlash=0.01, vectoring_friction=0.05), 0.02, []
    dof = plant.model.joint(name).dofadr[0]
    for _ in range(200):
        plant.data.qfrc_applied[dof] = load
        angles.append(plant.step(command()).vectoring[2, axis])
    # Inside the play only the spring of the friction carries the load.
    assert angles[-1] == pytest.approx(load / STICKING, rel=0.01)
    assert np.ptp(angles[100:150]) < 0.01 * np.ptp(angles[:50])


def limp(joint: str) -> Command:
    """A command that holds all joints except for `joint`, which has no torque."""
    return command(limit=np.array([0.0 if name == joint else 7.0 for name in JOINT_NAMES]))


@pytest.mark.parametrize(("friction", "torque"), [(0.3, 0.2), (0.5, -0.45)])
def test_dry_friction_holds_a_joint_against_a_smaller_torque(friction, torque):
    free = loaded(floating(), "joint2_yaw", torque, limp("joint2_yaw")).joint_velocity[OUTER_YAW]
    held = loaded(floating(joint_friction=friction), "joint2_yaw", torque, limp("joint2_yaw"))
    assert abs(free) > 0.2
    assert abs(held.joint_velocity[OUTER_YAW]) < 0.02 * abs(free)


@pytest.mark.parametrize(("damping", "friction"), [(0.3, 0.0), (0.9, 0.0), (2.0, 0.0), (0.9, 0.1)])
def test_a_limp_joint_turns_at_the_torque_less_the_dry_friction_over_the_viscous_one(damping, friction):
    plant = floating(joint_damping=damping, joint_friction=friction)
    state = loaded(plant, "joint2_yaw", 0.2, limp("joint2_yaw"), 2.5 if damping > 0.5 else 3.0)
    np.testing.assert_allclose(state.joint_velocity[OUTER_YAW], (0.2 - friction) / damping, rtol=0.05)


@pytest.mark.parametrize("backlash", [0.005, 0.01])
@pytest.mark.parametrize("torque", [1.5, -3.0, 0.1])
def test_under_a_load_a_joint_with_play_rests_half_the_play_farther_than_one_without(backlash, torque):
    tight = loaded(floating(), "joint2_yaw", torque, command(), 3.0).joint_position[OUTER_YAW]
    loose = loaded(floating(backlash=backlash), "joint2_yaw", torque, command(), 3.0).joint_position[OUTER_YAW]
    np.testing.assert_allclose(loose - tight, math.copysign(backlash, torque), rtol=1e-3)


def test_within_its_play_a_joint_moves_from_edge_to_edge_and_stays_where_it_is_left():
    b, touch = 0.01, 0.2
    slack, tight = floating(backlash=b, q=np.full(16, SPIN)), floating(q=np.full(16, SPIN))
    commanded = command(joints=SPIN)
    for torque in (touch, -touch, touch):
        for plant, play in ((slack, b), (tight, 0.0)):
            state = loaded(plant, "joint2_yaw", torque, commanded, 4.0)
            edge = math.copysign(play + touch / ROBOT.joint_kp, torque)
            np.testing.assert_allclose(state.joint_position[OUTER_YAW] - SPIN, edge, rtol=5e-3)
            left = loaded(plant, "joint2_yaw", 0.0, commanded)
            # The spring beyond the play's edge returns; the play itself has no restoring torque.
            away = left.joint_position[OUTER_YAW] - SPIN
            np.testing.assert_allclose(away, math.copysign(play, torque), rtol=0.02, atol=1e-6)
            assert abs(left.joint_torque[OUTER_YAW]) < 1e-3


def test_a_setpoint_that_moves_within_the_play_hardly_moves_the_link():
    plant = floating(backlash=0.02)
    for _ in range(40):
        state = plant.step(command(joints=0.018))
    np.testing.assert_allclose(setpoints(plant)[8:24], 0.018, rtol=1e-9)
    assert np.abs(state.joint_position).max() < 0.2 * 0.018
    tight = floating()
    for _ in range(40):
        state = tight.step(command(joints=0.018))
    np.testing.assert_allclose(state.joint_position, 0.018, rtol=0.02)


def test_true_minus_indicated_is_the_offset_at_reset_and_in_motion_for_joints_and_vectoring_angles():
    rng = np.random.default_rng(7)
    joint, vectoring = rng.uniform(-0.02, 0.02, 16), rng.uniform(-0.01, 0.01, (8, 2))
    config = PlantConfig(
        sense=True,
        aero=VACUUM,
        actuators=ActuatorConfig(joint_offset=joint, vectoring_offset=vectoring),
        sensors=SensorConfig(factor=0.0, dropout=0.0),
    )
    plant = Plant(config)
    plant.model.opt.gravity[:] = 0.0
    q, angles = rng.uniform(-0.5, 0.5, 16), rng.uniform(-1.0, 1.0, (8, 2))
    state = plant.reset(HIGH, joint_position=q, vectoring=angles, rng=rng)
    np.testing.assert_allclose(state.joint_position - q, joint, rtol=0, atol=1e-15)
    np.testing.assert_allclose(state.vectoring - angles, vectoring, rtol=0, atol=1e-15)
    still = plant.step(command(joints=q, vectoring=angles))
    np.testing.assert_allclose(still.joint_position, state.joint_position, rtol=0, atol=1e-12)
    for _ in range(120):
        state = plant.step(command(joints=q + 0.1, vectoring=angles - 0.2))
        said = plant.measure()
    np.testing.assert_allclose(state.joint_position - (q + 0.1), joint, rtol=0, atol=1e-4)
    np.testing.assert_allclose(state.vectoring - (angles - 0.2), vectoring, rtol=0, atol=1e-4)
    half = 0.5 * ENCODER_STEPS + 1e-4
    assert np.all(np.abs(state.joint_position - said.joint_position - joint) < half[:16])
    assert np.all(np.abs((state.vectoring - said.vectoring - vectoring).reshape(-1)) < half[16:])
    assert np.abs(joint).max() > 2 * half[:16].max()


def arrays(model: mujoco.MjModel) -> dict[str, np.ndarray]:
    """All arrays of a model."""
    names = [name for name in dir(model) if not name.startswith("_")]
    return {name: value.copy() for name in names if isinstance(value := getattr(model, name), np.ndarray)}


DERIVED = {"actuator_acc0"}
"""Acceleration per unit force of an actuator, unused by the simulation and tested separately."""


def differing(plant: Plant, other: Plant) -> set[str]:
    """Names of the arrays in which two models differ."""
    one, two = arrays(plant.model), arrays(other.model)
    return {name for name, array in one.items() if not np.array_equal(array, two[name])}


@pytest.mark.parametrize("seed", range(3))
def test_the_nominal_configuration_overwrites_every_array_of_another_robot(seed):
    rng = np.random.default_rng(seed)
    strange, _ = randomize(PlantConfig(joint_speed=0.7), rng, 1.0)
    used, fresh = Plant(strange), Plant()
    used.reset(HIGH, disturbances=Disturbances(wind=3.0), rng=rng)
    tumbled(used, 5, 1)
    fresh.reset(HIGH)
    touched = differing(used, fresh)
    assert {"actuator_gear", "actuator_dynprm", "actuator_biasprm", "dof_damping", "dof_frictionloss"} <= touched
    used.configure(PlantConfig())
    used.reset(HIGH)
    assert differing(used, fresh) - DERIVED == set()
    assert np.array_equal(tumbled(used, 10, 1), tumbled(fresh, 10, 1))


def test_configuring_twice_is_configuring_once():
    config, _ = randomize(PlantConfig(), np.random.default_rng(9), 1.0)
    once, twice = Plant(config), Plant(config)
    twice.configure(config)
    for plant in (once, twice):
        plant.reset(HIGH, rng=np.random.default_rng(0))
    assert differing(once, twice) - DERIVED == set()


def test_what_mujoco_derives_from_the_gears_is_that_of_the_present_robot_too():
    config, _ = randomize(PlantConfig(), np.random.default_rng(9), 1.0)
    once, twice, back = Plant(config), Plant(config), Plant(config)
    twice.configure(config)
    back.configure(PlantConfig())
    assert differing(once, twice) & DERIVED == set()
    assert differing(back, Plant()) & DERIVED == set()


SCALARS = (
    "thrust_gain", "max_thrust", "thrust_lag", "spin_down", "thrust_noise", "delay", "vectoring_delay", "joint_kp",
    "joint_speed_factor", "max_joint_torque", "joint_friction", "joint_damping", "backlash", "vectoring_kp", "jitter",
    "loss", "vectoring_backlash", "vectoring_friction", "battery_spent",
)  # fmt: skip
SHARES = ("loss", "battery_spent")
NOT_NEGATIVE = (
    "thrust_noise", "delay", "vectoring_delay", "joint_friction", "joint_damping", "backlash", "jitter",
    "vectoring_backlash", "vectoring_friction", *SHARES,
)  # fmt: skip
ARRAYS = {
    "module_gain": (8,), "duct_imbalance": (8,), "thrust_tilt": (8, 2), "thrust_offset": (8, 2),
    "servo_stiffness": (16,), "servo_speed": (16,), "joint_offset": (16,), "vectoring_offset": (8, 2),
}  # fmt: skip


@pytest.mark.parametrize("name", SCALARS)
def test_an_invalid_number_is_refused(name):
    for value in (-0.1, math.nan, math.inf, -math.inf):
        with pytest.raises(InvalidValueError, match=rf"{name} = .*expected (a number|a finite|finite)"):
            ActuatorConfig(**{name: value})
    if name in NOT_NEGATIVE:
        ActuatorConfig(**{name: 0.0})
    else:
        with pytest.raises(InvalidValueError, match=f"{name} = .*expected a number above 0"):
            ActuatorConfig(**{name: 0.0})


@pytest.mark.parametrize(("name", "shape"), ARRAYS.items())
@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_an_array_with_a_number_that_is_not_finite_is_refused(name, shape, value):
    array = np.ones(shape)
    array.flat[-1] = value
    with pytest.raises(InvalidValueError, match=rf"(?s){name} = .*expected finite numbers"):
        ActuatorConfig(**{name: array})


@pytest.mark.parametrize("name", SHARES)
def test_a_share_above_1_is_refused(name):
    ActuatorConfig(**{name: 1.0})
    with pytest.raises(InvalidValueError, match=rf"{name} = 1.1 .* within 0 … 1"):
        ActuatorConfig(**{name: 1.1})


@pytest.mark.parametrize("name", ["module_gain", "servo_stiffness", "servo_speed"])
def test_a_negative_factor_of_a_module_or_a_servo_is_refused(name):
    array = np.ones(ARRAYS[name])
    array[-1] = -1.0
    with pytest.raises(InvalidValueError, match=rf"(?s){name} = .*expected"):
        ActuatorConfig(**{name: array})


@pytest.mark.parametrize(("name", "shape"), ARRAYS.items())
def test_an_array_of_another_length_is_refused(name, shape):
    with pytest.raises(InvalidValueError, match=f"{name}"):
        Plant(PlantConfig(actuators=ActuatorConfig(**{name: np.ones((3, *shape[1:]))})))


def test_the_defaults_are_read_only():
    for name in ARRAYS:
        with pytest.raises(ValueError, match="read-only"):
            getattr(ActuatorConfig(), name)[0] = 0.5
