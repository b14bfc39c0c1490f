"""Pins the stack on the ground: feet's maps against MuJoCo, allocation against an exact solver, crawls on the plant."""

import copy
from dataclasses import fields, replace
from functools import cache
from itertools import product

import mujoco
import numpy as np
import pytest
from support.states import demand_of, exact, model, resting

from spidar_gym.control.allocation.allocator import AllocationStatus, Allocator
from spidar_gym.control.allocation.blocks import torque_map
from spidar_gym.control.allocation.modes import ground_modes
from spidar_gym.control.allocation.problem import FORCE_SCALE, assemble
from spidar_gym.control.crawl.controller import Crawler, CrawlerConfig, with_feet
from spidar_gym.control.crawl.footsteps import GaitConfig, Lift, Move, Stand, lying_pose
from spidar_gym.control.crawl.kinematics import leg_angles
from spidar_gym.control.crawl.pose2 import Pose2
from spidar_gym.errors import InvalidValueError
from spidar_gym.model.rotor import thrust_map
from spidar_gym.robot import GIMBAL_NAMES, JOINT_NAMES, N_LEGS, ROBOT
from spidar_gym.sim.plant import Plant
from spidar_gym.sim.scene import scene
from spidar_gym.so3 import exp, matrix_to_quat, quat_to_matrix
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
        yield (
            q + rng.normal(scale=0.08, size=16),
            exp(rng.uniform(-0.08, 0.08, 3)),
            R_wf,
            rng.uniform(-0.6, 0.6, (8, 2)),
        )


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
def answers(name, powered):
    """Poses, what is asked there, the exact optimum [N] or None, and the allocator's answer."""
    rng, mode, allocator = np.random.default_rng(5), MODES[powered][name], Allocator(MODES[powered])
    found = []
    for pose in random_stances(6, 40 if powered else 120):
        demand = ground_demand(rng, pose, mode)
        # The exact solver wants independent equalities: a rotor that gives nothing needs no plane.
        optimum = exact(assemble(mode, replace(demand, locked=demand.locked & ~demand.lost)))
        allocation = allocator.allocate(demand, name, np.zeros((8, 3)))
        found.append((pose, demand, None if optimum is None else FORCE_SCALE * optimum, allocation))
    return found


@pytest.mark.parametrize("powered", [False, True], ids=["paper", "power"])
@pytest.mark.parametrize("name", ["rest", "leg", "legs", "stance"])
def test_every_ground_mode_agrees_with_an_exact_solver(name, powered):
    for _, _, optimum, allocation in answers(name, powered):
        assert optimum is not None, "nothing here asks for the impossible"
        assert allocation.status in OPTIMAL
        np.testing.assert_allclose(allocation.forces_l.reshape(-1), optimum[:24], rtol=0, atol=1e-6)
        np.testing.assert_allclose(allocation.foot_forces_f.reshape(-1)[: len(optimum) - 24], optimum[24:], atol=1e-6)


def by_mujoco(pose, demand, forces_l, foot_forces_f):
    """Wrench of rotors, feet and weight about the CoG, world axes, and joint torque that holds the links."""
    q, R_wb, R_wf, vectoring = pose
    engine().move(q, R_wb, vectoring)
    centres, links = engine().rotors()
    points, outer = engine().touching(R_wf)
    forces_w = [engine().attitude(link) @ f for link, f in zip(links, forces_l, strict=True)]
    forces_w += [R_wf @ f for f in foot_forces_f]
    torque, wrench = engine().gravity_torque, np.array([0.0, 0.0, -ROBOT.weight, 0.0, 0.0, 0.0])
    for point, link, force in zip([*centres, *points], links + outer, forces_w, strict=True):
        torque -= engine().jacobian(point, link).T @ force
        wrench += np.concatenate([force, np.cross(point - engine().com, force)])
    return wrench, torque


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


def test_robot_on_its_pegs_asks_of_them_a_wrench_within_bounds_and_no_joint_bears_more_than_its_limit():
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


def test_a_robot_at_rest_is_given_no_thrust():
    for _, _, _, allocation in answers("rest", False)[::10]:
        assert not allocation.forces_l.any()
        assert allocation.status == AllocationStatus.CLOSED_FORM


def test_what_no_floor_can_give_is_softened_within_the_sphere_and_the_held_planes():
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


def attitude(state):
    return quat_to_matrix(state.quat_wb)


class Ride:
    """A crawl of the nominal robot: states before, commands, ticks, what the floor felt after."""

    def __init__(self, commands, config=None):
        self.crawler, plant = Crawler(config), Plant()
        state = plant.reset(ON_THE_FLOOR, joint_position=lying_pose(self.crawler.config.gait))
        self.crawler.reset(state, commands)
        self.states, self.commands, self.ticks, self.touches, self.contacts, self.heights = [state], [], [], [], [], []
        while len(self.ticks) < 1000 and (not self.ticks or not self.over):
            self.commands.append(self.crawler.step(state))
            state = plant.step(self.commands[-1])
            self.states.append(state)
            self.ticks.append(self.crawler.last_step)
            self.touches.append(plant.touch())
            self.contacts.append(plant.contact_forces())
            sites = [*(f"foot{leg}" for leg in range(1, 5)), *(f"peg{i}" for i in (1, 3, 5, 7))]
            radii = np.repeat([ROBOT.foot_radius, 0.0], 4)
            self.heights.append([plant.data.site(name).xpos[2] for name in sites] - radii)

    @property
    def over(self):
        return self.crawler.done

    def during(self, phase):
        """Ticks of a phase."""
        return [k for k, tick in enumerate(self.ticks) if tick.phase == phase]


@cache
def ride(*commands, **config):
    return Ride(commands, CrawlerConfig(**config))


STEP, STAND, ALL = Move(Pose2(0.1)), Stand(), Lift((0, 1, 2, 3))
JOURNEYS = pytest.mark.parametrize("command", [STEP, STAND, ALL, Lift((0,))], ids=["move", "stand", "lift", "lift one"])


def test_one_cycle_moves_the_torso_where_it_was_sent():
    states = ride(STEP).states
    np.testing.assert_allclose(states[-1].position_w - states[0].position_w, [0.1, 0.0, 0.0], atol=0.005)
    assert abs(states[-1].quat_wb[0]) > 1.0 - 1e-4


@JOURNEYS
def test_thrust_comes_and_goes_without_a_jolt_and_is_off_at_the_end(command):
    crawl = ride(command)
    assert crawl.over
    thrust = np.array([np.zeros(8), *(command.thrust for command in crawl.commands)])
    assert np.abs(np.diff(thrust.sum(axis=1))).max() <= 5.0
    assert thrust.max() <= ROBOT.max_thrust
    assert thrust.sum(axis=1).max() > 15.0
    assert not thrust[-1].any()
    forces = np.array([np.zeros((8, 3)), *(tick.forces_l for tick in crawl.ticks)])
    np.testing.assert_allclose(np.linalg.norm(forces, axis=2), thrust, atol=1e-9)
    assert np.linalg.norm(np.diff(forces, axis=0), axis=2).max() <= 1.0


@JOURNEYS
def test_every_tick_of_a_crawl_is_answered_with_an_optimum(command):
    assert {tick.allocation.status for tick in ride(command).ticks} <= set(OPTIMAL)


def test_without_blending_forces_would_jump_when_the_mode_changes():
    forces = np.array([tick.forces_l for tick in ride(Stand(0.05, seconds=0.0), blend_time=0.0).ticks])
    assert np.linalg.norm(np.diff(forces, axis=0), axis=2).max() > 5.0


@pytest.mark.parametrize("leg", range(4))
def test_lifting_a_leg_raises_its_foot_alone_by_its_own_rotors_within_the_joint_torque(leg):
    crawl = ride(Lift((leg,), seconds=0.2))
    others = np.arange(4) != leg
    assert np.array(crawl.heights)[crawl.during("hold"), leg].min() > 0.1
    assert not any(crawl.touches[k].feet[leg] for k in crawl.during("hold"))
    assert crawl.touches[-1].feet.all()
    for command, tick, touch, heights in zip(crawl.commands, crawl.ticks, crawl.touches, crawl.heights, strict=True):
        assert touch.feet[others].all()
        assert not touch.ducts
        assert np.abs(heights[4:]).max() < 1e-4, "pegs"
        assert not command.thrust[others[ROTOR_LEG]].any()
        if tick.mode == "leg":
            assert np.abs(tick.allocation.joint_torques[4 * leg : 4 * leg + 4]).max() <= 5.0 + 1e-4
    assert np.abs([s.joint_torque for s in crawl.states]).max() < ROBOT.max_joint_torque


@pytest.mark.parametrize("command", [STAND, ALL, Lift((0,))], ids=["stand", "lift", "lift one"])
def test_floor_carries_what_the_commanded_forces_leave_of_the_weight(command):
    crawl = ride(command)
    last = crawl.during("hold")[-1]
    tick, force_w = crawl.ticks[last], np.array([0.0, 0.0, -ROBOT.weight])
    engine().move(crawl.states[last].joint_position, attitude(crawl.states[last]), crawl.states[last].vectoring)
    for link, force in zip(engine().rotors()[1], tick.forces_l, strict=True):
        force_w += engine().attitude(link) @ force
    np.testing.assert_allclose(crawl.contacts[last][:, 3:].sum(axis=0), -force_w, atol=0.1)
    assert crawl.commands[last].thrust.sum() > 15.0


@pytest.mark.parametrize("command", [ALL, Lift((0,))], ids=["all", "one"])
def test_servos_of_a_leg_held_in_the_air_bear_what_was_allocated_to_them(command):
    crawl = ride(command)
    last = crawl.during("hold")[-1]
    up = np.repeat(crawl.ticks[last].demand.lifted, 4)
    allocated = crawl.ticks[last].allocation.joint_torques
    np.testing.assert_allclose(crawl.states[last + 1].joint_torque[up], allocated[up], atol=0.05)
    assert np.abs(allocated[up]).max() > 4.9


def test_feet_of_a_standing_robot_press_as_they_were_allocated():
    crawl = ride(STAND)
    last = crawl.during("hold")[-1]
    points, forces = crawl.contacts[last][:, :3], crawl.contacts[last][:, 3:]
    assert len(points) == 4
    turn = np.arctan2(*(points - crawl.states[last].position_w)[:, 1::-1].T) % (2.0 * np.pi)
    by_leg = forces[np.argsort(turn)]
    allocated = crawl.ticks[last].allocation.foot_forces_f
    np.testing.assert_allclose(by_leg[:, 2], allocated[:, 2], atol=0.2)
    assert crawl.touches[last].feet.all()
    assert not crawl.touches[last].pegs.any()


def test_setpoints_lead_the_plan_by_the_torque_fed_forward_or_not_at_all():
    lying = ride(STAND).states[0]
    for share in (0.0, 0.5, 1.0):
        crawler = Crawler(CrawlerConfig(feed_forward=share, blend_time=0.0))
        crawler.reset(lying, [STAND])
        for state in ride(STAND).states[:50]:
            command = crawler.step(state)
            lead = ROBOT.joint_kp * (command.joint_position - crawler.gait.memory.plan)
            np.testing.assert_allclose(lead, share * crawler.last_step.allocation.joint_torques, atol=1e-9)
    assert np.abs(crawler.last_step.allocation.joint_torques).max() > 4.9


def follow(crawl, residuals=None, crawler=None):
    """Commands of a crawler, a fresh one unless given, that sees the states of another's crawl."""
    if crawler is None:
        crawler = Crawler()
        crawler.reset(crawl.states[0], [STEP])
    states = crawl.states[: len(crawl.ticks)]
    residuals = [NO_RESIDUAL] * len(states) if residuals is None else residuals
    return [crawler.step(state, residual) for state, residual in zip(states, residuals, strict=True)]


def same(a: Command, b: Command) -> bool:
    return all(np.array_equal(getattr(a, f.name), getattr(b, f.name)) for f in fields(a))


def test_a_crawl_depends_on_the_states_alone_bit_for_bit():
    crawl = ride(STEP)
    crawler = Crawler()
    crawler.reset(crawl.states[0], [STAND])
    for state in crawl.states[:40]:
        crawler.step(state)
    crawler.reset(crawl.states[0], [STEP])
    assert all(map(same, follow(crawl, crawler=crawler), crawl.commands))


@pytest.mark.parametrize("tick", [60, 240])
def test_both_memories_are_all_that_a_crawler_remembers(tick):
    crawl, crawler = ride(STEP), Crawler()
    crawler.reset(crawl.states[0], [STEP])
    for state in crawl.states[:tick]:
        crawler.step(state)
    other = Crawler()
    other.memory, other.gait.memory = copy.deepcopy((crawler.memory, crawler.gait.memory))
    for state, command in zip(crawl.states[tick : tick + 50], crawl.commands[tick : tick + 50], strict=True):
        assert same(other.step(state), command)


def test_a_residual_of_zeros_or_one_that_is_not_finite_changes_no_bit():
    crawl = ride(STEP)
    nothing = Residual(np.zeros(6), np.zeros(16), 1.0, np.zeros((8, 3)), np.zeros((4, 3)))
    lost = [Residual(leg_forces_b=np.full((4, 3), np.nan)), Residual(forces_l=np.full((8, 3), np.inf))]
    lost += [Residual(wrench=np.full(6, np.nan)), Residual(stride_scale=np.nan), Residual(lift_scale=np.inf)]
    kinds = [nothing, *lost]
    commands = follow(crawl, [kinds[k % len(kinds)] for k in range(len(crawl.ticks))])
    assert all(map(same, commands, crawl.commands))


def test_a_residual_joint_offset_is_added_to_the_setpoints_within_the_joints_range():
    crawl, rng = ride(STEP), np.random.default_rng(8)
    offsets = rng.uniform(-0.5, 0.5, (len(crawl.ticks), 16))
    commands = follow(crawl, [Residual(joint_offset=offset) for offset in offsets])
    for command, plain, offset in zip(commands, crawl.commands, offsets, strict=True):
        moved = np.clip(plain.joint_position + offset, -np.pi / 2, np.pi / 2)
        np.testing.assert_allclose(command.joint_position, moved, atol=1e-12)
        np.testing.assert_array_equal(command.thrust, plain.thrust)
    assert np.abs([command.joint_position for command in commands]).max() == np.pi / 2


@pytest.mark.parametrize(("by", "size"), [("forces_l", 60.0), ("leg_forces_b", 3.0)])
def test_residual_forces_stay_within_the_sphere_and_the_joint_torque_of_the_servos(by, size):
    crawl, rng, shape = ride(STEP), np.random.default_rng(9), {"forces_l": (8, 3), "leg_forces_b": (4, 3)}
    crawler, changed, short = Crawler(), 0.0, 0
    crawler.reset(crawl.states[0], [STEP])
    for k, (state, plain) in enumerate(zip(crawl.states[:180], crawl.commands, strict=False)):
        command = crawler.step(state, Residual(**{by: rng.uniform(-size, size, shape[by])}))
        tick, allocation = crawler.last_step, crawler.last_step.allocation
        assert max(command.thrust.max(), allocation.thrust.max()) <= ROBOT.max_thrust + 1e-9
        changed = max(changed, np.abs(command.thrust - plain.thrust).max())
        assert allocation.status in OPTIMAL
        if k % 4:
            continue
        pose = state.joint_position, attitude(state), crawler.gait.memory.floor_R, state.vectoring
        _, torque = by_mujoco(pose, tick.demand, allocation.forces_l, allocation.foot_forces_f)
        up = np.repeat(tick.demand.lifted, 4)
        assert not up.any() or np.abs(torque[up]).max() <= ROBOT.max_joint_torque + 1e-3
        short += bool(up.any() and np.abs(torque[up]).max() > 5.1)
    assert changed > 0.5
    assert short > 0, "the policy may use what the allocation keeps in reserve"


def test_residual_forces_do_not_start_the_rotors_of_legs_that_stand():
    crawl, crawler = ride(Lift((0,))), Crawler()
    crawler.reset(crawl.states[0], [Lift((0,))])
    for state in crawl.states[: crawl.during("hold")[0]]:
        command = crawler.step(state, Residual(leg_forces_b=np.full((4, 3), 5.0)))
        assert crawler.last_step.mode == "leg"
        assert not command.thrust[2:].any()
    assert command.thrust[:2].min() > 0.0


def test_valid_residual_forces_by_leg_are_shared_by_its_two_rotors():
    crawl, found = ride(STAND), 0
    crawler = Crawler(CrawlerConfig(blend_time=0.0))
    crawler.reset(crawl.states[0], [STAND])
    wish = np.random.default_rng(10).uniform(-0.2, 0.2, (4, 3))
    for state in crawl.states[:100]:
        saved = copy.deepcopy((crawler.memory, crawler.gait.memory))
        plain = crawler.step(state)
        before = crawler.last_step
        crawler.memory, crawler.gait.memory = saved
        crawler.step(state, Residual(leg_forces_b=wish))
        if before.demand.locked.any() or np.abs(plain.thrust).max() > 40.0:
            continue
        found += 1
        engine().move(state.joint_position, attitude(state), state.vectoring)
        more = crawler.last_step.forces_l - before.forces_l
        for i, link in enumerate(engine().links):
            given_b = attitude(state).T @ engine().attitude(link.id) @ more[i]
            np.testing.assert_allclose(given_b, 0.5 * wish[i // 2], atol=1e-6)
    assert found > 50


NUMBERS = (
    "position_w", "quat_wb", "velocity_w", "omega_b", "joint_position", "joint_velocity", "vectoring",
)  # fmt: skip


def test_a_state_that_is_not_finite_is_answered_with_the_last_command_and_forgotten():
    crawl, crawler = ride(STEP), Crawler()
    crawler.reset(crawl.states[0], [STEP])
    for k, state in enumerate(crawl.states[:-1]):
        for name in NUMBERS if k % 40 == 30 else ():
            for value in (np.nan, np.inf, -np.inf):
                bad = getattr(state, name).copy()
                bad.flat[1] = value
                held = crawler.step(replace(state, **{name: bad}))
                assert crawler.last_step.allocation.status == AllocationStatus.HELD
                np.testing.assert_allclose(held.thrust, crawl.commands[k - 1].thrust, rtol=1e-12)
                for part in ("vectoring", "joint_position", "joint_torque_limit"):
                    np.testing.assert_array_equal(getattr(held, part), getattr(crawl.commands[k - 1], part))
        assert same(crawler.step(state), crawl.commands[k])
        assert crawler.last_step.allocation.status in OPTIMAL


def test_a_lost_pose_on_the_first_tick_is_answered_with_a_robot_that_lies_still():
    lying = resting(lying_pose(GaitConfig()))
    crawler = Crawler()
    crawler.reset(lying, [STEP])
    command = crawler.step(replace(lying, quat_wb=np.zeros(4)))
    assert not command.thrust.any()
    np.testing.assert_array_equal(command.joint_position, lying.joint_position)
    np.testing.assert_array_equal(command.vectoring, lying.vectoring)


def test_a_crawler_with_nothing_to_do_lies_still_with_its_rotors_off():
    crawler, state = Crawler(), resting(lying_pose(GaitConfig()))
    crawler.reset(state)
    for _ in range(20):
        command = crawler.step(state)
        assert not command.thrust.any()
        np.testing.assert_allclose(command.joint_position, state.joint_position, atol=1e-12)
        np.testing.assert_array_equal(command.joint_torque_limit, ROBOT.max_joint_torque)
    assert crawler.gait.done


@pytest.mark.parametrize(
    ("gain", "disturbed"), [("leg_stiffness", "joint_position"), ("leg_damping", "joint_velocity")]
)
def test_thrust_of_a_lifted_leg_pushes_against_its_error_or_its_rate(gain, disturbed):
    crawl, rng, crawler = ride(ALL), np.random.default_rng(11), Crawler()
    crawler.reset(crawl.states[0], [ALL])
    last = crawl.during("hold")[-1]
    for state in crawl.states[:last]:
        crawler.step(state)
    crawlers = Crawler(), Crawler(CrawlerConfig(**{gain: 20.0}))
    for _ in range(10):
        error, state, torques = rng.uniform(-0.05, 0.05, 16), crawl.states[last], []
        for other in crawlers:
            other.memory, other.gait.memory = copy.deepcopy((crawler.memory, crawler.gait.memory))
            other.step(replace(state, **{disturbed: getattr(state, disturbed) + error}))
            torques.append(other.last_step.demand.torque_map @ other.last_step.allocation.forces_l.reshape(-1))
        assert error @ (torques[1] - torques[0]) < 0.0


@pytest.mark.parametrize("name", ["joint_speed", "rate_hz", "torque_limit", "foot_friction", "peg_friction"])
@pytest.mark.parametrize("value", [0.0, -1.0, np.nan, np.inf])
def test_a_crawler_without_a_positive_limit_is_refused(name, value):
    with pytest.raises(InvalidValueError, match=f"{name}.*expected"):
        CrawlerConfig(**{name: value})


@pytest.mark.parametrize("name", ["blend_time", "min_normal", "torque_weight", "feed_forward", "leg_stiffness"])
def test_a_crawler_with_a_negative_gain_or_time_is_refused_but_zero_is_a_choice(name):
    with pytest.raises(InvalidValueError, match=f"{name}.*expected"):
        CrawlerConfig(**{name: -0.1})
    assert getattr(CrawlerConfig(**{name: 0.0}), name) == 0.0
