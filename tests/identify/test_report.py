"""Pins the verdict of an identification: where the identified robot predicts worse than the described one."""

import numpy as np
import pytest

from spidar_gym.identify.ahead import Ahead
from spidar_gym.identify.estimate import Estimate
from spidar_gym.identify.report import Report
from spidar_gym.identify.robot_file import Identified
from spidar_gym.identify.sensors import Sensors

SENSORS = Sensors(1.0, 1.0, 1.0, 1.0, 1.0, Estimate(np.array(0.0), np.array(1.0), np.array(1.0)), 0.0)


@pytest.mark.parametrize(
    ("own", "worse"),
    [
        (Ahead(0.20, 0.10, 0.001), []),
        (Ahead(0.25, 0.12, 0.001), []),  # what eddies do differs by so much
        (Ahead(0.30, 0.10, 0.001), ["position in thrust.log"]),
        (Ahead(0.10, 0.14, 0.003), ["joints in thrust.log", "attitude in thrust.log"]),
    ],
)
def test_a_report_says_where_the_identified_robot_is_worse(own, worse):
    mass = Estimate(np.array(16.0), np.array(0.02), np.array(0.5))
    ahead = {"thrust.log": (own, 31, Ahead(0.20, 0.10, 0.002))}
    report = Report(("thrust.log",), (), SENSORS, Identified(mass, None, None), ahead, ("forms.log",))
    assert report.worse == worse
    assert ("Something was wrong" in report.text()) == bool(worse)
    assert "not used: forms.log" in report.text()
