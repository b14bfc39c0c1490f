"""Pins Course-v0: random courses, success of the rule, equal results of engine and Python controller, failures."""

import re
from typing import Any

import gymnasium
import numpy as np
import pytest

from spidar_gym.control.course.gates import HALF_WIDTH, Course, Gate, plain_course
from spidar_gym.control.course.target import Target
from spidar_gym.control.crawl.pose2 import Pose2
from spidar_gym.control.locomotion.orders import PHASES
from spidar_gym.envs.registry import COURSE
from spidar_gym.envs.vector import NativeVectorEnv
from spidar_gym.errors import InvalidValueError, UnknownNameError
from spidar_gym.sim.course_boxes import boxes
from spidar_gym.tasks.course import DECIDE, MAX_HIT, SIZES, CourseTask

SHORT = Course((Gate("slot", 2.3, 2.6, 1.5, 0.3), Gate("tiles", 4.4, 7.9, 0.015)), Pose2(6.1, 0.1, 0.1),
               tuple(np.random.default_rng(0).uniform(0.0, 0.015, 28).tolist()))  # fmt: skip
DRAWN: dict[str, Any] = {"sensors": True, "randomization": 0.5}


def make(**options):
    return gymnasium.make(COURSE, disable_env_checker=True, **options).unwrapped


def go(env, steps=600, until=True, target=None):
    """Follow the rule, or a constant target; return the last `info`."""
    info = {}
    for _ in range(steps):
        aim = env.rule() if target is None else target
        _, reward, terminated, _, info = env.step(aim.action(env.course, env.seen.position_w))
        assert 0.0 <= reward <= 1.0
        if terminated or (until and info["is_success"]):
            break
    return info


# ---- random courses ----


def test_random_courses_are_feasible_and_have_every_kind_of_gate():
    task, kinds = CourseTask(), set()
    for seed in range(300):
        course = task.draw_course(np.random.default_rng(seed))
        kinds |= {gate.kind for gate in course.gates}
        assert sum(gate.kind == "beam" for gate in course.gates) <= 1
        for gate in course.gates:
            low, high = SIZES[gate.kind]
            assert low <= gate.size <= high
        assert len(boxes(course)) <= 64
    assert kinds == {*SIZES}


def test_boxes_span_the_field_and_leave_the_openings_of_the_map():
    course = Course((Gate("beam", 3.0, 3.4, 0.6), Gate("slot", 7.0, 7.3, 1.4, 0.5)), Pose2(10.0))
    beam, right, left, _ = boxes(course)
    assert beam[2] - beam[5] == pytest.approx(0.6)
    assert beam[4] == HALF_WIDTH
    assert right[1] - right[4] == pytest.approx(-HALF_WIDTH)
    assert left[1] + left[4] == pytest.approx(HALF_WIDTH)
    assert (left[1] - left[4]) - (right[1] + right[4]) == pytest.approx(1.4)
    assert 0.5 * ((left[1] - left[4]) + (right[1] + right[4])) == pytest.approx(0.5)


def test_a_slopes_top_is_where_the_map_has_it():
    slope = Gate("slope", 3.0, 6.5, 0.15)
    x, _, z, half, _, thick, pitch = boxes(Course((slope,), Pose2(4.7)))[0]
    for along in (-half, half):  # corners of the top
        top = (x + along * np.cos(pitch) + thick * np.sin(pitch), z - along * np.sin(pitch) + thick * np.cos(pitch))
        assert top[1] == pytest.approx((top[0] - slope.begin) * np.tan(slope.size), abs=1e-9)
    assert top[0] == pytest.approx(slope.end)


def test_a_task_draws_the_course_that_its_environment_does():
    env = make()
    for seed in range(12):
        env.reset(seed=seed)
        assert env.course == CourseTask().draw_course(np.random.Generator(np.random.PCG64(seed)))


def test_a_given_course_is_used_and_can_be_read_from_lists():
    env = make()
    env.reset(seed=0, options={"course": plain_course(SHORT)})
    assert env.course == SHORT
    env.reset(seed=1)
    assert env.course == SHORT
    assert make(course=plain_course(SHORT)).task.course == SHORT


# ---- flying and crawling ----


def assert_alike(options, steps):
    """Compare engine and Python controller step by step; return the last `info`."""
    one, other = make(**options), make(control="python", **options)
    (a, _), (b, info) = one.reset(seed=5), other.reset(seed=5)
    np.testing.assert_array_equal(a, b)
    for _ in range(steps):
        action = one.rule().action(one.course, one.seen.position_w)
        a, reward, over, _, told = one.step(action)
        b, own_reward, own_over, _, info = other.step(action)
        assert (over, told["phase"], told["gate"]) == (own_over, info["phase"], info["gate"])
        np.testing.assert_allclose(a, b, atol=1e-5)
        np.testing.assert_allclose(told["thrust_command"], info["thrust_command"], atol=1e-4)
        assert reward == pytest.approx(own_reward, abs=1e-6)
        if told["is_success"]:
            break
    assert told.keys() == info.keys()
    assert told["is_success"] == info["is_success"]
    return told


def test_engine_and_python_controller_agree_at_take_off():
    assert assert_alike({"course": SHORT, **DRAWN}, 8)["phase"] == "climb"


@pytest.mark.slow
@pytest.mark.parametrize("options", [{"course": SHORT, **DRAWN}, {"gates": ("beam",), "count": (1, 1)}])
def test_engine_and_python_controller_agree_on_whole_courses(options):
    assert assert_alike(options, 400)["is_success"]


@pytest.mark.parametrize("mode", ["residual", "direct"])
def test_engine_and_python_controller_agree_in_every_mode(mode):
    one, other = (make(control=control, action_mode=mode, course=SHORT) for control in ("core", "python"))
    one.reset(seed=2)
    other.reset(seed=2)
    rng = np.random.default_rng(0)
    for _ in range(30):
        action = 0.2 * rng.uniform(-1.0, 1.0, one.action_space.shape)
        a, *_ = one.step(action)
        b, *_ = other.step(action)
        np.testing.assert_allclose(a, b, atol=1e-5)


def test_the_rule_takes_off_passes_a_slot_lands_on_tiles_and_crawls_to_the_goal():
    env = make(course=SHORT)
    env.reset(seed=0)
    phases = []
    for _ in range(120):
        info = go(env, 1)
        phases.append(info["phase"])
        if info["is_success"]:
            break
    assert info["is_success"]
    assert {*phases} >= {"climb", "fly", "descend", "crawl"}
    assert info["most_hit_n"] == 0.0
    assert np.hypot(*info["goal_error"][:2]) < 0.03
    assert info["flown_s"] > 10.0


@pytest.mark.slow
def test_the_rule_succeeds_on_random_courses():
    env = make(**DRAWN)
    ends = []
    for seed in range(10):
        env.reset(seed=seed)
        ends.append(go(env)["is_success"])
    assert sum(ends) >= 9


def test_the_rule_is_the_residuals_base():
    env, base = make(course=SHORT, hold=DECIDE), make(course=SHORT, action_mode="residual", hold=DECIDE)
    env.reset(seed=0)
    base.reset(seed=0)
    for _ in range(20):
        env.step(env.rule().action(env.course, env.seen.position_w))
        base.step(np.zeros(base.action_space.shape))
        np.testing.assert_allclose(env.state.position_w, base.state.position_w, atol=1e-12)


def test_a_step_is_as_many_control_periods_as_it_holds():
    long, short = make(course=SHORT), make(course=SHORT, hold=5)
    assert (long.horizon, short.horizon) == (600, 2400)
    long.reset(seed=0)
    short.reset(seed=0)
    for _ in range(6):
        action = long.rule().action(long.course, long.seen.position_w)
        long.step(action)
        for _ in range(4):
            short.step(action)
    np.testing.assert_array_equal(long.state.position_w, short.state.position_w)
    assert long.state.time == pytest.approx(3.0)


def test_robots_of_a_vector_equal_single_ones():
    vector = NativeVectorEnv(COURSE, 2, num_threads=2, **DRAWN)
    observations, _ = vector.reset(seed=3)
    actions = np.random.default_rng(0).uniform(-1.0, 1.0, (5, 2, 8))
    alone = [make(**DRAWN) for _ in range(2)]
    own = [env.reset(seed=3 + k)[0] for k, env in enumerate(alone)]
    np.testing.assert_array_equal(observations, own)
    for action in actions:
        observations = vector.step(action)[0]
        own = [env.step(action[k])[0] for k, env in enumerate(alone)]
        np.testing.assert_array_equal(observations, own)
    assert vector.robots["course"]["count"].tolist() == [len(env.course.gates) for env in alone]


# ---- ends of episodes ----


def test_flying_into_a_wall_is_a_hit():
    env = make(course=Course((Gate("wall", 2.5, 2.7, 1.5),), Pose2(5.5)))
    env.reset(seed=0)
    info = go(env, 60, target=Target(True, 5.0, 0.0, 0.8, speed=1.0, narrow=1.0))
    assert info["failure"] == "hit"
    assert info["most_hit_n"] > MAX_HIT
    assert not info["is_success"]


def test_an_empty_battery_ends_it_and_a_weak_one_lifts_less():
    env = make(course=SHORT, charge=0.01, battery=True)
    env.reset(seed=0)
    assert go(env, 60)["failure"] == "empty"
    lifts = []
    for charge in (1.0, 0.02):
        env = make(course=SHORT, charge=charge, battery=True, action_mode="direct")
        env.reset(seed=0)
        _, _, _, _, info = env.step(np.ones(40))
        for _ in range(10):
            _, _, _, _, info = env.step(np.ones(40))
        lifts.append(info["total_thrust"])
    assert lifts[1] < 0.95 * lifts[0]


def test_leaving_the_field_ends_it():
    env = make(course=SHORT, action_mode="direct")
    env.reset(seed=0)
    action = np.zeros(40)
    action[:8] = 1.0
    for _ in range(200):
        _, _, over, _, info = env.step(action)
        if over:
            break
    assert info["failure"] in ("out", "tilt", "hit")


def test_lying_at_the_start_is_safe_and_no_success():
    env = make(course=SHORT)
    env.reset(seed=0)
    for _ in range(6):
        _, reward, over, _, info = env.step(np.zeros(8))
    assert not over
    assert info["lies"]
    assert not info["is_success"]
    assert info["phase"] in PHASES
    assert reward < 0.3


@pytest.mark.parametrize(
    ("options", "word"),
    [
        ({"course": {"gates": [["wall", 1.5, 1.7, 0.5, 0.0]], "goal": [1.6, 0.0, 0.0]}}, "goal"),
        ({"course": {"gates": [["beam", 2.0, 2.4, 0.3, 0.0]], "goal": [5.0, 0.0, 0.0]}}, "size of a beam"),
        ({"course": {"gates": [["wall", 3.0, 3.2, 3.5, 0.0]], "goal": [9.0, 0.0, 0.0]}}, "size of a wall"),
        ({"course": {"gates": [["slot", 3.0, 3.2, 0.9, 0.0]], "goal": [9.0, 0.0, 0.0]}}, "size of a slot"),
        ({"course": {"gates": [["wall", 3, 3.4, 0.5], ["beam", 3.2, 3.6, 0.6]], "goal": [9, 0, 0]}}, "begin"),
        ({"course": {"gates": [["hedge", 3.0, 3.2, 0.9, 0.0]], "goal": [9.0, 0.0, 0.0]}}, "unknown gate 'hedge'"),
        ({"course": {"gates": [["wall", 3.0, float("nan"), 0.9, 0.0]], "goal": [9.0, 0.0, 0.0]}}, "end"),
        ({"course": {"gates": [], "goal": [float("nan"), 0.0, 0.0]}}, "x"),
        ({"course": {"gates": [], "goal": [3.0, 0.0]}, "charge": 2.0}, "charge"),
        ({"course": [1, 2]}, "course"),
        ({"course": {"gates": [["wall"]], "goal": [5.0, 0.0, 0.0]}}, "course"),
        ({"gates": ("door",)}, "gate"),
        ({"floors": ()}, "gate"),
        ({"count": (3, 2)}, "count"),
        ({"charge": 0.0}, "charge"),
        ({"charge": float("nan")}, "charge"),
        ({"joint_speed": -1.0}, "joint_speed"),
        ({"hold": 0}, "hold"),
        ({"action_mode": "teleport"}, "action mode"),
    ],
)
def test_bad_options_are_refused_in_one_line(options, word):
    with pytest.raises((InvalidValueError, UnknownNameError), match=word) as error:
        make(**options)
    assert "\n" not in str(error.value)
    assert re.search(r"is not valid; expected .|valid: .", str(error.value))


def test_a_bad_course_at_reset_changes_nothing():
    env = make(course=SHORT)
    env.reset(seed=0)
    with pytest.raises(InvalidValueError, match="y = 9"):
        env.reset(seed=1, options={"course": {"gates": [], "goal": [1.0, 9.0, 0.0]}})
    with pytest.raises(InvalidValueError, match="action"):
        env.step(np.full(8, np.nan))
    assert env.course == SHORT
    assert env.ticks == 0


@pytest.mark.parametrize(("mode", "size"), [("waypoint", 8), ("residual", 23), ("direct", 40)])
@pytest.mark.parametrize("wrong", [np.nan, np.inf])
def test_an_action_without_a_number_is_refused_and_nothing_moves_alone_or_side_by_side(mode, size, wrong):
    env, vector = make(action_mode=mode), NativeVectorEnv(COURSE, 2, action_mode=mode)
    env.reset(seed=0)
    vector.reset(seed=0)
    before, place = vector.robots.tobytes(), env.state.position_w.copy()
    action, actions = np.zeros(size), np.zeros((2, size))
    action[-1] = actions[1, 0] = wrong
    for step, given in ((env.step, action), (vector.step, actions)):
        with pytest.raises(InvalidValueError, match="expected finite numbers within −1 … 1"):
            step(given)
    assert vector.robots.tobytes() == before
    np.testing.assert_array_equal(env.state.position_w, place)
    vector.close()


def test_a_bad_course_of_one_robot_changes_none():
    vector = NativeVectorEnv(COURSE, 2)
    vector.reset(seed=0)
    before = vector.robots.tobytes()
    bad = {"gates": [["wall", 3.0, 3.2, 2.5, 0.0]], "goal": [9.0, 0.0, 0.0]}
    with pytest.raises(InvalidValueError, match=r"size of a wall = 2.5 is not valid; expected within 0 … 2 m"):
        vector.reset(options={"course": [plain_course(SHORT), bad]})
    assert vector.robots.tobytes() == before
    vector.close()
