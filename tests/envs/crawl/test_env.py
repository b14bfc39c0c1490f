"""Pins the crawl environment: goals, zero action, info, rewards, success, failure, floors, refusals."""

import math
from dataclasses import replace
from functools import cache

import gymnasium
import jaxtyping
import numpy as np
import pytest
from support.page_robots import robots_with

from spidar_gym.control.allocation.allocator import AllocatorConfig
from spidar_gym.control.crawl.controller import Crawler, CrawlerConfig
from spidar_gym.control.crawl.footsteps import GaitConfig, Move, lying_pose
from spidar_gym.control.crawl.kinematics import feet_at, leg_angles
from spidar_gym.control.crawl.observation import crawl_layout
from spidar_gym.control.crawl.phases import PHASES
from spidar_gym.control.crawl.pose2 import Pose2
from spidar_gym.control.flight.controller import FlightController
from spidar_gym.control.presets import CRAWL_PRESETS
from spidar_gym.envs.actions import CRAWL_MODES
from spidar_gym.errors import InvalidValueError, UnknownNameError
from spidar_gym.model.dynamics import Model
from spidar_gym.native.core_crawler import CoreCrawler
from spidar_gym.native.plant import Plant
from spidar_gym.robot import ROBOT
from spidar_gym.sim.config import PlantConfig
from spidar_gym.state import NO_RESIDUAL
from spidar_gym.tasks.crawl import SHORTFALLS, CrawlTask, arc_astray
from spidar_gym.tasks.robots import CrawlRobots

CRAWL = "spidar_gym/Crawl-v0"
SHORT = {"distance": 0.15, "direction": 0.0, "turn": 0.0, "schedule": "overlapped", "joint_speed": 0.4}
"""One quick cycle."""
EVERY_MODE = list(CRAWL_MODES)


def make(**options):
    return gymnasium.make(CRAWL, disable_env_checker=True, **options).unwrapped


def crawl(env, policy=None, seed=0, ticks=3000):
    """Steps of an episode up to its end: (observation, reward, terminated, info), the reset's first."""
    observation, info = env.reset(seed=seed)
    steps = [(observation, 0.0, False, info)]
    zero = np.zeros(env.action_space.shape[0])
    for k in range(ticks):
        observation, reward, terminated, _, info = env.step(zero if policy is None else policy(k))
        steps.append((observation, reward, terminated, info))
        if terminated or info["finished"]:
            break
    return steps


@cache
def short(**options):
    """The quick cycle, crawled once."""
    return crawl(make(**SHORT, **options))


def random_policy(env, seed=0):
    rng = np.random.Generator(np.random.PCG64(seed))
    return lambda _: rng.uniform(-1.0, 1.0, env.action_space.shape[0])


def test_a_cycle_reaches_its_goal_and_is_a_success():
    info = short()[-1][3]
    assert info["finished"]
    assert info["is_success"], info["shortfalls"]
    assert np.hypot(*info["goal_error"][:2]) < 0.010
    assert abs(info["goal_error"][2]) < 0.02
    assert info["failure"] == info["shortfalls"] == ""


def test_the_phases_come_in_the_papers_order():
    phases = [info["phase"] for *_, info in short()]
    order = [phase for k, phase in enumerate(phases) if k == 0 or phase != phases[k - 1]]
    assert order[0] == order[-1] == "done"
    assert [p for p in order[1:-1] if p not in ("spool", "brace", "settle")] == [
        "raise", "swing", "lower", "up", "forward", "down"
    ]  # fmt: skip


@pytest.mark.parametrize("mode", [mode for mode in EVERY_MODE if mode not in ("direct", "torso_forces")])
@pytest.mark.parametrize(("control", "kind"), [("python", Crawler), ("core", CoreCrawler)], ids=["python", "core"])
def test_the_zero_action_is_the_crawler_bit_for_bit(mode, control, kind):
    env = make(**SHORT, action_mode=mode, wake=False, control=control)
    env.reset(seed=0)
    plant = Plant(env.plant.config)
    q = lying_pose(env.controller.config.gait)
    state = plant.reset(np.array([0.0, 0.0, ROBOT.peg_depth]), joint_position=q)
    crawler = kind(env.controller.config)
    crawler.reset(state, [Move(Pose2(0.15, 0.0, 0.0))])
    for _ in range(120):
        state = plant.step(crawler.step(state))
        env.step(np.zeros(env.action_space.shape[0]))
        assert np.array_equal(plant.data.qpos, env.plant.data.qpos)


@pytest.mark.parametrize("mode", EVERY_MODE)
def test_random_actions_stay_within_observations_rewards_and_info(mode):
    env = make(**SHORT, action_mode=mode)
    steps = crawl(env, random_policy(env), ticks=200)
    kinds = [{key: (type(value), np.shape(value)) for key, value in info.items()} for *_, info in steps]
    assert all(kind == kinds[0] for kind in kinds)
    for observation, reward, _, info in steps[1:]:
        assert observation in env.observation_space
        terms = {key: value for key, value in info.items() if key.startswith("reward_")}
        assert set(terms) == {f"reward_{term}" for term in CrawlTask.reward_terms}
        assert all(0.0 <= value <= 1.0 for value in (reward, *terms.values()))
        assert abs(reward - sum(w * terms[f"reward_{t}"] for t, (w, _) in CrawlTask.reward_terms.items())) < 1e-12


def test_observation_elements_that_never_change_are_those_with_a_reason():
    env = make(**SHORT | {"turn": 0.1}, action_mode="residual", sensors=True)
    observations = np.array([o for o, *_ in crawl(env, random_policy(env))])
    names = [(f.name, i) for f in crawl_layout(env.action_space.shape[0]) for i in range(f.size)]
    still = {names[k] for k in np.flatnonzero(np.ptp(observations, axis=0) < 1e-6)}
    # A single cycle of a schedule without waits has no phases hold, spool and settle.
    assert still <= {("phase", PHASES.index(name)) for name in ("hold", "spool", "settle")}


def test_metrics_agree_with_the_infos_of_the_steps():
    env = make(**SHORT)
    steps = crawl(env)
    info = steps[-1][3]
    fractions = np.array([i["thrust_fraction"] for *_, i in steps[1:]])
    assert abs(fractions.mean() - info["thrust_fraction_mean"]) < 1e-12
    assert abs(fractions.max() - info["thrust_fraction_peak"]) < 1e-12
    swing = np.array([i["foot_contact"] for *_, i in steps[1:] if i["phase"] == "swing"])
    assert abs((1.0 - swing.mean(axis=0)).min() - info["airborne_share"]) < 1e-12
    energy = sum(i["power_w"] for *_, i in steps[1:]) / 40.0 / 3600.0
    np.testing.assert_allclose(info["energy_wh"], energy, rtol=1e-9)
    way = env.progress.initial_distance - env.progress.distance
    np.testing.assert_allclose(info["cost_of_transport"], 3600.0 * energy / (16.0 * 9.81 * way), rtol=1e-9)
    assert info["duct_clearance_m"] > 0.03


def test_the_robot_lies_on_its_pegs_before_and_after():
    env = make(**SHORT)
    first = crawl(env, ticks=1)[-1][3]
    assert env.plant.touch().pegs[:4].all()
    assert first["tilt_rad"] < 0.02
    last = crawl(env)[-1][3]
    assert env.plant.touch().pegs[:4].all()
    assert last["tilt_rad"] < 0.02
    assert last["thrust_fraction"] == 0.0


def test_goals_are_sampled_from_the_seed_and_a_quarter_are_the_papers():
    task = CrawlTask()
    ways = [task.draw_way(np.random.Generator(np.random.PCG64(seed))) for seed in range(400)]
    paper = [way for way in ways if way == Pose2(0.6, 0.0, 0.0)]
    assert 70 <= len(paper) <= 130
    others = [way for way in ways if way not in paper]
    assert all(0.2 <= way.distance <= 0.6 and abs(way.yaw) <= 0.5 for way in others)
    directions = np.array([math.atan2(way.y, way.x) for way in others])
    assert [(np.abs(directions - d) < 0.5).sum() > 10 for d in (-2.5, -1.0, 0.5, 2.0)] == [True] * 4
    assert task.draw_way(np.random.Generator(np.random.PCG64(3))) == ways[3]


def test_given_numbers_fix_the_goal_and_the_others_stay_random():
    rng = [np.random.Generator(np.random.PCG64(7)) for _ in range(2)]
    free, fixed = CrawlTask().draw_way(rng[0]), CrawlTask(direction=math.pi / 2).draw_way(rng[1])
    assert abs(fixed.x) < 1e-12
    np.testing.assert_allclose([fixed.distance, fixed.yaw], [free.distance, free.yaw])


def test_resting_at_the_goal_earns_more_than_anything_before():
    env = make(**SHORT)
    steps = crawl(env)
    rewards = [env.step(np.zeros(env.action_space.shape[0]))[1] for _ in range(20)]
    assert min(rewards) > max(reward for _, reward, *_ in steps[1:-40])


def test_inverse_kinematics_of_the_legs_inverts_the_models_forward_kinematics():
    rng, model, reached = np.random.Generator(np.random.PCG64(4)), Model(), 0
    home = GaitConfig().home_b
    for _ in range(300):
        feet = home + rng.uniform((-0.25, -0.25, -0.15), (0.25, 0.25, 0.1), (4, 3))
        q = leg_angles(feet)
        if q is None:
            continue
        reached += 1
        np.testing.assert_allclose(model.contacts(q)[0][:4], feet, atol=1e-12)
        np.testing.assert_allclose(feet_at(q), feet, atol=1e-12)
        assert np.abs(q).max() <= math.pi / 2
        assert (q[3::4] >= 0.0).all()
    assert reached > 50
    assert leg_angles(1.6 * home) is None


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"finished": 0.0}, "unfinished"), ({"position_error": 0.0101}, "position"), ({"yaw_error": 0.021}, "yaw"),
        ({"airborne": 0.94}, "airborne"), ({"timeouts": 1}, "timeout"), ({"foot_slip": 0.051}, "slip"),
        ({"duct_touched": 1}, "duct"), ({"finished": 25.1}, "time"),
    ],
)  # fmt: skip
def test_each_shortfall_alone_denies_success(change, word):
    good = {
        "nominal_time": 20.0, "position_error": 0.0071, "yaw_error": 0.01, "finished": 24.0, "airborne": 0.96,
        "timeouts": 0, "foot_slip": 0.049, "duct_touched": 0,
    }  # fmt: skip
    task = CrawlTask()
    for numbers, words in ((good, []), (good | change, [word])):
        robots = robots_with(CrawlRobots, **numbers)
        assert [each for each, is_missed in task.shortfalls(robots).items() if is_missed[0]] == words
        assert task.succeeded(robots).tolist() == [not words]
        bits = task.tell(robots)["shortfalls_code"]
        assert [each for k, each in enumerate(SHORTFALLS) if bits[0] >> k & 1] == words


def test_a_robot_that_drags_its_legs_is_no_success():
    weak = PlantConfig()
    actuators = type(weak.actuators)(thrust_gain=0.5)
    steps = crawl(make(**SHORT, plant=PlantConfig(actuators=actuators)))
    info = steps[-1][3]
    assert not info["is_success"]
    assert "airborne" in info["shortfalls"] or "slip" in info["shortfalls"]


def test_a_duct_on_the_floor_ends_the_episode():
    env = make(**SHORT)
    env.reset(seed=0)
    # Flat legs and a module on its side, so that one of its ducts touches the floor.
    angles = np.zeros((8, 2))
    angles[3, 0] = math.pi / 2
    env.plant.reset(np.array([0.0, 0.0, ROBOT.peg_depth]), joint_position=np.zeros(16), vectoring=angles)
    assert env.plant.touch().ducts
    robots = robots_with(CrawlRobots, duct_touches=1, tilt=0.0, distance=0.5, initial_distance=0.5)
    assert [word for word, is_so in env.task.failed(robots).items() if is_so[0]] == ["duct"]
    assert set(CrawlTask.failures) == {"duct", "tilt", "astray", "diverged"}


def test_a_tilted_robot_has_failed():
    env = make(**SHORT)
    env.reset(seed=0)
    env.plant.data.qpos[2] += 1.0
    env.plant.data.qpos[3:7] = math.cos(0.3), math.sin(0.3), 0.0, 0.0
    *_, terminated, _, info = env.step(np.zeros(env.action_space.shape[0]))
    assert terminated
    assert info["failure"] == "tilt"


@pytest.mark.parametrize(
    "options",
    [{"slope": 0.12, "slope_direction": 1.0}, {"steps": 0.015}, {"steps": 0.03, "terrain": "stairs"}],
)
def test_a_cycle_on_a_slope_or_on_tiles_reaches_its_goal(options):
    info = crawl(make(**SHORT, preset="robust", **options))[-1][3]
    assert np.hypot(*info["goal_error"][:2]) < 0.015
    assert info["failure"] == ""


def test_the_floor_of_an_uneven_episode_follows_from_the_seed():
    env = make(**SHORT, steps=0.02)
    env.reset(seed=1)
    first = env.plant.config.ground.tiles.copy()
    env.reset(seed=2)
    assert not np.array_equal(first, env.plant.config.ground.tiles)
    env.reset(seed=1)
    assert np.array_equal(first, env.plant.config.ground.tiles)


def test_stairs_are_across_the_x_axis_and_half_of_the_floors_of_mixed_steps_have_them():
    env = make(**SHORT, steps=0.04, terrain="mixed")
    floors, home = [], make(**SHORT).controller.config.gait.home_b
    for seed in range(40):
        env.reset(seed=seed)
        floors.append(env.plant.config.ground)
    stairs = [ground for ground in floors if (ground.tiles == ground.tiles[:, :1]).all()]
    assert 12 <= len(stairs) <= 28
    points = np.array([(x, y, 0.0) for x in (-1.9, 0.0, 0.49, 0.51, 1.24, 1.26, 1.9) for y in (-1.0, 0.0, 1.5)])
    for ground in stairs:
        assert ground.height(points).reshape(7, 3).T.tolist() == [[0.0, 0.0, 0.0, 0.04, 0.04, 0.08, 0.08]] * 3
        # The torso starts below them, the front feet on the first.
        assert ground.height(home).tolist() == [0.04, 0.0, 0.0, 0.04]
    rest = [ground.tiles for ground in floors if (ground.tiles != ground.tiles[:, :1]).any()]
    assert all(0.0 < tiles.min() < 0.002 and 0.038 < tiles.max() < 0.04 for tiles in rest)


def test_options_reach_the_robot_and_the_gait():
    env = make(friction=0.45, schedule="overlapped", joint_speed=0.3, preset="robust")
    assert env.plant.model.geom_friction[env.plant.model.geom("foot1").id, 0] == 0.45
    assert env.controller.config.joint_speed == env.plant.config.joint_speed == 0.3
    assert env.controller.config.gait.swing_at == CRAWL_PRESETS["overlapped"].gait.swing_at
    assert env.controller.config.leg_stiffness == CRAWL_PRESETS["robust"].leg_stiffness
    assert make(max_iter=300).controller.config.allocator == AllocatorConfig(max_iter=300)


def test_gait_residuals_shape_the_gait():
    slow = crawl(make(**SHORT), lambda _: np.array([-1.0, 0.0, 0.0, 0.0]))
    assert slow[-1][3]["time_s"] > 1.3 * short()[-1][3]["time_s"]
    env = make(**SHORT)
    heights = [o[[f.name for f in env.layout].index("goal_position")] for o, *_ in slow]
    assert len(heights) == len(slow)
    low = crawl(make(**SHORT), lambda _: np.array([0.0, 0.0, 0.0, -1.0]))
    at = 2 + 2 + 3

    def highest(steps):
        return max(o[at] for o, *_ in steps)

    assert highest(low) < highest(short()) - 0.01


@pytest.mark.parametrize(
    ("options", "kind", "valid"),
    [
        ({"preset": "paper"}, UnknownNameError, "published, overlapped, robust"),
        ({"schedule": "trot"}, UnknownNameError, "sequential, overlapped"),
        ({"action_mode": "torque"}, UnknownNameError, "residual_gait"),
        ({"forms": "paper"}, UnknownNameError, "distance, direction, turn"),
        *(({"friction": v}, InvalidValueError, "within 0.001") for v in (-0.5, 0.0, math.nan)),
        *(({"slope": v}, InvalidValueError, "within -0.6") for v in (1.0, math.inf)),
        ({"steps": -0.01}, InvalidValueError, "within 0"),
        ({"steps": 0.5}, InvalidValueError, "within 0"),
        ({"terrain": "gravel"}, UnknownNameError, "tiles, stairs, mixed"),
        *(({"steps": 0.11, "terrain": t}, InvalidValueError, "at most 0.1 m") for t in ("stairs", "mixed")),
        ({"distance": -1.0}, InvalidValueError, "within 0"),
        ({"joint_speed": 0.0}, InvalidValueError, "rad/s"),
        ({"horizon_s": 0.0}, InvalidValueError, r"\[s\]"),
        ({"distance": 0.0, "turn": 0.0}, InvalidValueError, "a distance or a turn"),
        ({"obstacles": ((1.0, 0.0, -0.2),)}, InvalidValueError, "radius within 0"),
        ({"obstacles": ((1.0, math.nan, 0.2),)}, InvalidValueError, "radius within 0"),
    ],
)
def test_an_argument_that_is_not_valid_is_refused_with_what_would_be(options, kind, valid):
    with pytest.raises(kind, match=valid):
        gymnasium.make(CRAWL, **options)


@pytest.mark.parametrize(
    ("options", "valid"),
    [
        ({"turn": 6.28}, r"turn = 6.28 .*within -4.14159 … 4.14159 \[rad\]"),
        ({"turn": math.radians(359.8), "distance": 0.6, "direction": 0.0}, "within -4.14159"),
        ({"turn": 4.1, "distance": 0.6}, "the arc leads 0.56 m away from the goal, below 0.5 m is valid"),
        ({"turn": -3.7, "distance": 10.0}, "the arc leads 0.68 m away"),
        ({"horizon_s": 1e10}, r"within 0.025 … 1e\+09 \[s\]"),
    ],
)
def test_turns_with_large_detours_and_endless_horizons_are_refused_before_planning(options, valid):
    with pytest.raises(InvalidValueError, match=valid):
        make(**options)


@pytest.mark.parametrize("distance", [0.0, 0.3, 2.0])
@pytest.mark.parametrize("turn", [0.4, 3.0, 3.3, 3.7, 4.0])
def test_the_detour_of_an_arc_is_the_largest_distance_of_its_points_beyond_that_of_its_start(distance, turn):
    way = Pose2(distance, 0.0, turn)
    rests = []
    for share in np.linspace(0.0, 1.0, 2001).tolist():
        pose = way.arc(share)
        yaw = math.remainder(way.yaw - pose.yaw, 2.0 * math.pi)
        rests.append(math.hypot(way.x - pose.x, way.y - pose.y) + 0.5 * abs(yaw))
    assert abs(max(rests) - rests[0] - arc_astray(distance, -turn)) < 1e-2
    assert arc_astray(distance, -turn) >= max(rests) - rests[0] - 1e-9


def test_a_planned_friction_of_the_pegs_that_would_tip_the_torso_is_refused():
    with pytest.raises(InvalidValueError, match=r"peg_friction = 1.2 .*below 1.17"):
        CrawlerConfig(peg_friction=1.2)


def test_a_given_goal_in_an_obstacle_is_refused_and_a_random_one_is_drawn_again():
    block = ((0.6, 0.0, 0.2),)
    with pytest.raises(InvalidValueError, match=r"obstacles = .*0\.3 m from each of them; .* at \(0\.6, 0\)"):
        make(distance=0.6, direction=0.0, obstacles=block).reset(seed=0)
    env = make(obstacles=block)
    for seed in range(12):
        env.reset(seed=seed)
        assert math.hypot(env.progress.goal.x - 0.6, env.progress.goal.y) > 0.45
    tiles = env.plant.config.ground.tiles
    assert tiles[10, 8] == 0.15
    assert tiles[4, 4] == 0.0


def test_an_unknown_reset_option_is_refused():
    with pytest.raises(UnknownNameError, match="valid: disturbances"):
        make().reset(options={"goal": 1})


def test_the_searched_crawler_is_at_its_joint_speed_four_fifths_of_the_time():
    """Other rates and forces could save at most the rest of the time."""
    env = make(preset="robust_overlapped", control="python", distance=0.6, turn=0.0)
    env.reset(seed=0)
    crawler = env.controller
    reach, plan, fast, ticks = crawler.config.joint_speed * crawler.dt, crawler.gait.memory.plan, 0, 0
    while not crawler.done:
        env.step(np.zeros(env.action_space.shape))
        fast += np.abs(crawler.gait.memory.plan - plan).max() >= 0.9 * reach
        plan, ticks = crawler.gait.memory.plan, ticks + 1
    assert 0.76 < fast / ticks < 0.9


def test_a_custom_control_law_crawls_and_invalid_ones_are_refused(monkeypatch):
    class Slow(Crawler):
        def step(self, state, residual=NO_RESIDUAL):
            return super().step(state, replace(residual, joint_speed_scale=0.5))

    joints = []
    for how in ({"law": Slow}, {"control": "python"}, {}):
        env = make(distance=0.2, turn=0.0, preset="overlapped", **how)
        env.reset(seed=0)
        start = env.state.joint_position
        for _ in range(28):
            env.step(np.zeros(env.action_space.shape))
        joints.append(env.controller.memory.joint_position - start)
    assert np.abs(joints[0]).max() < 0.8 * np.abs(joints[1]).max()
    assert joints[1] == pytest.approx(joints[2], abs=1e-6)
    monkeypatch.setattr(jaxtyping.config, "jaxtyping_disable", True)
    for law in (FlightController, Crawler(), "Crawler"):
        with pytest.raises(InvalidValueError, match=r"law = .* a subclass of Crawler"):
            make(law=law)
    with pytest.raises(InvalidValueError, match=r"law = .* None: the core has its own"):
        make(law=Slow, control="core")
    with pytest.raises(InvalidValueError, match=r"law = .* a subclass of FlightController"):
        gymnasium.make("spidar_gym/Hover-v0", law=Slow)


@pytest.mark.parametrize("control", ["core", "python"])
def test_a_foot_has_to_be_in_the_air_while_its_own_leg_swings(control):
    env = make(**SHORT, control=control)
    env.reset(seed=0)
    assert env.progress.airborne == 1.0
    swung, airborne = np.zeros(4), np.zeros(4)
    for _ in range(400):
        *_, info = env.step(np.zeros(env.action_space.shape))
        if info["phase"] == "swing":
            swung += 1.0
            airborne += ~info["foot_contact"]
        if info["finished"]:
            break
    assert swung.min() > 10
    np.testing.assert_array_equal(env.progress.swing_ticks, swung)
    np.testing.assert_array_equal(env.progress.airborne_ticks, airborne)
    assert info["airborne_share"] == (airborne / swung).min()


@pytest.mark.parametrize("control", ["core", "python"])
def test_the_clock_of_a_crawl_without_a_gait_shows_the_time_since_the_reset(control):
    env = gymnasium.make(CRAWL, action_mode="torso_forces", hold=5, control=control).unwrapped
    sizes = [(f.name, f.size) for f in env.layout]
    at = sum(size for _, size in sizes[: [name for name, _ in sizes].index("clock")])
    idle = np.zeros(env.action_space.shape, np.float32)
    for _ in range(2):
        shown = [env.reset(seed=3)[0]] + [env.step(idle)[0] for _ in range(5)]
        for k, observation in enumerate(shown):
            time = k * 5 / 40.0  # a step is an eighth of a second
            expected = np.sin(np.pi * time), np.cos(np.pi * time)
            np.testing.assert_allclose(observation[at : at + 2], expected, atol=1e-6)
