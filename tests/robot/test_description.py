"""Pins the model files: committed == generated, MuJoCo and Pinocchio read one robot, its symmetry, names, cameras."""

import os
import shutil
import subprocess
import sys
import xml.etree.ElementTree as ET
from collections import Counter
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pinocchio as pin
import pytest

from spidar_gym.errors import StaleAssetError
from spidar_gym.robot import CONTACT_SITES, GIMBAL_NAMES, JOINT_NAMES, ROBOT, ROTOR_SITES, description
from spidar_gym.so3 import quat_to_matrix, rotation_z

JOINTS = JOINT_NAMES + GIMBAL_NAMES
POINTS = ROTOR_SITES + CONTACT_SITES
MJCF = description.assets_dir() / "mjcf" / "spidar.xml"
URDF = description.assets_dir() / "urdf" / "spidar.urdf"


class Mujoco:
    """Quantities of one configuration from MuJoCo; velocities in torso axes, joints in the order of `JOINTS`."""

    def __init__(self, xml: str):
        self.model = mujoco.MjModel.from_xml_string(xml)
        self.data = mujoco.MjData(self.model)
        self.dofs = [*range(6), *(int(self.model.joint(name).dofadr[0]) for name in JOINTS)]
        self.mass = self.model.body_mass.sum()
        self.armature = self.model.dof_armature[self.dofs]

    def move(self, position, quat, angles):
        self.data.qpos[:7] = [*position, *quat]
        for name, angle in zip(JOINTS, angles, strict=True):
            self.data.joint(name).qpos = angle
        mujoco.mj_forward(self.model, self.data)

    def com(self):
        return self.data.body("torso").subtree_com.copy()

    def inertia(self):
        M = np.zeros((self.model.nv, self.model.nv))
        mujoco.mj_fullM(self.model, self.data, M)
        # The free joint's linear velocity is in world axes: rotate it to torso axes.
        T = np.eye(self.model.nv)
        T[:3, :3] = self.data.body("torso").xmat.reshape(3, 3)
        return (T.T @ M @ T)[np.ix_(self.dofs, self.dofs)] - np.diag(self.armature)

    def frames(self, names=POINTS):
        sites = [self.data.site(name) for name in names]
        return np.array([s.xpos for s in sites]), np.array([s.xmat.reshape(3, 3) for s in sites])


class Pinocchio:
    """Quantities of one configuration from Pinocchio."""

    def __init__(self, model, kind):
        self.model, self.data, self.kind = model, model.createData(), kind
        self.ids = [model.getJointId(name) for name in JOINTS]
        self.dofs = [*range(6), *(model.idx_vs[i] for i in self.ids)]
        self.mass = pin.computeTotalMass(model)
        self.armature = np.array(model.armature)[self.dofs]

    def move(self, position, quat, angles):
        self.q = pin.neutral(self.model)
        self.q[:7] = [*position, *np.roll(quat, -1)]  # Pinocchio's order is x, y, z, w
        for i, angle in zip(self.ids, angles, strict=True):
            start, size = self.model.idx_qs[i], self.model.nqs[i]
            # A continuous joint of the URDF is a point on the circle.
            self.q[start : start + size] = angle if size == 1 else (np.cos(angle), np.sin(angle))

    def com(self):
        return pin.centerOfMass(self.model, self.data, self.q).copy()

    def inertia(self):
        upper = np.triu(pin.crba(self.model, self.data, self.q))
        M = upper + np.triu(upper, 1).T
        return M[np.ix_(self.dofs, self.dofs)] - np.diag(self.armature)

    def frames(self, names=POINTS):
        pin.framesForwardKinematics(self.model, self.data, self.q)
        placements = [self.data.oMf[self.model.getFrameId(name, self.kind)] for name in names]
        return np.array([p.translation for p in placements]), np.array([p.rotation for p in placements])


@pytest.fixture(scope="module")
def mujoco_robot():
    return Mujoco(MJCF.read_text())


@pytest.fixture(scope="module", params=["mjcf", "urdf"])
def pinocchio_robot(request):
    if request.param == "mjcf":
        return Pinocchio(pin.buildModelFromMJCF(str(MJCF)), pin.FrameType.OP_FRAME)
    return Pinocchio(pin.buildModelFromUrdf(str(URDF), pin.JointModelFreeFlyer()), pin.FrameType.BODY)


def configurations(seed: int, count: int = 20):
    rng = np.random.default_rng(seed)
    for _ in range(count):
        quat = rng.normal(size=4)
        angles = np.concatenate([rng.uniform(-1.5, 1.5, 16), rng.uniform(-3.0, 3.0, 16)])
        yield rng.uniform(-3.0, 3.0, 3), quat / np.linalg.norm(quat), angles


def bodies() -> list[ET.Element]:
    world = ET.fromstring(MJCF.read_text()).find("worldbody")
    return [] if world is None else list(world.iter("body"))


@pytest.mark.parametrize("name", ["mjcf/spidar.xml", "urdf/spidar.urdf", "README.md"])
def test_committed_file_is_what_the_robot_description_generates(name):
    assert (description.assets_dir() / name).read_text(encoding="utf-8") == description.generated_files()[name]


def test_no_model_file_is_written_by_hand():
    root = description.assets_dir()
    models = {path.relative_to(root).as_posix() for folder in ("mjcf", "urdf") for path in (root / folder).iterdir()}
    assert models | {"README.md"} == set(description.generated_files())


def test_every_body_has_its_own_inertial():
    assert len(bodies()) == 1 + 8 * 4
    for body in bodies():
        assert len(body.findall("inertial")) == 1, body.get("name")


def test_model_path_is_refused_after_an_edit_or_a_loss(tmp_path, monkeypatch):
    copy = tmp_path / "assets"
    shutil.copytree(description.assets_dir(), copy)
    monkeypatch.setattr(description, "assets_dir", lambda: copy)
    path = description.mjcf_path()
    assert path == copy / "mjcf" / "spidar.xml"
    path.write_text(path.read_text().replace('mass="0.28', 'mass="0.29', 1))
    with pytest.raises(StaleAssetError, match=r"spidar\.xml"):
        description.mjcf_path()
    path.unlink()
    with pytest.raises(StaleAssetError, match=r"spidar\.xml"):
        description.mjcf_path()


def test_a_robot_replaced_in_memory_is_named_as_the_cause(monkeypatch):
    monkeypatch.setattr(description, "ROBOT", replace(ROBOT, described_mass=20.0))
    description._written.cache_clear()
    try:
        with pytest.raises(StaleAssetError) as refusal:
            description.mjcf_path()
    finally:
        description._written.cache_clear()
    assert "described_mass = 20.0 instead of 16.0" in str(refusal.value)
    assert "by hand" not in str(refusal.value)
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize(
    ("line", "other", "words"),
    [("N_LEGS = 4", "N_LEGS = 6", "N_LEGS = 6 is not valid; expected 4"),
     ("N_JOINTS = 16", "N_JOINTS = 24", "N_JOINTS = 24 is not valid; expected 16")],
)  # fmt: skip
def test_a_robot_of_another_kind_is_refused_in_one_line_before_anything_is_written(line, other, words, tmp_path):
    package = tmp_path / "spidar_gym"
    shutil.copytree(Path(description.__file__).parents[1], package, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copytree(
        description.assets_dir(), tmp_path / "assets", ignore=shutil.ignore_patterns("scenarios", "pictures")
    )
    robot = package / "robot" / "spec.py"
    text = robot.read_text(encoding="utf-8")
    assert text.count(f"\n{line}\n") == 1
    robot.write_text(text.replace(f"\n{line}\n", f"\n{other}\n"), encoding="utf-8")
    before = {path: path.read_bytes() for path in (tmp_path / "assets").rglob("*.*")}
    code = "from spidar_gym.cli.main import main; main(['assets'])"
    told = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, env=os.environ | {"PYTHONPATH": str(tmp_path)}, check=False,
        capture_output=True, text=True,
    )  # fmt: skip
    assert told.returncode == 2, told.stderr
    (message,) = told.stderr.splitlines()
    assert words in message
    assert {path: path.read_bytes() for path in (tmp_path / "assets").rglob("*.*")} == before


def test_bodies_in_mujoco_have_the_mass_distribution_of_the_robot_description(mujoco_robot):
    model = mujoco_robot.model
    for body in bodies():
        name = body.get("name", "")
        number = next((int(c) for c in name if c.isdigit()), 0)
        side = "inner" if number % 2 else "outer"
        kind = name[8:] if name.startswith("gimbal") else f"{side}_{name[:-1]}" if number else name
        expected, compiled = ROBOT.bodies[kind], model.body(name)
        R = quat_to_matrix(compiled.iquat)
        np.testing.assert_allclose(compiled.mass, expected.mass, rtol=1e-11)
        np.testing.assert_allclose(compiled.ipos, expected.com, rtol=0, atol=1e-12)
        np.testing.assert_allclose(R @ np.diag(compiled.inertia) @ R.T, expected.matrix, rtol=0, atol=1e-12)


def test_robot_of_another_mass_and_reach_is_written_as_such():
    spec = replace(ROBOT, described_mass=20.0, pitch_to_foot=0.6)
    changed = Mujoco(description.mjcf(spec))
    assert abs(changed.mass - spec.total_mass) < 1e-9
    assert spec.total_mass > 20.0  # the longer links are heavier
    changed.move(np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(32))
    feet = changed.frames(("foot1", "foot3"))[0]
    assert abs(np.linalg.norm(feet[0] - feet[1]) + 2 * spec.foot_radius - spec.diameter) < 1e-9


def test_every_engine_weighs_16_kg(mujoco_robot, pinocchio_robot):
    assert abs(mujoco_robot.mass - 16.0) < 1e-9
    assert abs(pinocchio_robot.mass - 16.0) < 1e-9


def test_engines_agree_on_the_centre_of_mass(mujoco_robot, pinocchio_robot):
    for configuration in configurations(1):
        mujoco_robot.move(*configuration)
        pinocchio_robot.move(*configuration)
        np.testing.assert_allclose(pinocchio_robot.com(), mujoco_robot.com(), rtol=0, atol=1e-9)


def test_engines_agree_on_the_inertia_matrix(mujoco_robot, pinocchio_robot):
    for configuration in configurations(2):
        mujoco_robot.move(*configuration)
        pinocchio_robot.move(*configuration)
        np.testing.assert_allclose(pinocchio_robot.inertia(), mujoco_robot.inertia(), rtol=0, atol=1e-9)


def test_engines_agree_on_thrust_frames_feet_and_pegs(mujoco_robot, pinocchio_robot):
    for configuration in configurations(3):
        mujoco_robot.move(*configuration)
        pinocchio_robot.move(*configuration)
        for ours, theirs in zip(pinocchio_robot.frames(), mujoco_robot.frames(), strict=True):
            np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-9)


def test_both_engines_read_the_same_armature_from_the_mjcf(mujoco_robot):
    model = Pinocchio(pin.buildModelFromMJCF(str(MJCF)), pin.FrameType.OP_FRAME)
    np.testing.assert_array_equal(model.armature, mujoco_robot.armature)
    np.testing.assert_allclose(model.armature[6:22], ROBOT.joint_armature)
    np.testing.assert_allclose(model.armature[22:], ROBOT.vectoring_armature)


def test_urdf_and_mjcf_limit_the_same_joints_alike(mujoco_robot):
    limits = {
        joint.get("name"): (joint.get("type"), joint.find("limit"))
        for joint in ET.fromstring(URDF.read_text()).iter("joint")
    }
    for name in JOINTS:
        joint, (kind, limit) = mujoco_robot.model.joint(name), limits[name]
        assert (kind == "revolute") == bool(joint.limited[0]) == (name in JOINT_NAMES)
        if kind == "revolute":
            np.testing.assert_allclose([float(limit.get("lower")), float(limit.get("upper"))], joint.range)
        servo = mujoco_robot.model.actuator(name)
        np.testing.assert_allclose(servo.forcerange, float(limit.get("effort")) * np.array([-1.0, 1.0]))


def test_a_quarter_turn_permutes_the_legs(mujoco_robot):
    turn = rotation_z(np.pi / 2)
    rotors, feet = ROTOR_SITES, CONTACT_SITES[:4]
    groups = ((rotors, 2), (feet, 1), (CONTACT_SITES[4:8], 1), (CONTACT_SITES[8:], 1))
    for _, _, angles in configurations(4, count=5):
        here = np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])
        mujoco_robot.move(*here, angles)
        before = [mujoco_robot.frames(names) for names, _ in groups]
        mujoco_robot.move(*here, np.concatenate([np.roll(angles[:16], 4), np.roll(angles[16:], 4)]))
        for (names, step), (positions, attitudes) in zip(groups, before, strict=True):
            turned_positions, turned_attitudes = mujoco_robot.frames(names)
            np.testing.assert_allclose(np.roll(positions, step, 0) @ turn.T, turned_positions, rtol=0, atol=1e-11)
            np.testing.assert_allclose(turn @ np.roll(attitudes, step, 0), turned_attitudes, rtol=0, atol=1e-11)


def test_actuators_are_thrusts_then_joint_servos_then_vectoring_servos(mujoco_robot):
    model = mujoco_robot.model
    assert tuple(model.actuator(i).name for i in range(model.nu)) == ROTOR_SITES + JOINTS
    for name in ROTOR_SITES:
        assert model.actuator(name).trnid[0] == model.site(name).id
    for name in JOINTS:
        assert model.actuator(name).trnid[0] == model.joint(name).id


def test_the_robot_has_one_free_joint_and_the_named_ones(mujoco_robot):
    model = mujoco_robot.model
    names = [model.joint(i).name for i in range(model.njnt)]
    assert names[0] == "root"
    assert sorted(names[1:]) == sorted(JOINTS)
    assert {model.site(i).name for i in range(model.nsite)} == {*POINTS, "imu"}


def test_only_feet_pegs_ducts_and_torso_touch_the_floor(mujoco_robot):
    model = mujoco_robot.model
    solid = [model.geom(i) for i in np.flatnonzero(model.geom_contype | model.geom_conaffinity)]
    parents = Counter(model.body(int(geom.bodyid[0])).name.rstrip("12345678") for geom in solid)
    assert Counter(geom.name.rstrip("12345678") for geom in solid) == {"foot": 4, "peg": 8, "torso": 1, "": 16}
    ducts = sum(count for name, count in parents.items() if name.endswith("pitch_module"))
    assert (ducts, parents["link"], parents["junction"], parents["torso"]) == (16, 4, 8, 1)
    assert all(int(geom.conaffinity[0]) & 1 for geom in solid)


def test_no_two_parts_of_the_robot_can_collide(mujoco_robot):
    model = mujoco_robot.model
    assert not np.any(model.geom_contype[:, None] & model.geom_conaffinity[None, :])


def test_contact_points_are_where_the_solids_meet_the_floor(mujoco_robot):
    mujoco_robot.move(np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(32))
    for name in CONTACT_SITES:
        geom, site = mujoco_robot.data.geom(name), mujoco_robot.data.site(name)
        radius = 0.0 if name.startswith("foot") else mujoco_robot.model.geom(name).size[0]
        np.testing.assert_allclose(geom.xpos - [0.0, 0.0, radius], site.xpos, rtol=0, atol=1e-12)


@pytest.mark.parametrize("camera", description.CAMERAS)
def test_camera_follows_the_robot_without_turning_with_it_and_looks_at_it(mujoco_robot, camera):
    looks, offsets = [], []
    for position, quat, _ in configurations(5, count=3):
        mujoco_robot.move(position, quat, np.zeros(32))
        eye = mujoco_robot.data.camera(camera)
        looks.append(eye.xmat.reshape(3, 3).copy())
        offsets.append(eye.xpos - mujoco_robot.com())
    np.testing.assert_allclose(offsets, [offsets[0]] * 3, rtol=0, atol=1e-9)
    np.testing.assert_allclose(looks, [looks[0]] * 3, rtol=0, atol=1e-9)
    distance = np.linalg.norm(offsets[0])
    assert looks[0][:, 2] @ offsets[0] > np.cos(np.radians(5.0)) * distance
    assert distance * np.tan(np.radians(mujoco_robot.model.camera(camera).fovy[0] / 2)) > ROBOT.diameter / 2
