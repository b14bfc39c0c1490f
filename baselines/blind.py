"""`blind`: the paper's controllers on their own plan instead of the measured state, a probe of the tracks.

A track on which it comes near a controller with feedback does not test feedback. The state at the beginning of an
episode is known; afterwards nothing measured enters a command.
"""

from dataclasses import replace

import numpy as np

from spidar_gym.benchmark import CRAWL, HOVER, PresetPolicy
from spidar_gym.control.crawl.controller import Crawler
from spidar_gym.control.flight.centroidal import MotionError
from spidar_gym.control.flight.controller import FlightController
from spidar_gym.control.flight.memory import ControlState
from spidar_gym.so3 import matrix_to_quat, quat_to_matrix, rotation_z
from spidar_gym.state import NO_RESIDUAL, Command, Reference, Residual, RobotState

_STILL = np.zeros(3)
_ON_FEET = ("brace", "up", "forward", "down")


class BlindFlight(FlightController):
    """The flight controller on the reference: the weight's wrench in the commanded form, errors of zero."""

    def step(
        self,
        state: RobotState,
        reference: Reference,
        residual: Residual = NO_RESIDUAL,
        control_state: ControlState | None = None,
    ) -> Command:
        """Compute the command for a robot that is where the reference and the last command want it."""
        memory = self.memory
        planned = replace(
            RobotState.at_rest(memory.joint_position, memory.vectoring),
            quat_wb=reference.quat_wb, omega_b=reference.omega_b, joint_velocity=memory.joint_velocity,
        )  # fmt: skip
        R_wb = quat_to_matrix(reference.quat_wb)
        snapshot = self.model.snapshot(planned.joint_position, R_wb, planned.vectoring)
        none = MotionError(_STILL, _STILL, _STILL, _STILL)
        return super().step(planned, reference, residual, ControlState(R_wb, snapshot, none))


class BlindCrawler(Crawler):
    """The crawler on its gait's plan: every phase ends when a robot that follows the plan would end it."""

    def step(self, state: RobotState, residual: Residual = NO_RESIDUAL) -> Command:
        """Compute the command for a robot that has followed the plan so far."""
        gait = self.gait.memory
        position, R_wb = gait.position_w, gait.R_wb
        if gait.phase in _ON_FEET:
            pose = gait.way.arc(gait.share)
            position = gait.floor_w + gait.floor_R @ (pose.x, pose.y, max(gait.height, 0.0))
            R_wb = gait.floor_R @ rotation_z(pose.yaw)
        planned = replace(
            RobotState.at_rest(gait.plan, self.memory.vectoring), position_w=position, quat_wb=matrix_to_quat(R_wb)
        )
        return super().step(planned, residual)


class Blind(PresetPolicy):
    """The paper's controllers without feedback: their commands for a robot that follows the plan exactly."""

    presets = {  # noqa: RUF012 - a constant of the class
        HOVER: {"preset": "paper", "law": BlindFlight},
        CRAWL: {"preset": "published", "law": BlindCrawler},
    }
