"""Pins the search for `tuned`: bounds and reflection of its parameters, its seeds, its files, its interruptions."""

import json
import pickle
import sys

import numpy as np
import pytest

from spidar_gym.control.flight.centroidal import CentroidalConfig
from spidar_gym.control.flight.compensation import CompensationConfig
from spidar_gym.control.flight.controller import ControllerConfig
from spidar_gym.control.presets import controller_config
from spidar_gym.errors import InvalidValueError, MissingDependencyError, SpidarError
from spidar_gym.paper import flight_studies as studies
from spidar_gym.paper import tune
from spidar_gym.paper.trial import CONDITIONS, Outcome, fly
from spidar_gym.paper.tune import PARAMETERS, configuration, cost, decode, shortfall, trials

N = len(PARAMETERS)
NAMES, START, LOW, HIGH = zip(*((p.name, p.start, p.low, p.high) for p in PARAMETERS), strict=True)
BUDGET = {"population": 4, "flights": 1, "seed": 0, "workers": 1}


def values(x):
    return np.array(list(decode(x).values()))


def test_the_search_starts_at_the_first_guess_and_its_bounds_are_at_one():
    assert list(decode(np.zeros(N))) == list(NAMES)
    np.testing.assert_allclose(values(np.zeros(N)), START, rtol=1e-12)
    np.testing.assert_allclose(values(np.ones(N)), HIGH, rtol=1e-12)
    np.testing.assert_allclose(values(-np.ones(N)), LOW, rtol=1e-12)


def test_no_point_of_the_search_leaves_the_bounds():
    rng = np.random.default_rng(0)
    for scale in (0.3, 1.0, 5.0, 1e3):
        for _ in range(100):
            v = values(rng.normal(scale=scale, size=N))
            assert np.all(v >= np.array(LOW) * (1.0 - 1e-12))
            assert np.all(v <= np.array(HIGH) * (1.0 + 1e-12))


def test_parameters_are_continuous_monotonic_within_the_bounds_and_reflected_beyond():
    u = np.linspace(-6.0, 6.0, 4801)
    v = np.log(np.array([values(np.full(N, x)) for x in u]))
    width = np.log(np.array(HIGH) / np.array(LOW))
    assert np.all(np.abs(np.diff(v, axis=0)) < 0.01 * width)
    inside = np.abs(u) <= 1.0
    assert np.all(np.diff(v[inside], axis=0) > 0.0)
    for x in (0.0, 0.2, 0.7, 1.0):
        np.testing.assert_allclose(values(np.full(N, 1.0 + x)), values(np.full(N, 1.0 - x)), rtol=1e-9)
        np.testing.assert_allclose(values(np.full(N, -1.0 - x)), values(np.full(N, x - 1.0)), rtol=1e-9)


def test_equal_steps_of_the_search_are_equal_ratios():
    for sign in (1.0, -1.0):
        steps = np.log(np.array([values(np.full(N, sign * x)) for x in (0.0, 0.25, 0.5, 0.75, 1.0)]))
        np.testing.assert_allclose(np.diff(steps, n=2, axis=0), 0.0, atol=1e-12)


def test_every_parameter_changes_the_controller_in_one_place():
    start = configuration(decode(np.zeros(N)))
    for i, name in enumerate(NAMES):
        changed = configuration(decode(0.5 * (np.arange(N) == i)))
        assert changed != start
        option = hasattr(start.compensation, name)
        assert (changed.compensation != start.compensation) == option
        assert (changed.centroidal != start.centroidal) == (not option)
        if option:
            assert getattr(changed.compensation, name) == pytest.approx(values(0.5 * np.ones(N))[i])


@pytest.mark.parametrize(("axis", "rows"), [("xy", (0, 1)), ("z", (2,)), ("roll_pitch", (3, 4)), ("yaw", (5,))])
@pytest.mark.parametrize(("term", "column"), [("p", 0), ("i", 1), ("d", 2)])
def test_a_gain_is_that_of_its_axis_and_its_term(axis, rows, term, column):
    config = configuration(decode(np.zeros(N)) | {f"{axis}_{term}": 123.0})
    gains = np.array([*config.centroidal.position_gains, *config.centroidal.attitude_gains])
    expected = np.zeros((6, 3), bool)
    expected[list(rows), column] = True
    np.testing.assert_array_equal(gains == 123.0, expected)


def test_tuned_lies_within_the_bounds_of_the_search():
    tuned = controller_config("tuned")
    found = {name: getattr(tuned.compensation, name) for name in NAMES if hasattr(tuned.compensation, name)}
    rows = {"xy": tuned.centroidal.position_gains[0], "z": tuned.centroidal.position_gains[2]}
    rows |= {"roll_pitch": tuned.centroidal.attitude_gains[0], "yaw": tuned.centroidal.attitude_gains[2]}
    found |= {f"{axis}_{term}": row["pid".index(term)] for axis, row in rows.items() for term in "pid"}
    assert set(found) == set(NAMES)
    assert all(p.low <= found[p.name] <= p.high for p in PARAMETERS)
    assert configuration(found) == tuned


def test_margins_fall_short_for_gains_that_are_too_high_and_the_more_the_higher():
    def wild(factor):
        gains = ((factor * 3.6, 0.03, factor * 4.0),) * 3
        return shortfall(ControllerConfig(centroidal=CentroidalConfig(position_gains=gains)))

    assert wild(1.0) == 0.0 < wild(4.0) < wild(100.0)
    greedy = CompensationConfig(observer_gain=0.99, observer_time=0.02)
    assert shortfall(ControllerConfig(compensation=greedy)) > 0.0


def test_a_lost_flight_costs_more_than_any_that_was_flown_well():
    flown = Outcome(position=0.05, attitude=0.05, softened=0, joint_torque=1.0, late=0, failure="")
    lost = Outcome(position=0.001, attitude=0.001, softened=0, joint_torque=1.0, late=0, failure="tilt")
    assert (
        cost(lost) > cost(flown) > cost(Outcome(0.01, 0.05, 0, 1.0, 0, "")) > cost(Outcome(0.01, 0.01, 0, 1.0, 0, ""))
    )


@pytest.mark.parametrize("flights", [1, 6, 12])
def test_no_two_generations_share_a_seed_and_none_flies_a_seed_of_anything_else(flights):
    seeds = [{s.seed for s in trials(generation, flights)} for generation in range(200)]
    assert all(len(own) == flights for own in seeds)
    assert len(set.union(*seeds)) == 200 * flights
    assert min(set.union(*seeds)) >= 900_000 > studies.FIRST_SEED + 100_000 > 100_000


def test_a_generation_of_six_flies_every_condition_at_every_speed():
    kinds = {(s.condition, s.joint_speed) for s in trials(3, 6)}
    assert kinds == {(condition, speed) for condition in CONDITIONS for speed in tune.SPEEDS}


@pytest.fixture
def short(monkeypatch):
    """Flights of eight ticks."""
    monkeypatch.setattr(tune, "SECONDS", 0.2)


def log(folder):
    return json.loads((folder / "tune.json").read_text(encoding="utf-8"))


def test_a_search_writes_its_log_and_answers_with_its_last_line(short, tmp_path):
    flights, heads = [], []
    last = tune.tune(
        tmp_path, generations=2, **BUDGET, on_flight=lambda: flights.append(None), on_generation=heads.append
    )
    written = log(tmp_path)
    assert written["settings"] == {"population": 4, "flights": 1, "seed": 0}
    assert [line["generation"] for line in written["log"]] == [0, 1]
    assert written["log"][-1] == last
    assert [head["cost"] for head in heads] == [line["cost"] for line in written["log"]]
    # Four candidates and the mean of the distribution.
    assert len(flights) == 2 * 5
    assert set(last["parameters"]) == set(NAMES)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["tune.json"]


def test_the_cost_in_the_log_is_that_of_the_mean_of_the_distribution_on_the_same_flights(short, tmp_path):
    """It starts at the first guess."""
    line = tune.tune(tmp_path, generations=1, **(BUDGET | {"flights": 2}))
    start = configuration(decode(np.zeros(N)))
    flown = [cost(fly(start, flight)) for flight in trials(0, 2)]
    assert line["shortfall"] == shortfall(start)
    assert line["cost"] == pytest.approx(np.mean(flown) + 10.0 * shortfall(start), rel=1e-12)
    assert line["best"] != line["cost"]


def test_an_interrupted_search_goes_on_as_if_it_had_not_been(short, tmp_path):
    tune.tune(tmp_path / "whole", generations=3, **BUDGET)
    for generations in (1, 2, 3):
        # Another process would start with another state of NumPy's global generator, and others draw from it.
        np.random.seed(generations)  # noqa: NPY002 - the global state must not matter
        draw = lambda: np.random.random(generations)  # noqa: E731, NPY002, B023 - called at once
        tune.tune(tmp_path / "parts", generations=generations, **BUDGET, on_flight=draw)
    assert log(tmp_path / "whole") == log(tmp_path / "parts")
    finished = log(tmp_path / "parts")["log"][-1]
    assert tune.tune(tmp_path / "parts", generations=2, **BUDGET) == finished


def test_another_seed_is_another_search(short, tmp_path):
    a, b = (tune.tune(tmp_path / str(seed), generations=1, **(BUDGET | {"seed": seed})) for seed in (0, 1))
    assert a["parameters"] != b["parameters"]


@pytest.mark.parametrize("other", [{"population": 5}, {"flights": 2}, {"seed": 1}])
def test_a_search_of_other_settings_is_not_mixed_with_one_in_the_folder(short, tmp_path, other):
    tune.tune(tmp_path, generations=1, **BUDGET)
    before = log(tmp_path)
    with pytest.raises(SpidarError, match="valid: the same settings, or another folder"):
        tune.tune(tmp_path, generations=2, **(BUDGET | other))
    assert log(tmp_path) == before


class Trap:
    """Bites whoever unpickles it."""

    def __reduce__(self):
        return pytest.fail, ("unpickled",)


def test_the_state_of_an_earlier_version_is_refused_and_not_opened(tmp_path):
    (tmp_path / "tune.pickle").write_bytes(pickle.dumps(Trap()))
    with pytest.raises(SpidarError, match=r"tune\.pickle .* can run code; valid: another folder") as caught:
        tune.tune(tmp_path, generations=1, **BUDGET)
    assert "\n" not in str(caught.value)
    assert [path.name for path in tmp_path.iterdir()] == ["tune.pickle"]


def test_every_flipped_bit_of_a_log_is_noticed(short, tmp_path):
    tune.tune(tmp_path, generations=2, **BUDGET)
    path = tmp_path / "tune.json"
    whole, rng = path.read_bytes(), np.random.default_rng(0)
    for place in rng.choice(len(whole), 300, replace=False).tolist():
        data = bytearray(whole)
        data[place] ^= 1 << int(rng.integers(8))
        path.write_bytes(data)
        with pytest.raises(SpidarError) as caught:
            tune.tune(tmp_path, generations=2, **BUDGET)
        assert str(caught.value).isprintable()
        assert "valid: " in str(caught.value)


@pytest.mark.parametrize(
    "change",
    [
        lambda log: log[1]["costs"].reverse(),
        lambda log: log[1]["costs"].pop(),
        lambda log: log[1].update(sigma=0.25),
        lambda log: log[0]["parameters"].update(z_p=1.0),
        lambda log: log[0].update(cost=0.0),
        lambda log: log.pop(0),
    ],
)
def test_a_log_whose_costs_do_not_lead_to_it_is_refused_though_its_checksum_is_right(short, tmp_path, change):
    tune.tune(tmp_path, generations=2, **BUDGET)
    content = log(tmp_path)
    change(content["log"])
    (tmp_path / "tune.json").write_text(tune.log_text(content["settings"], content["log"]), encoding="utf-8")
    with pytest.raises(SpidarError, match=r"told its costs, the search does not come to generation .*; valid: "):
        tune.tune(tmp_path, generations=3, **BUDGET)


@pytest.mark.parametrize(
    ("name", "value", "least"),
    [("generations", 0, 1), ("flights", 0, 1), ("workers", 0, 1), ("population", 1, 2), ("seed", -1, 0)],
)
def test_a_search_that_cannot_be_made_is_refused_before_it_flies(tmp_path, name, value, least):
    with pytest.raises(InvalidValueError, match=f"{name} = {value} .*at least {least}"):
        tune.tune(tmp_path, **({"generations": 1} | BUDGET | {name: value}))
    assert not list(tmp_path.iterdir())


def test_a_search_without_cma_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "cma", None)
    with pytest.raises(MissingDependencyError, match=r"cma is not available; install it with: .*spidar-gym\[tune\]"):
        tune.tune(tmp_path, generations=1, **BUDGET)
