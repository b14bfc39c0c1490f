"""Pins payloads: merged inertia, visual geometry without contacts, and rejection of invalid payloads."""

import mujoco
import numpy as np
import pytest
from support.robots import LOADED

from spidar_gym.errors import InvalidValueError, UnknownNameError
from spidar_gym.robot import ROBOT, RobotSpec
from spidar_gym.robot.description import mjcf, urdf
from spidar_gym.robot.inertial import merge
from spidar_gym.robot.payload import Payload
from spidar_gym.so3 import quat_to_matrix


def compiled(spec):
    return mujoco.MjModel.from_xml_string(mjcf(spec))


def test_the_body_that_carries_it_has_the_mass_distribution_of_both():
    model, plain = compiled(LOADED), compiled(ROBOT)
    for payload, kind in zip(LOADED.payloads, ("torso", "outer_link"), strict=True):
        both, body = merge(ROBOT.bodies[kind], payload.inertial), model.body(payload.body)
        R = quat_to_matrix(body.iquat)
        assert float(body.mass[0]) == pytest.approx(both.mass)
        np.testing.assert_allclose(body.ipos, both.com, atol=1e-12)
        np.testing.assert_allclose(R @ np.diag(body.inertia) @ R.T, both.matrix, atol=1e-12)
    others = [name for name in ("link1", "link2", "link6", "junction4", "gimbal4_roll_module")]
    assert [float(model.body(n).mass[0]) for n in others] == [float(plain.body(n).mass[0]) for n in others]
    assert model.body_mass.sum() == pytest.approx(LOADED.total_mass) == pytest.approx(ROBOT.total_mass + 1.0)


def test_an_even_box_has_a_boxs_inertia():
    spec = RobotSpec(payloads=(Payload("torso", 1.2, size=(0.1, 0.2, 0.3)),))
    xx, yy, zz, *products = spec.payloads[0].inertial.inertia
    np.testing.assert_allclose([xx, yy, zz], [0.1 * (0.04 + 0.09), 0.1 * (0.01 + 0.09), 0.1 * (0.01 + 0.04)])
    assert products == [0.0, 0.0, 0.0]


def test_it_is_drawn_where_it_is_and_touches_nothing():
    model, plain = compiled(LOADED), compiled(ROBOT)
    assert model.ngeom == plain.ngeom + 2
    (box,) = [g for g in range(model.ngeom) if np.allclose(model.geom_size[g], (0.06, 0.05, 0.03))]
    np.testing.assert_allclose(model.geom_pos[box], (0.02, -0.01, 0.09))
    assert model.geom_bodyid[box] == model.body("torso").id
    assert (model.geom_conaffinity[box], model.geom_contype[box]) == (0, 0)
    assert urdf(LOADED).count("payload") == 3  # the colour, and both boxes


def test_a_robot_without_one_is_written_as_before():
    assert mjcf(RobotSpec(payloads=())) == mjcf(ROBOT)


@pytest.mark.parametrize(
    ("numbers", "kind", "words"),
    [
        ({"body": "hand"}, UnknownNameError, "unknown carrier 'hand'; valid: torso, link1, link2"),
        ({"mass": 0.0}, InvalidValueError, r"payload: mass = 0.0 is not valid; expected a number above 0 \[kg\]"),
        ({"mass": float("nan")}, InvalidValueError, "payload: mass"),
        ({"position": (0.0, 0.0, float("inf"))}, InvalidValueError, "payload: position .* 3 finite numbers"),
        ({"size": (0.1, -0.1, 0.1)}, InvalidValueError, r"payload: size .* three edges above 0 \[m\]"),
        ({"inertia": (1.0, 1.0, 3.0, 0.0, 0.0, 0.0)}, InvalidValueError, "payload: inertia .* of a rigid body"),
        ({"inertia": (1.0, 1.0, -1.0, 0.0, 0.0, 0.0)}, InvalidValueError, "payload: inertia .* of a rigid body"),
    ],
)
def test_what_is_no_payload_is_refused_in_one_line(numbers, kind, words):
    with pytest.raises(kind, match=words) as refusal:
        Payload(**{"body": "torso", "mass": 1.0} | numbers)
    assert "\n" not in str(refusal.value)
