"""Pins the simulated robot: mechanics without and with contact, limits of the actuators, exact saving, refusals."""

import copy
import math
from dataclasses import asdict, fields, replace

import gymnasium
import mujoco
import numpy as np
import pytest
from support.episodes import same

import spidar_gym  # noqa: F401 - registers the environments
from spidar_gym.errors import InvalidValueError
from spidar_gym.robot import FORMS, GIMBAL_NAMES, GRAVITY, JOINT_NAMES, ROBOT
from spidar_gym.sim.actuators import ActuatorConfig
from spidar_gym.sim.air import AeroConfig
from spidar_gym.sim.disturbances import Disturbances
from spidar_gym.sim.plant import TIMESTEP, Plant, PlantConfig
from spidar_gym.so3 import exp, matrix_to_quat
from spidar_gym.state import Command, RobotState

HIGH = np.array([0.0, 0.0, 5.0])
ASKEW = matrix_to_quat(exp(np.array([0.2, -0.1, 0.3])))
VACUUM = AeroConfig(wake=False)
NOISE = ActuatorConfig(thrust_noise=0.3)
STORM = Disturbances(wind=4.0, push=30.0)
EVERYTHING = ActuatorConfig(
    thrust_noise=0.3, delay=0.0275, vectoring_delay=0.01, backlash=0.01, spin_down=0.6, battery=True,
    joint_friction=0.2, thrust_tilt=np.full((8, 2), 0.02), joint_offset=np.full(16, 0.01),
    vectoring_offset=np.full((8, 2), -0.01),
)  # fmt: skip
ODDITIES: dict[str, tuple[PlantConfig, Disturbances]] = {
    "vacuum": (PlantConfig(aero=VACUUM), Disturbances()),
    "wake": (PlantConfig(), Disturbances()),
    "noise": (PlantConfig(actuators=NOISE), Disturbances()),
    "delay": (PlantConfig(actuators=ActuatorConfig(delay=0.0325)), Disturbances()),
    "vectoring delay": (PlantConfig(actuators=ActuatorConfig(vectoring_delay=0.015)), Disturbances()),
    "backlash": (PlantConfig(actuators=ActuatorConfig(backlash=0.02)), Disturbances()),
    "spin-down": (PlantConfig(actuators=ActuatorConfig(spin_down=0.5), aero=VACUUM), Disturbances()),
    "battery": (PlantConfig(actuators=ActuatorConfig(battery=True)), Disturbances()),
    "wind": (PlantConfig(), Disturbances(wind=4.0)),
    "wind in a vacuum": (PlantConfig(aero=VACUUM), Disturbances(wind=4.0)),
    "pushes": (PlantConfig(), Disturbances(push=30.0)),
    "lost thrust": (PlantConfig(), Disturbances(lost_rotor=3, fault_time=0.1)),
    "lost vectoring": (PlantConfig(), Disturbances(lost_rotor=3, fault="vectoring", fault_time=0.05)),
    "sensors": (PlantConfig(sense=True), Disturbances()),
    "everything": (PlantConfig(substeps=7, sense=True, idle_thrust=1.2, actuators=EVERYTHING), STORM),
}
"""What a simulated moment can depend on, one thing at a time and all of it."""


def command(thrust=0.0, joints=0.0, vectoring=0.0, limit=7.0) -> Command:
    """A command; numbers stand for equal entries."""
    shapes = ((8,), (8, 2), (16,), (16,))
    values = (thrust, vectoring, joints, limit)
    return Command(*(np.broadcast_to(v, s).astype(float) for v, s in zip(values, shapes, strict=True)))


def floating(**config) -> Plant:
    """A plant at rest without gravity and air."""
    plant = Plant(PlantConfig(aero=VACUUM, **config))
    plant.model.opt.gravity[:] = 0.0
    plant.reset(HIGH)
    return plant


def momentum(plant: Plant) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """CoG, its velocity and the angular momentum about it, world axes, from all bodies."""
    data, torso = copy.copy(plant.data), plant.model.body("torso").id
    mujoco.mj_forward(plant.model, data)
    mujoco.mj_subtreeVel(plant.model, data)
    return data.subtree_com[torso].copy(), data.subtree_linvel[torso].copy(), data.subtree_angmom[torso].copy()


def tumbled(plant: Plant, ticks: int, seed: int = 0) -> list[np.ndarray]:
    """Drive the robot with random thrusts, joints and vectoring angles; the full state after every tick."""
    rng, states = np.random.default_rng(seed), []
    for _ in range(ticks):
        plant.step(command(rng.uniform(0, 15, 8), rng.uniform(-1, 1, 16), rng.uniform(-1, 1, (8, 2))))
        states.append(np.concatenate([plant.data.qpos, plant.data.qvel, plant.data.act]))
    return states


def dropped(**config) -> Plant:
    """A plant above the floor, askew, falling."""
    plant = Plant(PlantConfig(**({"aero": VACUUM} | config)))
    plant.reset(np.array([0.0, 0.0, 0.4]), ASKEW, FORMS["form1"])
    return plant


def odd(case: str) -> Plant:
    """A plant above the floor, askew, that what `case` names happens to."""
    config, disturbances = ODDITIES[case]
    plant = Plant(config)
    start = np.array([0.0, 0.0, 0.37])
    plant.reset(start, ASKEW, FORMS["form1"], disturbances=disturbances, rng=np.random.default_rng(5))
    if disturbances.push:
        plant.memory.weather.next_push = 0.1
    return plant


def witnessed(plant: Plant, ticks: int, seed: int = 0) -> list[np.ndarray]:
    """Drive the robot as `tumbled` does; everything that anybody sees of it after every tick."""
    seen = []
    for k in range(ticks):
        motion = tumbled(plant, 1, 100 * seed + k)[0]
        memory = plant.memory
        numbers = [memory.power, memory.energy_wh, plant.mean_power, plant.in_contact, plant.state().time]
        parts = [motion, plant.state().joint_torque, numbers, plant.thrust_factor, plant.air_force]
        if memory.sensors is not None:
            parts += [np.ravel(value) for value in asdict(plant.measure()).values()]
        seen.append(np.concatenate(parts))
    return seen


def touching(plant: Plant) -> set[str]:
    """Names of what touches the floor: the geom's, or its body's where it has none."""
    model = plant.model
    geoms = {int(g) for contact in plant.data.contact for g in contact.geom}
    names = {model.geom(g).name or model.body(model.geom_bodyid[g]).name for g in geoms}
    return names - {"floor"}


def test_the_simulated_robot_weighs_16_kg():
    plant = Plant()
    assert abs(plant.model.body("torso").subtreemass[0] - 16.0) < 1e-9
    assert abs(plant.model.body_subtreemass[0] - 16.0) < 1e-9


def test_without_thrust_the_cog_falls_by_half_g_t_squared_however_the_legs_move():
    plant = Plant(PlantConfig(aero=VACUUM))
    plant.reset(HIGH)
    start = momentum(plant)[0]
    legs = np.random.default_rng(1).uniform(-1, 1, 16)
    for _ in range(30):
        plant.step(command(joints=legs))
    time = plant.state().time
    end, velocity, _ = momentum(plant)
    assert abs(time - 0.75) < 1e-9
    assert np.abs(plant.state().joint_velocity).mean() > 0.1
    assert abs(end[2] - start[2] + 0.5 * GRAVITY * time**2) < 0.5 * GRAVITY * time * TIMESTEP * 1.01
    np.testing.assert_allclose(end[:2], start[:2], rtol=0, atol=1e-5)
    np.testing.assert_allclose(velocity, [0.0, 0.0, -GRAVITY * time], rtol=0, atol=1e-4)


def test_thrust_of_an_eighth_of_the_weight_each_keeps_the_height_for_a_second():
    plant = Plant(PlantConfig(aero=VACUUM))
    plant.reset(HIGH, thrust=np.full(8, ROBOT.hover_thrust))
    start = momentum(plant)[0]
    for _ in range(40):
        plant.step(command(ROBOT.hover_thrust))
    assert abs(momentum(plant)[0][2] - start[2]) < 1e-3


def test_moving_legs_leave_the_angular_momentum_about_the_cog_but_for_an_error_that_vanishes_with_the_time_step():
    def final(timestep):
        plant = Plant(PlantConfig(joint_speed=2.0, substeps=round(0.025 / timestep), aero=VACUUM))
        plant.model.opt.timestep = timestep
        plant.reset(HIGH)
        plant.data.qvel[3:6] = (0.3, -0.2, 0.4)
        before = momentum(plant)[2]
        for _ in range(20):
            plant.step(command(joints=np.random.default_rng(0).uniform(-1, 1, 16)))
        assert np.linalg.norm(plant.state().omega_b - (0.3, -0.2, 0.4)) > 0.1
        return before, momentum(plant)[2] - before

    before, coarse = final(TIMESTEP)
    _, fine = final(TIMESTEP / 2)
    assert np.linalg.norm(before) > 1.0
    assert np.linalg.norm(coarse) < 0.05 * np.linalg.norm(before)
    assert np.linalg.norm(2 * fine - coarse) < 0.002 * np.linalg.norm(before)


def test_thrust_has_come_63_percent_of_its_way_after_30_ms():
    plant = Plant(PlantConfig(substeps=12, aero=VACUUM))
    plant.reset(HIGH, thrust=np.full(8, 5.0))
    thrust = plant.step(command(25.0)).thrust
    np.testing.assert_allclose(thrust, 25.0 - 20.0 * math.exp(-1.0), rtol=1e-9)


@pytest.mark.parametrize(("idle", "told", "given"), [(0.0, 99.0, 42.0), (0.0, -9.0, 0.0), (1.2, 0.0, 1.2)])
def test_thrust_settles_within_idle_and_42_newton(idle, told, given):
    plant = Plant(PlantConfig(idle_thrust=idle))
    plant.reset(HIGH, thrust=np.full(8, 20.0))
    for _ in range(40):
        thrust = plant.step(command(told)).thrust
        assert thrust.max() <= 42.0
    np.testing.assert_allclose(thrust, given, rtol=0, atol=1e-9)


@pytest.mark.parametrize("speed", [0.2, 0.5])
def test_a_joint_moves_no_faster_than_the_joint_speed_and_follows_its_setpoint(speed):
    plant = floating(joint_speed=speed)
    legs = np.tile([1.0, 0.0, 0.0, 0.0], 4)
    for _ in range(40):
        state = plant.step(command(joints=legs))
    servo = plant.model.actuator("joint1_yaw").id
    setpoint = plant.data.act[plant.model.actuator_actadr[servo]]
    assert abs(setpoint - speed) < 1e-9
    lag = speed * (ROBOT.joint_kd + ROBOT.joint_damping) / ROBOT.joint_kp
    assert abs(setpoint - state.joint_position[0] - lag) < 0.1 * lag
    assert abs(state.joint_velocity[0] - speed) < 1e-3


def test_an_unsaturated_joint_servo_is_the_papers_pd_law():
    plant, rng = floating(), np.random.default_rng(4)
    servos = [plant.model.actuator(name).id for name in JOINT_NAMES]
    joints = [plant.model.joint(name) for name in JOINT_NAMES]
    for _ in range(20):
        targets = rng.uniform(-0.3, 0.3, 16)
        plant.step(command(joints=targets))
        setpoint = np.array([plant.data.act[plant.model.actuator_actadr[servo]] for servo in servos])
        # A servo moves its setpoint first, by what the joint speed allows in one physics step.
        setpoint += np.clip(targets - setpoint, -ROBOT.joint_speed * TIMESTEP, ROBOT.joint_speed * TIMESTEP)
        mujoco.mj_forward(plant.model, plant.data)
        q = np.array([plant.data.qpos[joint.qposadr[0]] for joint in joints])
        rate = np.array([plant.data.qvel[joint.dofadr[0]] for joint in joints])
        torque = ROBOT.joint_kp * (setpoint - q) - ROBOT.joint_kd * rate
        assert np.abs(torque).max() < ROBOT.max_joint_torque
        np.testing.assert_allclose(plant.data.actuator_force[servos], torque, atol=1e-9)
    assert np.abs(torque).max() > 0.1


@pytest.mark.parametrize("limit", [7.0, 2.0, 99.0])
def test_no_joint_torque_exceeds_its_limit_or_7_newton_metres_at_any_physics_step(limit):
    plant = floating(joint_speed=10.0, substeps=1)
    torques = [plant.step(command(joints=1.0, limit=limit)).joint_torque for _ in range(100)]
    assert abs(np.abs(torques).max() - min(limit, ROBOT.max_joint_torque)) < 1e-12


def test_each_joint_has_its_own_torque_limit():
    plant = floating(joint_speed=10.0, substeps=1)
    limits = np.linspace(0.5, 6.5, 16)
    torques = [plant.step(command(joints=1.0, limit=limits)).joint_torque for _ in range(100)]
    np.testing.assert_allclose(np.abs(torques).max(axis=0), limits, rtol=1e-12)


def test_a_torque_limit_that_is_written_in_place_is_obeyed_too():
    plant = floating(joint_speed=10.0)
    told = command(joints=1.0)
    plant.step(told)
    told.joint_torque_limit[:] = 2.0
    assert np.abs(plant.step(told).joint_torque).max() <= 2.0


def test_vectoring_turns_without_end_and_within_its_torque():
    plant = floating(substeps=1)
    plant.reset(HIGH)
    torque = 0.0
    for _ in range(1000):
        state = plant.step(command(vectoring=4 * math.pi))
        torque = max(torque, *(abs(plant.data.actuator(name).force[0]) for name in GIMBAL_NAMES))
    np.testing.assert_allclose(state.vectoring, 4 * math.pi, rtol=0, atol=1e-3)
    assert abs(torque - ROBOT.max_vectoring_torque) < 1e-12


def test_reset_puts_every_joint_and_rotor_where_it_was_asked_at_rest():
    rng = np.random.default_rng(2)
    q, vectoring, thrust = rng.uniform(-1, 1, 16), rng.uniform(-3, 3, (8, 2)), rng.uniform(0, 42, 8)
    plant = dropped()
    tumbled(plant, 3)
    state = plant.reset(HIGH, ASKEW, q, vectoring, thrust)
    for name, angle in zip((*JOINT_NAMES, *GIMBAL_NAMES), np.concatenate([q, vectoring.reshape(-1)]), strict=True):
        assert plant.data.joint(name).qpos[0] == angle
    assert np.array_equal(state.joint_position, q)
    assert np.array_equal(state.vectoring, vectoring)
    assert np.array_equal(state.thrust, thrust)
    assert state.time == 0.0
    assert not plant.data.qvel.any()


def test_a_state_handed_out_does_not_change_afterwards():
    plant = dropped()
    state = plant.state()
    before = copy.deepcopy(state)
    tumbled(plant, 3)
    assert not np.array_equal(plant.state().position_w, state.position_w)
    for field in fields(RobotState):
        assert np.array_equal(getattr(state, field.name), getattr(before, field.name)), field.name


@pytest.mark.parametrize("ticks", [3, 20])
def test_a_restored_plant_continues_bit_for_bit_in_the_air_and_on_the_floor(ticks):
    plant = dropped()
    tumbled(plant, ticks)
    assert plant.in_contact == (ticks == 20)
    plant.step(command(limit=3.0))
    saved = plant.save()
    ahead = tumbled(plant, 20, seed=1)
    other = dropped()
    for again in (plant, other):
        again.restore(saved)
        assert same(again.save(), saved)
        assert np.array_equal(tumbled(again, 20, seed=1), ahead)


def test_a_restored_plant_keeps_the_torque_limit_it_was_saved_with():
    plant = floating(joint_speed=10.0)
    plant.step(command(joints=1.0, limit=2.0))
    saved = plant.save()
    plant.step(command(joints=1.0, limit=7.0))
    plant.restore(saved)
    mujoco.mj_step(plant.model, plant.data)
    assert np.abs(plant.state().joint_torque).max() <= 2.0


@pytest.mark.parametrize("ticks", [3, 20])
def test_restoring_returns_the_state_that_was_saved(ticks):
    plant = dropped()
    tumbled(plant, ticks)
    state, saved = plant.state(), plant.save()
    tumbled(plant, 5, seed=1)
    restored = plant.restore(saved)
    for field in fields(RobotState):
        assert np.array_equal(getattr(restored, field.name), getattr(state, field.name)), field.name


def test_a_restored_plant_touches_the_floor_exactly_if_the_saved_one_did():
    plant, touched = dropped(substeps=1), []
    for _ in range(150):
        plant.step(command())
        touched.append(plant.in_contact)
        plant.restore(plant.save())
        assert plant.in_contact == touched[-1]
    assert 0 < sum(touched) < 150


@pytest.mark.parametrize("change", [lambda s: s[:-1], lambda s: np.append(s, 0.0), lambda s: s[None]])
def test_a_saved_state_of_another_length_is_refused(change):
    plant = dropped()
    saved = plant.save()
    with pytest.raises(InvalidValueError, match=f"{saved.state.size} numbers"):
        plant.restore(replace(saved, state=change(saved.state)))


@pytest.mark.parametrize("ticks", [3, 16])
@pytest.mark.parametrize("case", ODDITIES)
def test_a_restored_plant_continues_bit_for_bit_whatever_happens_to_it(case, ticks):
    plant = odd(case)
    witnessed(plant, ticks)
    saved = plant.save()
    kept = copy.deepcopy(saved)
    ahead = witnessed(plant, 8, seed=1)
    other = odd(case)
    for again in (plant, plant, other):
        again.restore(saved)
        assert same(again.save(), kept)
        assert np.array_equal(witnessed(again, 8, seed=1), ahead)
    assert same(saved, kept), "restoring writes nothing into what was saved"


def test_the_moments_that_are_restored_have_a_command_on_its_way_a_push_a_stuck_servo_and_a_contact():
    """Without these the test above would be easier than it looks."""
    plant = odd("everything")
    assert not plant.in_contact
    witnessed(plant, 3)
    assert plant.memory.pending
    assert plant.memory.clock % 5
    witnessed(plant, 6)
    assert plant.memory.weather.push_w.any()
    assert plant.memory.noise.any()
    assert plant.memory.falling.any()
    assert plant.memory.loose.any()
    for case in ("everything", "wake"):
        plant = odd(case)
        touched = False
        for k in range(16):
            witnessed(plant, 1, seed=k)
            touched |= plant.in_contact
        assert touched
    plant = odd("lost vectoring")
    witnessed(plant, 3)
    assert plant.memory.stuck is not None


@pytest.mark.parametrize("case", ["wind", "pushes", "lost thrust", "lost vectoring"])
def test_what_happens_to_the_robot_is_part_of_a_saved_moment_even_if_the_plant_was_reset_since(case):
    plant = odd(case)
    witnessed(plant, 2)
    saved = plant.save()
    ahead = witnessed(plant, 8, seed=1)
    plant.reset(HIGH)
    plant.restore(saved)
    assert np.array_equal(witnessed(plant, 8, seed=1), ahead)


@pytest.mark.parametrize("case", ODDITIES)
def test_a_reset_leaves_nothing_of_the_episode_before(case):
    config, disturbances = ODDITIES[case]
    used = odd(case)
    witnessed(used, 8)
    states = []
    for plant in (Plant(config), used):
        start, weather = np.array([0.0, 0.0, 0.5]), np.random.default_rng(9)
        state = plant.reset(start, ASKEW, FORMS["form2"], disturbances=disturbances, rng=weather)
        states.append([state, plant.save(), witnessed(plant, 8)])
    assert same(states[0], states[1])


@pytest.mark.parametrize("case", ["noise", "wind", "pushes", "sensors"])
def test_something_random_without_a_generator_is_refused(case):
    config, disturbances = ODDITIES[case]
    with pytest.raises(InvalidValueError, match="a generator, where there is noise, wind or pushes"):
        Plant(config).reset(HIGH, disturbances=disturbances)


def test_a_plant_without_sensors_has_nothing_to_measure():
    with pytest.raises(InvalidValueError, match=r"sense = False .*expected True"):
        dropped().measure()


def attentive(plant: Plant) -> Plant:
    """The same plant, but it looks for contacts at every step."""
    watch = plant._watch.enable
    plant._watch.enable = lambda _: watch(True)
    return plant


def fallen(plant: Plant, height: float, speed: float, ticks: int) -> list[np.ndarray]:
    """What is seen of a plant that starts at a height [m], falls at a speed [m/s] and kicks."""
    plant.reset(np.array([0.0, 0.0, height]), ASKEW, FORMS["form2"], rng=np.random.default_rng(1))
    plant.data.qvel[2] = -speed
    return witnessed(plant, ticks)


@pytest.mark.parametrize("case", ["vacuum", "wake", "everything"])
@pytest.mark.parametrize(("height", "speed", "ticks"), [(1.6, 0.0, 30), (1.2, 4.0, 12), (3.5, 9.0, 14)])
def test_not_looking_for_contacts_far_from_the_floor_changes_nothing(case, height, speed, ticks):
    config, _ = ODDITIES[case]
    ahead = fallen(Plant(config), height, speed, ticks)
    assert np.array_equal(fallen(attentive(Plant(config)), height, speed, ticks), ahead)


def test_a_robot_that_falls_at_11_metres_a_second_meets_the_floor_in_the_same_step_wherever_the_tick_begins():
    config, skipped = PlantConfig(aero=VACUUM), 0
    one, other = Plant(config), attentive(Plant(config))
    for height in np.linspace(1.5, 2.0, 14):
        ahead = fallen(one, height, 11.0, 5)
        assert np.array_equal(fallen(other, height, 11.0, 5), ahead)
        assert one.data.qvel[2] > -9.0, "it has met the floor"
        one.reset(np.array([0.0, 0.0, height]), ASKEW, FORMS["form2"])
        one.step(command())
        skipped += one.model.opt.disableflags & int(mujoco.mjtDisableBit.mjDSBL_CONTACT) > 0
    assert skipped > 0, "at least the highest starts need no look"


@pytest.mark.parametrize("substeps", [20, 40])
def test_a_longer_control_period_does_not_hide_the_floor(substeps):
    """5 m/s is the speed after a fall of 1.3 m."""
    config = PlantConfig(substeps=substeps, aero=VACUUM)
    one, other = Plant(config), attentive(Plant(config))
    for height in np.linspace(1.2, 1.7, 6):
        assert np.array_equal(fallen(one, height, 5.0, 4), fallen(other, height, 5.0, 4)), height


def test_a_robot_that_falls_from_high_touches_the_floor():
    plant = Plant()
    plant.reset(np.array([0.0, 0.0, 10.0]))
    touched = []
    for _ in range(80):
        state = plant.step(command())
        touched.append(plant.in_contact)
    assert any(touched)
    # √(2 h / g) in a vacuum from the lowest peg on; the air brakes a little.
    fall = math.sqrt(2.0 * (10.0 - 0.148) / GRAVITY)
    assert fall - 0.05 < touched.index(True) * plant.period < fall + 0.15
    assert np.isfinite(state.position_w).all()
    assert not plant.diverged


def test_the_default_robot_flies_in_air_and_the_vacuum_is_a_choice():
    plant = Plant()
    plant.reset(HIGH, thrust=np.full(8, ROBOT.hover_thrust))
    plant.step(command(ROBOT.hover_thrust))
    assert plant.memory.air is not None
    plant = Plant(PlantConfig(aero=VACUUM))
    plant.reset(HIGH, thrust=np.full(8, ROBOT.hover_thrust))
    plant.step(command(ROBOT.hover_thrust))
    assert plant.memory.air is None
    assert np.array_equal(plant.thrust_factor, np.ones(8))
    assert not plant.air_force.any()


@pytest.mark.parametrize("form", ["form1", "form3"])
def test_hovering_is_possible_in_air(form):
    env = gymnasium.make("spidar_gym/Hover-v0", forms=form, perturbation=0.0)
    env.reset(seed=0)
    factors = []
    for _ in range(80):
        *_, terminated, _, info = env.step(np.zeros(env.action_space.shape))
        factors.append(info["thrust_factor"])
        assert not terminated
    env.close()
    assert np.abs(np.array(factors) - 1.0).max() > 1e-4, "the air is there"
    assert np.linalg.norm(info["position_error"]) < 0.05
    assert np.linalg.norm(info["attitude_error"]) < 0.02


def test_a_robot_lowered_onto_the_floor_comes_to_rest_on_its_pegs():
    plant = Plant()
    plant.reset(np.array([0.0, 0.0, 0.16]), thrust=np.full(8, 15.0))
    assert not plant.in_contact
    for k in range(100):
        state = plant.step(command(max(0.0, 15.0 - 0.5 * k)))
    assert plant.in_contact
    assert touching(plant) == {f"peg{i}" for i in range(1, 9)}
    peg_tip = -ROBOT.yaw_axis_z - ROBOT.peg_top + ROBOT.peg_length
    assert abs(state.position_w[2] - peg_tip) < 1e-3
    assert np.abs(plant.data.qvel).max() < 1e-4


def test_feet_and_ducts_touch_the_floor_too():
    plant = Plant()
    plant.reset(np.array([0.0, 0.0, 1.02]), joint_position=np.tile([0.0, 0.0, 0.0, math.pi / 2], 4))
    assert not plant.in_contact
    plant.reset(np.array([0.0, 0.0, 0.56]), joint_position=np.tile([0.0, 0.0, 0.0, math.pi / 2], 4))
    assert touching(plant) == {f"foot{leg}" for leg in range(1, 5)}
    sideways = np.tile([math.pi / 2, 0.0], (8, 1))
    plant.reset(np.array([0.0, 0.0, 0.2]), vectoring=sideways)
    assert touching(plant) == {f"gimbal{i}_pitch_module" for i in range(1, 9)}


def test_sparse_and_dense_jacobians_give_the_same_motion_through_a_second_of_contact():
    trajectories, touched = [], []
    for kind in (mujoco.mjtJacobian.mjJAC_DENSE, mujoco.mjtJacobian.mjJAC_SPARSE):
        plant = dropped()
        plant.model.opt.jacobian = kind
        tumbled(plant, 14)
        touched.append(plant.in_contact)
        trajectories.append(tumbled(plant, 40, seed=1))
        touched.append(plant.in_contact)
    assert all(touched)
    np.testing.assert_allclose(*trajectories, rtol=0, atol=1e-9)


def test_a_state_that_is_no_number_is_reported_until_the_next_reset_or_restore(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # MuJoCo logs what it warns of in the working folder
    plant = dropped()
    tumbled(plant, 3)
    saved = plant.save()
    assert not plant.diverged
    for back in (lambda: plant.restore(saved), lambda: plant.reset(HIGH)):
        plant.data.qpos[9] = math.nan
        plant.step(command())
        assert plant.diverged
        back()
        assert not plant.diverged
        assert np.isfinite(plant.step(command()).position_w).all()


def test_two_plants_share_no_setting():
    slow, fast = Plant(), Plant(PlantConfig(joint_speed=1.0))
    fast.model.opt.gravity[:] = 0.0
    for plant in (slow, fast):
        plant.reset(HIGH)
        for _ in range(4):
            plant.step(command(joints=np.tile([1.0, 0.0, 0.0, 0.0], 4), limit=7.0 if plant is slow else 1.0))
    assert slow.model.opt.gravity[2] == -GRAVITY
    assert abs(slow.data.act[slow.model.actuator_actadr[slow.model.actuator("joint1_yaw").id]] - 0.02) < 1e-9
    assert abs(fast.data.act[fast.model.actuator_actadr[fast.model.actuator("joint1_yaw").id]] - 0.10) < 1e-9
    servo = slow.model.actuator("joint1_yaw").id
    assert slow.model.actuator_forcerange[servo, 1] == 7.0
    assert fast.model.actuator_forcerange[servo, 1] == 1.0


@pytest.mark.parametrize(
    ("name", "value"),
    [("substeps", 0), *(("joint_speed", v) for v in (0.0, -1.0, math.nan, math.inf)),
     *(("idle_thrust", v) for v in (-1.0, 42.1, math.nan))],
)  # fmt: skip
def test_a_plant_that_cannot_be_simulated_is_refused(name, value):
    with pytest.raises(InvalidValueError, match=f"{name} = .*expected"):
        PlantConfig(**{name: value})
