"""Pins the air on the whole robot: form 3's loss, symmetry, work, drag, wind, the floor, held forces, refusals."""

# pyright: reportAttributeAccessIssue=false

import math
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from reference import air as air_module
from reference import plant as plant_module
from reference.events import every
from support.air import HIGH, HOVER, LEVEL, LINKS, NONE, RADIUS, STILL, TORSO, evaluate, posed, world
from support.states import upright

from spidar_gym.errors import InvalidValueError
from spidar_gym.native.formulas import AirForces
from spidar_gym.robot import FORMS, ROBOT
from spidar_gym.sim.air import AIR_DENSITY, N_DUCTS, AeroConfig
from spidar_gym.so3 import exp, rotation_z
from spidar_gym.state import Command

INNER = np.arange(8) % 2 == 0
"""Rotors of the inner links, the upper ones in form 3."""


def form(name, R_wb=LEVEL, **changes) -> mujoco.MjData:
    """Simulation data of one of the paper's forms with upright rotors."""
    return posed(FORMS[name], upright(FORMS[name], R_wb), R_wb, **changes)


def tossed(rng, **changes) -> mujoco.MjData:
    """Simulation data of a random pose and attitude, with all bodies in motion."""
    velocity = np.concatenate([rng.normal(0, 3, 3), rng.normal(0, 1, world().nv - 3)])
    kinds = {"R_wb": exp(rng.normal(0, 1, 3)), "velocity": velocity} | changes
    return posed(rng.uniform(-1.5, 1.5, 16), rng.uniform(-3, 3, (8, 2)), **kinds)


def by_module(air: AirForces) -> np.ndarray:
    """Thrust factor of each module."""
    return air.thrust_factor.reshape(8, 2).mean(axis=1)


def test_form_3_upright_loses_8_to_14_percent_of_the_weight_in_its_own_wake():
    air = evaluate(form("form3"))
    assert 0.08 < -air.generalized[2] / ROBOT.weight < 0.14
    factor = by_module(air)
    np.testing.assert_allclose(factor[INNER], 1.0, rtol=0, atol=1e-3)
    np.testing.assert_allclose(factor[~INNER], 0.79, rtol=0, atol=0.05)
    np.testing.assert_allclose(air.generalized[[0, 1, 3, 4, 5]], 0.0, rtol=0, atol=1e-9)


def test_stacking_costs_the_lower_modules_of_form_3_their_share_and_no_module_of_form_1():
    vectoring = upright(FORMS["form3"], LEVEL)
    vectoring[INNER, 1] = -0.40
    data = posed(FORMS["form3"], vectoring)
    ratio = by_module(evaluate(data, stacking_loss=0.1)) / by_module(evaluate(data))
    # The lower rotors are 37 mm from the vertical through the upper ones: exp(−(0.037 / 0.22)²) = 0.97.
    np.testing.assert_allclose(ratio[~INNER], 1.0 - 0.1 * 0.97, rtol=0, atol=0.002)
    np.testing.assert_allclose(ratio[INNER], 1.0, rtol=0, atol=0.005)
    flat = [by_module(evaluate(form("form1"), stacking_loss=loss)) for loss in (0.0, 0.2)]
    np.testing.assert_allclose(flat[1], flat[0], rtol=0, atol=0.005)
    # The jets alone lose less than 1 % with the literature's shortest core and θ 0.06 rad off.
    vectoring[INNER, 1] = -0.46
    assert -evaluate(posed(FORMS["form3"], vectoring), core_length=3.25).generalized[2] < 0.01 * ROBOT.weight
    with pytest.raises(InvalidValueError, match="stacking_loss"):
        AeroConfig(stacking_loss=1.1)


def test_form_3_loses_less_than_a_hundredth_of_its_lift_once_the_upper_jets_point_past_the_lower_rotors():
    vectoring = upright(FORMS["form3"], LEVEL)
    vectoring[INNER, 1] = -0.40
    air = evaluate(posed(FORMS["form3"], vectoring))
    lift = ROBOT.hover_thrust * (4.0 + 4.0 * math.cos(vectoring[0, 1] - upright(FORMS["form3"], LEVEL)[0, 1]))
    assert 0.0 < -air.generalized[2] < 0.01 * lift
    assert by_module(air).min() > 0.99


def test_form_1_loses_nothing_in_its_own_wake():
    air = evaluate(form("form1"))
    assert abs(air.generalized[2]) < 1e-3 * ROBOT.weight
    np.testing.assert_allclose(air.thrust_factor, 1.0, rtol=0, atol=1e-3)


@pytest.mark.parametrize(("name", "worse"), [("zero_thrust_speed", 2.1), ("duct_drag_area", 4e-3)])
def test_form_3_loses_more_with_a_softer_rotor_or_more_drag(name, worse):
    assert evaluate(form("form3"), **{name: worse}).generalized[2] < evaluate(form("form3")).generalized[2] - 0.5


def test_turning_the_robot_about_the_vertical_turns_the_forces():
    rng = np.random.default_rng(0)
    for angle in (0.5 * math.pi, 1.0, -2.5):
        turn, state = rotation_z(angle), rng.bit_generator.state
        here = tossed(rng)
        R_wb, velocity = here.xmat[world().body("torso").id].reshape(3, 3), here.qvel.copy()
        velocity[:3] = turn @ velocity[:3]
        rng.bit_generator.state = state
        there = tossed(rng, R_wb=turn @ R_wb, velocity=velocity)
        ours = evaluate(here, wind=(2.0, 1.0, -0.5))
        theirs = evaluate(there, wind=turn @ (2.0, 1.0, -0.5))
        np.testing.assert_allclose(theirs.forces_w, ours.forces_w @ turn.T, rtol=0, atol=1e-9)
        np.testing.assert_allclose(theirs.thrust_factor, ours.thrust_factor, rtol=0, atol=1e-12)
        np.testing.assert_allclose(theirs.generalized[3:], ours.generalized[3:], rtol=0, atol=1e-9)


def test_turning_the_robot_by_a_leg_moves_the_forces_on_by_a_leg():
    rng, quarter = np.random.default_rng(1), rotation_z(0.5 * math.pi)
    for k in range(6):
        q, vectoring, thrust = rng.uniform(-1, 1.5, 16), rng.uniform(-1, 1, (8, 2)), rng.uniform(5, 40, 8)
        position = HIGH if k else np.array([0.0, 0.0, 0.3])
        here = evaluate(posed(q, vectoring, position=position), thrust, (3.0, 0.0, 1.0))
        turned = posed(np.roll(q, 4), np.roll(vectoring, 2, axis=0), position=position)
        there = evaluate(turned, np.roll(thrust, 2), quarter @ (3.0, 0.0, 1.0))
        expected = here.forces_w @ quarter.T
        np.testing.assert_allclose(there.forces_w[:N_DUCTS], np.roll(expected[:N_DUCTS], 4, axis=0), rtol=0, atol=1e-9)
        np.testing.assert_allclose(there.forces_w[LINKS], np.roll(expected[LINKS], 6, axis=0), rtol=0, atol=1e-9)
        centre, rim = there.forces_w[TORSO][0], there.forces_w[TORSO][1:]
        np.testing.assert_allclose(centre, expected[TORSO][0], rtol=0, atol=1e-9)
        np.testing.assert_allclose(rim, np.roll(expected[TORSO][1:], 1, axis=0), rtol=0, atol=1e-9)
        np.testing.assert_allclose(there.generalized[:3], quarter @ here.generalized[:3], rtol=0, atol=1e-9)


def test_the_generalized_force_is_that_of_every_force_at_its_point_on_its_body():
    rng, model = np.random.default_rng(2), world()
    bodies = air_module.Aero(model, mujoco.MjData(model))._body
    for _ in range(5):
        data = tossed(rng)
        air = evaluate(data, rng.uniform(0, 40, 8), rng.normal(0, 3, 3), rng.normal(0, 1, 8), rng.normal(0, 20, 3))
        total = np.zeros(model.nv)
        for force, point, body in zip(air.forces_w, air.points_w, bodies, strict=True):
            mujoco.mj_applyFT(model, data, force, np.zeros(3), point, int(body), total)
        assert np.abs(total).max() > 10.0
        np.testing.assert_allclose(air.generalized, total, rtol=0, atol=1e-9)


def test_the_stations_are_on_ducts_links_and_torso():
    data = tossed(np.random.default_rng(3))
    points = evaluate(data).points_w
    for i in range(8):
        R, origin = (getattr(data.body(f"gimbal{i + 1}_pitch_module"), name) for name in ("xmat", "xpos"))
        left = R.reshape(3, 3)[:, 1] * ROBOT.duct_offset_y
        np.testing.assert_allclose(points[2 * i : 2 * i + 2], [origin + left, origin - left], rtol=0, atol=1e-12)
        R, origin = (getattr(data.body(f"link{i + 1}"), name) for name in ("xmat", "xpos"))
        local = (points[LINKS][3 * i : 3 * i + 3] - origin) @ R.reshape(3, 3)
        np.testing.assert_allclose(local[:, 1:], 0.0, rtol=0, atol=1e-12)
        assert np.all((local[:, 0] > 0.0) & (local[:, 0] < ROBOT.pitch_to_yaw))
    np.testing.assert_allclose(points[TORSO].mean(axis=0), data.body("torso").xpos, rtol=0, atol=1e-12)


def test_the_power_of_the_generalized_force_is_that_of_the_forces_at_their_moving_points():
    rng, model, h = np.random.default_rng(4), world(), 1e-6
    for _ in range(4):
        data = tossed(rng)
        air = evaluate(data, rng.uniform(0, 40, 8), rng.normal(0, 3, 3))
        ends = []
        for sign in (-1.0, 1.0):
            moved = mujoco.MjData(model)
            moved.qpos[:] = data.qpos
            mujoco.mj_integratePos(model, moved.qpos, data.qvel, sign * h)
            mujoco.mj_forward(model, moved)
            ends.append(evaluate(moved).points_w)
        power = (air.forces_w * (ends[1] - ends[0]) / (2 * h)).sum()
        assert abs(power) > 1.0
        np.testing.assert_allclose(air.generalized @ data.qvel, power, rtol=1e-6)


def test_a_push_acts_at_the_torso_and_noise_along_the_thrust():
    calm = evaluate(form("form3")).generalized
    pushed = evaluate(form("form3"), push=(3.0, -20.0, 5.0)).generalized
    np.testing.assert_allclose((pushed - calm)[:6], [3.0, -20.0, 5.0, 0.0, 0.0, 0.0], rtol=0, atol=1e-9)
    noise = np.random.default_rng(5).normal(0, 1, 8)
    noisy = evaluate(form("form3"), noise=noise).generalized
    np.testing.assert_allclose((noisy - calm)[:3], [0.0, 0.0, noise.sum()], rtol=0, atol=1e-9)


@pytest.mark.parametrize("wake", [True, False])
def test_the_robot_in_motion_and_the_robot_in_an_opposite_wind_have_the_same_forces(wake):
    """Without a wake, the air acts only where there is wind, so the wind is never zero in that case."""
    rng = np.random.default_rng(6)
    for _ in range(4):
        state, wind = rng.bit_generator.state, rng.normal(0, 4, 3)
        results = []
        for share in (0.0, 0.4, 1.0 if wake else 0.9):
            rng.bit_generator.state = state
            data = tossed(rng)
            data.qvel[:3] -= share * wind
            mujoco.mj_forward(world(), data)
            results.append(evaluate(data, wind=(1.0 - share) * wind, wake=wake))
        for other in results[1:]:
            np.testing.assert_allclose(other.forces_w, results[0].forces_w, rtol=0, atol=1e-9)
            np.testing.assert_allclose(other.generalized, results[0].generalized, rtol=0, atol=1e-9)
        assert np.abs(results[0].generalized).max() > 1.0


def test_without_wake_and_wind_there_is_no_air():
    rng = np.random.default_rng(7)
    for position in (HIGH, np.array([0.0, 0.0, 0.25])):
        air = evaluate(tossed(rng, position=position), wake=False)
        np.testing.assert_allclose(air.generalized, 0.0, rtol=0, atol=1e-12)
        np.testing.assert_allclose(air.thrust_factor, 1.0, rtol=0, atol=1e-12)


def test_wind_without_a_wake_is_the_same_in_form_3_as_if_the_jets_met_nothing():
    wind = (4.0, 0.0, 0.0)
    air = evaluate(form("form3"), wind=wind, wake=False)
    np.testing.assert_allclose(air.thrust_factor, 1.0, rtol=0, atol=1e-9)
    assert abs(air.generalized[2]) < 1e-9
    assert air.generalized[0] > 20.0


def test_without_thrust_the_air_takes_energy_from_any_motion():
    rng = np.random.default_rng(8)
    for _ in range(30):
        data = tossed(rng)
        assert evaluate(data, NONE).generalized @ data.qvel < -1.0


def test_without_thrust_drag_opposes_the_flight_and_grows_with_the_square_of_its_speed():
    rng = np.random.default_rng(9)
    for _ in range(10):
        direction = rng.normal(0, 1, 3)
        direction /= np.linalg.norm(direction)
        slow, fast = (evaluate(form("form1", velocity=v * direction), NONE).generalized[:3] for v in (10.0, 20.0))
        assert slow @ direction < -5.0
        assert 3.5 < (fast @ direction) / (slow @ direction) < 4.01


@pytest.mark.parametrize("direction", [0.0, 0.7, 2.0])
def test_ducts_at_hover_thrust_resist_sideways_flight_by_6_newton_per_metre_a_second(direction):
    """ρ A w V: each duct ingests air at rest and accelerates it along its axis."""
    velocity = 0.01 * np.array([math.cos(direction), math.sin(direction), 0.0])
    air = evaluate(form("form1", velocity=velocity))
    assert abs(air.generalized[:3] @ velocity / 1e-4 + 6.24) < 0.05
    np.testing.assert_allclose(air.forces_w[:N_DUCTS], np.tile(-0.39 * velocity, (N_DUCTS, 1)), rtol=0, atol=1e-4)
    gale = evaluate(form("form1"), wind=-500.0 * velocity)
    assert 0.18 < np.linalg.norm(gale.generalized[:3]) / ROBOT.weight < 0.25


def test_a_climb_reduces_thrust_and_a_descent_increases_it():
    up, down = (evaluate(form("form1", velocity=(0.0, 0.0, v))).thrust_factor for v in (3.0, -3.0))
    assert np.all(up < 0.99)
    assert np.all(down > 1.01)


def test_the_force_on_a_rod_has_no_axial_component():
    data = tossed(np.random.default_rng(10))
    forces = evaluate(data, wind=(7.0, -3.0, 2.0)).forces_w[LINKS]
    assert np.linalg.norm(forces, axis=1).max() > 0.1
    for i in range(8):
        axis = data.body(f"link{i + 1}").xmat.reshape(3, 3)[:, 0]
        np.testing.assert_allclose(forces[3 * i : 3 * i + 3] @ axis, 0.0, rtol=0, atol=1e-12)


def test_flow_along_a_rod_does_not_add_to_the_drag_of_the_flow_across_it():
    data = posed(np.zeros(16), np.zeros(16))
    for i in range(8):
        axis = data.body(f"link{i + 1}").xmat.reshape(3, 3)[:, 0]
        across = np.cross(axis, (0.2, -0.3, 1.0)) * 5.0
        here, there = (
            evaluate(data, NONE, across + along * axis).forces_w[LINKS][3 * i : 3 * i + 3] for along in (0, 9)
        )
        assert np.linalg.norm(here, axis=1).min() > 0.1
        np.testing.assert_allclose(there, here, rtol=0, atol=1e-9)


def test_links_and_torso_have_the_drag_of_cylinders_and_a_disc_of_their_size():
    """½ ρ C_d A V² with C_d of 1 … 1.2; a link is a rod of half a metre with a battery 7 cm wide."""
    forces = evaluate(form("form1"), NONE, (0.0, 0.0, 10.0)).forces_w
    pressure = 0.5 * AIR_DENSITY * 10.0**2
    for i in range(8):
        assert 1.5 < forces[LINKS][3 * i : 3 * i + 3, 2].sum() < 2.5
    area = math.pi * ROBOT.torso_radius**2
    assert pressure * area < forces[TORSO][:, 2].sum() < 1.2 * pressure * area
    sideways = evaluate(form("form1"), NONE, (10.0, 0.0, 0.0)).forces_w[TORSO][:, 0].sum()
    edge = 2 * ROBOT.torso_radius * ROBOT.torso_height
    assert pressure * edge < sideways < 1.2 * pressure * edge


def grounded(a, height, vectoring=None):
    """Relative change of the thrust factors by ground effect `a`, in form 1 with the ducts' exits at a height [m]."""
    vectoring = np.zeros((8, 2)) if vectoring is None else vectoring
    centre = posed(np.zeros(16), vectoring, position=STILL).body("gimbal1_pitch_module").xpos[2]
    up = posed(np.zeros(16), vectoring).body("gimbal1_pitch_module").xmat[8]
    data = posed(np.zeros(16), vectoring, position=np.array([0.0, 0.0, height - centre - ROBOT.duct_z[0] * up]))
    with_floor, without = (evaluate(data, ground_effect=k).thrust_factor for k in (a, 0.0))
    return with_floor / without - 1.0


@pytest.mark.parametrize("a", [-1.0, 0.5, 1.0, 3.0])
def test_the_floor_acts_within_four_radii_and_with_the_sign_of_its_coefficient(a):
    heights = np.array([1.0, 1.5, 2.0, 3.0, 3.95])
    gains = np.array([grounded(a, k * RADIUS) for k in heights])
    assert np.all(gains * a > 0.0)
    np.testing.assert_allclose(gains, np.tile(gains[:, :1], N_DUCTS), rtol=1e-9)
    assert np.all(np.diff(np.abs(gains[:, 0])) < 0.0)
    for height in (4.05, 6.0, 40.0):
        assert not grounded(a, height * RADIUS).any()


def test_the_ground_effect_is_that_of_cheeseman_and_bennett():
    for height in (1.0, 1.5, 2.0, 3.0):
        found = 1.0 / (1.0 - (1.0 / (4.0 * height)) ** 2) - 1.0
        np.testing.assert_allclose(grounded(1.0, height * RADIUS), found, rtol=0.07)


def test_the_ground_effect_ends_at_a_tilt_of_60_degrees_and_uses_the_distance_along_the_jet():
    steep, flat = (np.tile([0.0, math.radians(angle)], (8, 1)) for angle in (55.0, 65.0))
    gain = grounded(1.0, 0.1, steep)
    assert np.all(gain > 0.0)
    np.testing.assert_allclose(gain.mean(), (RADIUS * math.cos(math.radians(55.0)) / 0.4) ** 2, rtol=0.3)
    assert not grounded(1.0, 0.1, flat).any()


def test_the_floor_acts_only_on_the_ducts_near_it():
    q = np.zeros(16)
    q[1] = 0.6
    data = posed(q, upright(q, LEVEL), position=np.array([0.0, 0.0, 0.5]))
    air, without = evaluate(data), evaluate(data, ground_effect=0.0)
    gain = air.thrust_factor / without.thrust_factor - 1.0
    near = air.points_w[:N_DUCTS, 2] + ROBOT.duct_z[0] < 4.0 * RADIUS
    assert 0 < near.sum() < 3
    assert np.all(gain[near] > 0.0)
    assert not gain[~near].any()


@pytest.mark.parametrize(("name", "share"), [("form1", 1.0), ("form3", 1.0), ("form3", 0.8)])
def test_holding_the_forces_for_25_milliseconds_changes_a_second_of_flight_by_5_millimetres_at_most(
    monkeypatch, name, share
):
    vectoring, thrust = upright(FORMS[name], LEVEL), share * HOVER
    command = Command(thrust, vectoring, FORMS[name], np.full(16, ROBOT.max_joint_torque))
    ends = []
    for steps in (1, 2, plant_module.AIR_STEPS):
        monkeypatch.setattr(plant_module, "AIR_STEPS", steps)
        events = (replace(e, due=every(steps)) if e.name == "air" else e for e in plant_module.EVENTS)
        monkeypatch.setattr(plant_module, "EVENTS", tuple(events))
        plant = plant_module.Plant()
        plant.reset(HIGH, joint_position=FORMS[name], vectoring=vectoring, thrust=thrust)
        for _ in range(40):
            state = plant.step(command)
        ends.append(np.concatenate([state.position_w, state.velocity_w]))
    error = np.abs(ends[2] - ends[0]).max()
    assert 0.0 < error < 0.0055
    assert abs(error / np.abs(ends[1] - ends[0]).max() - 9.0) < 0.9, "the error is of first order in the hold"


@pytest.mark.parametrize(
    ("name", "value", "expected"),
    [*(("zero_thrust_speed", v, "above 1") for v in (1.0, 0.5, -2.0, math.nan, math.inf)),
     *(("core_length", v, "above 0") for v in (0.0, -4.0, math.nan, math.inf)),
     *(("duct_drag_area", v, "at least 0") for v in (-0.001, math.nan, math.inf)),
     *(("ground_effect", v, "finite") for v in (math.nan, math.inf, -math.inf))],
)  # fmt: skip
def test_an_invalid_air_is_refused(name, value, expected):
    with pytest.raises(InvalidValueError, match=f"{name} = .*expected .*{expected}"):
        AeroConfig(**{name: value})


def test_air_without_duct_drag_or_with_suction_by_the_floor_is_valid():
    AeroConfig(zero_thrust_speed=1.01, core_length=0.1, duct_drag_area=0.0, ground_effect=-1.0)
