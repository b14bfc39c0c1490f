"""Pins non-nominal masses, centres of mass, inertia and friction by sums over the bodies and by sliding."""

import math

import mujoco
import numpy as np
import pytest

from spidar_gym.errors import InvalidValueError
from spidar_gym.native.plant import Plant
from spidar_gym.robot import JOINT_NAMES, ROBOT
from spidar_gym.robot.description import mjcf_path
from spidar_gym.sim.air import AeroConfig
from spidar_gym.sim.body import BodyConfig
from spidar_gym.sim.config import PlantConfig
from spidar_gym.sim.scene import scene
from spidar_gym.so3 import exp, matrix_to_quat
from spidar_gym.state import Command

VACUUM = AeroConfig(wake=False)
FACTORS = np.linspace(0.9, 1.1, 8)
FLAT = np.zeros(16)
ON_TIPTOE = np.tile([0.0, 0.0, 0.0, math.pi / 2], 4)
"""Outer links vertical: only the feet touch."""
KINDS = {"inner": ("inner_junction", "inner_link"), "outer": ("outer_junction", "outer_link")}


def command(thrust=0.0, joints=0.0, vectoring=0.0, limit=7.0) -> Command:
    """A command; a number fills all entries of its field."""
    shapes = ((8,), (8, 2), (16,), (16,))
    values = (thrust, vectoring, joints, limit)
    return Command(*(np.broadcast_to(v, s).astype(float) for v, s in zip(values, shapes, strict=True)))


def built(**body) -> Plant:
    """A plant with a body of these parameters."""
    return Plant(PlantConfig(substeps=1, aero=VACUUM, body=BodyConfig(**body)))


def posed(plant: Plant, seed: int = 0) -> Plant:
    """The plant in a random pose."""
    rng = np.random.default_rng(seed)
    quat = matrix_to_quat(exp(rng.uniform(-0.5, 0.5, 3)))
    plant.reset(np.array([0.3, -0.2, 5.0]), quat, rng.uniform(-1, 1, 16), rng.uniform(-2, 2, (8, 2)))
    return plant


def described() -> dict[str, float]:
    """Mass of every body by name, from the description."""
    masses = {"torso": ROBOT.bodies["torso"].mass}
    for i in range(1, 9):
        junction, link = KINDS["inner" if i % 2 else "outer"]
        masses[f"junction{i}"], masses[f"link{i}"] = ROBOT.bodies[junction].mass, ROBOT.bodies[link].mass
        masses[f"gimbal{i}_roll_module"] = ROBOT.bodies["roll_module"].mass
        masses[f"gimbal{i}_pitch_module"] = ROBOT.bodies["pitch_module"].mass
    return masses


def centre(plant: Plant) -> np.ndarray:
    """Centre of mass of the robot, world, from all bodies."""
    mass = plant.model.body_mass
    return (mass[:, None] * plant.data.xipos).sum(axis=0) / mass.sum()


def tensor(plant: Plant, name: str) -> np.ndarray:
    """Inertia tensor of a body about its own centre of mass, its own axes."""
    body = plant.model.body(name)
    R = np.zeros(9)
    mujoco.mju_quat2Mat(R, body.iquat)
    R = R.reshape(3, 3)
    return R @ np.diag(body.inertia) @ R.T


def mass_matrix(plant: Plant) -> np.ndarray:
    full = np.zeros((plant.model.nv, plant.model.nv))
    mujoco.mj_fullM(plant.model, plant.data, full)
    return full


@pytest.mark.parametrize(
    "name",
    ["body_mass", "body_inertia", "body_ipos", "body_iquat", "body_subtreemass", "geom_friction", "dof_invweight0",
     "body_invweight0"],
)  # fmt: skip
def test_the_nominal_body_is_the_model_of_the_description_in_every_array(name):
    plant, nominal = built(), scene(visual=False)
    np.testing.assert_allclose(getattr(plant.model, name), getattr(nominal, name), rtol=1e-12, atol=1e-15)


def test_the_nominal_bodies_have_the_masses_of_the_description():
    plant = built()
    for name, mass in described().items():
        assert abs(plant.model.body(name).mass[0] - mass) < 1e-9, name


@pytest.mark.parametrize("mass", [15.2, 16.0, 16.4, 20.0])
def test_the_robot_has_the_configured_total_mass_for_any_link_masses(mass):
    rng = np.random.default_rng(1)
    plant = built(total_mass=mass, link_mass=rng.uniform(0.9, 1.1, 8), inertia=rng.uniform(0.8, 1.2, 8))
    np.testing.assert_allclose(plant.model.body_mass.sum(), mass, rtol=1e-12)
    np.testing.assert_allclose(plant.model.body("torso").subtreemass, mass, rtol=1e-12)
    np.testing.assert_allclose(mass_matrix(posed(plant))[:3, :3], mass * np.eye(3), atol=1e-9)


def test_a_heavier_robot_alone_scales_all_masses_and_inertias_alike():
    plant, nominal = posed(built(total_mass=20.0)), posed(built())
    motors = np.diag(np.concatenate([np.zeros(6), plant.model.dof_armature[6:]]))
    np.testing.assert_allclose(mass_matrix(plant) - motors, 1.25 * (mass_matrix(nominal) - motors), atol=1e-9)
    np.testing.assert_allclose(centre(plant), centre(nominal), atol=1e-12)


def test_the_mass_factor_of_a_link_holds_for_its_junction_and_module_and_nothing_else():
    plant, masses = built(link_mass=FACTORS), described()
    torso = plant.model.body("torso").mass[0]
    for name, mass in masses.items():
        factor = 1.0 if name == "torso" else FACTORS[int("".join(c for c in name if c.isdigit())) - 1]
        np.testing.assert_allclose(plant.model.body(name).mass[0] / torso, factor * mass / masses["torso"], rtol=1e-9)


def test_a_heavier_link_keeps_its_shape():
    """Its radii of gyration: inertia over mass."""
    plant, nominal = built(link_mass=FACTORS), built()
    for name in described():
        one, other = plant.model.body(name), nominal.model.body(name)
        np.testing.assert_allclose(one.inertia / one.mass, other.inertia / other.mass, rtol=1e-9)
        np.testing.assert_allclose(one.ipos, other.ipos, rtol=0, atol=1e-15)


def test_the_centre_of_mass_of_an_uneven_robot_is_the_sum_over_its_parts():
    rng = np.random.default_rng(2)
    factors, shifts, torso = rng.uniform(0.8, 1.2, 8), rng.uniform(-0.02, 0.02, (8, 3)), np.array([0.02, -0.01, 0.015])
    plant = posed(built(total_mass=15.5, link_mass=factors, link_com=shifts, torso_com=torso))
    moment, total = np.zeros(3), 0.0
    for name, mass in described().items():
        i = 0 if name == "torso" else int("".join(c for c in name if c.isdigit()))
        kind = name.rstrip("12345678")
        if i and kind in ("junction", "link"):
            lump = ROBOT.bodies[f"{'inner' if i % 2 else 'outer'}_{kind}"]
        else:
            lump = ROBOT.bodies["torso" if i == 0 else name.partition("_")[2]]
        shift = torso if i == 0 else shifts[i - 1] if kind == "link" else np.zeros(3)
        body = plant.data.body(name)
        weight = mass * (1.0 if i == 0 else factors[i - 1])
        moment += weight * (body.xpos + body.xmat.reshape(3, 3) @ (np.array(lump.com) + shift))
        total += weight
    np.testing.assert_allclose(centre(plant), moment / total, rtol=0, atol=1e-9)
    np.testing.assert_allclose(plant.data.subtree_com[plant.model.body("torso").id], moment / total, rtol=0, atol=1e-9)


@pytest.mark.parametrize("link", [1, 4, 8])
def test_shifting_the_centre_of_one_link_moves_the_robots_by_the_links_share_of_the_mass(link):
    shift = np.zeros((8, 3))
    shift[link - 1] = (0.01, -0.02, 0.03)
    plant, nominal = posed(built(link_com=shift)), posed(built())
    R = plant.data.body(f"link{link}").xmat.reshape(3, 3)
    share = described()[f"link{link}"] / 16.0
    np.testing.assert_allclose(centre(plant) - centre(nominal), share * R @ shift[link - 1], rtol=0, atol=1e-12)


def test_the_weight_of_an_off_centre_torso_has_a_moment_about_the_origin():
    plant, nominal = built(torso_com=np.array([0.02, 0.0, 0.0])), built()
    turning = []
    for one in (plant, nominal):
        one.reset(np.array([0.0, 0.0, 5.0]))
        turning.append(one.net_wrench()[1].copy())
    weight = described()["torso"] * 9.81
    np.testing.assert_allclose(turning[0] - turning[1], [0.0, 0.02 * weight, 0.0], rtol=0, atol=1e-9)


def test_the_inertia_factor_scales_the_inertia_about_a_joint_and_no_mass():
    factors = np.linspace(0.85, 1.15, 8)
    plant, nominal = posed(built(inertia=factors)), posed(built())
    assert np.array_equal(plant.model.body_mass, nominal.model.body_mass)
    change = mass_matrix(plant) - mass_matrix(nominal)
    assert not np.abs(change[:3, :]).max() > 1e-12
    for i in (1, 4, 7):
        kind = "inner_link" if i % 2 else "outer_link"
        added = (factors[i - 1] - 1.0) * ROBOT.bodies[kind].matrix
        np.testing.assert_allclose(
            tensor(plant, f"link{i}"), factors[i - 1] * ROBOT.bodies[kind].matrix, rtol=0, atol=1e-8
        )
        if i % 2 == 0:
            # The pitch joint (y) of an outer link moves only that link and its module.
            dof = plant.model.joint(f"joint{i}_pitch").dofadr[0]
            np.testing.assert_allclose(change[dof, dof], added[1, 1], rtol=1e-6)
    for name in described():
        if not name.startswith("link"):
            np.testing.assert_allclose(tensor(plant, name), tensor(nominal, name), rtol=0, atol=1e-15)


@pytest.mark.parametrize(
    ("mass", "place"), [(0.3, (0.0, 0.0, -0.2)), (1.5, (0.1, -0.05, 0.04)), (4.0, (0.0, 0.0, 0.0))]
)
def test_a_payload_is_a_body_welded_to_the_torso(mass, place):
    """Compared with MuJoCo's model with one more body: mass matrix, bias and centre of mass in motion."""
    spec = mujoco.MjSpec.from_file(str(mjcf_path()))
    carried = spec.body("torso").add_body(pos=place, mass=mass, ipos=[0, 0, 0], inertia=[1e-12] * 3)
    carried.explicitinertial = True
    model = spec.compile()
    data = mujoco.MjData(model)
    plant = posed(built(payload_mass=mass, payload_position=np.array(place)))
    rng = np.random.default_rng(0)
    plant.data.qvel[:] = data.qvel[:] = rng.normal(0.0, 1.0, model.nv)
    data.qpos[:] = plant.data.qpos
    for one, its in ((plant.model, plant.data), (model, data)):
        mujoco.mj_forward(one, its)
    np.testing.assert_allclose(plant.data.subtree_com[1], data.subtree_com[1], rtol=0, atol=1e-12)
    full = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, full)
    np.testing.assert_allclose(mass_matrix(plant), full, rtol=0, atol=1e-9)
    np.testing.assert_allclose(plant.data.qfrc_bias, data.qfrc_bias, rtol=0, atol=1e-8)


def test_a_payload_adds_to_the_total_mass_and_is_removed_by_the_next_configuration():
    plant = built(payload_mass=2.0, payload_position=np.array([0.1, 0.0, 0.0]), total_mass=15.5)
    assert plant.model.body_mass.sum() == pytest.approx(17.5, abs=1e-9)
    nominal = built()
    plant.configure(nominal.config)
    for name in ("body_mass", "body_inertia", "body_ipos", "body_iquat", "body_subtreemass"):
        assert np.array_equal(getattr(plant.model, name), getattr(nominal.model, name)), name


@pytest.mark.parametrize("mass", [-0.1, math.nan])
def test_a_negative_payload_is_refused(mass):
    with pytest.raises(InvalidValueError, match=r"payload_mass = .*(at least 0 kg|finite)"):
        BodyConfig(payload_mass=mass)


def test_inertias_stay_those_of_real_bodies():
    """No principal moment exceeds the sum of the two others; the mass matrix is positive."""
    rng = np.random.default_rng(3)
    for seed in range(20):
        plant = built(
            total_mass=rng.uniform(15.2, 16.4), link_mass=rng.uniform(0.9, 1.1, 8), inertia=rng.uniform(0.85, 1.15, 8),
            link_com=rng.uniform(-0.01, 0.01, (8, 3)), torso_com=rng.uniform(-0.02, 0.02, 3),
        )  # fmt: skip
        moments = np.sort(plant.model.body_inertia[1:], axis=1)
        assert np.all(moments > 0.0)
        assert np.all(moments[:, 2] <= moments[:, 0] + moments[:, 1] + 1e-15)
        assert np.linalg.eigvalsh(mass_matrix(posed(plant, seed))).min() > 0.0


def test_a_second_configuration_starts_from_the_nominal_body():
    plant = built(total_mass=20.0, link_mass=FACTORS, link_com=np.full((8, 3), 0.01), inertia=FACTORS)
    plant.configure(PlantConfig(aero=VACUUM))
    for name in ("body_mass", "body_inertia", "body_ipos", "geom_friction", "body_subtreemass"):
        assert np.array_equal(getattr(plant.model, name), getattr(built().model, name)), name


def resting(pose, height, thrust, vectoring=0.0, steps=60, **body) -> tuple[Plant, Command]:
    """A robot at rest on the floor, partly carried by its rotors, and its command."""
    plant = built(**body)
    commanded = command(thrust, pose, vectoring)
    start = np.array([0.0, 0.0, height])
    plant.reset(start, joint_position=pose, vectoring=commanded.vectoring, thrust=commanded.thrust)
    for _ in range(steps):
        plant.step(commanded)
    assert plant.in_contact
    return plant, commanded


def sliding(plant: Plant, commanded: Command) -> dict[str, float]:
    """Largest ratio of friction to normal force by geom in contact, while the robot slides after a push."""
    plant.data.qvel[:2] = (0.5, 0.2)
    ratios: dict[str, float] = {}
    for _ in range(60):
        plant.step(commanded)
        force = np.zeros(6)
        for k in range(plant.data.ncon):
            mujoco.mj_contactForce(plant.model, plant.data, k, force)
            geom = plant.data.contact[k].geom[1]
            name = plant.model.geom(geom).name or plant.model.body(plant.model.geom_bodyid[geom]).name
            if force[0] > 1.0:
                ratios[name] = max(ratios.get(name, 0.0), math.hypot(force[1], force[2]) / force[0])
    return ratios


@pytest.mark.parametrize("mu", [0.5, 0.8, 1.2])
def test_a_sliding_foot_is_held_by_its_friction_times_the_normal_force(mu):
    plant, commanded = resting(ON_TIPTOE, 0.56, 15.0, foot_friction=mu, peg_friction=0.25)
    ratios = sliding(plant, commanded)
    assert set(ratios) == {f"foot{leg}" for leg in range(1, 5)}
    assert max(ratios.values()) <= mu * (1.0 + 1e-6)
    if mu < 1.0:
        assert max(ratios.values()) > 0.98 * mu


@pytest.mark.parametrize("mu", [0.2, 0.6, 0.8])
def test_sliding_pegs_are_held_by_their_own_friction(mu):
    plant, commanded = resting(FLAT, 0.149, 12.0, foot_friction=1.2, peg_friction=mu)
    ratios = sliding(plant, commanded)
    assert ratios
    assert set(ratios) <= {f"peg{i}" for i in range(1, 9)}
    np.testing.assert_allclose(max(ratios.values()), mu, rtol=0.02)


@pytest.mark.parametrize("mu", [0.2, 0.6])
def test_sliding_ducts_are_held_by_the_friction_of_pegs_ducts_and_torso(mu):
    sideways = np.array([math.pi / 2, 0.0])
    plant, commanded = resting(FLAT, 0.23, 1.0, sideways, 200, foot_friction=1.2, peg_friction=mu)
    ratios = sliding(plant, commanded)
    assert any("module" in name for name in ratios)
    assert max(ratio for name, ratio in ratios.items() if "module" in name) <= mu * (1.0 + 1e-6)


@pytest.mark.parametrize("value", [0.0, -1.0, math.nan, math.inf])
@pytest.mark.parametrize("name", ["total_mass", "foot_friction", "peg_friction"])
def test_a_body_without_mass_or_friction_is_refused(name, value):
    with pytest.raises(InvalidValueError, match=f"{name} = .*expected .*(numbers above 0|finite number)"):
        BodyConfig(**{name: value})


@pytest.mark.parametrize("value", [0.0, -1.0, math.nan, math.inf])
@pytest.mark.parametrize("name", ["link_mass", "inertia"])
def test_a_link_without_mass_or_inertia_is_refused(name, value):
    factors = np.ones(8)
    factors[3] = value
    with pytest.raises(InvalidValueError, match=f"{name} = .*expected .*(numbers above 0|finite number)"):
        BodyConfig(**{name: factors})


@pytest.mark.parametrize("value", [math.nan, math.inf])
@pytest.mark.parametrize(("name", "shape"), [("link_com", (8, 3)), ("torso_com", (3,))])
def test_a_centre_of_mass_that_is_not_finite_is_refused(name, shape, value):
    shift = np.zeros(shape)
    shift.flat[-1] = value
    with pytest.raises(InvalidValueError, match=rf"(?s){name} = .*expected"):
        BodyConfig(**{name: shift})


@pytest.mark.parametrize(
    ("name", "shape"), [("link_mass", (3,)), ("inertia", (3,)), ("link_com", (3, 3)), ("torso_com", (2,))]
)
def test_an_array_of_another_length_is_refused(name, shape):
    with pytest.raises(InvalidValueError, match=name):
        built(**{name: np.ones(shape)})


def test_the_defaults_are_read_only():
    for name in ("link_mass", "link_com", "torso_com", "inertia"):
        with pytest.raises(ValueError, match="read-only"):
            getattr(BodyConfig(), name)[0] = 0.5


def test_every_joint_still_has_the_gravity_torque_of_its_pose():
    """The servos' torques balance the gradient of the potential energy of the configured masses."""
    rng = np.random.default_rng(4)
    body = {"link_mass": FACTORS, "link_com": rng.uniform(-0.01, 0.01, (8, 3)), "total_mass": 16.3}
    plant = built(**body)
    q, level = rng.uniform(-0.5, 0.5, 16), np.array([1.0, 0.0, 0.0, 0.0])

    def energy(q):
        plant.reset(np.array([0.0, 0.0, 5.0]), level, q)
        return 16.3 * 9.81 * centre(plant)[2]

    for k in (1, 3, 6, 15):
        step = np.eye(16)[k] * 1e-5
        gradient = (energy(q + step) - energy(q - step)) / 2e-5
        energy(q)
        dof = plant.model.joint(JOINT_NAMES[k]).dofadr[0]
        np.testing.assert_allclose(plant.data.qfrc_bias[dof], gradient, rtol=0, atol=1e-5)
