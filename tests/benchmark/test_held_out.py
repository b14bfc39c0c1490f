"""Pins the held-out conditions: their deviations beyond all tracks, their scenarios, no use in training or tuning."""

import ast
import json
import math
import subprocess
import sys
from pathlib import Path

import mujoco
import numpy as np
import pytest
from support.plants import command
from support.worlds import WORLD, pinned_world

from spidar_gym.benchmark.held_out import (
    CONDITIONS,
    COUNT,
    DELAY,
    DRAWS,
    HELD_OUT,
    LOSS,
    PAYLOAD,
    PLACE,
    SOFT,
    WIND,
    draw_held_out,
    find_condition,
    scenarios_digest,
)
from spidar_gym.benchmark.held_out_table import read_content
from spidar_gym.benchmark.scenario import load_scenarios, make_env, reset_options
from spidar_gym.benchmark.track import BOTH, GROUND, SPLITS, TRACKS
from spidar_gym.control.course.gates import parse_course
from spidar_gym.errors import InvalidValueError, UnknownNameError
from spidar_gym.native.plant import Plant
from spidar_gym.robot import GRAVITY, JOINT_NAMES, N_JOINTS, N_ROTORS, ROBOT
from spidar_gym.sim.config import PlantConfig
from spidar_gym.sim.randomize import TABLE
from spidar_gym.sim.scene import TIMESTEP
from spidar_gym.sim.worlds import find_world
from spidar_gym.tasks.start import FlightStart
from spidar_gym.tune import search

ROOT = Path(__file__).resolve().parents[2]
FLIGHTS = [name for name, condition in CONDITIONS.items() if condition.flies]
ROBOTS = [name for name, condition in CONDITIONS.items() if "plant" in condition.options]
CALIBRATED = [name for name, condition in CONDITIONS.items() if condition.calibration]
"""Conditions on robots of the calibrated world."""
BEYOND = [name for name in CALIBRATED if CONDITIONS[name].world != BOTH]
"""Those with an effect beyond its range."""
HASHES = {
    "payload-fast2": "14d8fa9ca94aff26", "payload-fast4": "413b4355b9dd8a6e", "servo-fast2": "a8dfa9c5cd51aeb7",
    "servo-fast4": "40edfba610436a42", "delay-fast2": "0fda9d0cf93bd0f8", "delay-fast4": "0760c4b3dc20555d",
    "duct-fast2": "f778c78388793df4", "duct-fast4": "cf43a3f64501c4f4", "wind-fast2": "3306d7eb5a061088",
    "wind-fast4": "aac310f4a9d7d925", "payload-crawl": "2f81cf855f0cb999", "servo-crawl": "cbb9b2f71e9d7290",
    "delay-crawl": "3ee78790d5c75577",
    "damping-calibrated": "615e4adbbe7b0644", "delay-calibrated": "fb0a2b16674c6b75",
    "eddies-calibrated": "34c78d50414f080a", "play-calibrated": "5e994bb2e3fddfbf",
    "damping-calibrated-crawl": "fbff92cc38976cde", "delay-calibrated-crawl": "14f0d2b66ccfff0f",
    "eddies-calibrated-crawl": "4947721c83ecfb88", "pegs-calibrated-crawl": "1f8eb5c23ce42da0",
    "course-calibrated": "a338c072f4fb0c64",
}  # fmt: skip
"""First 16 digits of the hash of each condition's first `COUNT` scenarios."""


def plant_of(name: str | None = None) -> Plant:
    """A condition's robot, or the described one, level and at rest in the air."""
    plant = Plant(PlantConfig() if name is None else CONDITIONS[name].options["plant"])
    plant.reset(np.array([0.0, 0.0, 2.0]), thrust=np.full(N_ROTORS, ROBOT.hover_thrust))
    return plant


def mass_matrix(plant: Plant) -> tuple[float, np.ndarray, np.ndarray]:
    """Mass [kg], centre of mass [m] and inertia about it [kg m²] of the whole robot, world axes, summed over bodies."""
    model, data = plant.model, mujoco.MjData(plant.model)
    data.qpos[:] = plant.data.qpos
    mujoco.mj_kinematics(model, data)
    total, com, inertia = model.body_mass.sum(), model.body_mass @ data.xipos / model.body_mass.sum(), np.zeros((3, 3))
    for mass, at, R, own in zip(model.body_mass, data.xipos, data.ximat, model.body_inertia, strict=True):
        R, r = R.reshape(3, 3), at - com
        inertia += R @ np.diag(own) @ R.T + mass * (r @ r * np.eye(3) - np.outer(r, r))
    return total, com, inertia


# What is wrong


def test_the_payload_is_a_point_on_the_torso_and_moves_the_centre_of_mass_as_it_should():
    described, own = plant_of(), plant_of("payload-fast2")
    added = own.model.body_mass - described.model.body_mass
    torso = mujoco.mj_name2id(own.model, mujoco.mjtObj.mjOBJ_BODY, "torso")
    assert added[torso] == pytest.approx(PAYLOAD)
    assert np.delete(added, torso) == pytest.approx(0.0, abs=1e-12)
    assert math.hypot(*PLACE) == pytest.approx(0.1)
    (mass, com, inertia), (total, moved, found) = mass_matrix(described), mass_matrix(own)
    point = np.array([0.0, 0.0, 2.0]) + PLACE
    assert total == pytest.approx(mass + PAYLOAD)
    assert moved == pytest.approx((mass * com + PAYLOAD * point) / total, abs=1e-9)
    r = point - com
    exact = inertia + PAYLOAD * mass / total * (r @ r * np.eye(3) - np.outer(r, r))
    assert np.abs(found - exact).max() < 0.004
    assert np.abs(found - exact).max() < 0.002 * np.diag(exact).min()


def test_a_flight_with_the_payload_begins_with_the_wrench_that_carries_it():
    one = draw_held_out("payload-fast2", 1)[0]
    env = make_env(CONDITIONS["payload-fast2"], one, {})
    env.reset(seed=one.seed, options=reset_options(one))
    trim = env.unwrapped.trim
    com = env.unwrapped.controller.model.snapshot(
        env.unwrapped.state.joint_position, np.eye(3), env.unwrapped.state.vectoring
    ).com_b
    weight, lever = PAYLOAD * GRAVITY, np.array(PLACE) - com
    assert np.linalg.norm(trim[:3]) == pytest.approx(weight, rel=1e-3)
    # The robot is tilted by a degree at most.
    assert trim[3:5] == pytest.approx([lever[1] * weight, -lever[0] * weight], abs=0.03)


def test_one_servo_is_half_as_stiff():
    described, own = plant_of().model.actuator_biasprm, plant_of("servo-fast2").model.actuator_biasprm
    factor = own[N_ROTORS : N_ROTORS + N_JOINTS, 1] / described[N_ROTORS : N_ROTORS + N_JOINTS, 1]
    assert described[N_ROTORS, 1] == -ROBOT.joint_kp
    assert factor[JOINT_NAMES.index(SOFT)] == 0.5
    assert np.delete(factor, JOINT_NAMES.index(SOFT)) == pytest.approx(1.0)


@pytest.mark.parametrize(("name", "delay"), [(None, 0.0), ("delay-fast2", DELAY)])
def test_a_command_takes_45_ms_to_the_actuators(name, delay):
    plant = plant_of(name)
    for _ in range(4):
        plant.step(command(ROBOT.hover_thrust))
    step, period = 4.0, 0.025
    waited = round(delay / TIMESTEP) * TIMESTEP
    assert waited == pytest.approx(delay)
    for tick in range(1, 4):
        thrust = plant.step(command(ROBOT.hover_thrust + step)).thrust - ROBOT.hover_thrust
        reached = step * (1.0 - math.exp(-max(0.0, tick * period - waited) / ROBOT.thrust_lag))
        assert thrust == pytest.approx(reached, abs=0.03 * step)
        assert (abs(thrust) < 1e-9).all() == (tick * period <= waited)


def test_one_duct_gives_15_percent_less_and_the_other_what_it_gave():
    gear = plant_of("duct-fast4").model.actuator_gear
    module, arm = gear[0], ROBOT.duct_offset_y
    assert module[2] + module[3] / arm == pytest.approx(1.0 - LOSS)  # twice the left one
    assert module[2] - module[3] / arm == pytest.approx(1.0)  # twice the right one
    assert gear[1:N_ROTORS, 2] == pytest.approx(1.0)
    assert gear[1:N_ROTORS, 3] == pytest.approx(0.0, abs=1e-12)


def test_the_wind_blows_at_4_m_per_s_and_the_integrals_begin_against_it():
    for name in ("wind-fast2", "wind-fast4"):
        for one in draw_held_out(name, 2):
            assert one.disturbances == {"wind": WIND} == {"wind": 4.0}
            assert np.abs(one.start["trim"][:2]).max() > 0.5


# Beyond the calibrated world


@pytest.mark.parametrize("name", BEYOND)
def test_one_effect_is_beyond_the_range_of_the_world_and_the_others_stay(name, tmp_path, monkeypatch):
    pinned_world(tmp_path, monkeypatch)
    condition, effect = CONDITIONS[name], name.split("-")[0]
    world, beyond = find_world.__wrapped__(WORLD), condition.robots(0).rows
    assert condition.robots(5).kind == 5 % len(world.kinds)
    before = {row.field: row for row in world.rows}
    changed = {row.field: row for row in beyond if row != before.get(row.field)}
    outside = {
        "damping": ("actuators.joint_kd",), "delay": ("actuators.delay", "actuators.thrust_lag"),
        "eddies": ("recirculation.flow_xy", "recirculation.flow_z", "recirculation.turn_xy", "recirculation.turn_z"),
        "play": ("actuators.vectoring_backlash",), "pegs": ("body.peg_friction",),
    }[effect]  # fmt: skip
    assert set(outside) <= set(changed) <= {*outside, "actuators.joint_friction", "actuators.joint_damping"}
    for field in outside:
        new, old = changed[field], before[field]
        assert new.low > old.high or new.high < old.low or new.high > 1.4 * old.high or new.high <= 0.55 < old.low
    scenario = draw_held_out.__wrapped__(name, 1)[0]
    assert scenario.start is None or "trim" not in scenario.start
    env = make_env(condition, scenario, {})
    env.reset(seed=scenario.seed, options=reset_options(scenario))
    sampled = env.sampled_parameters
    assert all(row.low <= sampled[row.field].min() <= sampled[row.field].max() <= row.high for row in beyond)
    assert condition.settle == (10.0 if condition.flies else 1.0)


def test_courses_of_calibrated_robots_have_their_ranges_on_level_floors(tmp_path, monkeypatch):
    pinned_world(tmp_path, monkeypatch)
    condition, name = CONDITIONS["course-calibrated"], "course-calibrated"
    scenario = draw_held_out.__wrapped__(name, 4)[3]
    env = make_env(condition, scenario, {})
    env.reset(seed=scenario.seed, options=reset_options(scenario))
    world, kind, sampled = find_world.__wrapped__(WORLD), condition.robots(3).kind, env.sampled_parameters
    assert kind == sampled["kind"] == 3
    for row in world.rows:
        low, high = (0.0, 0.0) if row.field == "ground.slope" else row.kinds[kind]
        assert low <= sampled[row.field].min() <= sampled[row.field].max() <= high


# Beside the tracks


def test_joint_speeds_are_those_of_no_track():
    speeds = {track.options.get("joint_speed", ROBOT.joint_speed) for track in TRACKS.values()}
    assert not speeds & {CONDITIONS[name].options["joint_speed"] for name in FLIGHTS}
    assert not [track for track in TRACKS.values() if 0.4 in track.ranges.get("joint_speed", ())]


@pytest.mark.parametrize("name", ROBOTS)
def test_every_robot_has_a_parameter_outside_the_randomised_ranges(name):
    plant, beyond = CONDITIONS[name].options["plant"], 0
    for row in TABLE:
        part, field = row.field.split(".")
        value, nominal = (np.asarray(getattr(getattr(robot, part), field)) for robot in (plant, PlantConfig()))
        if not np.array_equal(value, nominal):
            value = value / nominal if row.operation == "scale" else value - nominal * (row.operation == "add")
            beyond += bool((value < row.low).any() or (value > row.high).any())
    assert beyond


def test_no_condition_is_a_track_and_every_condition_has_a_description():
    assert not set(CONDITIONS) & set(TRACKS)
    for name, condition in CONDITIONS.items():
        assert find_condition(name) is condition
        own = (condition.env_id, condition.options)
        assert all(condition.doc != track.doc and own != (track.env_id, track.options) for track in TRACKS.values())
        if name in CALIBRATED:
            continue
        assert condition.options["sensors"] is True
        assert "plant" in condition.options or condition.disturbances["wind"][0] > TRACKS["flight-wind"].disturbances[
            "wind"
        ][1]  # fmt: skip
    assert len({condition.doc for condition in CONDITIONS.values()}) == len(CONDITIONS)


def test_neither_tuning_nor_training_imports_them():
    """Importing every module of the package that they use does not import the conditions."""
    files = [*(ROOT / "train").rglob("*.py"), *(ROOT / "spidar_gym" / "tune").rglob("*.py")]
    names = set()
    for path in files:
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and node.module:
                # `from package import module` is two names.
                names |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
            elif isinstance(node, ast.Import):
                names |= {alias.name for alias in node.names}
    own = sorted(name for name in names if name.startswith("spidar_gym.") and "plugins" not in name)
    assert len(own) > 50
    assert not [name for name in own if "held_out" in name]
    code = f"""
import importlib, importlib.util, sys
for name in {own}:
    try:
        importlib.import_module(name)
    except ModuleNotFoundError as error:
        assert "is not a package" in str(error) or name.rpartition(".")[2] in str(error), error
print([name for name in sys.modules if "held_out" in name])
"""
    result = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert result.stdout.strip() == "[]"


# Scenarios


@pytest.mark.parametrize("name", HASHES)
def test_the_scenarios_are_the_pinned_ones(name):
    scenarios = draw_held_out(name)
    assert len(scenarios) == COUNT == 20
    assert [one.index for one in scenarios] == list(range(COUNT))
    assert scenarios_digest(scenarios)[:16] == HASHES[name]


@pytest.mark.parametrize("name", CONDITIONS)
def test_scenarios_drawn_again_are_the_same_and_fewer_are_the_first_of_more(name):
    few = draw_held_out(name, 2)
    assert few == draw_held_out(name)[:2]
    assert draw_held_out.__wrapped__(name, 1) == few[:1]
    assert scenarios_digest(few) != scenarios_digest(few[:1])


def test_their_seeds_differ_from_those_of_tracks_tuning_and_training():
    assert DRAWS not in (*SPLITS.values(), search.DRAWS)
    seeds = [one.seed for name in CONDITIONS for one in draw_held_out(name)]
    theirs = {one.seed for name in TRACKS for split in TRACKS[name].splits for one in load_scenarios(name, split)[0]}
    assert len(set(seeds)) == len(seeds) == len(CONDITIONS) * COUNT
    assert not theirs & set(seeds)
    assert all(0 <= seed < 2**31 for seed in seeds), "training seeds lie above"


@pytest.mark.parametrize("name", CONDITIONS)
def test_a_scenario_is_what_its_environment_takes(name):
    one = draw_held_out(name, 1)[0]
    assert json.loads(json.dumps(one.disturbances)) == one.disturbances
    world = CONDITIONS[name].world
    assert (one.start is not None) == (world != GROUND)
    env = make_env(CONDITIONS[name], one, {})
    env.reset(seed=one.seed, options=reset_options(one))
    assert env.fleet is not None, "not simulated by the engine"
    if world == BOTH:
        assert parse_course(one.start) == env.course
    elif one.start is not None:
        goals = FlightStart.parse(one.start).goals
        assert len(goals) > 1
        assert [goal.deadline for goal in env.progress.goals] == [goal.deadline for goal in goals]
    else:
        assert set(one.options) == {"distance", "direction", "turn"}
    env.close()


def test_unknown_conditions_and_counts_are_refused_in_one_line():
    with pytest.raises(UnknownNameError, match="unknown condition 'flight-paper'; valid: payload-fast2"):
        draw_held_out("flight-paper")
    with pytest.raises(InvalidValueError, match="scenarios = 0 is not valid; expected a whole number of at least 1"):
        draw_held_out("payload-fast2", 0)


# The committed table


def test_the_committed_table_was_evaluated_on_these_scenarios():
    content = read_content(ROOT / HELD_OUT)
    assert set(HASHES) == set(CONDITIONS) == set(content["conditions"])
    for name, digest in content["conditions"].items():
        assert digest == scenarios_digest(draw_held_out(name, content["scenarios"]))
