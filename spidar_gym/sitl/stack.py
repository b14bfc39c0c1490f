"""The robot's own flight stack: state machine, take-off, landing; it hands over to a runner and takes over again."""

import math
from dataclasses import dataclass, field, replace

import numpy as np

from spidar_gym.arrays import RotorVector
from spidar_gym.control.flight.controller import FlightController
from spidar_gym.control.presets import controller_config
from spidar_gym.model.rotor import thrust_map, vectoring_to_force
from spidar_gym.onboard.message_types import ARM_OFF, ARM_ON, FORCE_LANDING
from spidar_gym.onboard.runner_structs import FlightState
from spidar_gym.robot import N_JOINTS, N_ROTORS, ROBOT
from spidar_gym.so3 import quat_to_matrix
from spidar_gym.state import Command, Reference, RobotState

LANDING_FORM = np.tile([0.0, -0.25, 0.0, 0.72], 4)
"""Joint angles at take-off and landing [rad] [JSK]."""
TAKEOFF_HEIGHT = 1.0
"""Height of the torso after take-off [m] [JSK]."""
CLIMB, DESCENT = 0.3, 0.3
"""Speeds of the set-point upwards (our choice) and downwards [m/s] [JSK]."""
FORM_REACHED = 0.085
"""Joint error below which the landing form is reached [rad] [JSK]."""
TRIM_SECONDS = 0.5
"""Time constant of the filter that estimates the wrench which a runner adds to the weight [s]."""
LAND_SHOWN = 0.2
"""Time for which LAND is reported before the stack returns to HOVER to level its legs [s]."""


@dataclass
class Stack:
    """State machine (`FlightState`) and controller: the lab's part of the robot, with the controller of the paper."""

    crawls: bool = False
    """Whether the robot starts for the ground, where it never takes off."""
    state: FlightState = FlightState.ARM_OFF
    """Present state."""
    wishes: list[int] = field(default_factory=list)
    """Configuration commands that are to be sent to the board."""
    since: float = 0.0
    """Start time of the present state [s]."""

    def __post_init__(self) -> None:
        """Build the controller, with the preset `as_flown`."""
        self.controller = FlightController(controller_config("as_flown"))
        self._good = 0.0
        self._levelling = False
        self._reference: Reference | None = None
        self._track: list[tuple[float, float]] = []
        self._trim: np.ndarray | None = None

    def teleop(self, word: str, time: float) -> None:
        """Apply a command of the operator: start, takeoff, land, force_landing, halt; ignored where not allowed."""
        allowed = {
            "start": self.state == FlightState.ARM_OFF,
            "takeoff": self.state == FlightState.ARM_ON and not self.crawls,
            "land": self.state in (FlightState.ARM_ON, FlightState.TAKEOFF, FlightState.HOVER),
            "force_landing": self.state != FlightState.ARM_OFF,
            "halt": self.state != FlightState.ARM_OFF,
        }
        if not allowed.get(word, False):
            return
        if word == "start":
            self._become(FlightState.START, time)
            self.wishes.append(ARM_ON)
        elif word == "takeoff":
            self._become(FlightState.TAKEOFF, time)
            self._reference = None
        elif word == "force_landing":
            self.wishes.append(FORCE_LANDING)
        elif word == "land" and self.state != FlightState.ARM_ON:
            self._become(FlightState.LAND, time)
            self._levelling = True
            self._reference = None
        else:  # `land` on the ground disarms
            self._become(FlightState.STOP, time)
            self.wishes.append(ARM_OFF)

    def acknowledge(self, command: int, time: float) -> None:
        """Change the state after the board has executed a configuration command."""
        if command == ARM_ON and self.state == FlightState.START:
            self._become(FlightState.ARM_ON, time)
        elif command == ARM_OFF:
            self._become(FlightState.ARM_OFF, time)

    def _become(self, state: FlightState, time: float) -> None:
        self.state, self.since, self._good = state, time, time

    @property
    def flies(self) -> bool:
        """Whether the controller runs."""
        return self.state in (FlightState.TAKEOFF, FlightState.HOVER, FlightState.LAND)

    def tick(self, state: RobotState, thrust: RotorVector, *, driven: bool) -> Command | None:
        """Run one tick at 40 Hz; return the stack's command, or None where it commands nothing.

        Args:
            state: Estimated state.
            thrust: Last commanded thrust of the rotors [N].
            driven: Whether a runner drives; the stack then commands nothing.
        """
        if self.state in (FlightState.ARM_OFF, FlightState.START, FlightState.STOP):
            return None
        if self.state == FlightState.ARM_ON:
            still = np.full(N_JOINTS, ROBOT.max_joint_torque)
            return None if driven else Command(np.zeros(N_ROTORS), state.vectoring, state.joint_position, still)
        if driven:
            self._reference = None
            self._learn_trim(state, thrust)
            return None
        reference = self._refer(state)
        command = self.controller.step(state, reference)
        self._watch(state, reference)
        return command if self.flies else None

    def _learn_trim(self, state: RobotState, thrust: RotorVector) -> None:
        """Estimate the wrench that the runner adds to the weight; the controller's integrals later start from it."""
        R_wb = quat_to_matrix(state.quat_wb)
        snapshot = self.controller.model.snapshot(state.joint_position, R_wb, state.vectoring)
        forces = vectoring_to_force(thrust, state.vectoring)
        wrench = thrust_map(snapshot.R_bl, snapshot.rotor_c) @ forces.reshape(-1)
        wrench[:3] -= ROBOT.weight * R_wb[2]
        share = 1.0 if self._trim is None else self.controller.dt / TRIM_SECONDS
        self._trim = wrench if self._trim is None else self._trim + share * (wrench - self._trim)

    def _com(self, state: RobotState) -> np.ndarray:
        R_wb = quat_to_matrix(state.quat_wb)
        snapshot = self.controller.model.snapshot(state.joint_position, R_wb, state.vectoring)
        return state.position_w + R_wb @ snapshot.com_b

    def _refer(self, state: RobotState) -> Reference:
        """Advance the controller's reference: from the robot's present pose up, level in place, or down."""
        if self._reference is None:
            R_wb = quat_to_matrix(state.quat_wb)
            yaw = math.atan2(R_wb[1, 0], R_wb[0, 0])
            level = np.array([math.cos(0.5 * yaw), 0.0, 0.0, math.sin(0.5 * yaw)])
            self._reference = Reference(self._com(state), level, np.zeros(3), np.zeros(3), state.joint_position.copy())
            self._height = float(self._reference.position_w[2]) - float(state.position_w[2])
            self.controller.reset(state, state.joint_position, self._trim)
            self._trim = None
        r, dt, velocity = self._reference, self.controller.dt, np.zeros(3)
        target = r.joint_target
        position = r.position_w.copy()
        if self.state == FlightState.TAKEOFF:
            top = TAKEOFF_HEIGHT + self._height
            velocity[2] = CLIMB if position[2] < top else 0.0
            position[2] = min(top, position[2] + CLIMB * dt)
        elif self._levelling:
            target = LANDING_FORM
        elif self.state == FlightState.LAND:
            velocity[2] = -DESCENT
            position[2] -= DESCENT * dt
        self._reference = replace(r, position_w=position, velocity_w=velocity, joint_target=target)
        return self._reference

    def _watch(self, state: RobotState, reference: Reference) -> None:
        """Change the state when the conditions of the next one are met."""
        time = state.time
        if self.state == FlightState.TAKEOFF:
            error = reference.position_w - self._com(state)
            close = abs(error[2]) < 0.05 and math.hypot(error[0], error[1]) < 0.15 and reference.velocity_w[2] == 0.0
            self._good = self._good if close else time
            if time - self._good >= 1.0:
                self._become(FlightState.HOVER, time)
        elif self.state == FlightState.LAND and self._levelling and time - self.since >= LAND_SHOWN:
            self._become(FlightState.HOVER, time)
        elif self.state == FlightState.HOVER and self._levelling:
            if np.abs(state.joint_position - LANDING_FORM).max() < FORM_REACHED:
                self._levelling = False
                self._become(FlightState.LAND, time)
                self._track = []
        elif self.state == FlightState.LAND and not self._levelling:
            self._track = [(t, z) for t, z in self._track if t > time - 0.5] + [(time, float(state.position_w[2]))]
            still = self._track[-1][0] - self._track[0][0] > 0.45 and abs(self._track[0][1] - self._track[-1][1]) < 0.02
            if still and state.velocity_w[2] > -0.05:
                self._become(FlightState.STOP, time)
                self.wishes.append(ARM_OFF)
