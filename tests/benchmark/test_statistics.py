"""Pins the statistics of comparisons: interquartile means, paired scores, bootstrap intervals."""

import numpy as np
import pytest
from scipy import stats

from spidar_gym.benchmark.statistics import (
    compare,
    improvement,
    iqm,
    on_one_track,
    overall_score,
    paired_difference,
    ratio_score,
    stratified_bootstrap,
)

SCORES = {"ratio": ratio_score, "difference": paired_difference, "improvement": improvement}
NEUTRAL = {"ratio": 1.0, "difference": 0.0, "improvement": 0.5}


def rng(seed=0):
    return np.random.default_rng(seed)


def dyadic(shape, seed=0):
    """Errors in 64ths, whose sums and halves are exact."""
    return rng(seed).integers(1, 300, shape) / 64.0


def ends(interval):
    return interval.value, interval.low, interval.high


def bootstrap(strata, statistic, seed=0, **options):
    return stratified_bootstrap(strata, statistic, rng(seed), **options)


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        ([3.0], 3.0),
        ([1.0, 4.0], 2.5),
        # Weights 1/6, 2/3, 1/6.
        ([12.0, 0.0, 3.0], 4.0),
        ([4.0, -50.0, 2.0, 90.0], 3.0),
        # Weights 0, 0.3, 0.4, 0.3, 0.
        ([4.0, 1000.0, 1.0, -100.0, 2.0], 2.3),
        # Weights 0, 1/6, 1/3, 1/3, 1/6, 0.
        ([6.0, 0.0, 3.0, 12.0, -9.0, 99.0], 5.0),
        # 1.75 values are cut off at either end: weights 0, ¼, 1, 1, 1, ¼, 0 over 3.5.
        ([-70.0, 1.0, 2.0, 3.0, 4.0, 19.0, 70.0], 4.0),
    ],
)
def test_the_interquartile_mean_is_that_of_the_middle_half_with_cut_values_in_part(values, expected):
    assert float(iqm(np.array(values))) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("n", [4, 8, 20, 100])
def test_the_interquartile_mean_is_the_trimmed_mean_where_quarters_are_whole(n):
    values = rng(n).lognormal(size=n)
    assert float(iqm(values)) == pytest.approx(stats.trim_mean(values, 0.25), rel=1e-12)


@pytest.mark.parametrize("n", [1, 2, 3, 5, 7, 50])
def test_the_interquartile_mean_ignores_order_and_follows_shift_and_scale(n):
    values = rng(n).normal(size=n)
    assert float(iqm(rng(1).permutation(values))) == float(iqm(values))
    assert float(iqm(3.0 - 2.0 * values)) == pytest.approx(3.0 - 2.0 * float(iqm(values)), abs=1e-12)
    # Every value four times: the same distribution.
    assert float(iqm(np.repeat(values, 4))) == pytest.approx(float(iqm(values)), abs=1e-12)


def test_a_quarter_of_outliers_at_either_end_leaves_the_interquartile_mean_as_it_is():
    values = np.arange(40.0)
    wild = np.where(values < 10.0, -1e9, np.where(values >= 30.0, 1e9, values))
    assert float(iqm(wild)) == float(iqm(values)) == 19.5


def test_the_interquartile_mean_of_many_rows_is_that_of_each():
    values = rng().normal(size=(3, 2, 7))
    many = iqm(values)
    assert many.shape == (3, 2)
    np.testing.assert_allclose(many, [[float(iqm(row)) for row in block] for block in values], rtol=1e-12)


BASE = np.array([1.0, 2.0, 3.0, 4.0])


@pytest.mark.parametrize(
    ("own", "ratio", "difference", "better"),
    [
        # Differences 1, 0, −1, −2: mean of the middle two over 2.5; one tie, two wins.
        ([[2.0, 2.0, 2.0, 2.0]], 2.5 / 2.0, -0.5 / 2.5, 2.5 / 4.0),
        ([[0.5, 1.0, 1.5, 2.0]], 2.0, -0.5, 1.0),
        ([[2.0, 4.0, 6.0, 8.0]], 0.5, 1.0, 0.0),
        # Means of the two runs 2, 2, 4, 4: differences 1, 0, 1, 0; two losses and six ties among the eight.
        ([[3.0, 2.0, 3.0, 4.0], [1.0, 2.0, 5.0, 4.0]], 2.5 / 3.0, 0.5 / 2.5, 3.0 / 8.0),
        # One run is far better, the other far worse.
        ([[0.0, 0.0, 0.0, 0.0], [9.0, 9.0, 9.0, 9.0]], 2.5 / 4.5, 2.0 / 2.5, 0.5),
    ],
)
def test_scores_are_those_by_hand(own, ratio, difference, better):
    own = np.array(own)
    assert float(ratio_score(BASE, own)) == pytest.approx(ratio, rel=1e-12)
    assert float(paired_difference(BASE, own)) == pytest.approx(difference, rel=1e-12)
    assert float(improvement(BASE, own)) == pytest.approx(better, rel=1e-12)


@pytest.mark.parametrize("statistic", SCORES)
def test_scores_depend_neither_on_the_order_of_scenarios_nor_on_that_of_runs(statistic):
    base, own, order = dyadic(9), dyadic((3, 9), 1), rng(2).permutation(9)
    score = SCORES[statistic]
    shuffled = float(score(base[order], own[::-1][:, order]))
    assert shuffled == pytest.approx(float(score(base, own)), rel=1e-12)
    # Other pairs of scenarios change every score except the ratio of means.
    apart = float(score(base, own[:, order]))
    assert (apart == pytest.approx(shuffled, rel=1e-12)) == (statistic == "ratio")


def test_a_win_for_one_is_a_loss_for_the_other():
    a, b = dyadic(20), dyadic(20, 1)
    assert float(improvement(a, b[None])) + float(improvement(b, a[None])) == 1.0
    assert float(ratio_score(a, b[None])) * float(ratio_score(b, a[None])) == pytest.approx(1.0, rel=1e-12)


@pytest.mark.parametrize("runs", [1, 2, 4])
@pytest.mark.parametrize("statistic", SCORES)
def test_a_policy_like_the_base_is_exactly_neutral_and_its_interval_has_no_width(statistic, runs):
    base = dyadic(13)
    interval = bootstrap([(base, np.tile(base, (runs, 1)))], on_one_track(SCORES[statistic]))
    assert ends(interval) == (NEUTRAL[statistic],) * 3


def test_scenarios_are_drawn_jointly_for_base_and_policy():
    """Widely spread errors, all of them halved: the paired scores have no spread."""
    base = dyadic(17)
    strata = [(base, 0.5 * base[None])]
    assert ends(bootstrap(strata, on_one_track(ratio_score))) == (2.0, 2.0, 2.0)
    assert ends(bootstrap(strata, on_one_track(improvement))) == (1.0, 1.0, 1.0)
    np.testing.assert_allclose(ends(bootstrap(strata, on_one_track(paired_difference))), -0.5, rtol=1e-12)
    spread = bootstrap([(base, 0.5 * base[None, ::-1])], on_one_track(ratio_score))
    assert spread.low < 1.9 < 2.1 < spread.high


def test_a_seed_gives_the_same_interval_and_another_seed_another():
    strata = [(dyadic(10), dyadic((3, 10), 1)), (dyadic(6, 2), dyadic((1, 6), 3))]
    first = bootstrap(strata, overall_score)
    assert bootstrap(strata, overall_score) == first
    other = bootstrap(strata, overall_score, 1)
    assert other.value == first.value
    assert (other.low, other.high) != (first.low, first.high)


def test_the_interval_holds_the_value_and_a_single_scenario_has_none_to_draw_from():
    strata = [(dyadic(30), dyadic((1, 30), 1))]
    interval = bootstrap(strata, on_one_track(ratio_score))
    assert interval.low < interval.value < interval.high
    assert interval.value == float(ratio_score(*strata[0]))
    alone = bootstrap([(np.array([3.0]), np.array([[2.0]]))], on_one_track(ratio_score))
    assert ends(alone) == (1.5, 1.5, 1.5)


def test_runs_are_drawn_too():
    """One run equals the base, one has twice its error: in a quarter of the draws only one of the two occurs."""
    base, own = np.ones(8), np.array([np.ones(8), np.full(8, 2.0)])
    np.testing.assert_allclose(
        ends(bootstrap([(base, own)], on_one_track(ratio_score))), [2.0 / 3.0, 0.5, 1.0], rtol=1e-12
    )
    alike = bootstrap([(base, own[:1].repeat(2, axis=0))], on_one_track(ratio_score))
    assert ends(alike) == (1.0, 1.0, 1.0)


def test_a_run_is_drawn_whole():
    """If runs were drawn separately for each scenario, hardly any draw would be near one of the runs."""
    base = np.ones(40)
    interval = bootstrap([(base, np.array([np.full(40, 0.5), np.full(40, 1.5)]))], on_one_track(paired_difference))
    np.testing.assert_allclose(ends(interval), [0.0, -0.5, 0.5], atol=1e-12)


def test_tracks_are_not_mixed():
    """Each track has a constant score, whichever scenarios are drawn."""
    strata = [
        (dyadic(5), dyadic(5)[None]),
        (100.0 * dyadic(9), 20.0 * dyadic((1, 9))),
        (dyadic(3), 2.0 * dyadic((1, 3))),
    ]
    np.testing.assert_allclose(ends(bootstrap(strata, overall_score)), (1.0 * 5.0 * 0.5) ** (1 / 3), rtol=1e-12)


def test_a_track_is_drawn_from_as_often_as_it_has_scenarios():
    """Three wins in six: 1.6 % of the draws have no win, 11 % at most one."""
    strata = [(np.ones(6), np.array([[0.5, 0.5, 0.5, 2.0, 2.0, 2.0]]))]
    np.testing.assert_allclose(ends(bootstrap(strata, on_one_track(improvement))), [1 / 2, 1 / 6, 5 / 6], rtol=1e-12)


@pytest.mark.parametrize(("n", "wins"), [(50, 25), (100, 30), (40, 38)])
def test_the_interval_of_a_share_is_that_of_the_binomial(n, wins):
    own = np.where(np.arange(n) < wins, 0.5, 2.0)[None]
    interval = bootstrap([(np.ones(n), own)], on_one_track(improvement), draws=4000)
    low, high = stats.binom.ppf([0.025, 0.975], n, wins / n) / n
    assert interval.value == wins / n
    assert interval.low == pytest.approx(low, abs=1.01 / n)
    assert interval.high == pytest.approx(high, abs=1.01 / n)


@pytest.mark.parametrize("statistic", ["ratio", "difference"])
def test_intervals_hold_the_truth_about_as_often_as_they_say(statistic):
    """Most of the normal error is common to base and policy: without pairing, the intervals would be far too wide."""
    source, held, widths, repeats = rng(7), 0, [], 200
    truth = {"ratio": 1.0 / 0.8, "difference": -0.2}[statistic]
    for repeat in range(repeats):
        common = source.normal(scale=0.2, size=50)
        base = 1.0 + common + source.normal(scale=0.03, size=50)
        own = 0.8 + common + source.normal(scale=0.03, size=(1, 50))
        interval = bootstrap([(base, own)], on_one_track(SCORES[statistic]), repeat, draws=300)
        held += interval.low <= truth <= interval.high
        widths.append(interval.high - interval.low)
    assert 0.85 * repeats <= held <= 0.99 * repeats
    # Half of four standard errors of a single mean.
    assert np.median(widths) < 0.5 * 4.0 * 0.2 / np.sqrt(50.0)


def test_more_scenarios_make_an_interval_narrower_by_the_square_root():
    def width(n):
        source = rng(n)
        strata = [(np.ones(n), np.abs(1.0 + 0.2 * source.normal(size=(1, n))))]
        interval = bootstrap(strata, on_one_track(ratio_score))
        return interval.high - interval.low

    assert width(25) / width(2500) == pytest.approx(10.0, rel=0.35)


def test_the_overall_score_is_a_geometric_mean_and_inverts_when_the_roles_are_swapped():
    tracks = [(np.array([4.0, 8.0]), np.array([1.0, 2.0])), (np.array([3.0]), np.array([6.0]))]
    there = float(overall_score([(a, b[None]) for a, b in tracks]))
    back = float(overall_score([(b, a[None]) for a, b in tracks]))
    # √(4 · ½).
    assert there == pytest.approx(np.sqrt(2.0), rel=1e-12)
    assert there * back == pytest.approx(1.0, rel=1e-12)


def test_no_track_counts_more_for_its_unit_or_its_number_of_scenarios():
    a, b = (dyadic(4), dyadic((2, 4), 1)), (dyadic(6, 2), dyadic((1, 6), 3))
    score = float(overall_score([a, b]))
    assert score == pytest.approx(float(overall_score([a, (1e3 * b[0], 1e3 * b[1])])), rel=1e-12)
    twice = (np.tile(b[0], 2), np.tile(b[1], 2))
    assert score == pytest.approx(float(overall_score([a, twice])), rel=1e-12)
    assert float(overall_score([a])) == pytest.approx(float(ratio_score(*a)), rel=1e-12)


def test_a_comparison_of_two_controllers_gives_both_means_and_the_paired_change():
    change = compare(BASE, 0.5 * BASE[None], rng())
    assert (change.before, change.after) == (2.5, 1.25)
    np.testing.assert_allclose([change.relative, change.low, change.high], -0.5, rtol=1e-12)
    a, b = dyadic(20), dyadic(20, 1)
    change = compare(a, b[None], rng())
    assert change.low < change.relative < change.high
    assert change.relative == pytest.approx(float(iqm(b - a)) / float(iqm(a)), rel=1e-12)
    assert compare(a, b[None], rng()) == change
