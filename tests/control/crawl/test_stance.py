"""Pins ground allocation: foot forces and Jacobians against MuJoCo, every mode against an exact solver, equilibrium."""

from dataclasses import fields, replace
from functools import cache
from itertools import product

import numpy as np
import pytest
from support.crawls import OPTIMAL, ROTOR_LEG, by_mujoco, engine
from support.states import demand_of, exact, model

from spidar_gym.control.allocation.allocator import AllocationStatus, Allocator
from spidar_gym.control.allocation.blocks import torque_map
from spidar_gym.control.allocation.modes import ground_modes
from spidar_gym.control.allocation.problem import FORCE_SCALE, assemble
from spidar_gym.control.crawl.controller import with_feet
from spidar_gym.control.crawl.footsteps import GaitConfig
from spidar_gym.control.crawl.kinematics import leg_angles
from spidar_gym.model.rotor import thrust_map
from spidar_gym.robot import ROBOT
from spidar_gym.so3 import exp

MODES = {
    powered: ground_modes(
        power=powered, torque_weight=1.0, torque_limit=5.0, foot_friction=0.6, peg_friction=0.3, min_normal=10.0
    )
    for powered in (False, True)
}


def random_stances(seed, n):
    """Poses near those of a crawl, torso on the floor or lifted: q, attitudes of torso and floor, vectoring."""
    rng, config = np.random.default_rng(seed), GaitConfig()
    for _ in range(n):
        q = leg_angles(config.home_b - (0.0, 0.0, rng.choice([0.0, rng.uniform(0.0, 0.1)])))
        R_wf = exp(rng.uniform(-0.1, 0.1, 3))
        yield (
            q + rng.normal(scale=0.08, size=16),
            exp(rng.uniform(-0.08, 0.08, 3)),
            R_wf,
            rng.uniform(-0.6, 0.6, (8, 2)),
        )


def feet_maps(q, R_wb, R_wf, vectoring):
    """Thrust and torque maps of `with_feet`, after a check that the rotors' columns are unchanged."""
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
    """Demand of the crawler in a pose: all legs or some legs lifted, or the robot on its feet."""
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
def answers(name, powered):
    """Poses, their demands, the exact optimum [N] or None, and the allocator's answer."""
    rng, mode, allocator = np.random.default_rng(5), MODES[powered][name], Allocator(MODES[powered])
    found = []
    for pose in random_stances(6, 40 if powered else 120):
        demand = ground_demand(rng, pose, mode)
        # The exact solver requires independent equalities: a rotor without thrust needs no plane.
        optimum = exact(assemble(mode, replace(demand, locked=demand.locked & ~demand.lost)))
        allocation = allocator.allocate(demand, name, np.zeros((8, 3)))
        found.append((pose, demand, None if optimum is None else FORCE_SCALE * optimum, allocation))
    return found


@pytest.mark.parametrize("powered", [False, True], ids=["paper", "power"])
@pytest.mark.parametrize("name", ["rest", "leg", "legs", "stance"])
def test_every_ground_mode_agrees_with_an_exact_solver(name, powered):
    for _, _, optimum, allocation in answers(name, powered):
        assert optimum is not None, "every demand here is feasible"
        assert allocation.status in OPTIMAL
        np.testing.assert_allclose(allocation.forces_l.reshape(-1), optimum[:24], rtol=0, atol=1e-6)
        np.testing.assert_allclose(allocation.foot_forces_f.reshape(-1)[: len(optimum) - 24], optimum[24:], atol=1e-6)


def test_robot_on_its_feet_is_in_equilibrium_and_no_joint_bears_more_than_its_limit():
    pressed = 0
    for pose, demand, _, allocation in answers("stance", False)[::2]:
        wrench, torque = by_mujoco(pose, demand, allocation.forces_l, allocation.foot_forces_f)
        np.testing.assert_allclose(wrench, 0.0, atol=1e-5)
        np.testing.assert_allclose(allocation.joint_torques, torque, atol=1e-6)
        assert np.abs(torque).max() <= 5.0 + 1e-5
        pressed += np.abs(torque).max() > 5.0 - 1e-5
        feet = allocation.foot_forces_f
        assert feet[:, 2].min() >= 0.5 - 1e-4
        assert (np.abs(feet[:, :2]) <= 0.6 * feet[:, 2:] + 1e-4).all()
    assert pressed > 20, "the limit matters"


def test_a_robot_on_its_pegs_loads_them_within_bounds_and_no_joint_bears_more_than_its_limit():
    pressed = 0
    for pose, demand, _, allocation in answers("legs", False)[::2]:
        wrench, torque = by_mujoco(pose, demand, allocation.forces_l, allocation.foot_forces_f)
        assert np.abs(torque).max() <= 5.0 + 1e-5
        pressed += np.abs(torque).max() > 5.0 - 1e-5
        assert not allocation.foot_forces_f.any()
        pegs = -(pose[1].T @ wrench[:3])
        sideways = 0.3 * 10.0 / (2.0 * np.sqrt(2.0))
        assert pegs[2] >= 10.0 - 1e-4
        assert np.abs(pegs[:2]).max() <= sideways + 1e-4
    assert pressed > 20, "the limit matters"


def test_only_the_rotors_of_lifted_legs_lift_and_their_joints_bear_no_more_than_the_limit():
    for pose, demand, _, allocation in answers("leg", False)[::2]:
        _, torque = by_mujoco(pose, demand, allocation.forces_l, allocation.foot_forces_f)
        up = np.repeat(demand.lifted, 4)
        assert np.abs(torque[up]).max() <= 5.0 + 1e-5
        assert not allocation.forces_l[~demand.lifted[ROTOR_LEG]].any()
        assert not allocation.thrust[~demand.lifted[ROTOR_LEG]].any()


def test_a_robot_at_rest_needs_no_thrust():
    for _, _, _, allocation in answers("rest", False)[::10]:
        assert not allocation.forces_l.any()
        assert allocation.status == AllocationStatus.CLOSED_FORM


def test_a_wrench_that_no_floor_can_exert_is_softened_within_the_sphere_and_the_held_planes():
    rng, allocator = np.random.default_rng(7), Allocator(MODES[False])
    for pose in random_stances(7, 15):
        demand = ground_demand(rng, pose, MODES[False]["stance"])
        demand = replace(demand, wrench=demand.wrench - np.array([0.0, 0.0, 900.0, 0.0, 0.0, 0.0]))
        assert exact(assemble(MODES[False]["stance"], demand)) is None
        allocation = allocator.allocate(demand, "stance", np.zeros((8, 3)))
        assert allocation.status == AllocationStatus.SOFTENED
        assert allocation.slack > 0.1
        assert allocation.thrust.max() <= ROBOT.max_thrust + 1e-9
        off = np.cos(demand.phi) * allocation.forces_l[:, 1] + np.sin(demand.phi) * allocation.forces_l[:, 2]
        np.testing.assert_allclose(off[demand.locked], 0.0, atol=1e-4)
        np.testing.assert_allclose(
            allocation.unallocated_wrench,
            demand.wrench
            - demand.thrust_map
            @ np.concatenate([allocation.forces_l.reshape(-1), allocation.foot_forces_f.reshape(-1)]),
            atol=1e-9,
        )
