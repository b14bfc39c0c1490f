"""Pins that the known pitfalls of OSQP's generated code do not affect the core's commands."""

import re
from dataclasses import replace

import numpy as np
import pytest
from support.cores import CAP, Allocating
from support.states import random_demands

from spidar_gym.native.codegen.solvers import generate_solvers, programs
from spidar_gym.native.constants import ONBOARD_ITERATIONS
from spidar_gym.native.library import load_core


@pytest.fixture
def allocate():
    return Allocating(load_core())


@pytest.fixture(scope="module")
def sources():
    return generate_solvers()


def demands(seed, count=20):
    return random_demands(np.random.default_rng(seed), count, True)


def within(answer):
    """Return whether forces are finite and within the rotors' limits."""
    return np.isfinite(answer.forces_l).all() and np.linalg.norm(answer.forces_l, axis=1).max() <= 42.0 + 1e-9


def test_1_the_solvers_nan_is_a_finite_number_and_is_never_used(allocate, sources):
    header = sources["osqp_api_constants.h"]
    assert re.search(r"OSQP_NAN \(\(OSQPFloat\)0x7fc00000UL\)", header), "the pitfall is gone; remove this check"
    for demand in demands(11):
        answer = allocate(replace(demand, wrench=demand.wrench * 9.0))
        assert str(answer.status) in ("softened", "held")
        assert within(answer)
        assert np.abs(answer.joint_torques).max() < 1e6


@pytest.mark.parametrize("poison", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("name", ["wrench", "gravity_torque", "torque_map", "thrust_map", "lower", "phi"])
def test_2_one_number_that_is_not_finite_affects_one_tick_and_no_later_one(allocate, name, poison):
    good, previous = demands(12, 1)[0], np.full((8, 3), 5.0)
    good = replace(good, restricted=np.ones(8, bool), locked=np.ones(8, bool))
    before = allocate(good).forces_l.copy()
    spoilt = np.array(getattr(good, name), float)
    spoilt.reshape(-1)[2] = poison
    assert within(allocate(replace(good, **{name: spoilt}), previous))
    np.testing.assert_array_equal(allocate(good).forces_l, before)


def test_3_a_tick_is_a_pure_function_whatever_was_solved_before(allocate):
    given = demands(13, 60)
    forwards = [allocate(demand).forces_l.copy() for demand in given]
    order = np.random.default_rng(0).permutation(len(given))
    for k in order:
        allocate(replace(given[k], wrench=given[k].wrench * 30.0))  # infeasible: the step size ends at its bound
        np.testing.assert_array_equal(allocate(given[k]).forces_l, forwards[k])


@pytest.mark.parametrize("name", ["paper", "as_flown", "rest", "leg", "legs", "stance", "projection"])
def test_4_nothing_is_scaled_or_started_warm_and_the_work_space_is_fresh(sources, name):
    text = sources[f"{name}_workspace.c"]
    settings = re.search(r"\.settings = {(.+?)\n    },", text, re.S)
    assert settings
    numbers = [word.strip() for word in settings[1].split(",") if word.strip()]
    words = [
        "device",
        "linsys",
        "allocate_solution",
        "verbose",
        "profiler",
        "warm_starting",
        "scaling",
        "polishing",
        "rho",
    ]
    values = dict(zip(words, numbers, strict=False))
    assert [values[word] for word in ("verbose", "warm_starting", "scaling", "polishing")] == ["0"] * 4
    assert not re.search(r"^    \.sol_x =", text, re.M), "generated after a solution"
    assert re.search(r"OSQPFloat sol_x\[\d+\];", sources[f"{name}_workspace.h"])


@pytest.mark.parametrize("name", ["paper", "leg"])
def test_5_the_step_size_adapts_by_iterations_and_the_cap_is_the_only_clock(sources, name):
    text = sources[f"{name}_workspace.c"]
    settings = re.search(r"\.settings = {(.+?)\n    },", text, re.S)
    assert settings
    numbers = [word.strip() for word in settings[1].split(",") if word.strip()]
    assert numbers.count(str(ONBOARD_ITERATIONS)) == 1
    assert "OSQP_ENABLE_PROFILING" not in sources["osqp_configure.h"] or not re.search(
        r"#\s*define OSQP_ENABLE_PROFILING", sources["osqp_configure.h"]
    )
    assert not re.search(r"#\s*define OSQP_ENABLE_INTERRUPT", sources["osqp_configure.h"])


def test_5_no_attempt_continues_beyond_the_cap(allocate):
    most = [allocate(replace(demand, wrench=demand.wrench * 2.5)).iterations for demand in demands(14, 60)]
    # Hard and softened program, with two step sizes each.
    assert max(most) <= 4 * CAP
    assert max(most) > 0


def test_6_crossed_bounds_do_not_return_the_solution_of_the_last_program(allocate):
    good, other = demands(15, 2)
    previous = np.full((8, 3), 5.0)
    allocate(other)
    crossed = replace(good, restricted=np.ones(8, bool), lower=np.full(8, 0.5), upper=np.full(8, -0.5))
    answer = allocate(crossed, previous)
    assert within(answer)
    given = answer.forces_l.copy()
    fresh = Allocating(load_core())(crossed, previous)
    np.testing.assert_array_equal(given, fresh.forces_l)
    assert np.abs(given - allocate(other).forces_l).max() > 1e-3


def test_7_every_instance_has_its_own_workspace():
    one, two = Allocating(load_core()), Allocating(load_core())
    a, b = demands(16, 2)
    alone = one(a).forces_l.copy(), one(b).forces_l.copy()
    for _ in range(3):
        np.testing.assert_array_equal(one(a).forces_l, alone[0])
        np.testing.assert_array_equal(two(b).forces_l, alone[1])
    places = [set(each.room.record[kind].tolist()) - {0} for each in (one, two) for kind in ("hard", "soft")]
    assert len(set.union(*places)) == sum(map(len, places)) == 2 * len(programs())
