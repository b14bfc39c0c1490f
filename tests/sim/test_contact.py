"""Pins the contact with the floor: when it is detected, which parts touch, how the robot comes to rest."""

import math

import mujoco
import numpy as np
import pytest
from support.plants import ASKEW, ODDITIES, VACUUM, command, dropped, tumbled, witnessed

from spidar_gym.native.plant import Plant
from spidar_gym.robot import FORMS, GRAVITY, ROBOT
from spidar_gym.sim.config import PlantConfig
from spidar_gym.state import Command, RobotState


def touching(plant: Plant) -> set[str]:
    """Names of the geoms that touch the floor, or of their bodies where a geom has no name."""
    model = plant.model
    geoms = {int(g) for contact in plant.data.contact for g in contact.geom}
    names = {model.geom(g).name or model.body(model.geom_bodyid[g]).name for g in geoms}
    return names - {"floor"}


class Attentive(Plant):
    """A plant that detects contacts at every step."""

    def step(self, command: Command) -> RobotState:
        self.record["clearance"] = 0.0
        return super().step(command)


def fallen(plant: Plant, height: float, speed: float, ticks: int) -> list[np.ndarray]:
    """Motion of a plant that starts at a height [m], falls at a speed [m/s] and moves its joints at random."""
    plant.reset(np.array([0.0, 0.0, height]), ASKEW, FORMS["form2"], rng=np.random.default_rng(1))
    plant.data.qvel[2] = -speed
    return witnessed(plant, ticks)


@pytest.mark.parametrize("case", ["vacuum", "wake", "everything"])
@pytest.mark.parametrize(("height", "speed", "ticks"), [(1.6, 0.0, 30), (1.2, 4.0, 12), (3.5, 9.0, 14)])
def test_skipping_the_detection_of_contacts_far_from_the_floor_changes_nothing(case, height, speed, ticks):
    config, _ = ODDITIES[case]
    ahead = fallen(Plant(config), height, speed, ticks)
    assert np.array_equal(fallen(Attentive(config), height, speed, ticks), ahead)


def test_a_robot_that_falls_at_11_metres_a_second_meets_the_floor_in_the_same_step_wherever_the_tick_begins():
    config, skipped = PlantConfig(aero=VACUUM), 0
    one, other = Plant(config), Attentive(config)
    for height in np.linspace(1.5, 2.0, 14):
        ahead = fallen(one, height, 11.0, 5)
        assert np.array_equal(fallen(other, height, 11.0, 5), ahead)
        assert one.data.qvel[2] > -9.0, "it has met the floor"
        one.reset(np.array([0.0, 0.0, height]), ASKEW, FORMS["form2"])
        one.step(command())
        skipped += one.model.opt.disableflags & int(mujoco.mjtDisableBit.mjDSBL_CONTACT) > 0
    assert skipped > 0, "detection is skipped at least from the highest starts"


@pytest.mark.parametrize("substeps", [20, 40])
def test_a_longer_control_period_does_not_hide_the_floor(substeps):
    """5 m/s is the speed after a fall of 1.3 m."""
    config = PlantConfig(substeps=substeps, aero=VACUUM)
    one, other = Plant(config), Attentive(config)
    for height in np.linspace(1.2, 1.7, 6):
        assert np.array_equal(fallen(one, height, 5.0, 4), fallen(other, height, 5.0, 4)), height


def test_a_robot_that_falls_from_high_touches_the_floor():
    plant = Plant()
    plant.reset(np.array([0.0, 0.0, 10.0]))
    touched = []
    for _ in range(80):
        state = plant.step(command())
        touched.append(plant.in_contact)
    assert any(touched)
    # √(2 h / g) in a vacuum from the lowest peg on; the air brakes a little.
    fall = math.sqrt(2.0 * (10.0 - 0.148) / GRAVITY)
    assert fall - 0.05 < touched.index(True) * plant.period < fall + 0.15
    assert np.isfinite(state.position_w).all()
    assert not plant.diverged


def test_a_robot_lowered_onto_the_floor_comes_to_rest_on_its_pegs():
    plant = Plant()
    plant.reset(np.array([0.0, 0.0, 0.16]), thrust=np.full(8, 15.0))
    assert not plant.in_contact
    for k in range(100):
        state = plant.step(command(max(0.0, 15.0 - 0.5 * k)))
    assert plant.in_contact
    assert touching(plant) == {f"peg{i}" for i in range(1, 9)}
    peg_tip = -ROBOT.yaw_axis_z - ROBOT.peg_top + ROBOT.peg_length
    assert abs(state.position_w[2] - peg_tip) < 1e-3
    assert np.abs(plant.data.qvel).max() < 1e-4


def test_feet_and_ducts_touch_the_floor_too():
    plant = Plant()
    plant.reset(np.array([0.0, 0.0, 1.02]), joint_position=np.tile([0.0, 0.0, 0.0, math.pi / 2], 4))
    assert not plant.in_contact
    plant.reset(np.array([0.0, 0.0, 0.56]), joint_position=np.tile([0.0, 0.0, 0.0, math.pi / 2], 4))
    assert touching(plant) == {f"foot{leg}" for leg in range(1, 5)}
    sideways = np.tile([math.pi / 2, 0.0], (8, 1))
    plant.reset(np.array([0.0, 0.0, 0.2]), vectoring=sideways)
    assert touching(plant) == {f"gimbal{i}_pitch_module" for i in range(1, 9)}


def test_sparse_and_dense_jacobians_give_the_same_motion_through_a_second_of_contact():
    trajectories, touched = [], []
    for kind in (mujoco.mjtJacobian.mjJAC_DENSE, mujoco.mjtJacobian.mjJAC_SPARSE):
        plant = dropped()
        plant.model.opt.jacobian = kind
        tumbled(plant, 14)
        touched.append(plant.in_contact)
        trajectories.append(tumbled(plant, 40, seed=1))
        touched.append(plant.in_contact)
    assert all(touched)
    np.testing.assert_allclose(*trajectories, rtol=0, atol=1e-9)
