"""λ̄ that follows the battery's voltage: an input of every controller, equal in Python and in the core."""

import math

import numpy as np
import pytest
from support.needs import needs_compiler

from spidar_gym.control.crawl.controller import Crawler
from spidar_gym.control.crawl.footsteps import Lift, lying_pose
from spidar_gym.control.flight.controller import FlightController
from spidar_gym.control.presets import controller_config, crawler_config
from spidar_gym.model.rotor import BATTERY_THRUST, BATTERY_VOLTAGE, THRUST_PER_VOLT
from spidar_gym.native.core_crawler import CoreCrawler
from spidar_gym.native.core_flight import CoreFlightController
from spidar_gym.native.formulas import max_thrust
from spidar_gym.robot import FORMS, N_JOINTS, ROBOT
from spidar_gym.state import Reference, RobotState

pytestmark = needs_compiler
UPRIGHT, ZERO = np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3)
FLIGHT, CRAWL = (FlightController, CoreFlightController), (Crawler, CoreCrawler)


def demanding(controller, form: str, error: tuple[float, float, float], limit: float | None):
    """Step a controller at rest whose position is off; return the command and its record."""
    state = RobotState.at_rest(FORMS[form])
    controller.reset(state)
    if limit is not None:
        controller.thrust_limit = limit
    com = controller.model.snapshot(FORMS[form], np.eye(3), state.vectoring).com_b
    reference = Reference(com + error, UPRIGHT, ZERO, ZERO, FORMS[form])
    return controller.step(state, reference), controller.last_step.allocation


@pytest.mark.parametrize("kind", FLIGHT)
def test_a_binding_limit_turns_the_other_thrusts_instead_of_losing_the_wrench(kind):
    asked = (0.3, 0.0, 0.05)
    free, before = demanding(kind(controller_config("tuned")), "form1", asked, None)
    limit = 0.93 * float(free.thrust.max())
    bound, after = demanding(kind(controller_config("tuned")), "form1", asked, limit)
    assert bound.thrust.max() <= limit + 1e-9
    assert bound.thrust.max() > limit - 1e-3, "the limit binds"
    np.testing.assert_allclose(after.wrench, before.wrench, atol=1e-6)
    scaled = before.wrench * limit / free.thrust.max()  # what the board does: all thrusts by one factor
    assert np.abs(scaled - before.wrench).max() > 10.0


@pytest.mark.parametrize("preset", ["paper", "as_flown", "steady"])
def test_python_and_core_follow_it_alike(preset):
    rng, python, core = np.random.default_rng(3), *(kind(controller_config(preset)) for kind in FLIGHT)
    statuses, worst = set(), 0.0
    for _ in range(100):
        form = ("form1", "form2", "form3")[int(rng.integers(3))]
        error, limit = tuple(rng.normal(0.0, 0.15, 3)), float(rng.uniform(18.0, 42.0))
        (one, a), (two, b) = (demanding(each, form, error, limit) for each in (python, core))
        assert one.thrust.max() <= limit + 1e-9
        assert two.thrust.max() <= limit + 1e-9
        assert a.status == b.status
        statuses.add(str(a.status))
        worst = max(worst, float(np.abs(one.thrust - two.thrust).max()))
    assert worst < 1e-4
    assert {"projected", "softened"} <= statuses, "the sphere of the limit binds, and is infeasible"


@pytest.mark.parametrize("kind", CRAWL)
def test_a_crawl_respects_it_while_legs_are_in_the_air(kind):
    state, most = RobotState.at_rest(lying_pose(crawler_config("published").gait)), []
    for limit in (math.inf, 12.0):
        controller = kind(crawler_config("published"))
        controller.reset(state, [Lift((True, True, True, True), 0.2, 1.0)])
        controller.thrust_limit = limit
        most.append(max(float(controller.step(state).thrust.max()) for _ in range(160)))
    assert most[1] <= 12.0 + 1e-9 < most[0]


@pytest.mark.parametrize("kind", FLIGHT)
@pytest.mark.parametrize("limit", [ROBOT.max_thrust, 60.0, math.inf])
def test_limits_at_or_above_the_robots_change_no_bit(kind, limit):
    for error in ((0.1, 0.0, 0.2), (4.0, -3.0, 5.0)):
        free, _ = demanding(kind(), "form3", error, None)
        same, _ = demanding(kind(), "form3", error, limit)
        assert free.thrust.tobytes() + free.vectoring.tobytes() == same.thrust.tobytes() + same.vectoring.tobytes()


@pytest.mark.parametrize("kind", FLIGHT)
def test_limits_that_do_not_bind_change_no_bit(kind):
    free, _ = demanding(kind(), "form1", (0.05, 0.0, 0.05), None)
    same, _ = demanding(kind(), "form1", (0.05, 0.0, 0.05), float(free.thrust.max()) + 5.0)
    assert free.thrust.tobytes() == same.thrust.tobytes()


@pytest.mark.parametrize("kind", [*FLIGHT, *CRAWL])
def test_a_reset_keeps_it_for_it_is_an_input(kind):
    controller = kind()
    assert controller.thrust_limit == math.inf
    controller.thrust_limit = 30.0
    controller.reset(RobotState.at_rest(np.zeros(N_JOINTS) if kind in FLIGHT else lying_pose(controller.config.gait)))
    assert controller.thrust_limit == 30.0


def test_the_thrust_at_a_voltage_is_the_measured_line():
    assert max_thrust(BATTERY_VOLTAGE) == BATTERY_THRUST
    assert max_thrust(25.2) == pytest.approx(BATTERY_THRUST + 3.0 * THRUST_PER_VOLT)
    assert max_thrust(5.0) == 0.0
