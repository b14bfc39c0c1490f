"""Pins the end of a mission in each phase of a grasp: the object stands, the robot lies beside it."""

import math

import numpy as np
import pytest
from support.grasps import BOX, Manager, Mission

from spidar_gym.control.grasp.phases import GRASP_PHASES
from spidar_gym.control.locomotion.manager import ASIDE


@pytest.mark.parametrize("phase", [name for name in GRASP_PHASES[1:-1] if name != "back"])
def test_a_mission_that_is_ended_puts_the_object_down_and_lands_beside_it(phase):
    mission = Mission(seed=3).reach(phase)
    assert mission.manager.grasp_phase == phase
    mission.manager.end()
    mission.fly(seconds=60.0)
    thing = mission.plant.object()
    assert mission.manager.phase == "lie"
    assert mission.is_clean
    assert mission.tilt < 0.3
    assert thing.position_w[2] == pytest.approx(BOX.scale[2], abs=0.01)
    assert np.linalg.norm(thing.velocity_w) < 0.01
    assert math.dist(mission.state.position_w[:2], thing.position_w[:2]) > ASIDE - 0.1
    fall = max(-tick.thing.velocity_w[2] for tick in mission.log)
    assert fall < 0.4, "it is put down, not dropped"


@pytest.mark.parametrize("phase", ["over", "grip", "carry", "let_go"])
def test_core_and_python_end_alike(phase):
    ends = []
    for kind in (None, Manager):
        mission = Mission(seed=3) if kind is None else Mission(kind=Manager, seed=3)
        mission.reach(phase).manager.end()
        before = len(mission.log)
        mission.fly(seconds=60.0)
        ends.append(([tick.grasp_phase for tick in mission.log[before:]], mission.state.position_w))
    names = [[name for k, name in enumerate(found) if k == 0 or name != found[k - 1]] for found, _ in ends]
    assert names[0] == names[1]
    np.testing.assert_allclose(ends[0][1], ends[1][1], atol=2e-3)
