"""Pins the core's paths, and its flight along them, to those in Python."""

import ctypes
from dataclasses import replace

import numpy as np
import pytest
from support.states import model, resting

from spidar_gym.control.flight.controller import FlightController
from spidar_gym.control.flight.path import Path, from_motion, legs, lemniscate, spline
from spidar_gym.control.presets import controller_config
from spidar_gym.native.core_flight import CoreFlightController
from spidar_gym.native.core_structs import core_layouts
from spidar_gym.native.library import Struct, load_core, pointer
from spidar_gym.native.structs import fill
from spidar_gym.so3 import exp, matrix_to_quat

DOUBLE, ROOM = ctypes.c_double, 256


@pytest.fixture(scope="module")
def library():
    return load_core()


def built(function, *arguments):
    """Return the knots that the core builds, and their number."""
    knots = np.zeros(ROOM, core_layouts()["knot"])
    return knots, function(*arguments, pointer(knots), ROOM)


def built_legs(library, points, speed, along, yaw, begin, room=ROOM):
    knots, so_far = np.zeros(ROOM, core_layouts()["knot"]), Struct("legs")
    numbers = DOUBLE(speed), int(along), DOUBLE(yaw), DOUBLE(begin)
    library.sp_begin_legs(pointer(points), *numbers, pointer(knots), room, so_far.pointer)
    for point in points[1:]:
        library.sp_leg_to(pointer(point), pointer(knots), room, so_far.pointer)
    return knots, int(so_far["count"])


def built_spline(library, points, speed, along, yaw, begin):
    knots = np.zeros(ROOM, core_layouts()["knot"])
    knots["pose_w"][: len(points), :3] = points
    knots["rate_w"] = 7.0  # must be overwritten
    library.sp_path_spline(pointer(knots), len(points), DOUBLE(speed), int(along), DOUBLE(yaw), DOUBLE(begin))
    return knots, len(points)


def close(path: Path, knots: np.ndarray, count: int) -> None:
    assert count == len(path.times) <= ROOM
    np.testing.assert_allclose(knots["time"][:count], path.times, rtol=0, atol=1e-11)
    for name in ("pose_w", "rate_w", "acceleration_w"):
        np.testing.assert_allclose(knots[name][:count], getattr(path, name), rtol=0, atol=1e-11)


def random_points(rng):
    return rng.uniform(-2.0, 2.0, (int(rng.integers(2, 9)), 3))


@pytest.mark.parametrize("along", [False, True])
@pytest.mark.parametrize("seed", range(8))
def test_the_core_builds_the_same_paths(library, seed, along):
    rng = np.random.default_rng(seed)
    points, speed, yaw, begin = random_points(rng), rng.uniform(0.2, 2.0), rng.uniform(-3.0, 3.0), rng.uniform(0.0, 2.0)
    rows = [tuple(point) for point in points.tolist()]
    options = {"along": along, "yaw": yaw, "begin": begin}
    close(legs(rows, speed, **options), *built_legs(library, points, speed, along, yaw, begin))
    close(spline(rows, speed, **options), *built_spline(library, points, speed, along, yaw, begin))
    place, width, seconds = rng.normal(size=3), rng.uniform(0.5, 3.0), rng.uniform(6.0, 30.0)
    path = lemniscate(width, speed, seconds, position_w=place, direction=yaw, along=along, begin=begin)
    numbers = DOUBLE(width), DOUBLE(speed), DOUBLE(seconds), pointer(place), DOUBLE(yaw), int(along), DOUBLE(begin)
    close(path, *built(library.sp_path_lemniscate, *numbers))


def test_knots_beyond_the_array_are_counted_and_not_written(library):
    points = random_points(np.random.default_rng(3))
    whole, count = built_legs(library, points, 1.0, True, 0.0, 0.0)
    for room in range(count + 2):
        some, counted = built_legs(library, points, 1.0, True, 0.0, 0.0, room)
        assert counted == count
        np.testing.assert_array_equal(some[:room], whole[:room])
        assert not some[room:]["pose_w"].any() or room > count


@pytest.mark.parametrize("along", [False, True])
def test_the_core_computes_the_same_reference_at_every_time(library, along):
    path = spline([tuple(p) for p in random_points(np.random.default_rng(5))], 0.9, along=along, begin=1.0)
    knots = np.zeros(len(path.times), core_layouts()["knot"])
    knots["time"], knots["pose_w"] = path.times, path.pose_w
    knots["rate_w"], knots["acceleration_w"] = path.rate_w, path.acceleration_w
    found, wanted, q = Struct("reference"), Struct("reference"), np.linspace(-0.5, 0.5, 16)
    for time in [*np.linspace(-0.5, path.seconds + 0.5, 301), *path.times]:
        library.sp_follow_path(pointer(knots), len(knots), DOUBLE(time), found.pointer)
        fill(wanted.record, path.reference(float(time), q))
        for name in ("position_w", "quat_wb", "velocity_w", "omega_b", "acceleration_w", "alpha_b"):
            np.testing.assert_allclose(found[name], wanted[name], rtol=0, atol=1e-11)


@pytest.mark.parametrize("preset", ["paper", "tuned", "retuned"])
def test_both_controllers_command_the_same_along_a_path(preset):
    rng, config = np.random.default_rng(2), controller_config(preset)
    readable, compiled = FlightController(config, model()), CoreFlightController(config, model())
    path = lemniscate(1.0, 0.8, 20.0, position_w=np.array([0.0, 0.0, 1.0]), along=True)
    q = rng.uniform(-0.3, 0.3, 16)
    state = resting(q)
    for controller in (readable, compiled):
        controller.reset(state)
    for k in range(80):
        pose, rate, _ = path.at(4.0 + k / 40)
        R_wb = exp(np.array([0.0, 0.0, pose[3]])) @ exp(rng.normal(size=3) * 0.02)
        state = replace(
            state, time=k / 40, position_w=pose[:3] + rng.normal(size=3) * 0.02, quat_wb=matrix_to_quat(R_wb),
            velocity_w=rate[:3] + rng.normal(size=3) * 0.02, omega_b=np.array([0.0, 0.0, rate[3]]),
        )  # fmt: skip
        reference = path.reference(4.0 + k / 40, q)
        wanted, found = (controller.step(state, reference) for controller in (readable, compiled))
        np.testing.assert_allclose(found.thrust, wanted.thrust, rtol=0, atol=1e-6)
        np.testing.assert_allclose(found.vectoring, wanted.vectoring, rtol=0, atol=1e-7)
        np.testing.assert_allclose(
            compiled.last_step.wrench_desired, readable.last_step.wrench_desired, rtol=0, atol=1e-9
        )
    # The command includes the feed-forward of the reference's acceleration.
    still = readable.step(state, replace(reference, acceleration_w=np.zeros(3)))
    assert (preset != "paper") == (np.abs(still.thrust - wanted.thrust).max() > 0.05)


def test_from_motion_to_rest_the_core_builds_the_same_path(library):
    rng = np.random.default_rng(4)
    for _ in range(200):
        pose, end = rng.uniform(-2.0, 2.0, 4), rng.uniform(-5.0, 5.0, 4) * rng.choice([0.02, 1.0], 4)
        rate, acceleration = rng.uniform(-0.6, 0.6, 4), rng.uniform(-1.2, 1.2, 4) * rng.choice([0.0, 1.0])
        speed, begin, knots = rng.uniform(0.3, 1.5), Struct("knot"), np.zeros(8, core_layouts()["knot"])
        begin["pose_w"][:], begin["rate_w"][:], begin["acceleration_w"][:] = pose, rate, acceleration
        n = library.sp_path_from_motion(begin.pointer, pointer(end), DOUBLE(speed), pointer(knots))
        close(from_motion(pose, rate, acceleration, end, speed), knots, n)
