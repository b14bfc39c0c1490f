"""Pins the robot as meshes: its shape is MuJoCo's, arrows are proportional to forces, jets oppose thrusts."""

import mujoco
import numpy as np
import pytest

from spidar_gym.native.plant import Plant
from spidar_gym.robot import FORMS, ROBOT, ROTOR_SITES
from spidar_gym.sim.ground import TILES, GroundConfig, with_boxes
from spidar_gym.sim.scene import scene
from spidar_gym.sim.stage import CONTACT_LENGTH, JET_LENGTH, THRUST_LENGTH
from spidar_gym.so3 import exp, matrix_to_quat, quat_to_matrix
from spidar_gym.viz.live.puppet import MOST_CONTACTS, OUT_OF_SIGHT, Puppet, arrows, contact_arrows, jet_mesh

THRUST = np.linspace(4.0, 32.0, 8)
TILTED = matrix_to_quat(exp(np.array([0.3, -0.2, 0.5])))


def placed(form="form2", height=2.0, quat=TILTED):
    """Return a configuration, and MuJoCo's model and data in it."""
    plant = Plant()
    plant.reset(np.array([0.4, -0.3, height]), quat, FORMS[form], vectoring=np.full((8, 2), 0.1))
    model = scene(visual=True, film=True)
    data = mujoco.MjData(model)
    data.qpos[:] = plant.data.qpos
    mujoco.mj_forward(model, data)
    return data.qpos.copy(), model, data


@pytest.fixture(scope="module")
def puppet():
    return Puppet(None)


def triangles(mesh):
    return mesh.vertices[mesh.faces]


def test_every_body_that_is_seen_is_in_one_part(puppet):
    model = scene(visual=True, film=True)
    seen = {int(model.geom_bodyid[k]) for k in range(model.ngeom) if model.geom_bodyid[k] and model.geom_group[k] != 3}
    numbers = [body for part in puppet.parts for body in part.bodies.tolist()]
    assert sorted(numbers) == sorted(seen)
    # Torso, junctions, both kinds of links, both of a module's parts.
    assert sorted(len(part.bodies) for part in puppet.parts) == [1, 4, 4, 8, 8, 8]


def test_meshes_fill_what_mujocos_shapes_fill_and_their_faces_look_outward(puppet):
    geom = mujoco.mjtGeom
    model = scene(visual=True, film=True)
    volumes = {
        geom.mjGEOM_BOX: lambda s: 8.0 * s.prod(),
        geom.mjGEOM_CYLINDER: lambda s: 2.0 * np.pi * s[0] ** 2 * s[1],
        geom.mjGEOM_SPHERE: lambda s: 4.0 / 3.0 * np.pi * s[0] ** 3,
        geom.mjGEOM_ELLIPSOID: lambda s: 4.0 / 3.0 * np.pi * s.prod(),
        geom.mjGEOM_CAPSULE: lambda s: np.pi * s[0] ** 2 * (2.0 * s[1] + 4.0 / 3.0 * s[0]),
    }
    for part in puppet.parts:
        corners = triangles(part.mesh)
        signed = np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() / 6.0
        geoms = [k for k in range(model.ngeom) if model.geom_bodyid[k] == part.bodies[0] and model.geom_group[k] != 3]
        wanted = sum(float(volumes[geom(model.geom_type[k])](model.geom_size[k])) for k in geoms)
        assert signed == pytest.approx(wanted, rel=0.05), part.name


def test_meshes_have_the_colours_of_the_film(puppet):
    model = scene(visual=True, film=True)
    colors = {tuple((255.0 * rgba).astype(np.uint8)) for rgba in model.mat_rgba}
    for part in puppet.parts:
        assert {tuple(color) for color in part.mesh.colors} <= colors
        assert part.mesh.colors.shape == (len(part.mesh.vertices), 4)
    assert len({tuple(color) for part in puppet.parts for color in part.mesh.colors}) >= 6


def test_parts_are_where_mujoco_has_their_bodies(puppet):
    qpos, _, data = placed()
    puppet.place(qpos, THRUST)
    for part in puppet.parts:
        positions, quats = puppet.poses(part)
        assert positions == pytest.approx(data.xpos[part.bodies])
        assert quats == pytest.approx(data.xquat[part.bodies])
    assert puppet.com == pytest.approx(data.subtree_com[1])


def test_arrows_of_thrust_are_as_long_as_it_is_and_point_where_it_does(puppet):
    qpos, model, data = placed()
    puppet.place(qpos, THRUST)
    for (start, end), name, newtons in zip(puppet.arrows(), ROTOR_SITES, THRUST, strict=True):
        site = model.site(name).id
        assert start == pytest.approx(data.site_xpos[site])
        assert end - start == pytest.approx(THRUST_LENGTH * newtons * data.site_xmat[site].reshape(3, 3)[:, 2])


def test_a_rotor_without_thrust_has_no_arrow_and_no_jet(puppet):
    qpos, _, _ = placed()
    puppet.place(qpos, np.array([0.0, *[20.0] * 7]))
    shown = puppet.arrows()
    assert (shown[0] == OUT_OF_SIGHT).all()
    assert (shown[1:, :, 2] > 0.0).all()
    assert puppet.jet_opacities()[:2].tolist() == [0.0, 0.0]
    assert (puppet.jet_opacities()[2:] > 0.05).all()


def test_jets_leave_the_ducts_against_the_thrust(puppet):
    qpos, model, data = placed()
    puppet.place(qpos, THRUST)
    exits, quats, lengths = puppet.jets()
    for k in range(16):
        site = model.site(ROTOR_SITES[k // 2]).id
        frame = data.site_xmat[site].reshape(3, 3)
        assert quat_to_matrix(quats[k])[:, 2] == pytest.approx(-frame[:, 2])
        offset = (exits[k] - data.site_xpos[site]) @ frame
        assert abs(offset[1]) == pytest.approx(ROBOT.duct_offset_y)
        assert offset[[0, 2]] == pytest.approx([0.0, ROBOT.duct_z[0]])
    assert lengths == pytest.approx(JET_LENGTH)  # far above the floor
    assert len({tuple(point.round(6)) for point in exits}) == 16


def test_jets_end_on_the_floor(puppet):
    qpos, _, _ = placed("form1", height=0.3, quat=np.array([1.0, 0.0, 0.0, 0.0]))
    puppet.place(qpos, THRUST)
    exits, quats, lengths = puppet.jets()
    ends = exits + lengths[:, None] * np.array([quat_to_matrix(quat)[:, 2] for quat in quats])
    assert ends[:, 2] == pytest.approx(0.0, abs=1e-6)
    assert (lengths < JET_LENGTH).all()


def test_a_jet_is_as_wide_as_its_propeller_and_wider_below():
    vertices, faces = jet_mesh()
    radii = np.linalg.norm(vertices[:, :2], axis=1)
    assert radii[vertices[:, 2] == 0.0] == pytest.approx(ROBOT.propeller_radius)
    assert radii[vertices[:, 2] == 1.0].min() > 1.3 * ROBOT.propeller_radius
    assert faces.max() == len(vertices) - 1


def test_contact_forces_are_arrows_and_always_as_many():
    contacts = np.array(
        [[0.1, 0.2, 0.0, 0.0, 0.0, 50.0], [1.0, 0.0, 0.0, 3.0, 0.0, 4.0], [2.0, 0.0, 0.0, 0.0, 0.0, 0.0]]
    )
    shown = contact_arrows(contacts)
    assert shown.shape == (MOST_CONTACTS, 2, 3)
    assert shown[0] == pytest.approx(np.array([[0.1, 0.2, 0.0], [0.1, 0.2, 50.0 * CONTACT_LENGTH]]))
    assert np.linalg.norm(shown[1, 1] - shown[1, 0]) == pytest.approx(5.0 * CONTACT_LENGTH)
    assert (shown[2:] == OUT_OF_SIGHT).all()
    assert contact_arrows(np.tile(contacts, (40, 1))).shape == (MOST_CONTACTS, 2, 3)
    assert arrows(np.zeros((0, 3)), np.zeros((0, 3))).shape == (0, 2, 3)


def test_tiles_and_boxes_are_where_the_floor_has_them():
    heights = np.random.default_rng(0).uniform(0.0, 0.05, (TILES, TILES))
    at, _, edges, colors = Puppet(GroundConfig(tiles=heights)).blocks()
    assert len(at) == TILES * TILES
    assert sorted(at[:, 2] + 0.5 * edges[:, 2]) == pytest.approx(sorted(heights.ravel()))
    assert colors.dtype == np.uint8
    ground = with_boxes(GroundConfig(), [(2.0, 0.0, 0.5, 0.1, 3.0, 0.5, 0.0), (4.0, 1.0, 0.2, 0.3, 0.3, 0.2, 0.1)])
    puppet = Puppet(ground)
    at, quats, edges, _ = puppet.blocks()
    assert at.tolist() == [[2.0, 0.0, 0.5], [4.0, 1.0, 0.2]]
    assert edges == pytest.approx(np.array([[0.2, 6.0, 1.0], [0.6, 0.6, 0.4]]))
    assert quats[1] == pytest.approx([np.cos(0.05), 0.0, np.sin(0.05), 0.0])
    puppet.lay(with_boxes(GroundConfig(), [(9.0, 0.0, 0.5, 0.1, 3.0, 0.5, 0.0)]))
    assert puppet.blocks()[0].tolist() == [[9.0, 0.0, 0.5]]
    position, quat = Puppet(GroundConfig(slope=0.2)).floor()
    assert position == pytest.approx(np.zeros(3), abs=1e-12)
    assert abs(quat[2]) == pytest.approx(np.sin(0.1))
    assert len(Puppet(None).blocks()[0]) == 0
