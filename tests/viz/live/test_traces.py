"""Pins the curves: values of the environments' `info`, in the units of their titles, over the last 20 s."""

from itertools import pairwise

import numpy as np
import pytest

from spidar_gym.control.flight.controller import CONTROL_RATE
from spidar_gym.envs.registry import COURSE, CRAWL, ENVIRONMENTS, HOVER
from spidar_gym.robot import ROBOT
from spidar_gym.viz.live.session import Session
from spidar_gym.viz.live.traces import POINTS, SECONDS, Traces, plots, row


@pytest.mark.parametrize("env_id", ENVIRONMENTS)
def test_every_curve_has_a_value(env_id):
    session = Session(env_id)
    for _ in range(30):
        session.tick()
    values = row(env_id, session.info, session.env.plant)
    assert len(values) == sum(len(plot.names) for plot in plots(env_id))
    assert np.isfinite(values).all()
    torque, thrust = values[-2:]
    assert torque == pytest.approx(100.0 * np.abs(session.info["joint_torque"]).max() / ROBOT.max_joint_torque)
    assert thrust == pytest.approx(100.0 * session.info["thrust"].max() / ROBOT.max_thrust)
    assert 0.0 < max(torque, thrust) <= 100.0 + 1e-6
    if env_id == HOVER:
        assert values[:3] == pytest.approx(1e3 * session.info["position_error"])
        assert values[3:6] == pytest.approx(1e3 * session.info["attitude_error"])
    if env_id == CRAWL:
        assert values[:2] == pytest.approx(1e3 * session.info["goal_error"][:2])
    if env_id == COURSE:
        assert 50.0 < values[3] <= 100.0
    session.close()


def test_before_anything_has_passed_there_are_curves_that_lie_at_0():
    time, x, y = Traces().columns(0, 2)
    assert time[0] < time[1] == 0.0
    assert x.tolist() == y.tolist() == [0.0, 0.0]


def test_curves_are_the_last_seconds_and_end_now():
    traces, ticks = Traces(), round(50 * CONTROL_RATE)
    for k in range(ticks):
        traces.add(k / CONTROL_RATE, (float(k), -float(k)))
    time, values = traces.columns(1, 1)
    assert len(time) <= POINTS + 1
    assert -SECONDS <= time[0] < -SECONDS + 0.2
    assert time[-1] == 0.0
    assert values == pytest.approx(-(ticks - 1) - time * CONTROL_RATE)


def test_curves_do_not_flicker_as_they_move_on():
    """Thinning always leaves the same points out."""
    traces, shown = Traces(), []
    for k in range(round(30 * CONTROL_RATE)):
        traces.add(k / CONTROL_RATE, (float(k),))
        if k > 25 * CONTROL_RATE:
            shown.append(set(traces.columns(0, 1)[1].tolist()))
    for before, after in pairwise(shown):
        # One point is added and one removed; the newest point is always shown, whether it stays or not.
        assert len(after - before) <= 2
        assert len(before - after) <= 2
