"""Pins the model behind `Snapshot`: Jacobians and torques by finite differences, CoG and momenta against MuJoCo."""

from dataclasses import fields

import mujoco
import numpy as np
import pytest
from support.parts import mass_matrix, rotors, segments

from spidar_gym.model.dynamics import Model
from spidar_gym.model.rotor import nominal_vectoring
from spidar_gym.robot import CONTACT_SITES, FORMS, GIMBAL_NAMES, GRAVITY, JOINT_NAMES, ROBOT, ROTOR_SITES
from spidar_gym.robot.description import mjcf_path
from spidar_gym.so3 import exp, rotation_z

LEVEL = np.zeros((8, 2))


class Engine:
    """MuJoCo as independent reference, with the torso at the origin and aligned with the world axes."""

    def __init__(self):
        self.model = mujoco.MjModel.from_xml_path(str(mjcf_path()))
        self.data = mujoco.MjData(self.model)
        self.joint_dofs = [int(self.model.joint(name).dofadr[0]) for name in JOINT_NAMES]

    def move(self, q, vectoring, dq=None):
        self.data.qpos[:7] = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]
        for name, angle in zip(JOINT_NAMES + GIMBAL_NAMES, [*q, *vectoring.reshape(-1)], strict=True):
            self.data.joint(name).qpos = angle
        self.data.qvel[:] = 0.0
        self.data.qvel[self.joint_dofs] = np.zeros(16) if dq is None else dq
        mujoco.mj_forward(self.model, self.data)
        mujoco.mj_subtreeVel(self.model, self.data)
        return self.data.body("torso")

    def com(self, q, vectoring):
        return self.move(q, vectoring).subtree_com.copy()


@pytest.fixture(scope="module")
def model():
    return Model()


@pytest.fixture(scope="module")
def engine():
    return Engine()


def configurations(seed: int, count: int = 5):
    """Sample joint angles, attitude and vectoring angles."""
    rng = np.random.default_rng(seed)
    for _ in range(count):
        yield rng.uniform(-1.5, 1.5, 16), exp(rng.normal(size=3)), rng.uniform(-3.0, 3.0, (8, 2))


def gradient(function, q, h=1e-5):
    """Compute central differences, with the joint as last axis."""
    return np.stack([(function(q + h * e) - function(q - h * e)) / (2 * h) for e in np.eye(16)], axis=-1)


def close(actual, desired, *, atol=1e-9):
    np.testing.assert_allclose(actual, desired, rtol=0, atol=atol)


def upright(model, form):
    """Return the snapshot of a form with all rotors upright."""
    nominal = nominal_vectoring(model.snapshot(FORMS[form], np.eye(3), LEVEL).R_bl, LEVEL)
    return model.snapshot(FORMS[form], np.eye(3), nominal)


def test_com_and_rotor_frames_are_mujocos(model, engine):
    for q, R, vectoring in configurations(1):
        snapshot, (positions, attitudes) = model.snapshot(q, R, vectoring), rotors(model, q, vectoring)
        close(snapshot.com_b, engine.com(q, vectoring))
        sites = [engine.data.site(name) for name in ROTOR_SITES]
        close(positions, [site.xpos for site in sites])
        close(attitudes, [site.xmat.reshape(3, 3) for site in sites])
        close(snapshot.rotor_c, positions - snapshot.com_b)
        close(snapshot.R_bl, [engine.data.body(f"link{i}").xmat.reshape(3, 3) for i in range(1, 9)])


def test_rotor_jacobian_is_the_derivative_of_the_rotor_centres(model):
    for q, R, vectoring in configurations(2):
        derivative = gradient(lambda x, v=vectoring: rotors(model, x, v)[0], q)
        close(model.snapshot(q, R, vectoring).J_rotor, derivative)


def test_contact_points_are_mujocos_and_their_jacobian_is_their_derivative(model, engine):
    for q, _, vectoring in configurations(3):
        positions, jacobians = model.contacts(q)
        engine.move(q, vectoring)
        close(positions, [engine.data.site(name).xpos for name in CONTACT_SITES])
        close(jacobians, gradient(lambda x: model.contacts(x)[0], q))


def test_gravity_torque_holds_the_links_in_their_potential_at_any_attitude(model, engine):
    for q, R, vectoring in configurations(4):

        def potential(x, R=R, vectoring=vectoring):
            return 16.0 * GRAVITY * (R @ engine.com(x, vectoring))[2]

        close(model.snapshot(q, R, vectoring).gravity_torque, gradient(potential, q), atol=1e-7)


def test_gravity_torque_is_the_sum_over_the_segments_weights(model):
    for q, R, vectoring in configurations(5):
        masses, _, jacobians = segments(model, q, vectoring)
        weights_b = masses[:, None] * (R.T @ [0.0, 0.0, -GRAVITY])
        close(model.snapshot(q, R, vectoring).gravity_torque, -np.einsum("sij,si->j", jacobians, weights_b))


def test_the_flat_robots_inner_pitch_joints_would_need_three_times_their_torque_without_thrust(model):
    torque = model.snapshot(FORMS["form1"], np.eye(3), LEVEL).gravity_torque
    close(torque[1::4], -19.9, atol=0.1)
    assert np.all(torque[1::4] < -2.5 * ROBOT.max_joint_torque)
    close(torque[0::2], 0.0)


def test_segments_carry_the_robots_mass_and_centre(model, engine):
    for q, _, vectoring in configurations(6):
        masses, positions, jacobians = segments(model, q, vectoring)
        assert len(masses) == 33
        assert abs(masses.sum() - 16.0) < 1e-9
        close(masses @ positions / 16.0, engine.com(q, vectoring))
        close(jacobians, gradient(lambda x, v=vectoring: segments(model, x, v)[1], q))


def test_linear_momentum_map_is_the_mass_times_the_derivative_of_the_com(model, engine):
    for q, R, vectoring in configurations(7):
        derivative = gradient(lambda x, v=vectoring: engine.com(x, v), q)
        close(model.snapshot(q, R, vectoring).momentum_map[:3], 16.0 * derivative, atol=1e-8)


def test_momentum_of_moving_joints_is_mujocos(model, engine):
    rng = np.random.default_rng(8)
    for q, R, vectoring in configurations(8):
        dq = rng.normal(size=16)
        engine.move(q, vectoring, dq)
        root = engine.model.body("torso").id
        expected = [*(16.0 * engine.data.subtree_linvel[root]), *engine.data.subtree_angmom[root]]
        close(model.snapshot(q, R, vectoring).momentum_map @ dq, expected)


def test_centroidal_inertia_is_the_parallel_axis_sum_over_mujocos_bodies(model, engine):
    for q, R, vectoring in configurations(9):
        com = engine.com(q, vectoring)
        total = np.zeros((3, 3))
        for i in range(1, engine.model.nbody):
            axes, arm = engine.data.ximat[i].reshape(3, 3), engine.data.xipos[i] - com
            total += axes @ np.diag(engine.model.body_inertia[i]) @ axes.T
            total += engine.model.body_mass[i] * (arm @ arm * np.eye(3) - np.outer(arm, arm))
        close(model.snapshot(q, R, vectoring).inertia_c, total)


def test_kinetic_energy_of_the_free_robot_is_mujocos(model, engine):
    """The names order the 38 velocities: six of the torso in its own axes, then one per joint."""
    rng = np.random.default_rng(10)
    for q, _, vectoring in configurations(10):
        M, names = mass_matrix(model, q, vectoring)
        engine.move(q, vectoring)
        expected = np.zeros((38, 38))
        mujoco.mj_fullM(engine.model, engine.data, expected)
        dofs = [*range(6), *(int(engine.model.joint(name).dofadr[0]) for name in names[1:])]
        assert names[0] == "root"
        v = rng.normal(size=38)
        assert abs(v @ M @ v - v @ expected[np.ix_(dofs, dofs)] @ v) < 1e-9
        close(M, M.T, atol=0.0)


def test_attitude_turns_gravity_only(model):
    for q, R, vectoring in configurations(11):
        here, turned = model.snapshot(q, np.eye(3), vectoring), model.snapshot(q, R, vectoring)
        for name in ("mass", "com_b", "inertia_c", "R_bl", "rotor_c", "J_rotor", "momentum_map"):
            np.testing.assert_array_equal(getattr(here, name), getattr(turned, name))
        assert np.abs(here.gravity_torque - turned.gravity_torque).max() > 0.1
        heading = model.snapshot(q, rotation_z(1.0) @ R, vectoring)
        close(heading.gravity_torque, turned.gravity_torque, atol=1e-12)


def test_a_snapshot_is_untouched_by_later_calls_and_repeats_bit_for_bit(model):
    (q, R, vectoring), (q2, R2, vectoring2) = configurations(12, count=2)
    names = [f.name for f in fields(model.snapshot(q, R, vectoring))]
    snapshot = model.snapshot(q, R, vectoring)
    kept = {name: np.array(getattr(snapshot, name)) for name in names}
    others = (model.snapshot(q2, R2, vectoring2), model.contacts(q2), rotors(model, q2, vectoring2))
    others += (segments(model, q2, vectoring2), mass_matrix(model, q2, vectoring2))
    again = model.snapshot(q, R, vectoring)
    assert not np.array_equal(others[0].com_b, kept["com_b"])
    for name in names:
        np.testing.assert_array_equal(getattr(snapshot, name), kept[name])
        np.testing.assert_array_equal(getattr(again, name), kept[name])


def test_tables_of_one_call_survive_the_next(model):
    (q, _, vectoring), (q2, _, vectoring2) = configurations(13, count=2)

    def tables(q, vectoring):
        M, _ = mass_matrix(model, q, vectoring)
        return *rotors(model, q, vectoring), *model.contacts(q), *segments(model, q, vectoring), M

    first = tables(q, vectoring)
    kept = [np.array(table) for table in first]
    second = tables(q2, vectoring2)
    for before, now, other in zip(kept, first, second, strict=True):
        np.testing.assert_array_equal(now, before)
        assert before.ndim == 1 or not np.array_equal(other, before)


def test_flat_robot_reaches_over_the_papers_diameter(model):
    feet = model.contacts(FORMS["form1"])[0][:4]
    for leg in (0, 1):
        assert abs(np.linalg.norm(feet[leg] - feet[leg + 2]) + 2 * ROBOT.foot_radius - 2.701) < 0.002


def test_positive_pitch_lowers_and_positive_yaw_turns_the_leg_to_the_left(model):
    flat = model.contacts(np.zeros(16))[0][:4]
    for joint in range(16):
        moved = model.contacts(0.1 * np.eye(16)[joint])[0][:4]
        leg = joint // 4
        change = moved[leg] - flat[leg]
        left = np.cross([0.0, 0.0, 1.0], flat[leg])
        assert change[2] < -0.04 if joint % 2 else change @ left > 0.04
        np.testing.assert_array_equal(np.delete(moved, leg, 0), np.delete(flat, leg, 0))


@pytest.mark.parametrize(
    ("form", "height", "inertia"),
    [
        ("form1", -0.030, (5.00, 5.00, 9.97)),
        ("form2", -0.335, (3.47, 3.47, 5.00)),
        ("form3", -0.372, (2.20, 2.20, 2.62)),
    ],
)
def test_forms_have_the_labs_centre_of_mass_and_inertia(model, form, height, inertia):
    snapshot = upright(model, form)
    assert abs(snapshot.com_b[2] - height) < 1e-3
    # The lab's numbers refer to the 15.21 kg of the summed parts.
    close(np.diag(snapshot.inertia_c) * 15.2108 / 16.0, inertia, atol=0.01)


def test_form_3_stacks_each_outer_rotor_below_the_inner_one_and_slightly_outboard(model):
    snapshot = upright(model, "form3")
    rotors = snapshot.rotor_c + snapshot.com_b
    radius = np.hypot(rotors[:, 0], rotors[:, 1])
    close(radius, np.tile([0.390, 0.427], 4), atol=5e-4)
    close(rotors[:, 2], np.tile([-0.220, -0.588], 4), atol=5e-4)
