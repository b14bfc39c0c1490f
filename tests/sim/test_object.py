"""Pins the free object: mass, shape, friction and inertia in the engine, and the jets on it; robots do not notice."""

import math

import mujoco
import numpy as np
import pytest

from spidar_gym.errors import InvalidValueError
from spidar_gym.native.formulas import evaluate_air
from spidar_gym.native.plant import Plant
from spidar_gym.robot import GRAVITY
from spidar_gym.sim.config import PlantConfig
from spidar_gym.sim.disturbances import Disturbances
from spidar_gym.sim.ground import GroundConfig
from spidar_gym.sim.object import SHAPES, ObjectConfig
from spidar_gym.so3 import quat_to_matrix
from spidar_gym.state import Command

STILL = Command(np.zeros(8), np.zeros((8, 2)), np.zeros(16), np.full(16, 7.0))
LEVEL = (1.0, 0.0, 0.0, 0.0)
REAL = SHAPES[1:]
SIZE = np.array([0.3, 0.2, 0.25])


def plant_with(*, ground: GroundConfig | None = None, **thing) -> Plant:
    return Plant(PlantConfig(object=ObjectConfig(**{"half_size": SIZE, **thing}), ground=ground or GroundConfig()))


def placed(plant: Plant, position, quat=LEVEL, robot=(0.0, 0.0, 1.5)):
    plant.reset(np.array(robot), object_pose=np.array([*position, *quat]))
    return plant


def steps(plant: Plant, ticks: int):
    for _ in range(ticks):
        plant.step(STILL)
    return plant.object()


@pytest.mark.parametrize("shape", REAL)
def test_the_surface_is_closed_and_encloses_the_volume(shape):
    patches = ObjectConfig(shape=shape, half_size=SIZE).patches
    place, normal, area = patches[:, :3], patches[:, 3:6], patches[:, 6]
    volume = {"box": 8 * math.prod(SIZE), "cylinder": math.pi * 0.09 * 0.5, "ball": 4 / 3 * math.pi * 0.027}[shape]
    assert np.linalg.norm(normal, axis=1) == pytest.approx(1.0)
    assert area @ normal == pytest.approx(np.zeros(3), abs=1e-12)
    # ∫ x·n dA = 3 V; ∫ x × n dA = 0
    assert np.einsum("k,ki,ki", area, place, normal) == pytest.approx(3 * volume, rel=2e-3)
    assert area @ np.cross(place, normal) == pytest.approx(np.zeros(3), abs=1e-12)


@pytest.mark.parametrize("shape", REAL)
def test_it_falls_rests_and_weighs(shape):
    plant = plant_with(shape=shape, mass=2.5, pressure=0.0)
    half = float(plant.config.object.scale[2])
    falling = steps(placed(plant, (3.0, 0.0, half + 2.0)), 20)
    assert falling.velocity_w[2] == pytest.approx(-GRAVITY * 0.5)
    assert falling.floor_force_w == pytest.approx(np.zeros(3))
    resting = steps(plant, 100)
    assert resting.position_w == pytest.approx([3.0, 0.0, half], abs=2e-3)
    assert resting.floor_force_w == pytest.approx([0.0, 0.0, 2.5 * GRAVITY], abs=0.05)
    assert not resting.is_hit
    assert not resting.foot_force_w.any()


@pytest.mark.parametrize("shape", REAL)
def test_it_turns_as_a_body_of_an_independent_model(shape):
    com, factor, mass = np.array([0.05, -0.03, 0.02]), 1.4, 3.0
    plant = plant_with(shape=shape, mass=mass, com=com, inertia=factor, pressure=0.0)
    placed(plant, (3.0, 0.0, 4.0))
    plant.model.opt.gravity[:] = 0.0
    twist = np.array([0.4, -0.3, 0.8, 2.0, -1.5, 1.0])
    plant.data.qvel[38:] = twist
    spec = mujoco.MjSpec()
    spec.option.timestep, spec.option.gravity = 1e-4, [0, 0, 0]
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_RK4
    body = spec.worldbody.add_body(pos=[3.0, 0.0, 4.0])
    body.add_freejoint()
    kind = {"box": mujoco.mjtGeom.mjGEOM_BOX, "cylinder": mujoco.mjtGeom.mjGEOM_CYLINDER,
            "ball": mujoco.mjtGeom.mjGEOM_SPHERE}[shape]  # fmt: skip
    size = {"box": SIZE, "cylinder": [0.3, 0.25, 0.0], "ball": [0.3, 0.0, 0.0]}[shape]
    solid = body.add_geom(type=kind, size=size, mass=mass)
    alone = spec.compile()
    moments = alone.body_inertia[1] * factor
    solid.mass = 0.0
    body.explicitinertial, body.mass, body.ipos, body.inertia = True, mass, com, moments
    alone = spec.compile()
    data = mujoco.MjData(alone)
    data.qvel[:] = twist
    mujoco.mj_step(alone, data, 5000)
    seen = steps(plant, 20)
    assert seen.position_w == pytest.approx(data.qpos[:3], abs=2e-3)
    assert quat_to_matrix(seen.quat_wo) == pytest.approx(quat_to_matrix(data.qpos[3:]), abs=5e-3)


@pytest.mark.parametrize(("slope", "slides"), [(0.36, False), (0.42, True)])
def test_friction_holds_it_up_to_its_angle(slope, slides):
    plant = plant_with(shape="box", friction=0.4, ground=GroundConfig(slope=slope))
    R = plant.config.ground.R_wf
    tilt = np.array([math.cos(slope / 2), 0.0, -math.sin(slope / 2), 0.0])
    assert quat_to_matrix(tilt) == pytest.approx(R)
    placed(plant, R @ (3.0, 0.0, 0.25), tilt)
    plant.model.opt.impratio = 10
    way = np.linalg.norm(steps(plant, 40).position_w - R @ (3.0, 0.0, 0.25))
    assert (way > 0.05) == slides


def test_jets_lose_their_momentum_on_it():
    # Two ducts of one outer module, 20 N, over the middle of a box that is wider than their jets.
    thing, thrust = ObjectConfig(shape="box", half_size=np.array([0.4, 0.4, 0.2])), np.zeros(8)
    thrust[1] = 20.0
    plant = Plant(PlantConfig(object=thing))
    placed(plant, (0.0, 0.0, 0.2), robot=(0.0, 0.0, 2.0))
    x, y, z = plant.data.xpos[plant.model.body("gimbal2_pitch_module").id].tolist()
    for gap in (0.3, 0.5):
        placed(plant, (x + 0.03, y, z - gap - 0.2), robot=(0.0, 0.0, 2.0))
        air = evaluate_air(
            plant._engine.simulations[0], thrust, wind_w=np.zeros(3), noise=np.zeros(8), push_w=np.zeros(3), thing=thing
        )
        assert air.object_force_w == pytest.approx([0.0, 0.0, -20.0], abs=1.0)
        # About its origin: the jets press 0.03 m beside the middle.
        assert air.object_torque_w == pytest.approx([0.0, -0.03 * 20.0, 0.0], abs=0.1)


def test_wind_presses_with_the_dynamic_pressure_on_the_front():
    for shape, share in (("box", 1.0), ("cylinder", None), ("ball", 0.5)):
        thing = ObjectConfig(shape=shape, half_size=SIZE, pressure=1.1)
        plant = Plant(PlantConfig(object=thing))
        placed(plant, (8.0, 0.0, 0.3))
        air = evaluate_air(
            plant._engine.simulations[0],
            np.zeros(8),
            wind_w=np.array([5.0, 0.0, 0.0]),
            noise=np.zeros(8),
            push_w=np.zeros(3),
            thing=thing,
        )
        front = {"box": 0.4 * 0.5, "cylinder": 0.6 * 0.5, "ball": math.pi * 0.09}[shape]
        # Over a half circle ∫ cos³ is 2/3 of the diameter; over a half ball cos² has the mean 1/2.
        share = 2.0 / 3.0 if share is None else share
        assert air.object_force_w[0] == pytest.approx(0.5 * 1.225 * 25.0 * 1.1 * front * share, rel=0.01)


def test_a_robot_far_from_it_does_not_notice():
    alone, accompanied = Plant(PlantConfig()), plant_with(shape="box")
    alone.reset(np.array([0.0, 0.0, 1.2]))
    placed(accompanied, (30.0, 0.0, 0.25), robot=(0.0, 0.0, 1.2))
    command = Command(np.full(8, 19.0), np.full((8, 2), 0.1), np.full(16, 0.2), np.full(16, 7.0))
    for _ in range(40):
        one, other = alone.step(command), accompanied.step(command)
    assert one.position_w.tobytes() == other.position_w.tobytes()
    assert one.joint_position.tobytes() == other.joint_position.tobytes()


def test_a_robot_on_it_stands_on_no_floor():
    plant = plant_with(shape="box", half_size=np.array([0.6, 0.6, 0.2]), mass=20.0)
    seen = steps(placed(plant, (0.0, 0.0, 0.2), robot=(0.0, 0.0, 0.62)), 80)
    weight = plant.config.body.total_mass * GRAVITY
    assert seen.is_hit  # pegs and torso rest on it
    assert not plant.in_contact or plant.touch().feet.any()
    assert seen.floor_force_w[2] > 20.0 * GRAVITY + 0.2 * weight


def test_a_saved_object_goes_on_bit_for_bit():
    plant = plant_with(shape="cylinder", mass=0.7)
    steps(placed(plant, (0.1, 0.0, 1.0), (0.9, 0.1, 0.3, 0.2), robot=(0.0, 0.0, 2.5)), 10)
    saved = plant.save()
    first = steps(plant, 20)
    plant.restore(saved)
    again = steps(plant, 20)
    assert first.position_w.tobytes() == again.position_w.tobytes()
    assert first.quat_wo.tobytes() == again.quat_wo.tobytes()


def test_other_objects_and_worlds_are_refused():
    for name, value in (("mass", 0.0), ("half_size", np.zeros(3)), ("friction", -1.0), ("pressure", math.nan)):
        with pytest.raises(InvalidValueError, match=name):
            ObjectConfig(shape="box", **{name: value})
    with pytest.raises(Exception, match="none, box, cylinder, ball"):
        ObjectConfig(shape="cone")
    plant = Plant(PlantConfig())
    with pytest.raises(InvalidValueError, match="kind of world"):
        plant.configure(PlantConfig(object=ObjectConfig(shape="box")))
    with pytest.raises(InvalidValueError, match="object"):
        plant.object()


def test_a_standing_object_is_left_out_of_the_simulation():
    # Far from the robot the floor's friction holds it; with a push of the air beyond it the object is simulated.
    plant = plant_with(shape="box", mass=1.0, half_size=np.array([0.25, 0.25, 0.2]))
    before = steps(placed(plant, (2.0, 0.0, 0.2), robot=(0.0, 0.0, 60.0)), 40)
    record = plant.record["object"]
    assert record["rests"]
    assert before.floor_force_w == pytest.approx([0.0, 0.0, GRAVITY] - before.air_force_w, abs=1e-9)
    after = steps(plant, 40)
    assert after.position_w.tobytes() == before.position_w.tobytes()
    plant.reset(
        np.array([0.0, 0.0, 60.0]), object_pose=np.array([2.0, 0.0, 0.2, *LEVEL]),
        rng=np.random.Generator(np.random.PCG64(0)), disturbances=Disturbances(wind=12.0),
    )  # fmt: skip
    away = steps(plant, 80)
    assert not record["rests"]
    assert np.linalg.norm(away.position_w[:2] - (2.0, 0.0)) > 0.05
