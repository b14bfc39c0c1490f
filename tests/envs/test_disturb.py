"""Pins changes during an episode: wind and faults in every environment, and that controllers receive faults."""

import numpy as np
import pytest

from spidar_gym.envs.course_env import CourseEnv
from spidar_gym.envs.crawl_env import CrawlEnv
from spidar_gym.envs.hover_env import HoverEnv
from spidar_gym.envs.path_env import PathEnv
from spidar_gym.errors import InvalidValueError, SpidarError, UnknownNameError


class Readable(HoverEnv):
    """The hover with its reference in Python."""

    def reference(self):
        return super().reference()


def played(env, ticks):
    """Step with zero actions; return the last `info`."""
    for _ in range(ticks):
        *_, info = env.step(np.zeros(env.action_space.shape))
    return info


@pytest.mark.parametrize("kind", [HoverEnv, Readable, PathEnv])
def test_a_flight_loses_a_rotor_during_an_episode_and_regains_it(kind):
    env = kind(forms="form1", perturbation=0.0)
    env.reset(seed=0)
    played(env, 20)
    env.disturb({"lost_rotor": 3})
    info = played(env, 80)
    assert info["thrust"][2] < 0.1
    assert info["thrust_command"][2] < 0.1  # the controller received the fault
    env.disturb({})
    info = played(env, 80)
    assert info["thrust"][2] > 15.0
    assert info["failure"] == ""
    env.close()


def test_the_task_in_the_engine_and_the_one_in_python_see_the_same_change():
    ends = []
    for kind in (HoverEnv, Readable):
        env = kind(forms="form2", perturbation=0.0)
        env.reset(seed=1)
        played(env, 10)
        env.disturb({"wind": 4.0, "lost_rotor": 2, "fault": "vectoring"}, towards=1.0)
        ends.append(played(env, 60)["position_error"])
        env.close()
    assert ends[0] == pytest.approx(ends[1], abs=1e-9)
    assert np.linalg.norm(ends[0]) > 1e-3


@pytest.mark.parametrize(
    ("kind", "options"), [(CrawlEnv, {}), (CourseEnv, {"hold": 1, "action_mode": "residual"})], ids=["crawl", "course"]
)
def test_wind_begins_on_the_ground_too(kind, options):
    env = kind(**options)
    env.reset(seed=0)
    played(env, 5)
    assert not env.plant.record["weather"]["mean_w"].any()
    env.disturb({"wind": 3.0})
    played(env, 5)
    assert env.plant.record["weather"]["mean_w"].tolist() == [3.0, 0.0, 0.0]
    assert env.plant.record["weather"]["gust_w"].any()
    env.close()


@pytest.mark.parametrize("kind", [HoverEnv, Readable])
def test_changed_disturbances_hold_in_the_next_episode(kind):
    env = kind(forms="form1")
    env.reset(seed=0)
    env.disturb({"lost_rotor": 5, "fault_time": 0.0})
    env.reset(seed=1)
    assert played(env, 40)["thrust"][4] < 0.5
    env.close()


def test_changed_disturbances_hold_after_a_reset_that_rebuilds_the_environment():
    env = HoverEnv(forms="form1", disturbances={"wind": 1.0})
    env.reset(seed=0)
    env.disturb({"lost_rotor": 5, "fault_time": 0.0})
    env.reset(seed=1, options={"joint_speed": 1.0})
    assert played(env, 40)["thrust"][4] < 0.5
    assert not env.plant.record["weather"]["mean_w"].any()
    env.close()


@pytest.mark.parametrize("kind", [HoverEnv, Readable])
def test_a_restored_state_includes_changed_disturbances(kind):
    env, other = (kind(forms="form1") for _ in range(2))
    env.reset(seed=0)
    played(env, 20)
    env.disturb({"wind": 3.0, "lost_rotor": 6}, towards=2.0)
    played(env, 10)
    other.restore_state(env.save_state())
    assert played(env, 40)["position_error"].tolist() == played(other, 40)["position_error"].tolist()
    assert other.plant.record["weather"]["mean_w"][1] > 2.0
    for each in (env, other):
        each.reset(seed=1)  # rotor and wind in the next episode, too
    assert played(env, 40)["position_error"].tolist() == played(other, 40)["position_error"].tolist()
    assert other.plant.record["disturbances"]["lost_rotor"] == 6
    env.close()
    other.close()


@pytest.mark.parametrize("kind", [HoverEnv, Readable])
def test_refused_disturbances_change_nothing(kind):
    flights = []
    for wrong in (False, True):
        env = kind(forms="form1", disturbances={"wind": 2.0})
        with pytest.raises(SpidarError, match="before reset"):
            env.disturb({})
        env.reset(seed=3)
        if wrong:
            with pytest.raises(UnknownNameError, match="disturbance 'winds'"):
                env.disturb({"winds": 1.0})
            with pytest.raises(InvalidValueError, match="wind = -1"):
                env.disturb({"wind": -1.0})
        flights.append(played(env, 20)["position_error"])
        env.close()
    assert flights[0].tolist() == flights[1].tolist()
