"""Pins the floor: slope, tiles, contacts, slip and clearance, and a flat floor bit for bit."""

import math
from dataclasses import replace

import mujoco
import numpy as np
import pytest

from spidar_gym.control.crawl.footsteps import GaitConfig, lying_pose
from spidar_gym.errors import InvalidValueError
from spidar_gym.native.plant import Plant
from spidar_gym.robot import FOOT_SITES, FORMS, N_LEGS, PEG_SITES, ROBOT, ROTOR_SITES
from spidar_gym.sim.actuators import ActuatorConfig
from spidar_gym.sim.air import AeroConfig
from spidar_gym.sim.config import PlantConfig
from spidar_gym.sim.ground import TILE, TILE_DEPTH, TILES, GroundConfig, uneven, with_blocks
from spidar_gym.sim.scene import scene
from spidar_gym.so3 import exp, matrix_to_quat
from spidar_gym.state import Command

VACUUM = AeroConfig(wake=False)
LYING = lying_pose(GaitConfig())
SLOPES = [(0.0, 0.0), (0.3, 0.0), (0.2, 2.5), (-0.25, 1.0)]


def tiles(seed=0, highest=0.06):
    return np.random.default_rng(seed).uniform(0.0, highest, (TILES, TILES))


def plant_on(**ground) -> Plant:
    return Plant(PlantConfig(aero=VACUUM, ground=GroundConfig(**ground)))


def off(q=LYING) -> Command:
    return Command(np.zeros(8), np.zeros((8, 2)), q, np.full(16, 7.0))


def centre_of(i, j):
    """Centre of a tile, floor axes."""
    return np.array([(i + 0.5 - TILES / 2) * TILE, (j + 0.5 - TILES / 2) * TILE])


def moved(plant, position_w, R_wb, q=LYING, vectoring=None):
    """Simulation data of the robot placed at rest."""
    plant.reset(position_w, matrix_to_quat(R_wb), q, vectoring)
    return plant.data


def random_pose(rng):
    """Attitude, joints and vectoring angles of a robot that stands, leans or has fallen on its back."""
    R_wb = exp(rng.uniform(-1.0, 1.0, 3) * rng.choice([0.1, 0.5, 3.0]))
    return R_wb, rng.uniform(-1.2, 1.2, 16), rng.uniform(-3.0, 3.0, (8, 2))


def duct_points(data, n=3000):
    """Points on the rims of the sixteen ducts, from the robot's dimensions and the thrust frames: (16, 2 n, 3)."""
    angle = np.linspace(0.0, 2.0 * math.pi, n, endpoint=False)
    ring = ROBOT.duct_radius * np.column_stack([np.cos(angle), np.sin(angle), 0.0 * angle])
    ducts = []
    for name in ROTOR_SITES:
        frame = data.site(name)
        for side in (1.0, -1.0):
            rims = [ring + (0.0, side * ROBOT.duct_offset_y, z) for z in ROBOT.duct_z]
            ducts.append(frame.xpos + np.concatenate(rims) @ frame.xmat.reshape(3, 3).T)
    return np.array(ducts)


def duct_centres(data):
    middle = sum(ROBOT.duct_z) / 2.0
    return np.array(
        [
            data.site(name).xpos + data.site(name).xmat.reshape(3, 3) @ (0.0, side * ROBOT.duct_offset_y, middle)
            for name in ROTOR_SITES
            for side in (1.0, -1.0)
        ]
    )


@pytest.mark.parametrize("heading", [0.0, 0.7, math.pi / 2, -2.2])
@pytest.mark.parametrize("slope", [0.0, 0.1, 0.6, -0.3])
def test_the_floor_rises_by_the_slope_in_its_heading_and_turns_no_other_way(slope, heading):
    R_wf = GroundConfig(slope=slope, heading=heading).R_wf
    ahead, aside = (
        np.array([math.cos(heading), math.sin(heading), 0.0]),
        np.array([-math.sin(heading), math.cos(heading), 0.0]),
    )
    climb = R_wf @ ahead
    assert math.atan2(climb[2], climb @ ahead) == pytest.approx(slope, abs=1e-12)
    np.testing.assert_allclose(R_wf @ aside, aside, atol=1e-12)
    # The normal leans back from where the floor rises.
    np.testing.assert_allclose(R_wf[:, 2], math.cos(slope) * np.array([0, 0, 1]) - math.sin(slope) * ahead, atol=1e-12)


@pytest.mark.parametrize("visual", [False, True])
@pytest.mark.parametrize("with_tiles", [False, True])
@pytest.mark.parametrize(("slope", "heading"), SLOPES)
def test_rays_meet_the_floor_at_its_height(slope, heading, with_tiles, visual):
    rng = np.random.default_rng(1)
    ground = GroundConfig(slope, heading, tiles()) if with_tiles else GroundConfig(slope, heading)
    plant = Plant(PlantConfig(ground=ground))
    model = scene(visual=True, uneven=with_tiles).__copy__() if visual else plant.model
    ground.apply(model)
    data = mujoco.MjData(model)
    data.qpos[:3] = ground.R_wf @ (0.0, 0.0, 50.0)
    mujoco.mj_kinematics(model, data)
    points_f = np.column_stack([rng.uniform(-2.3, 2.3, (300, 2)), np.full(300, 3.0)])
    # Away from the edges of the tiles, where the height is ambiguous.
    points_f = points_f[np.abs((points_f[:, :2] / TILE + 0.5) % 1.0 - 0.5).min(axis=1) > 0.01]
    hit, normal = np.zeros(1, np.int32), ground.R_wf[:, 2]
    heights = []
    for point_w in points_f @ ground.R_wf.T:
        heights.append(3.0 - mujoco.mj_ray(model, data, point_w, -normal, None, 1, -1, hit, None))
        assert model.geom_bodyid[hit[0]] == 0
    np.testing.assert_allclose(heights, ground.height(points_f), atol=1e-9)
    if with_tiles:
        inside = np.abs(points_f[:, :2]).max(axis=1) < 2.0
        assert np.unique(np.round(heights, 6)).size > 100
        np.testing.assert_allclose(np.array(heights)[~inside], -TILE_DEPTH, atol=1e-9)
    else:
        np.testing.assert_allclose(heights, 0.0, atol=1e-9)


@pytest.mark.parametrize("with_tiles", [False, True])
@pytest.mark.parametrize(("slope", "heading"), SLOPES)
def test_a_foot_or_peg_touches_exactly_if_its_ball_reaches_down_to_the_floor(slope, heading, with_tiles):
    rng, heights = np.random.default_rng(2), tiles()
    plant = plant_on(slope=slope, heading=heading, **({"tiles": heights} if with_tiles else {}))
    R_wf = plant.config.ground.R_wf
    for name in (*FOOT_SITES, *PEG_SITES):
        i, j = rng.integers(4, 12, 2)
        R_wb, q, _ = random_pose(rng)
        data = moved(plant, np.zeros(3), R_wb, q)
        foot = name in FOOT_SITES
        radius = ROBOT.foot_radius if foot else ROBOT.peg_radius
        ball = data.geom(name).xpos.copy()
        top = heights[i, j] if with_tiles else 0.0
        for gap in (5e-4, -5e-4):
            lowest = np.array([*(centre_of(i, j) + rng.uniform(-0.05, 0.05, 2)), top + gap + radius])
            moved(plant, R_wf @ lowest - ball, R_wb, q)
            touch = plant.touch()
            touching = touch.feet[FOOT_SITES.index(name)] if foot else touch.pegs[PEG_SITES.index(name)]
            assert touching == (gap < 0.0)


@pytest.mark.parametrize("with_tiles", [False, True])
@pytest.mark.parametrize(("slope", "heading"), SLOPES)
def test_duct_clearance_is_the_height_of_the_lowest_point_of_all_ducts_over_the_floor_below_its_centre(
    slope, heading, with_tiles
):
    rng, heights = np.random.default_rng(3), tiles(highest=0.2)
    plant = plant_on(slope=slope, heading=heading, **({"tiles": heights} if with_tiles else {}))
    R_wf = plant.config.ground.R_wf
    for _ in range(12):
        R_wb, q, vectoring = random_pose(rng)
        data = moved(plant, rng.uniform((-0.8, -0.8, 0.3), (0.8, 0.8, 2.0)), R_wb, q, vectoring)
        low = (duct_points(data) @ R_wf[:, 2]).min(axis=1)
        if with_tiles:
            cells = [
                [math.floor(v / TILE) + TILES // 2 for v in centre] for centre in (duct_centres(data) @ R_wf)[:, :2]
            ]
            low = low - [heights[i, j] if min(i, j) >= 0 and max(i, j) < TILES else -TILE_DEPTH for i, j in cells]
        assert plant.touch().duct_clearance == pytest.approx(low.min(), abs=2e-6)


@pytest.mark.parametrize("floor", [{}, {"tiles": 0.1}, {"tiles": 0.1, "slope": 0.3, "heading": 2.0}], ids=str)
def test_ducts_touch_exactly_if_the_lowest_reaches_down_to_the_floor(floor):
    top = floor.get("tiles", 0.0)
    plant = plant_on(**floor | {"tiles": np.full((TILES, TILES), top)})
    rng, normal = np.random.default_rng(4), plant.config.ground.R_wf[:, 2]
    for _ in range(20):
        R_wb, q, vectoring = random_pose(rng)
        data = moved(plant, np.zeros(3), R_wb, q, vectoring)
        lowest = (duct_points(data) @ normal).min()
        for gap in (5e-4, -5e-4):
            moved(plant, (top + gap - lowest) * normal, R_wb, q, vectoring)
            assert plant.touch().ducts == (gap < 0.0)
            assert plant.touch().duct_clearance == pytest.approx(gap, abs=2e-6)


def slip_by_differences(plant, name, radius):
    """Speed along the floor of a ball's material at its contact point, by integrating for a microsecond."""
    data, normal, h = plant.data, plant.config.ground.R_wf[:, 2], 1e-6
    geom = data.geom(name)
    body = int(plant.model.geom_bodyid[geom.id])
    bottom_w = geom.xpos - radius * normal
    R_wb, position_w = data.xmat[body].reshape(3, 3), data.xpos[body]
    bottom_b = R_wb.T @ (bottom_w - position_w)
    ahead = []
    for step in (h, -h):
        later = mujoco.MjData(plant.model)
        later.qpos[:] = data.qpos
        mujoco.mj_integratePos(plant.model, later.qpos, data.qvel, step)
        mujoco.mj_kinematics(plant.model, later)
        ahead.append(later.xpos[body] + later.xmat[body].reshape(3, 3) @ bottom_b)
    velocity = (ahead[0] - ahead[1]) / (2.0 * h)
    return float(np.linalg.norm(velocity - (velocity @ normal) * normal))


@pytest.mark.parametrize(("slope", "heading"), SLOPES)
def test_slip_of_touching_feet_and_torso_pegs_is_the_speed_of_their_lowest_points_along_the_floor(slope, heading):
    rng, plant = np.random.default_rng(5), plant_on(slope=slope, heading=heading)
    R_wf, data = plant.config.ground.R_wf, plant.data
    for trial in range(4):
        # Pressed into the floor by 1 mm, so that feet and pegs touch, and dragged; the last trial with moving joints.
        moved(plant, R_wf @ (0.0, 0.0, ROBOT.peg_depth - 0.001), R_wf)
        data.qvel[:3] = R_wf @ (*rng.uniform(-0.5, 0.5, 2), -0.1)
        if trial:
            data.qvel[3:6] = rng.uniform(-1.0, 1.0, 3)
        if trial > 1:
            data.qvel[6:] = rng.uniform(-2.0, 2.0, plant.model.nv - 6)
        mujoco.mj_forward(plant.model, data)
        touch = plant.touch()
        assert touch.feet.all()
        assert touch.pegs[:4].all()
        feet = [slip_by_differences(plant, name, ROBOT.foot_radius) for name in FOOT_SITES]
        pegs = [slip_by_differences(plant, name, ROBOT.peg_radius) for name in PEG_SITES[:4]]
        assert min(*feet, *pegs) > 0.005
        np.testing.assert_allclose(touch.foot_slip, feet, atol=1e-7)
        np.testing.assert_allclose(touch.peg_slip, pegs, atol=1e-7)
        if trial == 0:
            along = np.linalg.norm((R_wf.T @ data.qvel[:3])[:2])
            np.testing.assert_allclose(feet + pegs, along, atol=1e-7)


def test_a_ball_that_rolls_does_not_slip_and_nothing_slips_in_the_air():
    plant = plant_on()
    data = moved(plant, np.array([0.0, 0.0, ROBOT.peg_depth - 0.001]), np.eye(3))
    data.qvel[2:6] = 0.0, 0.0, 0.0, 3.0  # spins about the vertical through the torso
    mujoco.mj_forward(plant.model, data)
    reach = np.linalg.norm([data.site(name).xpos[:2] for name in FOOT_SITES], axis=1)
    np.testing.assert_allclose(plant.touch().foot_slip, 3.0 * reach, rtol=1e-9)
    # A robot that rotates about its foot's contact point: every other point moves.
    bottom = data.site("foot1").xpos - (0.0, 0.0, ROBOT.foot_radius)
    omega = np.array([0.4, -0.7, 0.2])
    data.qvel[:6] = *np.cross(omega, data.qpos[:3] - bottom), *omega
    mujoco.mj_forward(plant.model, data)
    slip = plant.touch().foot_slip
    assert slip[0] < 1e-9
    assert slip[1:].min() > 0.01
    data = moved(plant, np.array([0.0, 0.0, 2.0]), np.eye(3))
    data.qvel[:6] = 1.0
    mujoco.mj_forward(plant.model, data)
    touch = plant.touch()
    assert not np.any([*touch.feet, *touch.pegs, touch.ducts])
    assert not np.any([*touch.foot_slip, *touch.peg_slip])


@pytest.mark.parametrize(("slope", "heading"), [(0.0, 0.0), (0.2, 0.6), (-0.2, 2.0)])
def test_a_robot_laid_on_the_floor_lies_on_feet_and_pegs_and_the_floor_bears_its_weight(slope, heading):
    plant = plant_on(slope=slope, heading=heading)
    R_wf = plant.config.ground.R_wf
    moved(plant, R_wf @ (0.0, 0.0, ROBOT.peg_depth), R_wf)
    for _ in range(60):
        state = plant.step(off())
    touch = plant.touch()
    assert touch.pegs[:4].all()
    assert not touch.ducts
    assert touch.foot_slip.max() < 0.01
    assert touch.peg_slip.max() < 0.01
    assert (R_wf.T @ state.position_w)[2] == pytest.approx(ROBOT.peg_depth, abs=2e-3)
    points, forces = np.split(plant.contact_forces(), 2, axis=1)
    np.testing.assert_allclose(forces.sum(axis=0), (0.0, 0.0, ROBOT.weight), atol=0.02 * ROBOT.weight)
    np.testing.assert_allclose((points @ R_wf)[:, 2], 0.0, atol=2e-3)


def test_a_robot_laid_on_a_raised_block_lies_that_much_higher():
    ground = with_blocks(GroundConfig(), ((0.0, 0.0, 0.3),), 0.15)
    plant = Plant(PlantConfig(aero=VACUUM, ground=ground))
    moved(plant, np.array([0.0, 0.0, ROBOT.peg_depth + 0.15]), np.eye(3))
    for _ in range(40):
        state = plant.step(off())
    touch = plant.touch()
    assert touch.pegs[:4].all()
    assert state.position_w[2] == pytest.approx(ROBOT.peg_depth + 0.15, abs=2e-3)


@pytest.mark.parametrize("with_tiles", [False, True])
def test_a_robot_that_falls_onto_high_ground_meets_it(with_tiles):
    """The robot falls far up the slope, where the floor is well above the origin."""
    plant = plant_on(slope=0.3, heading=math.pi, **({"tiles": np.full((TILES, TILES), 0.2)} if with_tiles else {}))
    R_wf, x = plant.config.ground.R_wf, -1.0 if with_tiles else -20.0
    top = 0.2 if with_tiles else 0.0
    moved(plant, R_wf @ (x, 0.0, 1.0 + top), R_wf)
    lowest = math.inf
    for _ in range(40):
        state = plant.step(off())
        lowest = min(lowest, float((R_wf.T @ state.position_w)[2]))
    assert plant.in_contact
    assert plant.touch().pegs.any()
    assert lowest > 0.5 * ROBOT.peg_depth + top


@pytest.mark.parametrize("floor", [{"slope": 0.3}, {"tiles": 0.2}, {"tiles": 0.2, "slope": -0.2}], ids=str)
def test_skipping_the_detection_of_contacts_far_from_high_ground_changes_nothing(floor):
    top, states = floor.get("tiles", 0.0), {}
    for looking in (False, True):
        plant = plant_on(**floor | {"tiles": np.full((TILES, TILES), top)})
        R_wf = plant.config.ground.R_wf
        for height in np.arange(0.16, 0.6, 0.04):
            moved(plant, R_wf @ (0.5, 0.2, top + height), R_wf, FORMS["form1"])
            plant.data.qvel[:3] = -11.0 * R_wf[:, 2]
            if looking:
                plant.record["clearance"] = 0.0
            plant.step(off(FORMS["form1"]))
            states.setdefault(looking, []).append(np.concatenate([plant.data.qpos, plant.data.qvel]))
    np.testing.assert_array_equal(states[True], states[False])
    speeds = np.array(states[True])[:, 39:42] @ R_wf[:, 2]
    assert speeds.max() > -5.0, "some have met the floor"
    assert speeds.min() < -11.0, "some have not yet"


def test_height_follows_the_tiles_and_is_deep_beside_them():
    heights = np.zeros((TILES, TILES))
    heights[3, 12], heights[0, 0], heights[15, 15] = 0.1, 0.05, 0.2
    ground = GroundConfig(tiles=heights)
    for (i, j), h in {(3, 12): 0.1, (0, 0): 0.05, (15, 15): 0.2, (12, 3): 0.0}.items():
        corners = centre_of(i, j) + 0.499 * TILE * np.array([[-1, -1], [-1, 1], [1, -1], [1, 1]])
        np.testing.assert_allclose(ground.height(np.column_stack([corners, np.zeros(4)])), h)
    beside = np.array([[2.001, 0.0, 0.0], [0.0, -2.001, 0.0], [-9.0, 9.0, 0.0]])
    np.testing.assert_allclose(ground.height(beside), -TILE_DEPTH)
    np.testing.assert_array_equal(GroundConfig().height(beside), np.zeros(3))


def test_blocks_raise_the_tiles_whose_centres_are_within_their_radius_and_no_others():
    base = GroundConfig(0.1, 0.3, tiles())
    blocks = ((0.6, -0.4, 0.3), (-1.0, 1.0, 0.2))
    raised = with_blocks(base, blocks, 0.15)
    assert (raised.slope, raised.heading) == (base.slope, base.heading)
    count = 0
    for i in range(TILES):
        for j in range(TILES):
            inside = any(math.dist(centre_of(i, j), (x, y)) <= r for x, y, r in blocks)
            count += inside
            assert raised.tiles[i, j] == (0.15 if inside else base.tiles[i, j])
    assert count > 4
    assert not with_blocks(base, (), 0.15).tiles[base.tiles != with_blocks(base, (), 0.15).tiles].size


def test_random_tiles_fill_the_range_keep_the_slope_and_follow_from_the_generator():
    base = GroundConfig(0.1, 0.3)
    first, again, other = (uneven(base, np.random.default_rng(seed), 0.08) for seed in (7, 7, 8))
    np.testing.assert_array_equal(first.tiles, again.tiles)
    assert np.any(first.tiles != other.tiles)
    assert (first.slope, first.heading) == (0.1, 0.3)
    assert 0.0 <= first.tiles.min() < 0.005
    assert 0.075 < first.tiles.max() <= 0.08
    assert first.tiles.mean() == pytest.approx(0.04, abs=0.005)
    assert first.uneven
    assert not base.uneven
    assert not base.tiles.any(), "the original floor is unchanged"


def flight(plant, ticks=60):
    """Positions, velocities and activations of a robot that drops onto the floor under random commands."""
    rng, states = np.random.default_rng(11), []
    plant.reset(np.array([0.0, 0.0, 0.45]), matrix_to_quat(exp(np.array([0.2, -0.1, 0.3]))), FORMS["form1"])
    for _ in range(ticks):
        plant.step(Command(rng.uniform(0, 15, 8), rng.uniform(-1, 1, (8, 2)), rng.uniform(-1, 1, 16), np.full(16, 7.0)))
        states.append(np.concatenate([plant.data.qpos, plant.data.qvel, plant.data.act]))
    assert plant.in_contact
    return np.array(states)


def test_a_flat_floor_is_bit_for_bit_the_plane_of_the_scene():
    default, chosen, untouched = Plant(), Plant(PlantConfig(ground=GroundConfig(0.0, 1.3))), Plant()
    plane, laid = scene(visual=False), untouched.model
    floor = laid.geom("floor").id
    for name in ("geom_pos", "geom_quat", "geom_sameframe"):
        getattr(laid, name)[floor] = getattr(plane, name)[floor]
    reference = flight(untouched)
    np.testing.assert_array_equal(flight(default), reference)
    np.testing.assert_array_equal(flight(chosen), reference)


def test_laying_one_floor_leaves_the_scene_and_other_plants_alone():
    flat, model = plant_on(), scene(visual=False)
    before = model.geom_quat[model.geom("floor").id].copy()
    sloped = plant_on(slope=0.4)
    for other in (flat.model, model):
        np.testing.assert_array_equal(other.geom_quat[other.geom("floor").id], before)
    assert np.any(sloped.model.geom_quat[model.geom("floor").id] != before)


def test_a_floor_laid_in_another_place_later_is_the_floor_of_a_plant_made_for_it():
    first, second = GroundConfig(0.2, 1.0, tiles(0)), GroundConfig(-0.1, 0.5, tiles(1))
    changed, fresh = (Plant(PlantConfig(ground=ground)) for ground in (first, second))
    flight(changed, 20)
    changed.configure(PlantConfig(ground=second))
    np.testing.assert_array_equal(flight(changed), flight(fresh))


@pytest.mark.parametrize("begin", [GroundConfig(), GroundConfig(0.1)], ids=["flat", "sloped"])
def test_tiles_where_there_were_none_and_none_where_there_were_are_refused_and_nothing_changes(begin):
    rough = GroundConfig(tiles=tiles())
    for one, other in ((begin, rough), (rough, begin)):
        plant = Plant(PlantConfig(ground=one, actuators=ActuatorConfig()))
        reference, config = flight(plant, 20), plant.config
        with pytest.raises(InvalidValueError, match="kind of world"):
            plant.configure(replace(config, ground=other))
        assert plant.config is config
        np.testing.assert_array_equal(flight(plant, 20), reference)


@pytest.mark.parametrize(
    ("floor", "name"),
    [
        ({"slope": 0.61}, "slope"),
        ({"slope": -0.61}, "slope"),
        ({"slope": math.nan}, "slope"),
        ({"heading": math.inf}, "heading"),
        ({"heading": 1e7}, "heading"),
        ({"tiles": np.full((TILES, TILES), -0.001)}, "tiles"),
        ({"tiles": np.full((TILES, TILES), 0.21)}, "tiles"),
        ({"tiles": np.full((TILES, TILES), math.nan)}, "tiles"),
        ({"tiles": np.zeros((TILES, 3))}, "tiles"),
    ],
    ids=str,
)
def test_walls_holes_and_what_is_no_number_are_refused(floor, name):
    with pytest.raises(InvalidValueError, match=name):
        GroundConfig(**floor)
    GroundConfig(0.6, -9.0, np.full((TILES, TILES), 0.2))


def test_one_tile_that_is_a_hole_is_enough_to_refuse():
    for value in (-0.001, 0.201):
        heights = tiles()
        heights[5, 9] = value
        with pytest.raises(InvalidValueError, match=r"0 … 0\.2 m"):
            GroundConfig(tiles=heights)


def test_the_scene_has_tiles_only_if_it_is_uneven_and_only_the_robot_collides_with_them():
    for visual in (False, True):
        names = [[model.geom(g).name for g in range(model.ngeom)] for model in (scene(visual), scene(visual, True))]
        assert not any(name.startswith("tile") for name in names[0])
        assert sum(name.startswith("tile") for name in names[1]) == TILES**2
    model = scene(False, True)
    world = model.geom_bodyid == 0
    assert not np.any(model.geom_contype[world][:, None] & model.geom_conaffinity[world])
    assert np.all(model.geom_contype[world] & 1)
    assert N_LEGS + len(PEG_SITES) + 2 * len(ROTOR_SITES) <= np.count_nonzero(model.geom_conaffinity[~world] & 1)
