"""Pins the ranges of lengths, masses and inertias: simulated accurately at their ends by two engines."""

import numpy as np
import pytest

from spidar_gym.errors import InvalidValueError
from spidar_gym.robot.ranges import Range
from spidar_gym.sim.randomize import Randomization
from tests.robot.ranges import CHANGES, any_size, is_well_simulated, well


@pytest.mark.filterwarnings("ignore")  # MuJoCo warns about robots that it cannot simulate
@pytest.mark.parametrize("change", CHANGES)
def test_a_robot_at_either_end_of_a_range_is_simulated_well_and_one_beyond_it_is_refused(change):
    make, accepted = CHANGES[change]
    for end in (accepted.least, accepted.most):
        assert is_well_simulated(make(end)), end
    for beyond in (accepted.least / 2 if accepted.least > 0 else 2 * accepted.least, 2 * accepted.most):
        with pytest.raises(InvalidValueError, match=r"^[^\n]* a number within [^\n]* which is simulated well$"):
            make(beyond)


def test_positions_far_away_are_not_simulated_accurately():
    assert not well("place of a payload of 1 kg on the torso [m]", 1e6)
    assert not well("mass of the part roll_module [kg]", 1e-12)


def test_ranges_are_validated_again_afterwards():
    range_ = Range(1.0, 2.0, "m")
    with any_size():
        range_.require("length", 3.0)
    with pytest.raises(InvalidValueError, match=r"length = nan is not valid; expected a number within 1 … 2 m"):
        range_.require("length", np.nan)


@pytest.mark.parametrize(
    "ranges", [{"body.link_com": (0.0, 1e300)}, {"body.torso_com": (-1e6, 0.0)}, {"body.total_mass": (1e-9, 1.0)},
               {"body.link_mass": (1.0, 1e9)}, {"body.inertia": (1e-12, 1.0)}],
)  # fmt: skip
def test_a_robot_that_is_drawn_is_within_them_too(ranges):
    with pytest.raises(
        InvalidValueError, match=r"^randomization: body[^\n]* a number within [^\n]* is simulated well$"
    ):
        Randomization.parse(ranges)
