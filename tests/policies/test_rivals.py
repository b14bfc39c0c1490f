"""Pins the rivals: each implements the method in its name, checked by a second implementation or an invariant."""

import importlib
import sys
from dataclasses import replace
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from support.answers import NO_FORCES, OPTIMAL
from support.states import cost, demand_of, exact, model, random_demands, random_wrench, resting, staying

from spidar_gym.benchmark import CRAWL, HOVER
from spidar_gym.benchmark.evaluate import play
from spidar_gym.benchmark.scenario import load_scenarios
from spidar_gym.control.allocation.allocator import Allocator
from spidar_gym.control.allocation.blocks import ThrustBox, ThrustEffort, WrenchBalance
from spidar_gym.control.allocation.modes import FORCE_ROWS, find_allocation
from spidar_gym.control.allocation.problem import FORCE_SCALE, Mode, assemble
from spidar_gym.control.crawl.footsteps import Move, Stand
from spidar_gym.control.crawl.pose2 import Pose2
from spidar_gym.control.flight.controller import CONTROL_RATE, FlightController
from spidar_gym.control.flight.margins import DELAY, LAG
from spidar_gym.errors import InvalidValueError
from spidar_gym.model.interference import InterferenceConfig
from spidar_gym.robot import FORMS, GRAVITY, ROBOT
from spidar_gym.sim.body import BodyConfig
from spidar_gym.sim.config import PlantConfig
from spidar_gym.so3 import exp, matrix_to_quat
from spidar_gym.tasks.start import FlightStart, FormGoal

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(autouse=True)
def checkout(monkeypatch):
    """Make the baselines importable, as in a checkout."""
    monkeypatch.setattr(sys, "path", [str(ROOT), *sys.path])


def rival(name):
    return importlib.import_module(f"baselines.{name}")


def heavy(rng, count):
    """Sample demands in stacked and flat forms, some with joint torques beyond their limit."""
    found = random_demands(rng, count, hard=True)
    return found + [
        demand_of(FORMS[name], np.eye(3), scale * random_wrench(rng, np.eye(3), hard=False))
        for name in ("form1", "form3")
        for scale in (1.0, 1.4, 1.8)
    ]


# Allocators


def test_unlimited_is_the_least_thrust_with_every_other_row():
    unlimited = rival("unlimited").WithoutTorques(find_allocation("paper"))
    assert set(unlimited.modes) == set(find_allocation("paper"))
    mode = Mode("flight", (ThrustEffort(1.0),), (WrenchBalance(), ThrustBox(), *FORCE_ROWS))
    beyond, answered = 0, 0
    for demand in heavy(np.random.default_rng(11), 40):
        answer, optimum = unlimited.allocate(demand, "flight", NO_FORCES), exact(assemble(mode, demand))
        if answer.status not in OPTIMAL:
            continue
        answered += 1
        assert answer.forces_l.reshape(-1) == pytest.approx(FORCE_SCALE * optimum, abs=1e-4)
        limited = Allocator(find_allocation("paper")).allocate(demand, "flight", NO_FORCES)
        if limited.status in OPTIMAL:
            assert cost(mode, demand, answer.forces_l) <= cost(mode, demand, limited.forces_l) + 1e-9
        beyond += np.abs(answer.joint_torques).max() > ROBOT.max_joint_torque
    assert answered > 20
    assert beyond > 2


def test_scaled_forces_keep_direction_and_the_torques_that_can_be_kept():
    module, rng = rival("scaled"), np.random.default_rng(12)
    modes = find_allocation("paper")
    scaled, whole = module.ScaledThrust(modes), rival("unlimited").WithoutTorques(modes)
    cut = 0
    for demand in heavy(rng, 60):
        answer, full = scaled.allocate(demand, "flight", NO_FORCES), whole.allocate(demand, "flight", NO_FORCES)
        assert np.cross(answer.forces_l, full.forces_l) == pytest.approx(NO_FORCES, abs=1e-6)
        assert (answer.thrust <= full.thrust + 1e-9).all()
        assert answer.joint_torques == pytest.approx(
            demand.gravity_torque - demand.torque_map @ answer.forces_l.reshape(-1), abs=1e-9
        )
        over, limit = np.abs(full.joint_torques).max(), ROBOT.max_joint_torque
        if over <= limit:
            assert answer.forces_l.tolist() == full.forces_l.tolist()
            continue
        cut += 1
        assert np.abs(answer.joint_torques).max() <= max(limit, over) + 1e-9
        s = answer.thrust.sum() / full.thrust.sum()
        # No other scale on a fine grid has a smaller excess, or the same excess with more thrust.
        others = np.linspace(0.0, 1.0, 1001)
        slope = full.joint_torques - demand.gravity_torque
        excess = np.maximum(np.abs(demand.gravity_torque + others[:, None] * slope).max(axis=1) - limit, 0.0)
        own = max(np.abs(answer.joint_torques).max() - limit, 0.0)
        assert own <= excess.min() + 1e-9
        assert s >= others[excess <= own + 1e-12].max(initial=0.0) - 1e-9
    assert cut > 3


# Control laws


def hover(arguments, seconds=12.0, **settings):
    """Simulate a hover; return its position error [m], averaged over the last second."""
    env = gymnasium.make(HOVER, forms="form2", horizon_s=seconds, **arguments, **settings, disable_env_checker=True)
    env.reset(seed=3)
    errors = []
    for _ in range(round(seconds * CONTROL_RATE)):
        *_, info = env.step(np.zeros(env.action_space.shape))
        errors.append(info["position_error"])
    env.close()
    return np.mean(errors[-round(CONTROL_RATE) :], axis=0)


HEAVY = PlantConfig(body=BodyConfig(total_mass=1.05 * ROBOT.total_mass))


@pytest.mark.parametrize("name", ["indi", "adrc"])
def test_a_law_with_a_full_observer_has_no_static_error_without_integrals(name):
    arguments = rival(name).SEARCH.arguments({p.name: p.start for p in rival(name).SEARCH.parameters})
    config = arguments["controller"]
    gains = np.array([*config.centroidal.position_gains, *config.centroidal.attitude_gains])
    assert not gains[:, 1].any()
    assert config.compensation.observer_gain == 1.0
    assert config.compensation.observer_order == {"indi": 1, "adrc": 2}[name]
    assert hover(arguments, plant=HEAVY) == pytest.approx([0.0, 0.0, 0.0], abs=1e-3)
    blind = replace(config, compensation=replace(config.compensation, observer_gain=0.0))
    # Without integrals, 5 % more weight cause a static error of 0.05 / 1.05 g divided by the position gain.
    sag = 0.05 / 1.05 * GRAVITY / config.centroidal.position_gains[2][0]
    assert hover({"controller": blind}, plant=HEAVY)[2] == pytest.approx(sag, rel=0.1)


def test_compensation_allows_interference():
    scenarios = load_scenarios("flight-narrow", "validation")[0][:1]
    free, tuned = (
        play(policy, "flight-narrow", scenarios)[0]["metrics"]
        for policy in (rival("compensation").Compensation(), rival("qp_tuned").QPTuned())
    )
    assert free["violations"] > 0.3
    assert tuned["violations"] < 0.01
    assert free["success"]


# Model predictive control


def test_the_feedback_is_the_optimum_over_the_horizon():
    mpc = rival("mpc")
    A, B = mpc.model(0.03, 0.4)
    weights, r = np.array([1.0, 0.02, 0.0, 0.0]), 7.0**-4
    rng = np.random.default_rng(0)
    # Reference: the state after k ticks as a linear function of n commands, and least squares over all costs.
    n = 300
    for _ in range(3):
        start = rng.standard_normal(4) * [0.05, 0.1, 1.0, 1.0]
        rows, sides, effect, free = [], [], np.zeros((4, n)), start.copy()
        for k in range(n):
            effect, free = A @ effect, A @ free
            effect[:, k] += B
            rows += [np.sqrt(weights)[:, None] * effect, np.sqrt(r) * np.eye(n)[k : k + 1]]
            sides += [-np.sqrt(weights) * free, [0.0]]
        best = np.linalg.lstsq(np.vstack(rows), np.concatenate(sides), rcond=None)[0]
        assert -mpc.solve(7.0, 0.02, 0.03, 0.4) @ start == pytest.approx(best[0], rel=1e-6)


@pytest.mark.parametrize("delay", [0.0, 0.4, 1.0])
def test_rotors_commanded_with_the_target_reach_the_needed_acceleration(delay):
    mpc, beta = rival("mpc"), 0.6
    time = mpc.DT * np.arange(60)
    needed = np.sin(3.0 * time)
    a, before, errors = 0.0, None, []
    for k in range(len(time) - 4):
        u = mpc.target(needed[k : k + 4], beta, delay)
        reached = u if before is None else (1.0 - delay) * u + delay * before
        a += beta * (reached - a)
        before = u
        errors.append(a - needed[k + 1])
    # Exact without a delay and with a delay of one tick; in between, the interpolation is applied twice.
    assert np.abs(errors[20:]).max() < (1e-9 if delay in (0.0, 1.0) else 0.02)


def moved(state, axis, x, v):
    """Return a state displaced and moving along or about an axis [m, m/s] or [rad, rad/s]."""
    along = np.eye(3)[axis % 3]
    if axis < 3:
        return replace(state, position_w=state.position_w + x * along, velocity_w=v * along)
    return replace(state, quat_wb=matrix_to_quat(exp(x * along)), omega_b=v * along)


def closed_loop(factor, axis, extra=0.0, seconds=9.0):
    """Simulate a rigid robot along one axis, with the rotor dynamics of the margins and a loop gain of `factor`."""
    mpc = rival("mpc")
    controller = mpc.arguments(mpc.FOUND)["law"](mpc.BASE)
    state = resting(FORMS["form2"])
    reference = staying(state)
    steps, lag, late = 20, LAG, DELAY - 0.5 * mpc.DT + extra  # half a tick of the delay comes from the zero-order hold
    x, v, a, errors = 2e-4, 0.0, 0.0, []  # small, so that no saturation turns growth into a limit cycle
    commands = [0.0] * (round(late / mpc.DT * steps) + 1)
    controller.reset(state)
    for _ in range(round(seconds / mpc.DT)):
        errors.append(x)
        now = moved(state, axis, x, v)
        controller.step(now, reference)
        wrench = controller.last_step.allocation.wrench
        control_state = controller.last_step.control_state
        u = mpc.to_acceleration(wrench, control_state, now.omega_b)[axis]
        for _ in range(steps):
            commands.append(factor * u)
            a += (1.0 - np.exp(-mpc.DT / steps / lag)) * (commands.pop(0) - a)
            x, v = x + mpc.DT / steps * v, v + mpc.DT / steps * a
    return np.abs(errors)


@pytest.mark.parametrize("axis", [0, 5])
def test_the_margins_are_where_the_loop_becomes_unstable(axis):
    mpc = rival("mpc")
    found = mpc.loops(mpc.FOUND)[mpc.AXIS[axis]]
    for factor, extra, is_stable in (
        (0.9 * found.gain, 0.0, True), (1.1 * found.gain, 0.0, False),
        (1.0, 0.85 * found.delay, True), (1.0, 1.15 * found.delay, False),
    ):  # fmt: skip
        errors = closed_loop(factor, axis, extra)
        third = len(errors) // 3
        assert (errors[-third:].max() < errors[third : 2 * third].max()) == is_stable, (factor, extra)


# Walking


@pytest.fixture(scope="module")
def walk():
    """Walk 0.3 m ahead; return mode, allocation, demand, torso height and swinging feet of each tick, and `info`."""
    env = gymnasium.make(CRAWL, distance=0.3, **rival("walking").Walking.presets[CRAWL])
    env.reset(seed=0)
    crawler, ticks, done = env.unwrapped.controller, [], False
    while not done:
        *_, terminated, truncated, info = env.step(np.zeros(env.action_space.shape))
        step = crawler.last_step
        ticks.append(
            (step.mode, step.allocation, step.demand, env.unwrapped.state.position_w[2], crawler.gait.swinging)
        )
        done = terminated or truncated
    env.close()
    return ticks, info


def test_a_walk_has_one_foot_in_the_air_which_gives_no_force_and_the_torso_up(walk):
    ticks, info = walk
    assert info["is_success"]
    stepping = [tick for tick in ticks if tick[0].startswith("walk")]
    assert {tick[0] for tick in stepping} == {"walk0", "walk1", "walk2", "walk3"}
    lying = ticks[0][3]
    friction = rival("walking").CONFIG.foot_friction
    for mode, allocation, demand, height, swinging in stepping:
        leg = int(mode[-1])
        assert not np.delete(swinging, leg).any()
        assert height > lying + 0.01  # the pegs are off the floor
        forces = allocation.foot_forces_f
        assert forces[leg] == pytest.approx(np.zeros(3), abs=1e-3)
        standing = np.delete(forces, leg, axis=0)
        assert (standing[:, 2] > 0.4).all()
        assert (np.abs(standing[:, :2]) <= friction * standing[:, 2:] + 1e-2).all()
        # Feet and rotors together produce the demanded wrench.
        weight = np.concatenate((allocation.forces_l.reshape(-1), forces.reshape(-1)))
        assert demand.thrust_map @ weight == pytest.approx(demand.wrench, abs=0.05)
    share = np.mean([tick[1].thrust.sum() for tick in stepping]) / ROBOT.weight
    assert 0.2 < share < 0.9


def test_a_walk_steps_with_each_leg_in_each_cycle_and_moves_on_four_feet_only(walk):
    ticks, _ = walk
    modes = [mode for mode, *_ in ticks]
    order = [mode for k, mode in enumerate(modes) if k == 0 or mode != modes[k - 1]]
    steps = [mode for mode in order if mode.startswith("walk")]
    assert len(steps) % 4 == 0
    assert steps == [f"walk{leg}" for leg in rival("walking").ORDER] * (len(steps) // 4)
    assert not any(tick[4].any() for tick in ticks if not tick[0].startswith("walk"))


def test_a_walk_takes_all_commands_or_none():
    gait = rival("walking").Walk(rival("walking").CONFIG.gait, joint_speed=0.2, dt=1.0 / CONTROL_RATE)
    assert gait.command([Move(Pose2(0.3))]) == len(gait.memory.steps) > 0
    before, planned = list(gait.memory.steps), gait.memory.planned
    with pytest.raises(InvalidValueError, match="height"):
        gait.command([Move(Pose2(0.2)), Stand(5.0)])
    assert gait.memory.steps == before
    assert gait.memory.planned == planned
    first, *_, last = gait.memory.steps
    assert first.phases[:2] == ("brace", "up")
    assert last.phases[-2:] == ("down", "settle")


# Planning

SWUNG = np.tile([0.5, 0.9, 0.0, 0.5], 4), np.tile([0.5, 0.9, -1.0, 0.9], 4)
"""Two forms without interference; on the straight path between them rotors are in jets [rad]."""


def test_a_way_is_bent_around_jets_and_no_joint_is_faster_on_it_than_on_the_straight_one():
    planning = rival("planning")
    begin, end = SWUNG
    guess = FlightController().rest_vectoring(begin)
    bender = planning.Bender(model(), planning.straight(begin, end), guess, InterferenceConfig())
    assert bender.goal == 0.0
    assert bender.straight > 0.1
    for _ in range(40):
        bender.go_on()
    assert bender.plan.bent < 0.1 * bender.plan.straight
    way = bender.way
    assert way.at(0.0).tolist() == begin.tolist()
    assert way.at(1.0) == pytest.approx(end, abs=1e-12)
    s = np.linspace(0.0, 1.0, 201)
    rates = np.diff([way.at(x) for x in s], axis=0) / np.diff(s)[:, None]
    assert np.abs(rates).max() <= way.length * (1.0 + 1e-9)
    # The interference test of the controller confirms that the path avoids jets.
    depth = [planning.overlap(model(), way.at(x), guess, InterferenceConfig())[0] for x in s[::10]]
    direct = [
        planning.overlap(model(), planning.straight(begin, end).at(x), guess, InterferenceConfig())[0] for x in s[::10]
    ]
    assert np.mean(depth) < 0.2 * np.mean(direct)


def test_a_form_in_its_own_jets_has_no_free_path_and_the_plan_states_so():
    planning = rival("planning")
    to, back = (planning.plan_between(FORMS[a], FORMS[b], 60) for a, b in (("form1", "form3"), ("form3", "form1")))
    assert to.goal > 1.0
    assert to.bent > 0.0
    assert back.goal == 0.0
    assert planning.drawn_pairs(3).startswith("of 6 drawn forms ")
    flat = planning.plan_between(FORMS["form1"], FORMS["form2"], 60)
    assert flat == (0.0, 0.0, 0.0)


def test_joints_go_the_bent_way_within_the_deadline_where_the_form_is_known_a_second_ahead():
    planning, speed = rival("planning"), 0.6
    begin, end = SWUNG
    goals = (FormGoal(0.0, 0.0, begin), FormGoal(2.0, 2.0 + 1.0 / speed, end))
    start = FlightStart(goals, np.zeros(3), np.zeros(3))
    env = gymnasium.make(HOVER, joint_speed=speed, horizon_s=5.0, **planning.Planning.presets[HOVER])
    env.reset(seed=0, options={"start": start})
    controller, told = env.unwrapped.controller, []
    for _ in range(200):
        *_, info = env.step(np.zeros(env.action_space.shape))
        told.append(controller.memory.joint_position.copy())
    env.close()
    assert len(controller.plans) == 1
    assert controller.plans[0].bent < controller.plans[0].straight
    told = np.array(told)
    assert told[-1] == pytest.approx(end, abs=1e-12)
    assert np.abs(np.diff(told, axis=0)).max() * CONTROL_RATE <= speed * (1.0 + 1e-9)
    line = begin + np.outer(np.linspace(0.0, 1.0, 400), end - begin)
    off = [np.abs(line - q).max(axis=1).min() for q in told]
    assert max(off) > 0.05
    assert info["is_success"] or not info["failure"]
