"""Pins tuned parameters: their bounds and reflection, and the field of the controller that each one sets."""

from dataclasses import fields

import numpy as np
import pytest

from spidar_gym.control.flight.centroidal import CentroidalConfig
from spidar_gym.control.flight.compensation import CompensationConfig
from spidar_gym.control.flight.controller import ControllerConfig
from spidar_gym.errors import InvalidValueError
from spidar_gym.tune import crawl, flight
from spidar_gym.tune.flight import loops, shortfall
from spidar_gym.tune.parameter import Parameter, decode

ALL = pytest.mark.parametrize("parameters", [flight.PARAMETERS, crawl.PARAMETERS], ids=["flight", "crawl"])


def values(parameters, x):
    return np.array(list(decode(parameters, x).values()))


@ALL
def test_the_search_starts_at_the_first_guess_and_its_bounds_are_at_one(parameters):
    n, (names, start, low, high) = (
        len(parameters), zip(*((p.name, p.start, p.low, p.high) for p in parameters), strict=True),
    )  # fmt: skip
    assert list(decode(parameters, np.zeros(n))) == list(names)
    assert len(set(names)) == n
    np.testing.assert_allclose(values(parameters, np.zeros(n)), start, rtol=1e-12)
    np.testing.assert_allclose(values(parameters, np.ones(n)), high, rtol=1e-12)
    np.testing.assert_allclose(values(parameters, -np.ones(n)), low, rtol=1e-12)


@ALL
def test_no_point_of_the_search_leaves_the_bounds(parameters):
    rng = np.random.default_rng(0)
    low, high = (np.array([getattr(p, end) for p in parameters]) for end in ("low", "high"))
    for scale in (0.3, 1.0, 5.0, 1e3):
        for _ in range(100):
            v = values(parameters, rng.normal(scale=scale, size=len(parameters)))
            assert np.all(v >= low - 1e-12 * np.abs(low))
            assert np.all(v <= high + 1e-12 * np.abs(high))


@ALL
def test_parameters_are_continuous_monotonic_within_the_bounds_and_reflected_beyond(parameters):
    n = len(parameters)
    u = np.linspace(-6.0, 6.0, 4801)
    v = np.array([values(parameters, np.full(n, x)) for x in u])
    logarithmic = np.array([not p.linear for p in parameters])
    v[:, logarithmic] = np.log(v[:, logarithmic])
    width = np.ptp(v, axis=0)
    assert np.all(np.abs(np.diff(v, axis=0)) < 0.01 * width)
    inside = np.abs(u) <= 1.0
    assert np.all(np.diff(v[inside], axis=0) >= 0.0)
    for x in (0.0, 0.2, 0.7, 1.0):
        for sign in (1.0, -1.0):
            a, b = (values(parameters, np.full(n, sign * end)) for end in (1.0 + x, 1.0 - x))
            np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize(("linear", "change"), [(False, np.log), (True, np.asarray)])
def test_equal_steps_are_equal_ratios_or_differences(linear, change):
    p = Parameter("x", 2.0, 0.5, 6.0, linear=linear)
    for sign in (1.0, -1.0):
        steps = change([p.value(sign * u) for u in (0.0, 0.25, 0.5, 0.75, 1.0)])
        np.testing.assert_allclose(np.diff(steps, n=2), 0.0, atol=1e-12)


@pytest.mark.parametrize(
    ("start", "low", "high"), [(1.0, 2.0, 3.0), (4.0, 2.0, 3.0), (0.5, 0.0, 1.0), (-1.0, -2.0, 1.0)]
)
def test_bounds_that_do_not_hold_the_start_or_have_no_logarithm_are_refused(start, low, high):
    with pytest.raises(InvalidValueError, match="low ≤ start ≤ high, above 0 unless linear"):
        Parameter("x", start, low, high)


def leaves(config, path=()):
    """Return every number of a configuration by its path."""
    found = {}
    for field in fields(config):
        value = getattr(config, field.name)
        if hasattr(value, "__dataclass_fields__"):
            found |= leaves(value, (*path, field.name))
        else:
            found[(*path, field.name)] = value
    return found


@pytest.mark.parametrize("module", [flight, crawl])
def test_every_parameter_changes_the_controller_in_one_place(module):
    n = len(module.PARAMETERS)
    start = leaves(module.configuration(decode(module.PARAMETERS, np.zeros(n))))
    for i, p in enumerate(module.PARAMETERS):
        own = -0.3 if p.high == p.start else 0.3
        x = own * (np.arange(n) == i)
        changed = leaves(module.configuration(decode(module.PARAMETERS, x)))
        different = [key for key in start if start[key] != changed[key]]
        assert len(different) == 1
        if module is crawl:
            assert different[0][-1] == p.name
            assert changed[different[0]] == pytest.approx(p.value(own))


@pytest.mark.parametrize(("axis", "rows"), [("xy", (0, 1)), ("z", (2,)), ("roll_pitch", (3, 4)), ("yaw", (5,))])
@pytest.mark.parametrize(("term", "column"), [("p", 0), ("i", 1), ("d", 2)])
def test_a_gain_is_that_of_its_axis_and_its_term(axis, rows, term, column):
    start = decode(flight.PARAMETERS, np.zeros(len(flight.PARAMETERS)))
    config = flight.configuration(start | {f"{axis}_{term}": 123.0})
    gains = np.array([*config.centroidal.position_gains, *config.centroidal.attitude_gains])
    expected = np.zeros((6, 3), bool)
    expected[list(rows), column] = True
    np.testing.assert_array_equal(gains == 123.0, expected)


def test_margins_fall_short_for_gains_that_are_too_high_and_the_more_the_higher():
    def wild(factor):
        gains = ((factor * 3.6, 0.03, factor * 4.0),) * 3
        return shortfall(loops(ControllerConfig(centroidal=CentroidalConfig(position_gains=gains))))

    assert wild(1.0) == 0.0 < wild(4.0) < wild(100.0)
    greedy = CompensationConfig(observer_gain=0.99, observer_time=0.02)
    assert shortfall(loops(ControllerConfig(compensation=greedy))) > 0.0
