"""Pins the clock of the page: simulated time relative to wall time, and the report of a machine that is too slow."""

import pytest

from spidar_gym.control.flight.controller import CONTROL_RATE
from spidar_gym.errors import InvalidValueError
from spidar_gym.viz.live.clock import FASTEST, PATIENCE, SLOWEST, Clock

PERIOD = 1.0 / CONTROL_RATE


class Wall:
    """A wall clock that the test sets."""

    def __init__(self):
        self.time = 100.0

    def __call__(self):
        return self.time


@pytest.fixture
def wall():
    return Wall()


def flown(clock, wall, seconds, step=PERIOD):
    """Return the number of periods that are due while some seconds pass in steps."""
    count = 0
    for _ in range(round(seconds / step)):
        wall.time += step
        count += clock.due()
    return count


@pytest.mark.parametrize("speed", [SLOWEST, 0.5, 1.0, 2.0, FASTEST])
@pytest.mark.parametrize("step", [0.003, PERIOD, 0.04])
def test_simulated_time_passes_as_fast_as_it_was_asked_to(wall, speed, step):
    clock = Clock(wall)
    clock.set_speed(speed)
    count = flown(clock, wall, 20.0, step)
    assert count == pytest.approx(20.0 * speed * CONTROL_RATE, abs=2)
    assert clock.pace == pytest.approx(speed, rel=0.05)
    assert not clock.is_late
    assert clock.given_up == 0


def test_a_short_delay_is_made_up_for(wall):
    clock = Clock(wall)
    before = flown(clock, wall, 2.0)
    wall.time += 0.2
    assert before + clock.due() == pytest.approx(2.2 * CONTROL_RATE, abs=1)
    assert clock.given_up == 0


def test_of_a_long_delay_the_rest_is_given_up_and_counted(wall):
    clock = Clock(wall)
    wall.time += 10.0
    assert clock.due() == round(PATIENCE * CONTROL_RATE)
    assert clock.given_up == round((10.0 - PATIENCE) * CONTROL_RATE)
    # Skipped periods are not made up for later.
    assert flown(clock, wall, 1.0) == pytest.approx(CONTROL_RATE, abs=1)


def test_a_machine_that_is_too_slow_is_said_to_be_late_and_its_pace_is_the_true_one(wall):
    clock = Clock(wall)
    clock.set_speed(4.0)
    for _ in range(40):
        wall.time += 0.5  # half a second between two calls
        clock.due()
    assert clock.is_late
    assert clock.pace == pytest.approx(PATIENCE * 4.0 / 0.5, rel=0.2)
    assert clock.given_up > 0


def test_paused_time_stands_still_and_goes_on_where_it_was(wall):
    clock = Clock(wall)
    flown(clock, wall, 1.0)
    clock.pause(True)
    assert flown(clock, wall, 50.0) == 0
    assert not clock.is_late
    clock.pause(False)
    assert flown(clock, wall, 1.0) == pytest.approx(CONTROL_RATE, abs=1)
    assert clock.given_up == 0
    assert not clock.is_late


def test_it_waits_until_the_next_period_is_due(wall):
    clock = Clock(wall)
    wall.time += 0.4 * PERIOD
    assert clock.due() == 0
    assert clock.wait == pytest.approx(0.6 * PERIOD)
    wall.time += clock.wait + 1e-9
    assert clock.due() == 1


@pytest.mark.parametrize("speed", [0.0, -1.0, 100.0, float("nan")])
def test_a_speed_that_no_clock_has_is_refused(wall, speed):
    with pytest.raises(InvalidValueError, match=r"speed = .* within 0\.1 … 4"):
        Clock(wall).set_speed(speed)
