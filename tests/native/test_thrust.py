"""Pins the core's allocation as a library to Python's, tick after tick, with lost rotors and NaN."""

from dataclasses import replace

import numpy as np
from support.needs import needs_compiler
from support.states import random_joints

from spidar_gym.control import ThrustAllocator
from spidar_gym.control.presets import controller_config
from spidar_gym.native.library import Room, Struct, load_core, pointer, read_allocation
from spidar_gym.native.structs import fill
from spidar_gym.robot import ROBOT
from spidar_gym.so3 import exp, matrix_to_quat
from spidar_gym.state import Reference, RobotState

pytestmark = needs_compiler
TICKS = 12
"""Number of ticks of one robot; the last one demands NaN."""


def test_it_allocates_as_python_does_tick_after_tick():
    library = load_core()
    flight, state, wanted, settings = map(Struct, ("flight", "robot_state", "reference", "controller_config"))
    readable, room = ThrustAllocator(), Room(library)
    fill(settings.record, controller_config("paper"))
    library.sp_flight_init(flight.pointer, settings.pointer)
    rng, statuses, worst = np.random.default_rng(5), set(), 0.0
    for _ in range(30):
        now = replace(RobotState.at_rest(random_joints(rng)), quat_wb=matrix_to_quat(exp(0.3 * rng.normal(size=3))))
        gone, stuck = (np.arange(8) == rng.integers(24) for _ in range(2))
        stuck = stuck & ~gone
        none = np.zeros(3)
        reference = Reference(none, np.array([1.0, 0.0, 0.0, 0.0]), none, none, now.joint_position)
        fill(wanted.record, replace(reference, lost_thrust=gone, lost_vectoring=stuck))
        fill(state.record, now)
        library.sp_flight_reset(room.robot, flight.pointer, state.pointer, None, None)
        readable.reset()
        for tick in range(TICKS):
            wrench = np.array([0.0, 0.0, ROBOT.weight, 0.0, 0.0, 0.0])
            wrench += rng.normal(size=6) * np.repeat([15.0, 3.0], 3)
            wrench[3] = np.nan if tick == TICKS - 1 else wrench[3]
            found, angles = np.zeros(8), np.zeros((8, 2))
            fill(state.record, now)
            library.sp_flight_allocate(
                flight.pointer, state.pointer, wanted.pointer, pointer(wrench), room.pointer, pointer(found),
                pointer(angles),
            )  # fmt: skip
            thrust, vectoring, allocation = readable.allocate(now, wrench, lost_thrust=gone, lost_vectoring=stuck)
            assert read_allocation(flight.inner("allocation", "allocation"), 0.0).status is allocation.status
            statuses.add(str(allocation.status))
            worst = max(worst, float(np.abs(found - thrust).max()), float(np.abs(angles - vectoring).max()))
            now = replace(now, thrust=thrust, vectoring=vectoring)
    assert worst < 1e-6
    assert {"closed_form", "held"} < statuses
