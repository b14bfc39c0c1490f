"""A robot on a floor that a manager of both gaits takes to the air and back: what is seen on the way."""

import math
from dataclasses import dataclass, field, replace

import numpy as np

from spidar_gym.control.crawl.footsteps import lying_pose
from spidar_gym.control.estimator import Estimator
from spidar_gym.control.locomotion.commands import Land, TakeOff
from spidar_gym.control.locomotion.manager import Manager
from spidar_gym.control.locomotion.orders import ManagerConfig
from spidar_gym.control.presets import controller_config
from spidar_gym.native.plant import Plant
from spidar_gym.robot import ROBOT
from spidar_gym.sim.config import PlantConfig
from spidar_gym.sim.disturbances import Disturbances
from spidar_gym.sim.ground import GroundConfig
from spidar_gym.sim.randomize import randomize
from spidar_gym.so3 import matrix_to_quat, quat_to_matrix
from spidar_gym.state import Command

JOINT_SPEED = 0.6
HOP = (TakeOff(1.0), Land())
SETTLING = 40
CONFIG = ManagerConfig(flight=replace(controller_config("tuned"), joint_speed=JOINT_SPEED))


@dataclass
class Seen:
    """What a mission looked like, tick by tick."""

    time: list[float] = field(default_factory=list)
    phase: list[str] = field(default_factory=list)
    position_w: list[np.ndarray] = field(default_factory=list)
    tilt: list[float] = field(default_factory=list)
    against_floor: list[float] = field(default_factory=list)
    thrust: list[float] = field(default_factory=list)
    vectoring: list[np.ndarray] = field(default_factory=list)
    touchdown: float = 0.0
    slip: float = 0.0
    done: float | None = None

    def phases(self):
        """Phases in their order."""
        return [p for k, p in enumerate(self.phase) if k == 0 or self.phase[k - 1] != p]

    def during(self, *phases):
        return np.isin(self.phase, phases)


class Mission:
    """One robot on a floor with a manager."""

    def __init__(self, seed=0, *, strength=0.0, sense=False, ground=None, wind=0.0, push=0.0, manager=None):
        rng, ground = np.random.default_rng(seed), ground or GroundConfig()
        config = PlantConfig(sense=sense, ground=ground, joint_speed=JOINT_SPEED)
        if strength:
            config = replace(randomize(config, rng, strength)[0], ground=ground, sense=sense)
        self.plant, self.estimator, self.ground = Plant(config), Estimator(), ground
        self.manager = manager or Manager(CONFIG)
        gait = self.manager.config.crawl.gait
        q = lying_pose(gait)
        below = ground.height(np.vstack((gait.home_b, 0.12 * np.eye(3), -0.12 * np.eye(3)))).max()
        place = ground.R_wf @ np.array([0.0, 0.0, ROBOT.peg_depth + float(below)])
        disturbances = Disturbances(wind=wind, push=push)
        state = self.plant.reset(
            place, matrix_to_quat(ground.R_wf), q, np.zeros((8, 2)), disturbances=disturbances, rng=rng
        )
        still = Command(np.zeros(8), np.zeros((8, 2)), q, np.full(16, ROBOT.max_joint_torque))
        for _ in range(SETTLING):
            state = self.plant.step(still)
        self.state = self.seen = state
        if sense:
            first = self.plant.measure()
            self.estimator.reset(replace(state, joint_position=first.joint_position, vectoring=first.vectoring))
            self.seen = self.estimator.update(first, state.thrust)
        self.seen_so_far = Seen()

    def tick(self):
        """One control period."""
        seen, m, fell = self.seen_so_far, self.manager, float(self.state.velocity_w[2])
        command = m.step(self.seen)
        self.state = self.plant.step(command)
        self.seen = self.state
        if self.plant.config.sense:
            self.seen = self.estimator.update(self.plant.measure(), command.thrust)
        if m.phase == "descend" and self.plant.in_contact and not seen.touchdown:
            seen.touchdown = -fell
        if m.phase in ("spool", "unload"):
            seen.slip += 0.025 * float(self.plant.touch().foot_slip.max())
        R_wb = quat_to_matrix(self.state.quat_wb)
        seen.time.append(len(seen.time) / 40.0)
        seen.phase.append(m.phase)
        seen.position_w.append(self.state.position_w)
        seen.tilt.append(math.acos(min(1.0, float(R_wb[2, 2]))))
        seen.against_floor.append(math.acos(min(1.0, float(R_wb[:, 2] @ self.ground.R_wf[:, 2]))))
        seen.thrust.append(float(command.thrust.sum()))
        seen.vectoring.append(command.vectoring)

    def until(self, phase, ticks=0):
        """Tick until this phase, and that many ticks into it."""
        while self.manager.phase != phase:
            self.tick()
            assert len(self.seen_so_far.time) < 4000, f"{phase} did not come"
        for _ in range(ticks):
            self.tick()

    def fly(self, commands, seconds=40.0, *, interrupt=None):
        """Do these commands, or others from a time on: `interrupt` is that time and them; what was seen."""
        self.manager.reset(self.seen, commands)
        seen = self.seen_so_far
        for k in range(round(40 * seconds)):
            if interrupt is not None and k == round(40 * interrupt[0]):
                self.manager.interrupt(interrupt[1])
            self.tick()
            if self.manager.done and seen.done is None:
                seen.done = k / 40.0
            if seen.done is not None and k / 40.0 >= seen.done + 0.5:
                break
        return seen


def steps(seen, *phases):
    """Largest change of Σλ in a tick of these phases [N], and of a vectoring angle [rad]."""
    during = seen.during(*phases)[1:]
    thrust = np.abs(np.diff(seen.thrust))[during].max(initial=0.0)
    turns = np.abs(np.diff(seen.vectoring, axis=0)).max(axis=(1, 2))[during].max(initial=0.0)
    return float(thrust), float(turns)
