"""Pins the baselines: loaded and called as in the leaderboard, each as described in its docstring."""

import importlib
import re
import sys
from dataclasses import replace
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from support.states import demand_of, random_demands, random_wrench

from spidar_gym.benchmark import COURSE, CRAWL, GRASP, HOVER, TRACKS, load_scenarios
from spidar_gym.benchmark.scenario import make_env, reset_options
from spidar_gym.benchmark.scoring import play_scenario
from spidar_gym.cli.evaluate import BASELINES
from spidar_gym.control.allocation.allocator import AllocationStatus, Allocator
from spidar_gym.control.allocation.modes import find_allocation
from spidar_gym.control.flight.controller import FlightController
from spidar_gym.control.presets import CRAWL_PRESETS, FORMER_CRAWL_PRESETS, FORMER_PRESETS, PRESETS
from spidar_gym.envs.registry import PATH
from spidar_gym.policies.load import load_policy
from spidar_gym.policies.policy import defined_on, policy_arguments, policy_digest, policy_doc, policy_kind, policy_name
from spidar_gym.robot import FORMS, N_ROTORS, ROBOT
from spidar_gym.sim.body import BodyConfig
from spidar_gym.sim.config import PlantConfig
from spidar_gym.tasks.hover import HoverTask
from spidar_gym.tasks.start import draw_start

ROOT = Path(__file__).resolve().parents[2]
TRACK = "flight-fast5"
STILL = np.zeros((N_ROTORS, 3))


@pytest.fixture(autouse=True)
def checkout(monkeypatch):
    """Make the baselines importable, as in a checkout."""
    monkeypatch.setattr(sys, "path", [str(ROOT), *sys.path])
    monkeypatch.chdir(ROOT)


@pytest.fixture
def pinv() -> Allocator:
    """Return the allocator that uses the pseudo-inverse instead of the paper's solver."""
    return importlib.import_module("baselines.pinv").PseudoInverse(find_allocation("paper"))


def free(demand):
    """Return the demand without locked or restricted rotors."""
    none = np.zeros(N_ROTORS, bool)
    return replace(demand, locked=none, restricted=none)


def hover(rng, scale=1.0):
    """Sample a hover demand in a form of the paper, without locked or restricted rotors."""
    demand = demand_of(FORMS[f"form{rng.integers(1, 4)}"], np.eye(3), random_wrench(rng, np.eye(3), hard=False))
    return free(replace(demand, wrench=scale * demand.wrench))


def across(demand):
    """Return the direction perpendicular to the plane to which a held φ confines each rotor's force."""
    return np.stack([np.zeros(N_ROTORS), np.cos(demand.phi), np.sin(demand.phi)], axis=1)


# All of them


@pytest.mark.parametrize("spec", BASELINES)
def test_a_baseline_is_defined_on_the_environments_that_its_doc_states(spec):
    policy = load_policy(spec)
    doc = policy_doc(policy)
    (only,) = re.findall(r"(flights|crawls|courses|grasps) only", doc) or [""]
    # Policies that hover with feedback also fly along a path.
    flights = [HOVER] if policy_name(policy) == "hold" else [HOVER, PATH]
    where = {"": [*flights, CRAWL], "flights": flights, "crawls": [CRAWL], "courses": [COURSE], "grasps": [GRASP]}[only]
    assert defined_on(policy) == where
    assert PATH not in where or policy_arguments(policy, PATH) == policy_arguments(policy, HOVER)
    assert doc.endswith(".")
    assert policy_kind(policy) == ("ceiling" if doc.startswith("A ceiling") else "classical")
    assert len(policy_digest(policy)) == 64
    flights, crawls = {*PRESETS, *FORMER_PRESETS}, {*CRAWL_PRESETS, *FORMER_CRAWL_PRESETS}
    presets = {HOVER: flights, PATH: flights, CRAWL: crawls, COURSE: flights, GRASP: flights}
    for env_id in where:
        arguments = policy_arguments(policy, env_id)
        assert arguments.get("preset", "published" if env_id == CRAWL else "paper") in presets[env_id]
        gymnasium.make(env_id, **arguments).close()


def test_every_baseline_has_a_unique_name_and_doc():
    policies = [load_policy(spec) for spec in BASELINES]
    names = [policy_name(policy) for policy in policies]
    assert len(set(names)) == len(names)
    assert names[0] == "qp"
    assert len({policy_doc(policy) for policy in policies}) == len(names)


def test_every_policy_in_the_folder_is_among_the_baselines():
    modules = {path.stem for path in (ROOT / "baselines").glob("*.py")} - {"__init__"}
    assert modules <= {spec.split(":")[0].split(".")[1] for spec in BASELINES}


def test_qp_is_the_environment_with_the_papers_preset_and_nothing_added(monkeypatch):
    monkeypatch.setitem(TRACKS, TRACK, replace(TRACKS[TRACK], seconds=2.0))
    scenario = load_scenarios(TRACK)[0][5]
    metrics = play_scenario(load_policy("baselines.qp:QP"), TRACK, scenario)["metrics"]
    env = gymnasium.make(HOVER, **TRACKS[TRACK].options, preset="paper", horizon_s=2.0).unwrapped
    env.reset(seed=scenario.seed, options=reset_options(scenario))
    errors = []
    for _ in range(80):
        info = env.step(np.zeros(env.action_space.shape))[4]
        errors.append([np.linalg.norm(info["position_error"]), np.linalg.norm(info["attitude_error"])])
    rms = np.sqrt(np.mean(np.square(errors[40:]), axis=0))
    assert [metrics["position_rms_m"], metrics["attitude_rms_rad"]] == pytest.approx(rms.tolist(), rel=1e-9)
    assert metrics["energy_wh"] == info["energy_wh"]


def test_the_constraint_is_all_that_qp_and_qp_unconstrained_differ_in(monkeypatch):
    monkeypatch.setitem(TRACKS, "flight-narrow", replace(TRACKS["flight-narrow"], seconds=1.5))
    monkeypatch.setitem(TRACKS, "flight-paper", replace(TRACKS["flight-paper"], seconds=1.0))
    policies = [load_policy(f"baselines.{name}") for name in ("qp:QP", "qp_unconstrained:QPUnconstrained")]

    def both(track):
        return [play_scenario(policy, track, load_scenarios(track)[0][0])["metrics"] for policy in policies]

    # In form ① no rotor is above another.
    on, off = both("flight-paper")
    assert on == off
    on, off = both("flight-narrow")
    assert on["violations"] < 0.1
    assert off["violations"] > 0.5


# The pseudo-inverse


def test_the_pseudo_inverse_gives_the_wrench_that_the_qp_gives_where_nothing_holds_it(pinv):
    rng, qp = np.random.default_rng(1), Allocator(find_allocation("paper"))
    for _ in range(12):
        demand = hover(rng)
        answer = pinv.allocate(demand, "flight", STILL)
        exact = qp.allocate(demand, "flight", STILL)
        assert exact.status in (AllocationStatus.CLOSED_FORM, AllocationStatus.SOLVED)
        assert answer.wrench == pytest.approx(demand.wrench, abs=1e-6)
        assert answer.wrench == pytest.approx(exact.wrench, abs=1e-2)
        assert answer.status == AllocationStatus.CLOSED_FORM
        assert answer.thrust.max() < ROBOT.max_thrust
        # The pseudo-inverse has the least force norm; the QP minimises other terms.
        assert np.linalg.norm(answer.forces_l) <= np.linalg.norm(exact.forces_l) + 1e-6


def test_the_pseudo_inverse_is_clamped_to_the_largest_thrust_along_its_own_direction(pinv):
    rng = np.random.default_rng(2)
    for _ in range(8):
        once = hover(rng)
        small = pinv.allocate(once, "flight", STILL)
        large = pinv.allocate(replace(once, wrench=6.0 * once.wrench), "flight", STILL)
        wish = 6.0 * np.linalg.norm(small.forces_l, axis=1)
        assert (wish > ROBOT.max_thrust).any()
        assert large.thrust == pytest.approx(np.minimum(wish, ROBOT.max_thrust))
        assert np.linalg.norm(large.forces_l, axis=1) == pytest.approx(large.thrust)
        assert np.cross(large.forces_l, small.forces_l) == pytest.approx(STILL, abs=1e-6)
        assert np.abs(large.unallocated_wrench).max() > 1.0


def test_a_held_phi_gets_no_force_across_its_plane_and_a_free_one_does(pinv):
    rng, held, loose = np.random.default_rng(3), 0, []
    for demand in random_demands(rng, 20, hard=True):
        answer = pinv.allocate(demand, "flight", STILL)
        side = np.einsum("ij,ij->i", answer.forces_l, across(demand))
        assert np.abs(side[demand.locked]).max(initial=0.0) < 1e-9
        held += int(demand.locked.sum())
        loose.extend(np.abs(side[~demand.locked]))
    assert held > 5
    assert np.median(loose) > 1e-3


def test_held_rotors_do_not_keep_the_others_from_the_wrench(pinv):
    rng = np.random.default_rng(4)
    for _ in range(5):
        demand = hover(rng)
        held = np.arange(N_ROTORS) == rng.integers(N_ROTORS)
        answer = pinv.allocate(replace(demand, locked=held), "flight", STILL)
        assert answer.wrench == pytest.approx(demand.wrench, abs=1e-6)


@pytest.mark.parametrize("name", ["wrench", "thrust_map"])
def test_numbers_that_are_none_hold_the_last_forces(pinv, name):
    demand, before = hover(np.random.default_rng(5)), np.tile([0.0, 0.0, 7.0], (N_ROTORS, 1))
    spoiled = getattr(demand, name).copy()
    spoiled[0] = np.nan
    answer = pinv.allocate(replace(demand, **{name: spoiled}), "flight", before)
    assert answer.status == AllocationStatus.HELD
    assert answer.forces_l.tolist() == before.tolist()


def test_a_controller_takes_the_pseudo_inverse_for_its_allocator(pinv):
    assert type(FlightController(allocator=type(pinv)).allocator) is type(pinv)


# No feedback


def test_hold_commands_once_and_for_all_what_the_robot_begins_with():
    policy = load_policy("baselines.hold:Hold")
    scenario = load_scenarios(TRACK)[0][3]
    env = make_env(TRACKS[TRACK], scenario, policy_arguments(policy, HOVER))
    policy.begin(env.action_space.shape[0])
    observation, before = env.reset(seed=scenario.seed, options=reset_options(scenario))
    policy.reset(0)
    q = env.state.joint_position.copy()
    first, info = policy.act(observation).copy(), before
    for _ in range(20):
        observation, *_, info = env.step(policy.act(observation))
        assert policy.act(observation).tolist() == first.tolist()
        turn = info["vectoring_command"] - before["vectoring"]
        assert np.abs(turn).max() < 1e-5
        assert info["thrust_command"] == pytest.approx(np.full(N_ROTORS, ROBOT.hover_thrust), rel=1e-6)
    assert np.abs(first).max() <= 1.0
    assert first[-16:] * ROBOT.joint_limit == pytest.approx(q, abs=1e-5)


def test_hold_forgets_its_command_at_a_reset():
    policy = load_policy("baselines.hold:Hold")
    actions = []
    for scenario in load_scenarios(TRACK)[0][:2]:
        env = make_env(TRACKS[TRACK], scenario, policy_arguments(policy, HOVER))
        policy.begin(env.action_space.shape[0])
        policy.reset(0)
        actions.append(policy.act(env.reset(seed=scenario.seed, options=reset_options(scenario))[0]).tolist())
    assert actions[0] != actions[1]


@pytest.mark.parametrize(
    ("env_id", "own", "ticks"),
    [(HOVER, {"forms": "independent", "joint_speed": 0.6}, 120), (CRAWL, {"distance": 0.3, "direction": 0.5}, 800)],
)
def test_blind_commands_do_not_depend_on_what_the_robot_does(env_id, own, ticks):
    """A light robot and a heavy one, pushed by the wind, receive the same commands from the same start."""
    policy = load_policy("baselines.blind:Blind")
    commands, ends = [], []
    for mass, wind in ((15.0, 0.0), (17.0, 1.0)):
        plant = PlantConfig(body=BodyConfig(total_mass=mass))
        env = gymnasium.make(
            env_id, **own, **policy_arguments(policy, env_id), plant=plant, disturbances={"wind": wind}
        ).unwrapped
        start = draw_start(HoverTask(**own), np.random.default_rng(4)) if env_id == HOVER else None
        env.reset(seed=4, options={} if start is None else {"start": replace(start, trim=np.zeros(6))})
        told = []
        for _ in range(ticks):
            env.step(np.zeros(env.action_space.shape))
            command = env.command
            told.append(np.concatenate((command.thrust, command.vectoring.reshape(-1), command.joint_position)))
        commands.append(np.array(told))
        ends.append(env.state.position_w)
    assert np.array_equal(*commands)
    assert np.abs(np.subtract(*ends)).max() > 0.001
    assert np.ptp(commands[0][:, -16:], axis=0).max() > 0.1, "the joints move"
