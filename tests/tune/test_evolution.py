"""Pins the pattern search: it finds minima, also at the edge of the feasible region, and then ends."""

import itertools

import numpy as np
import pytest

from spidar_gym.control.flight.margins import AXES, margins
from spidar_gym.control.presets import TUNED
from spidar_gym.tune.evolution import LEAST, SMALLEST, Pattern, better
from spidar_gym.tune.flight import INSIDE, RETUNED_START, at_the_edge, configuration, lack, loops, most, shortfall
from spidar_gym.tune.search import SEARCHES


def search(cost, size, step=0.3, most_steps=2000):
    """Run a pattern search until it ends; return it and the costs of its successive points."""
    pattern, now, costs = Pattern(size, step), cost(np.zeros(size)), []
    for _ in range(most_steps):
        if not pattern.sigma:
            break
        points = pattern.ask()
        told = [*map(cost, points), now]
        pattern.tell(points, told)
        now = told[better(told)]
        assert now == cost(pattern.mean)
        costs.append(now)
    return pattern, costs


def test_a_pattern_search_finds_a_minimum_and_rests_there():
    target, curved = np.array([0.4, -0.7, 0.1, 0.0]), np.array([1.0, 3.0, 0.5, 2.0])
    pattern, costs = search(lambda x: float(curved @ (x - target) ** 2) + 0.3 * x[0] * x[1], 4)
    expected = np.linalg.solve(2.0 * np.diag(curved) + 0.3 * np.eye(4)[[1, 0, 3, 2]] * [[1], [1], [0], [0]],
                               2.0 * curved * target)  # fmt: skip
    np.testing.assert_allclose(pattern.mean, expected, atol=0.05)
    assert pattern.sigma == 0.0
    assert all(later <= earlier for earlier, later in itertools.pairwise(costs))


def test_it_walks_along_an_edge_that_is_parallel_to_its_coordinates_and_stays_inside():
    pattern, _ = search(lambda x: 10.0 if x[0] > 0.25 else float(-x[0] + (x[1] - 1.5) ** 2), 2)
    assert 0.25 - 2.0 * SMALLEST < pattern.mean[0] <= 0.25
    assert pattern.mean[1] == pytest.approx(1.5, abs=0.03)


def test_nothing_is_better_that_is_not_better_by_a_little():
    assert better([1.0 - 0.9 * LEAST, 1.0 + 1.0, 1.0]) == 2
    assert better([1.0, 1.0 - 1.1 * LEAST, 1.0]) == 1


@pytest.mark.parametrize(("edge", "found"), [(0.7, 0.7), (1.9, 1.9), (0.4, 1.0), (3.0, 2.0)])
def test_the_largest_number_for_which_something_holds_is_found_to_a_thousandth(edge, found):
    """The result is 1 where the condition holds for none, and the largest number where it holds for all."""
    assert most(lambda f: f <= edge, 0.5, 2.0) == pytest.approx(found, rel=1.1e-3)
    assert most(lambda f: f <= edge, 0.5, 2.0) <= found


@pytest.mark.parametrize("start", [TUNED, RETUNED_START])
def test_at_the_edge_every_axis_keeps_its_margins_and_bears_no_stiffer_loop(start):
    values = {"xy_d": 6.5, "roll_pitch_d": 7.5}
    settled = at_the_edge(values, start)
    config = configuration(settled, start)
    assert shortfall(loops(config)) == 0.0
    stiffer = configuration({k: v * (1.004 if k.endswith("_d") else 1.008) for k, v in settled.items()}, start)
    assert all(lack(margins(stiffer, axis), INSIDE) > 0.0 for axis in range(len(AXES)))
    # The requested damping is relative to the stiffness of the start.
    row, first = config.centroidal.position_gains[0], start.centroidal.position_gains[0]
    assert row[2] / row[0] ** 0.5 == pytest.approx(6.5 / first[0] ** 0.5)
    assert row[1] == first[1]


def test_four_digits_of_what_is_at_the_edge_keep_its_margins():
    found, kept = SEARCHES["retuned"], 0
    for seed in range(6):
        rng = np.random.default_rng(seed)
        values = {p.name: p.value(rng.uniform(-0.2, 0.2)) for p in found.parameters}
        settled = found.settle(values)
        assert set(settled) == {*values, "xy_p", "z_p", "roll_pitch_p", "yaw_p"}
        if found.shortfall(settled) == 0.0:  # some loops do not keep their margins at any stiffness
            assert found.shortfall({name: float(f"{value:.4g}") for name, value in settled.items()}) == 0.0
            kept += 1
    assert kept >= 3
