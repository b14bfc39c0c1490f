"""Pins the simulated robot: mechanics without contact, limits of the actuators, air and vacuum, refusals."""

import copy
import math
from dataclasses import fields

import gymnasium
import mujoco
import numpy as np
import pytest
from support.plants import (
    ASKEW,
    HIGH,
    ODDITIES,
    VACUUM,
    command,
    dropped,
    tumbled,
    weightless,
)

import spidar_gym  # noqa: F401 - registers the environments
from spidar_gym.errors import InvalidValueError
from spidar_gym.native.plant import Plant
from spidar_gym.robot import GIMBAL_NAMES, GRAVITY, JOINT_NAMES, ROBOT
from spidar_gym.sim.config import PlantConfig
from spidar_gym.sim.scene import TIMESTEP
from spidar_gym.state import RobotState


def momentum(plant: Plant) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """CoG, its velocity and the angular momentum about it, world axes, from all bodies."""
    data, torso = copy.copy(plant.data), plant.model.body("torso").id
    mujoco.mj_forward(plant.model, data)
    mujoco.mj_subtreeVel(plant.model, data)
    return data.subtree_com[torso].copy(), data.subtree_linvel[torso].copy(), data.subtree_angmom[torso].copy()


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


def test_thrust_has_completed_63_percent_of_a_step_after_30_ms():
    plant = Plant(PlantConfig(substeps=12, aero=VACUUM))
    plant.reset(HIGH, thrust=np.full(8, 5.0))
    thrust = plant.step(command(25.0)).thrust
    np.testing.assert_allclose(thrust, 25.0 - 20.0 * math.exp(-1.0), rtol=1e-9)


@pytest.mark.parametrize(("idle", "commanded", "given"), [(0.0, 99.0, 42.0), (0.0, -9.0, 0.0), (1.2, 0.0, 1.2)])
def test_thrust_settles_within_idle_and_42_newton(idle, commanded, given):
    plant = Plant(PlantConfig(idle_thrust=idle))
    plant.reset(HIGH, thrust=np.full(8, 20.0))
    for _ in range(40):
        thrust = plant.step(command(commanded)).thrust
        assert thrust.max() <= 42.0
    np.testing.assert_allclose(thrust, given, rtol=0, atol=1e-9)


@pytest.mark.parametrize("speed", [0.2, 0.5])
def test_a_joint_moves_no_faster_than_the_joint_speed_and_follows_its_setpoint(speed):
    plant = weightless(joint_speed=speed)
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
    plant, rng = weightless(), np.random.default_rng(4)
    servos = [plant.model.actuator(name).id for name in JOINT_NAMES]
    joints = [plant.model.joint(name) for name in JOINT_NAMES]
    for _ in range(20):
        targets = rng.uniform(-0.3, 0.3, 16)
        plant.step(command(joints=targets))
        setpoint = np.array([plant.data.act[plant.model.actuator_actadr[servo]] for servo in servos])
        # A servo first slews its setpoint, at the joint speed for one physics step.
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
    plant = weightless(joint_speed=10.0, substeps=1)
    torques = [plant.step(command(joints=1.0, limit=limit)).joint_torque for _ in range(100)]
    assert abs(np.abs(torques).max() - min(limit, ROBOT.max_joint_torque)) < 1e-12


def test_each_joint_has_its_own_torque_limit():
    plant = weightless(joint_speed=10.0, substeps=1)
    limits = np.linspace(0.5, 6.5, 16)
    torques = [plant.step(command(joints=1.0, limit=limits)).joint_torque for _ in range(100)]
    np.testing.assert_allclose(np.abs(torques).max(axis=0), limits, rtol=1e-12)


def test_a_torque_limit_that_is_written_in_place_is_obeyed_too():
    plant = weightless(joint_speed=10.0)
    commanded = command(joints=1.0)
    plant.step(commanded)
    commanded.joint_torque_limit[:] = 2.0
    assert np.abs(plant.step(commanded).joint_torque).max() <= 2.0


def test_vectoring_turns_without_end_and_within_its_torque():
    plant = weightless(substeps=1)
    plant.reset(HIGH)
    torque = 0.0
    for _ in range(1000):
        state = plant.step(command(vectoring=4 * math.pi))
        torque = max(torque, *(abs(plant.data.actuator(name).force[0]) for name in GIMBAL_NAMES))
    np.testing.assert_allclose(state.vectoring, 4 * math.pi, rtol=0, atol=1e-3)
    assert abs(torque - ROBOT.max_vectoring_torque) < 1e-12


def test_reset_places_every_joint_and_rotor_as_requested_at_rest():
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


def test_a_returned_state_does_not_change_afterwards():
    plant = dropped()
    state = plant.state()
    before = copy.deepcopy(state)
    tumbled(plant, 3)
    assert not np.array_equal(plant.state().position_w, state.position_w)
    for field in fields(RobotState):
        assert np.array_equal(getattr(state, field.name), getattr(before, field.name)), field.name


@pytest.mark.parametrize("case", ["noise", "wind", "pushes", "sensors"])
def test_something_random_without_a_generator_is_refused(case):
    config, disturbances = ODDITIES[case]
    with pytest.raises(InvalidValueError, match="a generator, where there is noise, wind, pushes"):
        Plant(config).reset(HIGH, disturbances=disturbances)


def test_a_plant_without_sensors_has_nothing_to_measure():
    with pytest.raises(InvalidValueError, match=r"sense = False .*expected True"):
        dropped().measure()


def test_the_default_robot_flies_in_air_and_the_vacuum_is_a_choice():
    plant = Plant()
    plant.reset(HIGH, thrust=np.full(8, ROBOT.hover_thrust))
    plant.step(command(ROBOT.hover_thrust))
    assert plant.record["has_air"]
    plant = Plant(PlantConfig(aero=VACUUM))
    plant.reset(HIGH, thrust=np.full(8, ROBOT.hover_thrust))
    plant.step(command(ROBOT.hover_thrust))
    assert not plant.record["has_air"]
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
    assert np.abs(np.array(factors) - 1.0).max() > 1e-4, "the air acts"
    assert np.linalg.norm(info["position_error"]) < 0.05
    assert np.linalg.norm(info["attitude_error"]) < 0.02


def test_a_state_that_is_not_finite_is_reported_until_the_next_reset_or_restore(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # MuJoCo logs its warnings in the working folder
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
