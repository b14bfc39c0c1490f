"""Pins vectoring: force ↔ (λ, φ, θ) on the nearest branch, power duality of the thrust map, the lock of φ."""

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from support.parts import rotors

from spidar_gym.model.dynamics import Model
from spidar_gym.model.rotor import (
    Lock,
    LockConfig,
    force_to_angles,
    nominal_vectoring,
    thrust_map,
    update_lock,
    vectoring_to_force,
)
from spidar_gym.robot import FORMS, ROBOT
from spidar_gym.so3 import exp

CONFIG = LockConfig()
NONE, ALL = np.zeros(8, bool), np.ones(8, bool)
OUTER = np.arange(8) % 2 == 1
LEVEL = np.zeros((8, 2))
FREE = Lock(vertical=NONE, active=NONE, phi=np.zeros(8))


@pytest.fixture(scope="module")
def model():
    return Model()


def close(actual, desired, *, atol=1e-12):
    np.testing.assert_allclose(actual, desired, rtol=0, atol=atol)


def direction(phi, theta):
    return vectoring_to_force(np.ones(8), np.tile([phi, theta], (8, 1)))[0]


def force_to_vectoring(forces_l, present):
    """Compute (φ, θ) of eight forces without locked rotors."""
    return np.array(
        [force_to_angles(f, *angles) for f, angles in zip(forces_l.tolist(), present.tolist(), strict=True)]
    )


def upright(model, q, present=LEVEL):
    """Return the snapshot with all rotors upright, and (φ̂, θ̂)."""
    nominal = nominal_vectoring(model.snapshot(q, np.eye(3), LEVEL).R_bl, present)
    return model.snapshot(q, np.eye(3), nominal), nominal


def pitched(inner_deg, outer_deg):
    return np.tile(np.radians([0.0, inner_deg, 0.0, outer_deg]), 4)


def ticks(model, q, lock, restricted, count):
    """Return the lock after `count` ticks at one configuration."""
    snapshot, nominal = upright(model, q)
    for _ in range(count):
        lock = update_lock(lock, restricted, nominal, snapshot, lock.phi, config=CONFIG)
    return lock


def in_one_plane(phi, other):
    """Compute the angle between the planes that θ sweeps at two values of φ."""
    return np.abs((phi - other + math.pi / 2) % math.pi - math.pi / 2)


def test_forces_are_recovered_from_their_angles():
    rng = np.random.default_rng(1)
    for _ in range(50):
        forces = rng.normal(size=(8, 3)) * 20.0
        present = rng.uniform(-10.0, 10.0, (8, 2))
        angles = force_to_vectoring(forces, present)
        close(vectoring_to_force(np.linalg.norm(forces, axis=1), angles), forces, atol=1e-11)


def test_angles_survive_the_way_over_a_force_and_back():
    rng = np.random.default_rng(2)
    angles = rng.uniform(-10.0, 10.0, (200, 8, 2))
    for present in angles:
        # φ is undefined for forces along the rod: stay 0.05 rad away from it.
        present[:, 1] += np.where(np.abs(np.cos(present[:, 1])) < 0.05, 0.1, 0.0)
        close(force_to_vectoring(vectoring_to_force(np.full(8, 19.6), present), present), present, atol=1e-9)


def test_of_all_equal_solutions_the_one_nearest_to_the_present_angles_is_returned():
    rng = np.random.default_rng(3)
    for _ in range(20):
        force, present = 20.0 * rng.normal(size=3), rng.uniform(-7.0, 7.0, 2)
        phi, theta = force_to_angles(force.tolist(), *present.tolist())
        solutions = [
            (phi + math.pi * k, (math.pi - theta if k % 2 else theta) + 2 * math.pi * n)
            for k, n in itertools.product(range(-3, 4), repeat=2)
        ]
        for solution in solutions:
            close(direction(*solution), force / np.linalg.norm(force), atol=1e-11)
        nearest = min(solutions, key=lambda s: (round(abs(s[0] - present[0]), 9), abs(s[1] - present[1])))
        close((phi, theta), nearest, atol=1e-9)


def test_a_rotor_follows_its_link_through_the_vertical_without_a_flip():
    """Outer link of form 3: from 80° to 135° of pitch the upright thrust goes to θ = −135° at φ = 0."""
    angles = np.tile(np.radians([0.0, -80.0]), (8, 1))
    for pitch in np.radians(np.linspace(80.0, 135.0, 111)):
        forces = np.tile(20.0 * exp(np.array([0.0, pitch, 0.0])).T[:, 2], (8, 1))
        after = force_to_vectoring(forces, angles)
        assert np.abs(after[:, 1] - angles[:, 1]).max() < math.radians(0.6)
        close(after[:, 0], 0.0)
        angles = after
    close(angles[:, 1], math.radians(-135.0))


def test_angles_stay_where_a_force_is_too_small_to_have_a_direction():
    tiny, present = (0.1, -0.2, 0.3), (2.5, -4.0)
    assert force_to_angles(tiny, *present) == present
    assert force_to_angles(tiny, *present, 1.25) == (1.25, -4.0)
    assert force_to_angles(tiny, *present, min_force=0.0) != present


@pytest.mark.parametrize("held", [-2.0, 0.0, 0.4, 3.0])
def test_a_held_phi_points_at_the_forces_projection_on_its_plane(held):
    rng = np.random.default_rng(4)
    normal = np.array([0.0, math.cos(held), math.sin(held)])
    for _ in range(20):
        force, theta0 = 20.0 * rng.normal(size=3), rng.uniform(-8.0, 8.0)
        phi, theta = force_to_angles(force.tolist(), rng.uniform(-3.0, 3.0), theta0, held)
        assert phi == held
        u = direction(phi, theta)
        projection = force - normal * (normal @ force)
        close(u @ normal, 0.0)
        close(u * np.linalg.norm(projection), projection, atol=1e-11)
        assert abs(theta - theta0) <= math.pi + 1e-12


def test_force_points_along_the_z_axis_of_the_thrust_frame(model):
    rng = np.random.default_rng(5)
    for _ in range(10):
        q, vectoring = rng.uniform(-1.5, 1.5, 16), rng.uniform(-4.0, 4.0, (8, 2))
        thrust = rng.uniform(1.0, 40.0, 8)
        R_bl = model.snapshot(q, np.eye(3), vectoring).R_bl
        axes_l = np.einsum("ikl,ik->il", R_bl, rotors(model, q, vectoring)[1][:, :, 2])
        close(vectoring_to_force(thrust, vectoring), thrust[:, None] * axes_l, atol=1e-9)


def test_wrench_times_twist_is_the_power_of_the_rotor_forces():
    rng = np.random.default_rng(6)
    for _ in range(20):
        R_bl = np.array([exp(v) for v in rng.normal(size=(8, 3))])
        rotor_c, forces = rng.normal(size=(8, 3)), 20.0 * rng.normal(size=(8, 3))
        v, omega = rng.normal(size=(2, 3))
        wrench = thrust_map(R_bl, rotor_c) @ forces.reshape(-1)
        power = sum((R @ f) @ (v + np.cross(omega, p)) for R, f, p in zip(R_bl, forces, rotor_c, strict=True))
        assert abs(wrench @ [*v, *omega] - power) < 1e-10


def test_columns_of_the_thrust_map_are_unit_forces_and_their_lever_arms(model):
    snapshot, _ = upright(model, np.random.default_rng(7).uniform(-1.0, 1.0, 16))
    Q = thrust_map(snapshot.R_bl, snapshot.rotor_c)
    for i in range(8):
        for k in range(3):
            axis = snapshot.R_bl[i][:, k]
            close(Q[:, 3 * i + k], [*axis, *np.cross(snapshot.rotor_c[i], axis)])


def test_nominal_angles_point_every_rotor_up_on_the_present_branch(model):
    rng = np.random.default_rng(8)
    for _ in range(20):
        R_bl = model.snapshot(rng.uniform(-1.2, 1.2, 16), np.eye(3), LEVEL).R_bl
        present = rng.uniform(-6.0, 6.0, (8, 2))
        nominal = nominal_vectoring(R_bl, present)
        up = np.einsum("ikl,il->ik", R_bl, vectoring_to_force(np.ones(8), nominal))
        close(up, np.tile([0.0, 0.0, 1.0], (8, 1)))
        assert np.abs(nominal[:, 0] - present[:, 0]).max() <= math.pi / 2 + 1e-12
        close(nominal_vectoring(R_bl, nominal), nominal, atol=1e-9)


def test_upright_rotors_of_a_pitched_leg_tilt_back_by_the_pitch(model):
    _, nominal = upright(model, pitched(45.0, 30.0))
    close(nominal, np.radians(np.tile([[0.0, -45.0], [0.0, -75.0]], (4, 1))))


def test_lock_enters_near_the_vertical_and_leaves_farther_away(model):
    lean = {True: (0.34, 0.31, 0.29), False: (0.31, 0.34, 0.36)}
    lock = FREE
    for coming in (True, False):
        seen = []
        for angle in lean[coming]:
            lock = ticks(model, pitched(90.0 - math.degrees(angle), 0.0), lock, NONE, 1)
            seen.append(bool(lock.vertical[0]))
            assert np.all(lock.active | ~lock.vertical)
        assert seen == ([False, False, True] if coming else [True, True, False])


def test_a_rotor_far_from_the_vertical_and_free_of_interference_is_never_held(model):
    lock = FREE
    for inner in np.linspace(0.0, 60.0, 30):
        lock = ticks(model, pitched(inner, 0.0), lock, NONE, 1)
        assert not lock.active.any()


def test_held_phi_never_jumps_on_a_random_walk(model):
    rng = np.random.default_rng(9)
    lock, angles, q = FREE, LEVEL, FORMS["form2"].copy()
    for _ in range(300):
        q = np.clip(q + rng.uniform(-0.05, 0.05, 16), -1.5, 1.5)
        snapshot, nominal = upright(model, q, angles)
        now = update_lock(lock, rng.random(8) < 0.5, nominal, snapshot, lock.phi, config=CONFIG)
        assert np.abs(now.phi - lock.phi).max() <= CONFIG.slew + 1e-12
        lock, angles = now, nominal
    assert lock.active.any()


def test_a_rotor_taken_over_starts_from_the_commanded_phi(model):
    snapshot, nominal = upright(model, FORMS["form1"])
    command = np.linspace(-1.2, 1.2, 8)
    lock = update_lock(FREE, ALL, nominal, snapshot, command, config=CONFIG)
    close(np.abs(lock.phi), np.maximum(np.abs(command) - CONFIG.slew, 0.0))


def test_restricted_rotors_end_in_the_nominal_plane(model):
    snapshot, nominal = upright(model, np.random.default_rng(10).uniform(-0.8, 0.8, 16))
    start = np.random.default_rng(11).uniform(-4.0, 4.0, 8)
    lock = Lock(vertical=NONE, active=ALL, phi=start)
    for _ in range(40):  # a quarter turn at 0.04 rad a tick
        lock = update_lock(lock, ALL, nominal, snapshot, lock.phi, config=CONFIG)
    close(in_one_plane(lock.phi, nominal[:, 0]), 0.0)
    assert np.abs(lock.phi - start).max() <= math.pi / 2 + 1e-12
    up_l = snapshot.R_bl[:, 2]
    for phi, up in zip(lock.phi, up_l, strict=True):
        close(direction(*force_to_angles(up.tolist(), 0.0, 0.0, phi, min_force=0.0)), up)


def test_a_rotor_is_released_only_when_the_servo_can_turn_the_rest_in_one_tick(model):
    snapshot, nominal = upright(model, FORMS["form1"])
    lock = Lock(vertical=NONE, active=ALL, phi=np.linspace(0.1, 1.5, 8))
    assert CONFIG.release <= ROBOT.max_vectoring_speed / 40.0
    for _ in range(60):
        before = in_one_plane(lock.phi, nominal[:, 0])
        now = update_lock(lock, NONE, nominal, snapshot, lock.phi, config=CONFIG)
        released = lock.active & ~now.active
        assert np.all(before[released] <= CONFIG.release)
        assert np.all(now.active[before > CONFIG.release])
        np.testing.assert_array_equal(now.phi[released], lock.phi[released])
        lock = now
    assert not lock.active.any()


def test_a_lock_that_has_settled_moves_nothing(model):
    lock = ticks(model, FORMS["form2"], FREE, NONE, 100)
    after = ticks(model, FORMS["form2"], lock, NONE, 1)
    np.testing.assert_array_equal(lock.active, OUTER)
    close(after.phi, lock.phi)


def outer_pushes(snapshot, phi):
    """Horizontal directions of the outer rotors' forces at φ, and the directions in which they make yaw torque."""
    along = np.stack([np.zeros(8), -np.sin(phi), np.cos(phi)], axis=1)
    pushes = np.einsum("ikl,il->ik", snapshot.R_bl, along)[OUTER]
    return pushes, np.cross([0.0, 0.0, 1.0], snapshot.rotor_c[OUTER])


@pytest.mark.parametrize("start", [0.0, -0.7, 0.7, 1.5, 3.0])
def test_a_plane_locked_at_a_vertical_link_is_turned_off_the_radius(model, start):
    lock = ticks(model, FORMS["form2"], replace(FREE, active=ALL, phi=np.full(8, start)), NONE, 100)
    snapshot, _ = upright(model, FORMS["form2"])
    pushes, tangents = outer_pushes(snapshot, lock.phi)
    share = np.abs((pushes * tangents).sum(1)) / np.linalg.norm(tangents, axis=1)
    assert share.min() > math.sin(CONFIG.most) - 1e-9
    assert CONFIG.most > 0.3


@pytest.mark.parametrize("restricted", [NONE, ~OUTER], ids=["free", "inner restricted"])
def test_legs_are_locked_as_mirror_images_on_the_way_through_the_papers_forms(model, restricted):
    """So tilting all four outer rotors outwards or inwards makes no yaw torque."""
    lock, angles = FREE, LEVEL
    for name, target in itertools.pairwise(("form1", "form2", "form3")):
        for share in np.linspace(0.0, 1.0, 150):
            q = (1.0 - share) * FORMS[name] + share * FORMS[target]
            snapshot, angles = upright(model, q, angles)
            lock = update_lock(lock, restricted, angles, snapshot, lock.phi, config=CONFIG)
            # The tangents are relative to the CoG, which the computer shifts off the torso's axis.
            radius = np.hypot(*snapshot.rotor_c[:, :2].T).min()
            uneven = 2.0 * math.asin(math.hypot(*snapshot.com_b[:2]) / radius)
            legs = lock.phi.reshape(4, 2)
            close(legs[2:], legs[:2], atol=uneven)
            close(legs[1], -legs[0], atol=uneven)
            assert np.all(lock.active.reshape(4, 2) == lock.active[:2])
            pushes, tangents = outer_pushes(snapshot, lock.phi)
            assert abs((pushes * tangents).sum()) < 4 * uneven


def test_yaw_torque_remains_with_the_inner_rotors_restricted_and_the_outer_links_vertical(model):
    """Every force is confined to its held plane; the remaining wrenches still span all six directions."""
    lock = ticks(model, FORMS["form2"], FREE, ~OUTER, 100)
    assert lock.active.all()
    snapshot, _ = upright(model, FORMS["form2"])
    Q = thrust_map(snapshot.R_bl, snapshot.rotor_c)
    planes = [np.array([[1.0, 0.0, 0.0], [0.0, -math.sin(phi), math.cos(phi)]]).T for phi in lock.phi]
    left = np.hstack([Q[:, 3 * i : 3 * i + 3] @ plane for i, plane in enumerate(planes)])
    # A newton, spread over the four outer rotors at 0.69 m, makes at least that much yaw torque.
    assert np.linalg.svd(left)[1][-1] > 0.99 * 2.0 * 0.69 * math.sin(CONFIG.most)
