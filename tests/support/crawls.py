"""A crawling robot in MuJoCo, and MuJoCo as a source of positions and weight, for the tests of the crawler."""

from functools import cache

import mujoco
import numpy as np

from spidar_gym.control.allocation.allocator import AllocationStatus
from spidar_gym.control.crawl.controller import Crawler, CrawlerConfig
from spidar_gym.control.crawl.footsteps import Lift, Move, Stand, lying_pose
from spidar_gym.control.crawl.pose2 import Pose2
from spidar_gym.native.plant import Plant
from spidar_gym.robot import GIMBAL_NAMES, JOINT_NAMES, N_LEGS, ROBOT
from spidar_gym.sim.scene import scene
from spidar_gym.so3 import matrix_to_quat, quat_to_matrix

OPTIMAL = (AllocationStatus.CLOSED_FORM, AllocationStatus.SOLVED)
ON_THE_FLOOR = np.array([0.0, 0.0, ROBOT.peg_depth])
ROTOR_LEG = np.arange(8) // 2


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
        """Points where the feet touch the floor, and the links of these feet."""
        feet = [self.data.site(f"foot{leg}").xpos - ROBOT.foot_radius * R_wf[:, 2] for leg in range(1, N_LEGS + 1)]
        return feet, [self.links[2 * leg + 1].id for leg in range(N_LEGS)]

    def rotors(self):
        """Centres of the rotors, and their links."""
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


def attitude(state):
    return quat_to_matrix(state.quat_wb)


class Ride:
    """A recorded crawl of the nominal robot: states, commands, ticks, and the contacts with the floor after each."""

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
