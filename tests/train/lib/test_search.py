"""Pins gradient-free searches: descent despite noise shared by a generation, equal states from equal costs."""

import numpy as np
import pytest

from spidar_gym.errors import InvalidValueError, UnknownNameError
from train.lib.search import METHODS, SearchConfig, make_search

SIZE = 20


def descend(search, least, generations):
    """Minimise a squared distance with an offset common to each generation that is about a thousand times as large."""
    rng, told = np.random.default_rng(0), []
    for _ in range(generations):
        trials = search.ask()
        assert np.abs(trials).max() <= 1.0
        told.append(np.mean((trials - least) ** 2, axis=1) + 100.0 * rng.normal())
        search.tell(told[-1])
    return np.array(told)


@pytest.mark.parametrize("method", METHODS)
def test_a_search_descends_despite_noise_shared_by_a_generation(method):
    least = np.random.default_rng(1).uniform(-0.6, 0.6, SIZE)
    search = make_search(SearchConfig(method, generations=100), SIZE, 3)
    np.testing.assert_allclose(search.mean, 0.0, atol=1e-12)
    descend(search, least, 100)
    assert np.mean((search.mean - least) ** 2) < 0.1 * np.mean(least**2)
    assert np.abs(search.mean).max() <= 1.0


@pytest.mark.parametrize("method", METHODS)
def test_equal_costs_lead_to_equal_states(method):
    config, least = SearchConfig(method, generations=30), np.full(SIZE, 0.4)
    first, second, other = (make_search(config, SIZE, seed) for seed in (3, 3, 4))
    costs = descend(first, least, 12)
    np.random.default_rng(9).normal(size=5)  # other generators have no effect
    np.random.seed(1)  # noqa: NPY002 - the default generator of the library
    for own in costs:
        second.ask()
        second.tell(own)
    np.testing.assert_array_equal(first.mean, second.mean)
    np.testing.assert_array_equal(first.ask(), second.ask())
    assert not np.array_equal(other.ask(), make_search(config, SIZE, 3).ask())


def test_pairs_stay_where_nothing_makes_a_difference_and_have_two_sides_of_each_direction():
    search = make_search(SearchConfig("pairs"), SIZE, 0)
    trials = search.ask()
    np.testing.assert_allclose(trials[:6], -trials[6:])
    search.tell(np.ones(12))
    np.testing.assert_array_equal(search.mean, np.zeros(SIZE))


def test_bad_settings_are_refused():
    with pytest.raises(UnknownNameError, match="pairs"):
        SearchConfig("anneal")
    with pytest.raises(InvalidValueError, match="population"):
        SearchConfig(population=1)
    with pytest.raises(InvalidValueError, match="even"):
        SearchConfig("pairs", population=7)
