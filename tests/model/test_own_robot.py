"""Pins custom robots: MuJoCo and Pinocchio compute equal quantities from the same MJCF."""

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from support.robots import LONG, ROBOTS

from spidar_gym.model.dynamics import Model
from spidar_gym.robot import CONTACT_SITES, GIMBAL_NAMES, JOINT_NAMES, ROBOT, ROTOR_SITES
from spidar_gym.robot.description import mjcf, model_file
from spidar_gym.so3 import quat_to_matrix

JOINTS = JOINT_NAMES + GIMBAL_NAMES
SITES = ROTOR_SITES + CONTACT_SITES


class Both:
    """A robot in both engines in the same state; velocities in torso axes, joints in the order of `JOINTS`."""

    def __init__(self, robot):
        self.mj = mujoco.MjModel.from_xml_string(mjcf(robot))
        self.data = mujoco.MjData(self.mj)
        with model_file(robot) as path:
            self.pin = pin.buildModelFromMJCF(str(path))
        self.work = self.pin.createData()
        self.mj_dofs = [*range(6), *(int(self.mj.joint(name).dofadr[0]) for name in JOINTS)]
        self.ids = [self.pin.getJointId(name) for name in JOINTS]
        self.pin_dofs = [*range(6), *(self.pin.idx_vs[i] for i in self.ids)]

    def move(self, rng):
        quat = rng.normal(size=4)
        quat /= np.linalg.norm(quat)
        position, angles = rng.uniform(-2.0, 2.0, 3), np.append(rng.uniform(-1.5, 1.5, 16), rng.uniform(-3.0, 3.0, 16))
        self.v = rng.normal(size=38)  # linear and angular velocity of the torso in its axes, then the joints
        self.R = quat_to_matrix(quat)
        self.data.qpos[:7] = [*position, *quat]
        self.q = pin.neutral(self.pin)
        self.q[:7] = [*position, *np.roll(quat, -1)]
        for name, i, angle in zip(JOINTS, self.ids, angles, strict=True):
            self.data.joint(name).qpos = angle
            self.q[self.pin.idx_qs[i]] = angle
        self.data.qvel[self.mj_dofs] = self.v
        self.data.qvel[:3] = self.R @ self.v[:3]
        self.v_pin = np.zeros(self.pin.nv)
        self.v_pin[self.pin_dofs] = self.v
        mujoco.mj_forward(self.mj, self.data)

    def turned(self, rows):
        """Rotate the first three rows of MuJoCo's forces or maps from world axes to torso axes."""
        rows = rows[self.mj_dofs].copy()
        rows[:3] = self.R.T @ rows[:3]
        return rows

    def mass_matrices(self):
        M = np.zeros((self.mj.nv, self.mj.nv))
        mujoco.mj_fullM(self.mj, self.data, M)
        M -= np.diag(self.mj.dof_armature)
        one = self.turned(self.turned(M).T)
        two = pin.crba(self.pin, self.work, self.q)
        two = np.triu(two) + np.triu(two, 1).T - np.diag(self.pin.armature)
        return one, two[np.ix_(self.pin_dofs, self.pin_dofs)]

    def biases(self):
        # A constant velocity in torso axes is an acceleration in world axes: R (ω × v).
        rest = np.zeros(self.mj.nv)
        rest[:3] = self.R @ np.cross(self.v[3:6], self.v[:3])
        more = np.zeros(self.mj.nv)
        mujoco.mj_mulM(self.mj, self.data, more, rest)
        two = pin.rnea(self.pin, self.work, self.q, self.v_pin, np.zeros(self.pin.nv))
        return self.turned(self.data.qfrc_bias + more), two[self.pin_dofs]

    def sites(self):
        """Return the stacked positions and Jacobians of rotors, feet and pegs."""
        pin.computeJointJacobians(self.pin, self.work, self.q)
        pin.updateFramePlacements(self.pin, self.work)
        one, two = [], []
        for name in SITES:
            J = np.zeros((2, 3, self.mj.nv))
            mujoco.mj_jacSite(self.mj, self.data, J[0], J[1], self.data.site(name).id)
            one += [self.data.site(name).xpos.copy(), *(self.turned(each.T) for each in J)]
            frame = self.pin.getFrameId(name)
            both = pin.getFrameJacobian(self.pin, self.work, frame, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)
            two += [
                self.work.oMf[frame].translation.copy(),
                *(each.T for each in both[:, self.pin_dofs].reshape(2, 3, -1)),
            ]
        return np.vstack(one), np.vstack(two)

    def coms(self):
        J = np.zeros((3, self.mj.nv))
        mujoco.mj_jacSubtreeCom(self.mj, self.data, J, self.mj.body("torso").id)
        J_pin = pin.jacobianCenterOfMass(self.pin, self.work, self.q)[:, self.pin_dofs]
        one = np.vstack((self.data.body("torso").subtree_com, self.turned(J.T)))
        return one, np.vstack((self.work.com[0], J_pin.T))


@pytest.mark.parametrize("name", ROBOTS)
def test_mujoco_and_pinocchio_agree_on_a_custom_robot_to_a_billionth(name):
    both, rng = Both(ROBOTS[name]), np.random.default_rng(0)
    for _ in range(50):
        both.move(rng)
        for pair in (both.mass_matrices(), both.biases(), both.sites(), both.coms()):
            np.testing.assert_allclose(*pair, rtol=0, atol=1e-9)


@pytest.mark.parametrize("name", ROBOTS)
def test_the_model_of_a_robot_has_its_mass_and_its_feet(name):
    robot, model = ROBOTS[name], Model(ROBOTS[name])
    snapshot, feet = model.stance(np.zeros(16), np.eye(3), np.zeros((8, 2)))
    assert snapshot.robot is robot
    assert abs(snapshot.mass - robot.total_mass) < 1e-9
    reach = robot.diameter / 2 - robot.foot_radius
    np.testing.assert_allclose(np.hypot(feet.position_b[:, 0], feet.position_b[:, 1]), reach, rtol=1e-12)


def test_one_process_can_use_two_robots():
    pose = np.full(16, 0.3), np.eye(3), np.zeros((8, 2))
    nominal, long = Model(), Model(LONG)
    before = nominal.snapshot(*pose)
    other = long.snapshot(*pose)
    after = nominal.snapshot(*pose)
    np.testing.assert_array_equal(before.momentum_map, after.momentum_map)
    assert np.abs(other.momentum_map - before.momentum_map).max() > 0.01
    assert (before.robot, other.robot) == (ROBOT, LONG)
