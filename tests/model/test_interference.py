"""Pins the interference test: rotors and bounds in the paper's forms, the geometry of the jets, ties, symmetry."""

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from support.parts import rotors

from spidar_gym.model.dynamics import Model
from spidar_gym.model.interference import (
    InterferenceConfig,
    best_subset,
    find_interference,
    forbidden_interval,
    no_interference,
    valid_subsets,
)
from spidar_gym.model.rotor import nominal_vectoring, vectoring_to_force
from spidar_gym.robot import FORMS, ROBOT

CONFIG = InterferenceConfig()
LEVEL = np.zeros((8, 2))
INNER = np.arange(8) % 2 == 0
QUARTER = math.pi / 2


@pytest.fixture(scope="module")
def model():
    return Model()


def close(actual, desired, *, atol=1e-9):
    np.testing.assert_allclose(actual, desired, rtol=0, atol=atol)


def pitched(inner_deg, outer_deg):
    return np.tile(np.radians([0.0, inner_deg, 0.0, outer_deg]), 4)


def upright(model, q):
    """Return the snapshot with all rotors upright, and (φ̂, θ̂)."""
    nominal = nominal_vectoring(model.snapshot(q, np.eye(3), LEVEL).R_bl, LEVEL)
    return model.snapshot(q, np.eye(3), nominal), nominal


def from_rest(model, q):
    return find_interference(*upright(model, q), no_interference(), config=CONFIG)


@pytest.fixture
def pair(model):
    """Return a function: offset of rotor 2 from rotor 1 → snapshot of level, distant links, the torso high above."""
    snapshot, _ = upright(model, FORMS["form1"])

    def make(*offset):
        rotors = np.zeros((8, 3))
        rotors[:, 1] = 10.0 * np.arange(8)
        rotors[1] = offset
        return replace(snapshot, R_bl=np.tile(np.eye(3), (8, 1, 1)), rotor_c=rotors, com_b=np.array([0.0, 0.0, -50.0]))

    return make


def overlap(psi, x, z, radius, target_radius):
    """Compute the depth by which a jet at tilt ψ, a strip of half-width `radius`, covers the near end of a level disc.

    In the plane of the rotor's x and z axis, the jet starting at its origin; negative where it passes by.
    """
    across = np.cos(psi)[..., None] * (x + target_radius * np.array([-1.0, 1.0])) - np.sin(psi)[..., None] * z
    return radius - np.where(across[..., 0] * across[..., 1] < 0.0, 0.0, np.abs(across).min(-1))


def test_flat_form_restricts_nothing(model):
    result = from_rest(model, FORMS["form1"])
    assert not result.restricted.any()
    assert np.all(np.isneginf(result.lower))
    assert np.all(np.isposinf(result.upper))


def test_form_2_bounds_the_inner_rotors_just_inside_the_threshold(model):
    _, nominal = upright(model, FORMS["form2"])
    result = from_rest(model, FORMS["form2"])
    np.testing.assert_array_equal(result.restricted, INNER)
    close((result.lower - nominal[:, 1])[INNER], -0.195, atol=5e-4)
    close((result.upper - nominal[:, 1])[INNER], QUARTER)


def test_form_3_holds_rotors_1_3_5_7_at_the_papers_angle(model):
    result = from_rest(model, FORMS["form3"])
    np.testing.assert_array_equal(result.restricted, INNER)
    close(result.lower[INNER], -0.403, atol=3e-3)
    assert np.all(result.upper[INNER] > result.lower[INNER] + CONFIG.width)
    np.testing.assert_array_equal(result.side, np.ones(8))


def test_form_3_forbids_the_labs_interval(model):
    snapshot, _ = upright(model, FORMS["form3"])
    step = snapshot.rotor_c[1] - snapshot.rotor_c[0]
    outward = step @ [math.cos(math.pi / 4), math.sin(math.pi / 4), 0.0]
    interval = forbidden_interval(float(outward), float(step[2]), CONFIG.rotor_radius, CONFIG.rotor_radius)
    close(interval, (-0.558, 0.382), atol=1e-3)


def test_forbidden_interval_is_where_a_swept_jet_meets_the_target():
    """A jet meets an edge at distance l at asin(r / l) from its direction; the lab's atan is ≤ (r / l)³ / 2 smaller."""
    rng = np.random.default_rng(1)
    psi = np.linspace(-QUARTER, QUARTER, 60001)
    for _ in range(40):
        x, z = rng.uniform(-0.5, 0.5), rng.uniform(-1.0, -0.3)
        radius, target = rng.uniform(0.05, 0.15), rng.choice([0.09, ROBOT.torso_radius])
        blown = psi[overlap(psi, x, z, radius, target) > 0.0]
        edges = (x + target, x - target)
        for bound, exact, edge in zip(forbidden_interval(x, z, radius, target), blown[[0, -1]], edges, strict=True):
            short = 0.5 * (radius / math.hypot(edge, z)) ** 3
            inward = bound - exact if exact == blown[0] else exact - bound
            assert -1e-4 < inward < short + 1e-4


def test_a_mirrored_target_forbids_the_mirrored_interval():
    low, high = forbidden_interval(0.2, -0.5, 0.09, 0.12)
    close(forbidden_interval(-0.2, -0.5, 0.09, 0.12), (-high, -low))
    assert low + high < 0.0


@pytest.mark.parametrize("inner", range(-90, 91, 15))
def test_every_bound_grazes_a_target_and_free_rotors_blow_on_nothing(model, inner):
    """Legs in their vertical planes: the rotors of a leg and of the opposite one lie in one plane with the torso."""
    outward = np.array([math.cos(math.pi / 4), math.sin(math.pi / 4), 0.0])
    for outer in range(-90, 91, 15):
        snapshot, nominal = upright(model, pitched(inner, outer))
        result = find_interference(snapshot, nominal, no_interference(), config=CONFIG)
        places = [*snapshot.rotor_c[[0, 1, 4, 5]], -snapshot.com_b]
        radii = [CONFIG.rotor_radius] * 4 + [CONFIG.torso_radius]
        for i in range(2):
            steps = [(place - snapshot.rotor_c[i], radius) for place, radius in zip(places, radii, strict=True)]
            below = [(step @ outward, step[2], radius) for step, radius in steps if step[2] < -1e-9]

            def depths(psi, below=below):
                return [overlap(np.array(psi), x, z, CONFIG.rotor_radius, radius) for x, z, radius in below]

            bounds = np.array([result.lower[i], result.upper[i]]) - nominal[i, 1]
            for bound in bounds[np.abs(bounds) < QUARTER - 1e-9]:
                # The lab's atan: the jet's rim is r (1 − cos atan(r / l)) too deep, a few millimetres for l > 0.2 m.
                assert min(np.abs(depths(bound))) < 0.01
            if not result.restricted[i]:
                assert max([-1.0, *(depth.max() for depth in depths(np.linspace(-0.2, 0.2, 41)))]) < 0.01


def test_at_the_bound_the_thrust_frame_of_the_robot_points_its_jet_past_the_outer_rotor(model):
    """Form 3 in three dimensions: from the axis of the real thrust frame to the near rim of the rotor below."""
    q = FORMS["form3"]
    _, nominal = upright(model, q)
    tilted = nominal.copy()
    tilted[:, 1] = np.where(INNER, from_rest(model, q).lower, nominal[:, 1])
    positions, attitudes = rotors(model, q, tilted)
    for i in range(0, 8, 2):
        jet, step = -attitudes[i][:, 2], positions[i + 1] - positions[i]
        to_axis = step - (step @ jet) * jet
        assert jet @ step > 0.0
        assert jet[:2] @ positions[i][:2] < 0.0, "the jet goes inward, past the outboard rotor"
        rim = step + CONFIG.rotor_radius * np.array([*-step[:2], 0.0]) / np.linalg.norm(step[:2])
        distance = np.linalg.norm(rim - (rim @ jet) * jet)
        assert abs(distance - CONFIG.rotor_radius) < 0.003 < np.linalg.norm(to_axis) - distance


def test_restriction_begins_at_the_threshold_and_ends_beyond_the_hysteresis(model):
    result, outer = no_interference(), np.linspace(50.0, 62.0, 121)
    for enters, angles in ((True, outer), (False, outer[::-1])):
        for angle in angles:
            snapshot, nominal = upright(model, pitched(30.0, angle))
            before, result = result, find_interference(snapshot, nominal, result, config=CONFIG)
            if before.restricted[0] != result.restricted[0]:
                assert result.restricted[0] == enters
                close(result.lower[0] - nominal[0, 1], -0.20 if enters else -0.25, atol=2e-3)
        assert result.restricted[0] == enters


def test_bounds_are_the_same_directions_on_either_branch_of_the_angles(model):
    snapshot, nominal = upright(model, FORMS["form3"])
    flipped = nominal_vectoring(snapshot.R_bl, np.tile([math.pi, 0.0], (8, 1)))
    close(flipped[:, 0], math.pi)
    here, there = (find_interference(snapshot, n, no_interference(), config=CONFIG) for n in (nominal, flipped))
    np.testing.assert_array_equal(here.restricted, there.restricted)
    for ours, theirs in ((here.lower, there.upper), (here.upper, there.lower)):
        u = vectoring_to_force(np.ones(8), np.stack([np.zeros(8), np.where(INNER, ours, 0.0)], 1))
        v = vectoring_to_force(np.ones(8), np.stack([np.full(8, math.pi), np.where(INNER, theirs, math.pi)], 1))
        close(u, v)


def test_turning_the_robot_by_a_leg_turns_the_restricted_rotors(model):
    rng = np.random.default_rng(2)
    restricted = 0
    for _ in range(30):
        q = rng.uniform(np.tile([-0.4, 0.0, -0.4, 0.3], 4), np.tile([0.4, 1.2, 0.4, 1.5], 4))
        here, turned = from_rest(model, q), from_rest(model, np.roll(q, 4))
        restricted += here.restricted.sum()
        for name in ("restricted", "side"):
            np.testing.assert_array_equal(np.roll(getattr(here, name), 2), getattr(turned, name))
        close(np.roll(here.lower, 2), turned.lower)
        close(np.roll(here.upper, 2), turned.upper)
    assert restricted > 10


def test_folded_legs_are_restricted_by_the_torso(model):
    snapshot, nominal = upright(model, pitched(-90.0, 60.0))
    result = find_interference(snapshot, nominal, no_interference(), config=CONFIG)
    assert result.restricted[INNER].all()
    tilted = np.stack([nominal[:, 0], result.upper], axis=1)
    thrust = np.einsum("ikl,il->ik", snapshot.R_bl, vectoring_to_force(np.ones(8), tilted))
    places = snapshot.rotor_c + snapshot.com_b
    assert np.all((thrust[:, :2] * places[:, :2]).sum(1)[INNER] < 0.0), "thrust leans inward, so the jet goes outward"
    away = replace(snapshot, com_b=snapshot.com_b - np.array([0.0, 0.0, 9.0]))
    assert not find_interference(away, nominal, no_interference(), config=CONFIG).restricted[INNER].any()


def test_a_rotor_straight_above_the_torso_clears_its_disc(pair):
    snapshot = replace(pair(20.0, 0.0, 0.0), com_b=np.array([0.0, 0.0, 0.6]))
    result = find_interference(snapshot, LEVEL, no_interference(), config=CONFIG)
    np.testing.assert_array_equal(result.restricted, np.arange(8) == 0)
    clear = CONFIG.torso_radius * math.cos(result.lower[0]) - 0.6 * math.sin(result.lower[0])
    close(clear, -CONFIG.rotor_radius, atol=2e-3)


@pytest.mark.parametrize(("across", "counts"), [(0.16, True), (0.18, False), (-0.16, True), (-0.18, False)])
def test_a_pair_inclined_along_phi_by_more_than_0_4_rad_does_not_interfere(pair, across, counts):
    result = find_interference(pair(0.0, across, -0.4), LEVEL, no_interference(), config=CONFIG)
    assert result.restricted[0] == counts == (math.atan2(abs(across), 0.4) < 0.4)


def test_only_targets_below_count(pair):
    result = find_interference(pair(0.0, 0.0, 0.4), LEVEL, no_interference(), config=CONFIG)
    np.testing.assert_array_equal(result.restricted, np.arange(8) == 1)


@pytest.mark.parametrize("side", [-1, 1])
def test_a_tie_keeps_the_previous_side_and_a_clear_difference_does_not(pair, side):
    previous = replace(no_interference(), side=np.full(8, side))
    for offset, expected in ((0.0, side), (0.008 * side, side), (-0.1 * side, -side), (0.1 * side, side)):
        # A target at +x is met by a thrust tilted to −x, so the free side nearer to the vertical is that of the offset.
        result = find_interference(pair(offset, 0.0, -0.5), LEVEL, previous, config=CONFIG)
        assert result.side[0] == expected
        assert (result.lower[0] > 0.0) if expected > 0 else (result.upper[0] < 0.0)


@pytest.mark.parametrize("side", [-1, 1])
def test_a_target_slightly_to_the_other_side_does_not_flip_the_choice(pair, side):
    previous = replace(no_interference(), side=np.full(8, side))
    nearer = forbidden_interval(-0.008 * side, -0.5, CONFIG.rotor_radius, CONFIG.rotor_radius)
    assert 0.0 < (-nearer[0] - nearer[1]) * -side < CONFIG.tie
    assert find_interference(pair(-0.008 * side, 0.0, -0.5), LEVEL, previous, config=CONFIG).side[0] == side


def test_a_rotor_without_any_valid_subset_keeps_its_full_range(pair):
    everywhere = replace(CONFIG, torso_radius=50.0)
    snapshot = replace(pair(20.0, 0.0, 0.0), com_b=np.array([0.0, 0.0, 0.3]))
    result = find_interference(snapshot, LEVEL, no_interference(), config=everywhere)
    assert not result.restricted.any()
    assert np.all(np.isinf(result.lower) & np.isinf(result.upper))


@pytest.mark.parametrize(
    ("forbidden", "expected"),
    [
        ([], [(-QUARTER, QUARTER)]),
        ([(-0.5, 0.3)], [(-QUARTER, -0.5), (0.3, QUARTER)]),
        ([(-0.5, 0.3), (0.1, 0.8)], [(-QUARTER, -0.5), (0.8, QUARTER)]),
        ([(-0.5, 0.3), (-0.2, 0.1)], [(-QUARTER, -0.5), (0.3, QUARTER)]),
        ([(-0.5, -0.1), (0.35, 0.5)], [(-QUARTER, -0.5), (-0.1, 0.35), (0.5, QUARTER)]),
        ([(-0.5, -0.1), (0.25, 0.5)], [(-QUARTER, -0.5), (0.5, QUARTER)]),
        ([(-1.3, 0.0)], [(0.0, QUARTER)]),
        ([(-2.0, -1.0), (0.5, 3.0)], [(-1.0, 0.5)]),
        ([(-2.0, 2.0)], []),
        ([(-3.0, -2.0)], [(-QUARTER, QUARTER)]),
    ],
)
def test_valid_subsets_are_what_is_left_and_wide_enough(forbidden, expected):
    for order in itertools.permutations(forbidden):
        assert sorted(valid_subsets(list(order), width=0.4)) == expected


def test_valid_subsets_are_the_long_runs_of_angles_that_no_interval_covers():
    """Bounds on a grid of 0.01 rad, angles in the middle of its cells, a width of no whole number of cells."""
    rng = np.random.default_rng(3)
    cell, width = 0.01, 0.395
    psi = cell * (np.arange(-157, 157) + 0.5)
    for _ in range(50):
        lows = rng.integers(-200, 200, 4) * cell
        forbidden = list(zip(lows.tolist(), (lows + cell * rng.integers(5, 80, 4)).tolist(), strict=True))
        free = np.array([not any(low < angle < high for low, high in forbidden) for angle in psi])
        edges = np.flatnonzero(np.diff(np.concatenate([[False], free, [False]]).astype(int))).reshape(-1, 2)
        runs = [(psi[first], psi[last - 1]) for first, last in edges if (last - first) * cell > width]
        subsets = sorted(valid_subsets(forbidden, width=width))
        close(np.array(subsets).reshape(-1, 2), np.array(runs).reshape(-1, 2), atol=0.6 * cell)


@pytest.mark.parametrize(
    ("subsets", "side", "expected"),
    [
        ([(-QUARTER, -0.5), (0.3, QUARTER)], -1, (0.3, QUARTER)),
        ([(-QUARTER, -0.5), (0.3, QUARTER)], 1, (0.3, QUARTER)),
        ([(-QUARTER, -0.32), (0.3, QUARTER)], -1, (-QUARTER, -0.32)),
        ([(-QUARTER, -0.32), (0.3, QUARTER)], 1, (0.3, QUARTER)),
        ([(-QUARTER, -0.3), (0.32, QUARTER)], 1, (0.32, QUARTER)),
        ([(-QUARTER, -0.3), (0.37, QUARTER)], 1, (-QUARTER, -0.3)),
        ([(-QUARTER, -0.1), (-0.05, 0.9)], -1, (-0.05, 0.9)),
        ([(0.2, 0.7), (0.8, QUARTER)], -1, (0.2, 0.7)),
        ([], 1, None),
    ],
)
def test_best_subset_needs_the_least_tilt_and_ties_go_to_the_previous_side(subsets, side, expected):
    assert best_subset(subsets, side, tie=0.05) == expected
    assert best_subset(subsets[::-1], side, tie=0.05) == expected
