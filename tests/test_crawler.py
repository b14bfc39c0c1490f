"""Pins the stack on the ground: feet's maps against MuJoCo, allocation against an exact solver, crawls on the plant."""

from dataclasses import fields, replace
from functools import cache
from itertools import product

import mujoco
import numpy as np
import pytest
from states import demand_of, exact, model, resting

from spidar_gym.control.allocator import AllocationStatus, Allocator
from spidar_gym.control.blocks import torque_map
from spidar_gym.control.crawler import Crawler, CrawlerConfig, with_feet
from spidar_gym.control.footsteps import GaitConfig, Lift, Move, Stand, lying_pose
from spidar_gym.control.leg import leg_angles
from spidar_gym.control.modes import PROJECTION, ground_modes
from spidar_gym.control.planar import Planar
from spidar_gym.control.qp import FORCE_SCALE, assemble
from spidar_gym.errors import InvalidValueError
from spidar_gym.model.rotor import thrust_map
from spidar_gym.robot import GIMBAL_NAMES, JOINT_NAMES, N_LEGS, ROBOT
from spidar_gym.sim.plant import Plant
from spidar_gym.sim.scene import scene
from spidar_gym.so3 import exp, matrix_to_quat
from spidar_gym.state import NO_RESIDUAL, Command, Residual

OPTIMAL = (AllocationStatus.CLOSED_FORM, AllocationStatus.SOLVED)
ON_THE_FLOOR = np.array([0.0, 0.0, ROBOT.peg_depth])
ROTOR_LEG = np.arange(8) // 2
MODES = {
    powered: ground_modes(
        power=powered, torque_weight=1.0, torque_limit=5.0, foot_friction=0.6, peg_friction=0.3, min_normal=10.0
    )
    for powered in (False, True)
}


class Engine:
    """MuJoCo with the torso at the origin: the independent source of positions, Jacobians and weight."""

    def __init__(self):
        self.model = scene(visual=False)
        self.data = mujoco.MjData(self.model)
        self.joints = [int(self.model.joint(name).dofadr[0]) for name in JOINT_NAMES]
        self.links = [self.model.body(self.model.joint(f"joint{i}_pitch").bodyid[0]) for i in range(1, 9)]

    def move(self, q, R_wb, vectoring):
        self.data.qpos[:3], self.data.qpos[3:7] = 0.0, matrix_to_quat(R_wb)
        for name, angle in zip(JOINT_NAMES + GIMBAL_NAMES, [*q, *vectoring.reshape(-1)], strict=True):
            self.data.joint(name).qpos = angle
        self.data.qvel[:] = 0.0
        mujoco.mj_forward(self.model, self.data)

    def jacobian(self, point, body):
        """∂(point of the body)/∂q, world axes (3, 16)."""
        J = np.zeros((3, self.model.nv))
        mujoco.mj_jac(self.model, self.data, J, None, point, body)
        return J[:, self.joints]

    def touching(self, R_wf):
        """Where the feet touch the floor, and the links they belong to."""
        feet = [self.data.site(f"foot{leg}").xpos - ROBOT.foot_radius * R_wf[:, 2] for leg in range(1, N_LEGS + 1)]
        return feet, [self.links[2 * leg + 1].id for leg in range(N_LEGS)]

    def rotors(self):
        """Centres of the rotors and the links that they hang on."""
        return [self.data.site(f"thrust{i}").xpos.copy() for i in range(1, 9)], [link.id for link in self.links]

    def attitude(self, body):
        return self.data.xmat[body].reshape(3, 3).copy()

    @property
    def com(self):
        return self.data.body("torso").subtree_com.copy()

    @property
    def gravity_torque(self):
        return self.data.qfrc_bias[self.joints].copy()


@cache
def engine():
    return Engine()


def random_stances(seed, n):
    """Poses near the crawl's, torso on the floor or lifted: q, attitudes of torso and floor, vectoring."""
    rng, config = np.random.default_rng(seed), GaitConfig()
    for _ in range(n):
        q = leg_angles(config.home_b - (0.0, 0.0, rng.choice([0.0, rng.uniform(0.0, 0.1)])))
        R_wf = exp(rng.uniform(-0.1, 0.1, 3))
        yield q + rng.normal(scale=0.08, size=16), exp(rng.uniform(-0.08, 0.08, 3)), R_wf, rng.uniform(-0.6, 0.6, (8, 2))


def feet_maps(q, R_wb, R_wf, vectoring):
    """The columns of `with_feet` that belong to the feet, and the rest of them."""
    snapshot, feet = model().stance(q, R_wb, vectoring)
    Q, T = thrust_map(snapshot.R_bl, snapshot.rotor_c), torque_map(snapshot)
    wide_Q, wide_T = with_feet(Q, T, snapshot, feet, R_wb.T @ R_wf)
    np.testing.assert_array_equal(wide_Q[:, :24], Q)
    np.testing.assert_array_equal(wide_T[:, :24], T)
    return wide_Q, wide_T


def test_feet_and_their_jacobians_are_those_of_mujoco():
    for q, R_wb, _, vectoring in random_stances(0, 8):
        _, feet = model().stance(q, R_wb, vectoring)
        engine().move(q, R_wb, vectoring)
        centres, links = engine().touching(np.zeros((3, 3)))
        for leg, (centre, link) in enumerate(zip(centres, links, strict=True)):
            np.testing.assert_allclose(R_wb @ feet.position_b[leg], centre, atol=1e-9)
            np.testing.assert_allclose(R_wb @ feet.J[leg], engine().jacobian(centre, link), atol=1e-9)


def test_a_stance_is_the_snapshot_and_the_feet_and_neither_changes_when_the_model_moves_on():
    poses = list(random_stances(1, 2))
    (q, R_wb, _, vectoring), (other_q, other_R, _, _) = poses
    snapshot, feet = model().stance(q, R_wb, vectoring)
    kept = [getattr(part, f.name) for part in (snapshot, feet) for f in fields(part)]
    before = [np.copy(value) for value in kept]
    model().stance(other_q, other_R, vectoring)
    for value, old in zip(kept, before, strict=True):
        np.testing.assert_array_equal(value, old)
    alone = model().snapshot(q, R_wb, vectoring)
    for f in fields(alone):
        np.testing.assert_array_equal(getattr(alone, f.name), getattr(snapshot, f.name))


def test_wrench_of_foot_forces_is_that_of_forces_at_the_lowest_points_of_the_balls():
    rng = np.random.default_rng(2)
    for q, R_wb, R_wf, vectoring in random_stances(2, 8):
        Q, _ = feet_maps(q, R_wb, R_wf, vectoring)
        engine().move(q, R_wb, vectoring)
        points, _ = engine().touching(R_wf)
        forces = rng.uniform(-30.0, 30.0, (4, 3))
        forces_w = forces @ R_wf.T
        torque_w = np.cross(points - engine().com, forces_w).sum(axis=0)
        by_hand = np.concatenate([R_wb.T @ forces_w.sum(axis=0), R_wb.T @ torque_w])
        np.testing.assert_allclose(Q[:, 24:] @ forces.reshape(-1), by_hand, atol=1e-8)


def test_joint_torque_of_foot_forces_is_that_of_the_jacobian_of_the_touching_point():
    for q, R_wb, R_wf, vectoring in random_stances(3, 8):
        _, T = feet_maps(q, R_wb, R_wf, vectoring)
        engine().move(q, R_wb, vectoring)
        points, links = engine().touching(R_wf)
        for leg, (point, link) in enumerate(zip(points, links, strict=True)):
            by_mujoco = engine().jacobian(point, link).T @ R_wf
            np.testing.assert_allclose(T[:, 24 + 3 * leg : 27 + 3 * leg], by_mujoco, atol=1e-9)


def test_joint_torque_of_foot_forces_is_their_virtual_work_on_the_material_of_the_ball_where_it_touches():
    h = 1e-6
    for q, R_wb, R_wf, vectoring in random_stances(4, 3):
        _, T = feet_maps(q, R_wb, R_wf, vectoring)
        engine().move(q, R_wb, vectoring)
        points, links = engine().touching(R_wf)
        in_link = [engine().attitude(k).T @ (p - engine().data.xpos[k]) for p, k in zip(points, links, strict=True)]
        for j, step in enumerate(h * np.eye(16)):
            moved = []
            for side in (step, -step):
                engine().move(q + side, R_wb, vectoring)
                placed = zip(in_link, links, strict=True)
                moved.append([engine().data.xpos[k] + engine().attitude(k) @ p for p, k in placed])
            speed = (np.array(moved[0]) - moved[1]) / (2.0 * h)
            np.testing.assert_allclose(T[j, 24:], (speed @ R_wf).reshape(-1), atol=1e-7)


def ground_demand(rng, pose, mode):
    """What the crawler asks in one of these poses: all legs, some legs, or the robot on its feet."""
    q, R_wb, R_wf, vectoring = pose
    snapshot, feet = model().stance(q, R_wb, vectoring)
    Q, T = thrust_map(snapshot.R_bl, snapshot.rotor_c), torque_map(snapshot)
    if mode.feet_carry:
        Q, T = with_feet(Q, T, snapshot, feet, R_wb.T @ R_wf)
    lifted = np.full(4, mode.name != "rest")
    if mode.name == "leg":
        lifted = np.array(list(product((False, True), repeat=4))[rng.integers(1, 15)])
    return replace(
        demand_of(q, R_wb, np.concatenate([ROBOT.weight * R_wb[2], np.zeros(3)])),
        thrust_map=Q,
        torque_map=T,
        gravity_torque=snapshot.gravity_torque,
        locked=rng.random(8) < 0.15,
        lost=~lifted[ROTOR_LEG] if mode.name == "leg" else np.zeros(8, bool),
        lifted=lifted,
        com_b=snapshot.com_b,
        R_bf=R_wb.T @ R_wf,
        effort=rng.uniform(0.7, 1.5, 8),
    )


@cache
def answers(name, powered=False, n=200):
    """Poses, what is asked there, the exact optimum [N] or None, and the allocator's answer."""
    rng, mode, allocator = np.random.default_rng(5), MODES[powered][name], Allocator(MODES[powered])
    found = []
    for pose in random_stances(6, n):
        demand = ground_demand(rng, pose, mode)
        # The exact solver wants independent equalities: a rotor that gives nothing needs no plane.
        optimum = exact(assemble(mode, replace(demand, locked=demand.locked & ~demand.lost)))
        allocation = allocator.allocate(demand, name, np.zeros((8, 3)))
        found.append((pose, demand, None if optimum is None else FORCE_SCALE * optimum, allocation))
    return found


@pytest.mark.parametrize("powered", [False, True], ids=["paper", "power"])
@pytest.mark.parametrize("name", ["rest", "leg", "legs", "stance"])
def test_every_ground_mode_agrees_with_an_exact_solver(name, powered):
    feasible = 0
    for _, _, optimum, allocation in answers(name, powered):
        if optimum is None:
            assert allocation.status not in OPTIMAL
            assert allocation.slack > 0.0
            continue
        feasible += 1
        assert allocation.status in OPTIMAL
        np.testing.assert_allclose(allocation.forces_l.reshape(-1), optimum[:24], rtol=0, atol=1e-6)
        np.testing.assert_allclose(allocation.foot_forces_f.reshape(-1)[: len(optimum) - 24], optimum[24:], atol=1e-6)
    assert feasible > 150
