"""Pins saving, restoring and resetting: exact under every disturbance, and independent of earlier episodes."""

import copy
from dataclasses import fields, replace

import mujoco
import numpy as np
import pytest
from support.episodes import same
from support.plants import (
    ASKEW,
    HIGH,
    ODDITIES,
    command,
    dropped,
    tumbled,
    weightless,
    witnessed,
)

from spidar_gym.errors import InvalidValueError
from spidar_gym.native.plant import Plant
from spidar_gym.robot import FORMS
from spidar_gym.state import RobotState


def odd(case: str) -> Plant:
    """A tilted plant above the floor with the configuration and disturbances of `case`."""
    config, disturbances = ODDITIES[case]
    plant = Plant(config)
    start = np.array([0.0, 0.0, 0.37])
    plant.reset(start, ASKEW, FORMS["form1"], disturbances=disturbances, rng=np.random.default_rng(5))
    if disturbances.push:
        plant.record["weather"]["next_push"] = 0.1
    return plant


@pytest.mark.parametrize("ticks", [3, 20])
def test_a_restored_plant_continues_bit_for_bit_in_the_air_and_on_the_floor(ticks):
    plant = dropped()
    tumbled(plant, ticks)
    assert plant.in_contact == (ticks == 20)
    plant.step(command(limit=3.0))
    saved = plant.save()
    ahead = tumbled(plant, 20, seed=1)
    other = dropped()
    for again in (plant, other):
        again.restore(saved)
        assert same(again.save(), saved)
        assert np.array_equal(tumbled(again, 20, seed=1), ahead)


def test_a_restored_plant_keeps_the_torque_limit_it_was_saved_with():
    plant = weightless(joint_speed=10.0)
    plant.step(command(joints=1.0, limit=2.0))
    saved = plant.save()
    plant.step(command(joints=1.0, limit=7.0))
    plant.restore(saved)
    mujoco.mj_step(plant.model, plant.data)
    assert np.abs(plant.state().joint_torque).max() <= 2.0


@pytest.mark.parametrize("ticks", [3, 20])
def test_restoring_returns_the_state_that_was_saved(ticks):
    plant = dropped()
    tumbled(plant, ticks)
    state, saved = plant.state(), plant.save()
    tumbled(plant, 5, seed=1)
    restored = plant.restore(saved)
    for field in fields(RobotState):
        assert np.array_equal(getattr(restored, field.name), getattr(state, field.name)), field.name


def test_a_restored_plant_touches_the_floor_exactly_if_the_saved_one_did():
    plant, touched = dropped(substeps=1), []
    for _ in range(150):
        plant.step(command())
        touched.append(plant.in_contact)
        plant.restore(plant.save())
        assert plant.in_contact == touched[-1]
    assert 0 < sum(touched) < 150


@pytest.mark.parametrize("change", [lambda s: s[:-1], lambda s: s + b"0", lambda s: b""])
def test_a_saved_state_of_another_length_is_refused(change):
    plant = dropped()
    saved = plant.save()
    with pytest.raises(InvalidValueError, match=f"{len(saved.robot)} and .* bytes"):
        plant.restore(replace(saved, robot=change(saved.robot)))


@pytest.mark.parametrize("ticks", [3, 16])
@pytest.mark.parametrize("case", ODDITIES)
def test_a_restored_plant_continues_bit_for_bit_under_every_disturbance(case, ticks):
    plant = odd(case)
    witnessed(plant, ticks)
    saved = plant.save()
    kept = copy.deepcopy(saved)
    ahead = witnessed(plant, 8, seed=1)
    other = odd(case)
    for again in (plant, plant, other):
        again.restore(saved)
        assert same(again.save(), kept)
        assert np.array_equal(witnessed(again, 8, seed=1), ahead)
    assert same(saved, kept), "restoring does not modify the saved state"


def test_the_restored_states_include_a_pending_command_a_push_a_stuck_servo_and_a_contact():
    """Without these conditions the test above would be weaker."""
    plant = odd("everything")
    assert not plant.in_contact
    witnessed(plant, 3)
    assert plant.record["pending_count"]
    assert plant.record["clock"] % 5
    witnessed(plant, 6)
    assert plant.record["weather"]["push_w"].any()
    assert plant.record["noise"].any()
    assert plant.record["falling"].any()
    assert plant.record["loose"].any()
    for case in ("everything", "wake"):
        plant = odd(case)
        touched = False
        for k in range(16):
            witnessed(plant, 1, seed=k)
            touched |= plant.in_contact
        assert touched
    plant = odd("lost vectoring")
    witnessed(plant, 3)
    assert plant.record["is_stuck"]


@pytest.mark.parametrize("case", ["wind", "pushes", "lost thrust", "lost vectoring"])
def test_the_disturbances_are_part_of_a_saved_state_even_if_the_plant_was_reset_since(case):
    plant = odd(case)
    witnessed(plant, 2)
    saved = plant.save()
    ahead = witnessed(plant, 8, seed=1)
    plant.reset(HIGH)
    plant.restore(saved)
    assert np.array_equal(witnessed(plant, 8, seed=1), ahead)


@pytest.mark.parametrize("case", ODDITIES)
def test_a_reset_does_not_depend_on_the_episode_before(case):
    config, disturbances = ODDITIES[case]
    used = odd(case)
    witnessed(used, 8)
    states = []
    for plant in (Plant(config), used):
        start, weather = np.array([0.0, 0.0, 0.5]), np.random.default_rng(9)
        state = plant.reset(start, ASKEW, FORMS["form2"], disturbances=disturbances, rng=weather)
        states.append([state, plant.save(), witnessed(plant, 8)])
    assert same(states[0], states[1])
