"""Pins boxes in the world: their contacts and hits, and their ground effect."""

import math
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from support.plants import VACUUM

from spidar_gym.control.crawl.footsteps import GaitConfig, lying_pose
from spidar_gym.control.locomotion.commands import FlyTo, Land, TakeOff
from spidar_gym.control.locomotion.manager import Manager
from spidar_gym.errors import InvalidValueError
from spidar_gym.native.bare import BarePhysics
from spidar_gym.native.engine_binding import Engine
from spidar_gym.native.engine_structs import engine_layouts
from spidar_gym.native.plant import Plant
from spidar_gym.native.structs import fill
from spidar_gym.robot import N_LEGS, ROBOT
from spidar_gym.robot.description import mjcf_path
from spidar_gym.sim.config import PlantConfig
from spidar_gym.sim.ground import BOXES, TILES, GroundConfig, with_boxes
from spidar_gym.sim.renderer import OffscreenRenderer
from spidar_gym.sim.scene import scene
from spidar_gym.state import Command
from spidar_gym.studies.hops import Trip, manager_config

LYING = lying_pose(GaitConfig())
STILL = Command(np.zeros(8), np.zeros((8, 2)), LYING, np.full(16, ROBOT.max_joint_torque))
PLATFORM = (0.0, 0.0, 0.15, 1.5, 1.5, 0.15, 0.0)
RAMP = (0.1, -0.2, 0.2, 2.0, 1.8, 0.1, 0.12)
BEAM = (0.0, 0.0, 1.3, 0.3, 3.0, 0.1, 0.0)


def state_of(robot: Plant) -> np.ndarray:
    """Return MuJoCo's state of a robot without an object, for which the row has more room."""
    size = mujoco.mj_stateSize(robot.model, mujoco.mjtState.mjSTATE_INTEGRATION)
    return np.array(robot.record["row"][:size])


def floor(*boxes):
    return with_boxes(GroundConfig(), boxes)


def plant(*boxes, **config):
    return Plant(PlantConfig(aero=VACUUM, ground=floor(*boxes), **config))


def fallen(robot, height, ticks=80):
    robot.reset(np.array([0.0, 0.0, height]), joint_position=LYING)
    states = [robot.step(STILL) for _ in range(ticks)]
    return np.array([np.concatenate([s.position_w, s.quat_wb, s.joint_position]) for s in states])


def compiled_by_mujoco(*boxes) -> mujoco.MjModel:
    """The same world with boxes compiled by MuJoCo."""
    spec = mujoco.MjSpec.from_file(str(mjcf_path()))
    for geom in list(spec.geoms):
        if geom.contype == 0 and geom.conaffinity == 0:
            spec.delete(geom)
    plane = spec.worldbody.add_geom(name="floor", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 0.05])
    plane.contype, plane.conaffinity, plane.friction = 1, 0, [0.01, 0.005, 0.0001]
    for x, y, z, a, b, c, pitch in boxes:
        box = spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, pos=[x, y, z], size=[a, b, c])
        box.quat = [math.cos(0.5 * pitch), 0.0, math.sin(0.5 * pitch), 0.0]
        box.contype, box.conaffinity, box.friction = 1, 0, plane.friction
    model = spec.compile()
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
    return model


@pytest.mark.parametrize("boxes", [(PLATFORM,), (RAMP,), (PLATFORM, (0.9, 0.2, 0.4, 0.3, 0.2, 0.1, 0.0))])
def test_contacts_are_those_of_mujocos_own_model_of_the_same_world(boxes):
    robot, model = plant(*boxes), compiled_by_mujoco(*boxes)
    robot.reset(np.array([0.0, 0.0, 0.6]), joint_position=LYING)
    data = mujoco.MjData(model)
    for name in ("actuator_gear", "actuator_dynprm", "actuator_biasprm", "actuator_gainprm", "actuator_forcerange",
                 "actuator_ctrlrange", "actuator_actrange", "dof_damping", "dof_frictionloss", "body_mass",
                 "body_inertia", "body_ipos"):  # fmt: skip
        getattr(model, name)[:] = getattr(robot.model, name)
    mujoco.mj_setConst(model, data)
    mujoco.mj_setState(model, data, state_of(robot), mujoco.mjtState.mjSTATE_INTEGRATION)
    touched = 0
    for _ in range(60):
        robot.step(STILL)
        for _ in range(10):
            data.ctrl[:] = robot.data.ctrl
            mujoco.mj_step(model, data)
        np.testing.assert_allclose(data.qpos, robot.data.qpos, rtol=0, atol=2e-6)
        touched += robot.in_contact
        assert (data.ncon > 0) == robot.in_contact
    assert touched > 20


def test_a_platform_carries_as_the_floor_does():
    low, high = fallen(plant(), 0.3), fallen(plant(PLATFORM), 0.6)
    np.testing.assert_allclose(high[:, 2] - 0.3, low[:, 2], rtol=0, atol=1e-4)
    assert high[-1, 2] == pytest.approx(0.3 + ROBOT.peg_depth, abs=2e-3)


def test_robots_of_one_engine_have_separate_boxes_and_empty_ones_are_ignored():
    heights = (0.05, 0.2, 0.35)
    config = PlantConfig(aero=VACUUM, ground=floor(PLATFORM))
    engine = Engine("plant", config, 3, 2, alike=False)
    configs, poses = np.zeros(3, engine_layouts()["plant_config"]), np.zeros(3, Plant(config)._pose.dtype)
    for k, h in enumerate(heights):
        box = (0.0, 0.0, h, 1.5, 1.5, h, 0.0)
        fill(configs[k], replace(config, ground=floor(box, *[(0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 0.0)] * (2 * k))))
        poses[k]["position_w"], poses[k]["quat_wb"][0], poses[k]["joint_position"] = [0.0, 0.0, 2 * h + 0.2], 1.0, LYING
    engine.configure(configs)
    engine.run("sp_reset_plants", None, poses)
    commands = np.zeros(3, engine_layouts()["command"])
    commands["joint_position"], commands["joint_torque_limit"] = LYING, ROBOT.max_joint_torque
    bare = BarePhysics(engine, 1)
    for _ in range(60):
        engine.run("sp_step_plants", None, commands)
    lying = engine.robots["state"]["position_w"][:, 2]
    np.testing.assert_allclose(lying, np.array(heights) * 2 + ROBOT.peg_depth, rtol=0, atol=2e-3)
    bare.take(engine)
    bare.step(4)
    for simulation, z in zip(bare._simulations, lying, strict=True):
        assert simulation.data.qpos[2] == pytest.approx(z, abs=1e-3)
    bare.close()
    engine.close()


def test_a_hit_is_a_contact_of_a_link_or_a_duct_and_not_of_feet_and_pegs():
    robot = plant(PLATFORM)
    fallen(robot, 0.45)
    assert robot.in_contact
    assert robot.touch().hit == 0.0
    # Thrown up against a beam that no foot reaches.
    robot = plant(BEAM)
    robot.reset(np.array([0.0, 0.0, 0.8]), joint_position=LYING)
    row = state_of(robot)
    robot.data.qvel[2] = 3.0
    mujoco.mj_getState(robot.model, robot.data, row, mujoco.mjtState.mjSTATE_INTEGRATION)
    robot.record["row"][: row.size] = row
    hits, pushes = [], []
    for _ in range(12):
        robot.step(STILL)
        hits.append(robot.touch().hit)
        pushes.append(robot.contact_forces()[:, 5].sum())
    assert max(hits) > 20.0
    assert hits[0] == 0.0
    assert min(pushes) <= 0.0  # a beam pushes down
    assert not robot.touch().feet.any()
    assert len(robot.touch().feet) == N_LEGS


def test_a_platform_has_the_ground_effect_of_the_floor_and_only_where_it_is():
    def factors(height, *boxes):
        robot, q = Plant(PlantConfig(ground=floor(*boxes))), np.zeros(16)
        robot.reset(np.array([0.0, 0.0, height]), joint_position=q, thrust=np.full(8, ROBOT.hover_thrust))
        robot.step(replace(STILL, thrust=np.full(8, ROBOT.hover_thrust), joint_position=q))
        return robot.thrust_factor

    over_floor, far = factors(0.15), factors(2.0)
    assert (over_floor > far + 0.02).all()
    np.testing.assert_allclose(factors(1.15, (0.0, 0.0, 0.5, 2.0, 2.0, 0.5, 0.0)), over_floor, rtol=0, atol=1e-9)
    beside, above = (5.0, 0.0, 0.5, 2.0, 2.0, 0.5, 0.0), (0.0, 0.0, 3.0, 2.0, 2.0, 0.5, 0.0)
    for none in (beside, above):
        np.testing.assert_allclose(factors(1.15, none), factors(1.15), rtol=0, atol=1e-12)
    half = factors(1.15, (1.0, 0.0, 0.5, 1.0, 2.0, 0.5, 0.0))  # under the two front legs
    front = np.isin(np.arange(8), (0, 1, 6, 7))
    np.testing.assert_allclose(half[front], over_floor[front], rtol=0, atol=0.01)
    np.testing.assert_allclose(half[~front], factors(1.15)[~front], rtol=0, atol=0.01)


def test_the_manager_lands_on_a_platform():
    box = (3.0, 0.0, 0.15, 1.5, 1.6, 0.15, 0.0)
    mission = Trip(0, ground=floor(box), manager=Manager(manager_config("tuned")))
    seen = mission.fly([TakeOff(0.8), FlyTo((3.0, 0.0, 1.0), speed=0.8), Land(floor=0.3)], 40.0)
    assert seen.phase[-1] == "lie"
    np.testing.assert_allclose(mission.state.position_w, [3.0, 0.0, 0.3 + ROBOT.peg_depth], rtol=0, atol=0.03)
    assert 0.0 < seen.touchdown < 0.35
    # The same where the platform is not on the map.
    mission = Trip(0, ground=floor(box))
    seen = mission.fly([TakeOff(0.8), FlyTo((3.0, 0.0, 1.0), speed=0.8), Land()], 40.0)
    assert mission.state.position_w[2] == pytest.approx(0.3 + ROBOT.peg_depth, abs=0.01)


def test_pictures_show_boxes():
    def picture(ground):
        renderer = OffscreenRenderer("front", 160, 120, ground)
        model = scene(visual=True)
        qpos = model.qpos0.copy()
        qpos[2] = 1.0
        drawn = renderer.render(qpos)
        renderer.close()
        return drawn

    bare, boxed = picture(GroundConfig()), picture(floor((-1.5, 0.0, 0.5, 0.1, 1.5, 0.5, 0.0)))
    assert (np.abs(bare.astype(int) - boxed).max(axis=2) > 20).mean() > 0.05


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: floor((0.0, 0.0, 0.0, -1.0, 1.0, 1.0, 0.0)), "half sizes from 0"),
        (lambda: floor((math.nan, 0.0, 0.0, 1.0, 1.0, 1.0, 0.0)), "boxes"),
        (lambda: floor((1e9, 0.0, 0.0, 1.0, 1.0, 1.0, 0.0)), "nothing beyond 100 m"),
        (lambda: floor(*[PLATFORM] * (BOXES + 1)), f"at most {BOXES}"),
        (lambda: replace(floor(PLATFORM), tiles=np.full((TILES, TILES), 0.01)), "either tiles or boxes"),
        (lambda: plant(PLATFORM).configure(PlantConfig(aero=VACUUM)), "the kind of world given at construction"),
        (lambda: plant().configure(PlantConfig(aero=VACUUM, ground=floor(PLATFORM))), "the kind of world"),
    ],
)
def test_an_invalid_box_is_refused(make, words):
    with pytest.raises(InvalidValueError, match=words):
        make()


SLAB = (1.6, -0.3, 0.9, 0.5, 0.7, 0.05, -0.5)
WALL = (-2.0, 0.0, 1.5, 0.2, 3.0, 1.5, 0.0)


def test_the_clearance_is_at_most_the_distance_to_the_floor_and_to_each_box():
    """MuJoCo measures the distances of the geoms."""
    robot, rng = plant(SLAB, WALL, BEAM), np.random.default_rng(0)
    model = robot.model
    solid = [g for g in range(model.ngeom) if model.geom_contype[g] > 0]
    parts = [g for g in range(model.ngeom) if model.geom_conaffinity[g] > 0]
    far = []
    for _ in range(40):
        position, turn = rng.uniform([-1.0, -1.5, 0.5], [4.0, 1.5, 4.0]), rng.normal(size=4)
        robot.reset(position, turn / np.linalg.norm(turn), rng.uniform(-1.0, 1.0, 16))
        apart = min(
            mujoco.mj_geomDistance(model, robot.data, one, two, 10.0, None)
            for one in solid[: 1 + 3] for two in parts
        )  # fmt: skip
        assert robot.record["clearance"] <= max(apart, 0.0) + 1e-9
        far.append((float(robot.record["clearance"]), apart))
    bounds, true = np.array(far).T
    assert (bounds[true > 1.0] > 0.5).all(), "the bound is no trivial one"
    assert (true > 1.0).sum() > 5
    assert (true < 0.0).any()


@pytest.mark.parametrize(
    ("box", "ahead"), [(BEAM, (0.1, 0.0, -1.0)), (SLAB, (0.4, 0.2, -0.9)), (WALL, (-1.0, 0.1, 0.1))],
    ids=["beam", "slab", "wall"],
)  # fmt: skip
def test_skipping_the_detection_of_contacts_far_from_boxes_changes_nothing(box, ahead):
    states, skipped = {}, 0
    direction = np.array(ahead) / np.linalg.norm(ahead)
    for looking in (False, True):
        robot = plant(box)
        for away in np.arange(0.5, 3.5, 0.2):
            robot.reset(np.array(box[:3]) - away * direction, joint_position=LYING)
            robot.data.qvel[:3] = 11.0 * direction
            for _ in range(4):
                if looking:
                    robot.record["clearance"] = 0.0
                robot.step(STILL)
                skipped += robot.model.opt.disableflags & int(mujoco.mjtDisableBit.mjDSBL_CONTACT) > 0
                states.setdefault(looking, []).append(np.concatenate([robot.data.qpos, robot.data.qvel]))
    np.testing.assert_array_equal(states[True], states[False])
    speeds = np.array(states[True])[:, 39:42] @ direction
    assert speeds.min() < 5.0, "some have met the box"
    assert speeds.max() > 10.5, "some have not yet"
    assert skipped > 5, "detection is skipped at least from the farthest starts"
