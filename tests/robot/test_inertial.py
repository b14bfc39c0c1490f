"""Pins mass distributions against mass points: a stretched part, and a rod with a known inertia."""

import numpy as np
import pytest

from spidar_gym.robot.inertial import Inertial
from spidar_gym.robot.spec import PARTS


def points_of(part: Inertial):
    """Return six points on a part's principal axes with its mass, centre and inertia: masses (6,), positions (6, 3)."""
    moments, axes = np.linalg.eigh(0.5 * np.trace(part.matrix) * np.eye(3) - part.matrix)
    arms = axes * np.sqrt(3.0 * np.maximum(moments, 0.0) / part.mass)
    return np.full(6, part.mass / 6.0), np.array(part.com) + np.concatenate((arms.T, -arms.T))


@pytest.mark.parametrize("name", ["inner_link", "outer_link"])
@pytest.mark.parametrize("factor", [0.7, 1.2])
def test_a_stretched_link_is_its_points_farther_apart_and_as_much_heavier(name, factor):
    masses, places = points_of(PARTS[name])
    masses, places = factor * masses, places * (factor, 1.0, 1.0)
    stretched = PARTS[name].stretched(factor)
    com = masses @ places / masses.sum()
    arms = places - com
    inertia = np.einsum("i,ijk->jk", masses, [a @ a * np.eye(3) - np.outer(a, a) for a in arms])
    assert stretched.mass == pytest.approx(masses.sum())
    np.testing.assert_allclose(stretched.com, com, atol=1e-12)
    np.testing.assert_allclose(stretched.matrix, inertia, atol=1e-12)


def test_a_thin_rod_stays_one():
    mass, length, factor = 0.3, 0.5, 1.2
    rod = Inertial(mass, (length / 2, 0.0, 0.0), (0.0, mass * length**2 / 12, mass * length**2 / 12, 0.0, 0.0, 0.0))
    longer = rod.stretched(factor)
    expected = factor * mass * (factor * length) ** 2 / 12
    np.testing.assert_allclose(longer.inertia, (0.0, expected, expected, 0.0, 0.0, 0.0), atol=1e-15)
    assert longer.com[0] == pytest.approx(factor * length / 2)


def test_a_part_of_the_same_length_is_the_same_part():
    for part in PARTS.values():
        np.testing.assert_allclose(part.stretched(1.0).matrix, part.matrix, atol=1e-15)
