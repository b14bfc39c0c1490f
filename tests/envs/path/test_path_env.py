"""Pins Path-v0: its paths, equal flights by the core and by a Python controller, and their accuracy."""

import math
from itertools import product
from typing import Any

import gymnasium
import numpy as np
import pytest
from support.vectors import DRAWN

from spidar_gym.control.flight.path import AHEAD, AHEAD_STEP, Path, legs
from spidar_gym.envs.hover_env import HoverEnv
from spidar_gym.envs.path_env import PathEnv
from spidar_gym.envs.registry import HOVER, PATH
from spidar_gym.envs.vector import NativeVectorEnv
from spidar_gym.errors import InvalidValueError, UnknownNameError
from spidar_gym.native.structs import fill
from spidar_gym.so3 import exp, log, quat_to_matrix
from spidar_gym.tasks.hover import HoverTask, hover_height
from spidar_gym.tasks.path import CLIMB, PATH_BEGIN, SPEEDS, PathTask
from spidar_gym.tasks.start import draw_start

KINDS, HEADINGS = ("legs", "lemniscate", "spline"), ("kept", "along")
FAST: dict[str, Any] = {"forms": "independent", "joint_speed": 0.6}


def make(**options):
    return gymnasium.make(PATH, disable_env_checker=True, **options).unwrapped


def drawn(seeds, **options):
    """Paths of a task, one for each seed."""
    task = PathTask(**options)
    return [draw_start(task, np.random.default_rng(seed)).path for seed in seeds]


def sampled(path, step=0.02, until=20.0):
    return np.array([path.at(t) for t in np.arange(0.0, until, step)])


# ---- random paths ----


@pytest.mark.parametrize(("kind", "heading"), [*product(KINDS, HEADINGS)])
def test_a_random_path_begins_at_the_start_stays_within_bounds_and_outlasts_the_episode(kind, heading):
    for path in drawn(range(20), path=kind, heading=heading):
        np.testing.assert_allclose(path.pose_w[0, :3], [0.0, 0.0, hover_height()], atol=1e-12)
        rows = sampled(path)
        assert (np.linalg.norm(rows[:, 0, :2], axis=1) < 4.5).all()
        low, high = rows[:, 0, 2].min() - hover_height(), rows[:, 0, 2].max() - hover_height()
        assert low > -0.3
        assert high < CLIMB + 0.3
        np.testing.assert_array_equal(rows[: round(PATH_BEGIN / 0.02), 1], 0.0)
        assert path.seconds > 20.0
        speed = np.linalg.norm(rows[:, 1, :3], axis=1)
        assert 0.2 < speed.max() < 1.6 * SPEEDS[1]
        assert np.linalg.norm(rows[:, 2, :3], axis=1).max() < 8.0
        if heading == "kept":
            np.testing.assert_array_equal(rows[:, 0, 3], 0.0)


def test_kinds_speeds_and_headings_have_the_documented_frequencies():
    task = PathTask()
    paths = [draw_start(task, np.random.default_rng(seed)).path for seed in range(400)]
    turns = np.array([np.abs(path.rate_w[:, 3]).max() > 0.0 or path.pose_w[0, 3] != 0.0 for path in paths])
    assert 0.42 < turns.mean() < 0.58
    is_eight = np.array([np.ptp(np.diff(path.times)) < 1e-9 for path in paths])
    rests = np.array([(np.linalg.norm(path.rate_w[1:-1], axis=1) == 0.0).any() for path in paths])
    assert 0.18 < is_eight.mean() < 0.32
    assert 0.18 < (rests & ~is_eight).mean() < 0.32
    eights = [path for path, is_one in zip(paths, is_eight, strict=True) if is_one]
    fastest = [np.linalg.norm(sampled(path, 0.1)[:, 1, :3], axis=1).max() for path in eights]
    assert min(fastest) < SPEEDS[0] + 0.1
    assert max(fastest) > SPEEDS[1] - 0.1


@pytest.mark.parametrize("speed", [0.05, 3.0])
@pytest.mark.parametrize("kind", KINDS)
def test_every_random_path_fits_the_number_of_knots(kind, speed):
    for horizon in (0.5, 20.0, 90.0):
        task = PathTask(path=kind, speed=speed, horizon_s=horizon)
        for seed in range(12):
            assert len(draw_start(task, np.random.default_rng(seed)).path.times) <= task.most_knots


# ---- engine, task in Python and Python controller ----


@pytest.mark.parametrize(
    "options",
    [
        *({"path": kind, "heading": heading} for kind, heading in product(KINDS, HEADINGS)),
        {"preset": "paper", "speed": 1.0},
        {"action_mode": "residual", **DRAWN},
    ],
)
def test_the_engine_flies_as_the_python_controller_does(options):
    engine, readable = (make(**{"preset": "tuned", **FAST, **options}, control=c) for c in ("core", "python"))
    rng = np.random.default_rng(1)
    for seed in (2, 3):
        (seen, _), (expected, _) = engine.reset(seed=seed), readable.reset(seed=seed)
        for name in ("times", "pose_w", "rate_w", "acceleration_w"):
            np.testing.assert_allclose(getattr(engine.path, name), getattr(readable.path, name), rtol=0, atol=1e-11)
        for _ in range(70):
            np.testing.assert_allclose(seen, expected, rtol=0, atol=1e-6)
            action = rng.uniform(-0.3, 0.3, engine.action_space.shape)
            seen, reward, over, _, info = engine.step(action)
            expected, due, ended, _, known = readable.step(action)
            assert reward == pytest.approx(due, abs=1e-9)
            assert over == ended
            for name in ("position_error", "attitude_error", "wrench_desired"):
                np.testing.assert_allclose(info[name], known[name], rtol=0, atol=1e-8)


class Restating(PathTask):
    """A path task whose references pass through Python unchanged."""

    def reference(self, robots):
        return super().reference(robots)


@pytest.mark.parametrize("mode", ["NextStep", "SameStep", "Disabled"])
def test_references_that_pass_through_python_unchanged_change_nothing(mode):
    options: dict[str, Any] = {"autoreset_mode": mode, "max_episode_steps": 60, "horizon_s": 20.0, **FAST}
    own, built_in = (NativeVectorEnv(PATH, 4, task=task, **options) for task in (Restating, None))
    (seen, _), (expected, _) = own.reset(seed=7), built_in.reset(seed=7)
    for _ in range(130):
        np.testing.assert_array_equal(seen, expected)
        seen, rewards, *ends, info = own.step(np.zeros((4, 6)))
        expected, due, *others, known = built_in.step(np.zeros((4, 6)))
        np.testing.assert_array_equal(rewards, due)
        for name in ("position_error", "attitude_error", "term", "is_success", "wrench_desired"):
            np.testing.assert_array_equal(info[name], known[name])
        assert np.array_equal(ends, others)
        over = np.logical_or(*ends)
        if mode == "Disabled" and over.any():
            seen, _ = own.reset(options={"reset_mask": over})
            expected, _ = built_in.reset(options={"reset_mask": over})


def test_a_robot_in_a_vector_flies_like_a_single_one_and_continues_in_another_place():
    vector, single = NativeVectorEnv(PATH, 3, num_threads=2, **FAST, **DRAWN), make(**FAST, **DRAWN)
    vector.reset(seed=5)
    single.reset(seed=6)
    for _ in range(60):
        seen, *_ = vector.step(np.zeros((3, 6)))
        expected, *_ = single.step(np.zeros(6))
        np.testing.assert_array_equal(seen[1], expected)
    other = NativeVectorEnv(PATH, 2, **FAST, **DRAWN)
    other.reset(seed=0)
    other.restore(vector.save([1]), [0])
    for _ in range(20):
        np.testing.assert_array_equal(other.step(np.zeros((2, 6)))[0][0], vector.step(np.zeros((3, 6)))[0][1])


# ---- errors and accuracy ----


@pytest.mark.parametrize("control", ["core", "python"])
def test_errors_and_preview_refer_to_the_present_point_of_the_path(control):
    """A delay of one tick at 1.5 m/s would be 37 mm."""
    env = make(path="spline", heading="along", speed=1.5, preset="tuned", control=control, **FAST)
    env.reset(seed=4)
    model, starts, at = env.controller.model, {}, 0
    for field in env.layout:
        starts[field.name] = slice(at, at + field.size)
        at += field.size
    for tick in range(1, 161):
        seen, *_, info = env.step(np.zeros(6))
        if tick % 20:
            continue
        state, (pose, rate, acceleration) = env.state, env.path.at(tick / 40.0)
        R_wb = quat_to_matrix(state.quat_wb)
        com_w = state.position_w + R_wb @ model.snapshot(state.joint_position, R_wb, state.vectoring).com_b
        np.testing.assert_allclose(info["position_error"], pose[:3] - com_w, rtol=0, atol=1e-12)
        R_d = exp(np.array([0.0, 0.0, pose[3]]))
        np.testing.assert_allclose(info["attitude_error"], log(R_wb.T @ R_d), rtol=0, atol=1e-9)
        later = np.array([env.path.at(tick / 40.0 + AHEAD_STEP * (k + 1))[0] for k in range(AHEAD)]) - pose
        for name, wanted in (
            ("path_ahead", later[:, :3] @ R_wb),
            ("path_turn", later[:, 3]),
            ("path_velocity", rate[:3] @ R_wb),
            ("path_acceleration", acceleration[:3] @ R_wb),
            ("position_error", info["position_error"] @ R_wb),
        ):
            np.testing.assert_allclose(seen[starts[name]], wanted.reshape(-1), rtol=0, atol=1e-5)


@pytest.mark.parametrize("control", ["core", "python"])
def test_errors_refer_to_the_present_custom_reference(control):
    """A hover whose reference moves: errors refer to the present reference, not to that of the previous tick."""

    class Moving(HoverTask):
        def reference(self, robots):
            path = legs([(0.0, 0.0, hover_height()), (3.0, 0.0, hover_height())], 1.0)
            wanted = super().reference(robots)
            fill(wanted[0], path.reference(float(robots.time[0]), wanted[0]["joint_target"]))
            return wanted

    env = HoverEnv(task=Moving, forms="form1", preset="tuned", perturbation=0.0, control=control)
    env.reset(seed=0)
    for _ in range(80):
        *_, info = env.step(np.zeros(6))
        # Form ① has its CoG close to the torso's axis; a tick is 25 mm.
        off = env.reference().position_w[0] - env.state.position_w[0]
        assert info["position_error"][0] == pytest.approx(off, abs=4e-3)
    assert abs(info["position_error"][0]) < 0.02


@pytest.mark.slow
@pytest.mark.parametrize(
    ("options", "position", "attitude"),
    [
        ({"heading": "kept"}, 0.03, 0.02),
        ({"heading": "along"}, 0.03, 0.02),
        ({"randomization": 1.0, "sensors": True}, 0.06, 0.04),
    ],
)
def test_the_tuned_controller_follows_a_lemniscate_at_a_metre_a_second(options, position, attitude):
    """Within these tolerances; the paper's controller, which reacts to errors alone, is over four times as far off."""
    rms = {}
    for preset in ("tuned", "paper"):
        vector = NativeVectorEnv(PATH, 3, num_threads=2, path="lemniscate", speed=1.0, preset=preset, **FAST, **options)
        vector.reset(seed=0)
        errors = []
        for _ in range(799):
            *_, terminated, _, info = vector.step(np.zeros((3, 6)))
            assert not terminated.any()
            errors.append([info["position_error"], info["attitude_error"]])
        rms[preset] = np.sqrt((np.array(errors)[40:] ** 2).sum(axis=3).mean(axis=0)).max(axis=1)
    assert rms["tuned"][0] < position
    assert rms["tuned"][1] < attitude
    assert rms["paper"][0] > 4.0 * rms["tuned"][0]


def test_a_given_start_is_flown_as_the_sampled_one_was():
    env = make(**FAST)
    env.reset(seed=9)
    path, progress, record = env.path, env.progress, env.fleet.robots[0]
    rows = np.column_stack([path.times, path.pose_w, path.rate_w, path.acceleration_w])
    start = {
        "goals": [[goal.start, goal.deadline, goal.joint_target.tolist()] for goal in progress.goals],
        "position": record["offset"].tolist(), "rotation": record["rotation"].tolist(), "path": rows.tolist(),
    }  # fmt: skip
    flown = [env.step(np.zeros(6))[0] for _ in range(50)]
    env.reset(seed=1, options={"start": start})
    np.testing.assert_array_equal([env.step(np.zeros(6))[0] for _ in range(50)], flown)
    # Without a path the same environment hovers.
    env.reset(seed=1, options={"start": {**start, "path": None}})
    assert env.path is None
    np.testing.assert_array_equal(env.reference().velocity_w, 0.0)


@pytest.mark.parametrize(
    ("options", "kind", "match"),
    [
        ({"path": "circle"}, UnknownNameError, "legs, lemniscate, spline, mixed"),
        ({"heading": "back"}, UnknownNameError, "kept, along, mixed"),
        ({"speed": 9.0}, InvalidValueError, "0.05 … 3"),
        ({"speed": math.nan}, InvalidValueError, "0.05 … 3"),
        ({"speed": -1.0}, InvalidValueError, "0.05 … 3"),
    ],
)
def test_invalid_paths_are_refused(options, kind, match):
    with pytest.raises(kind, match=match):
        make(**options)


@pytest.mark.parametrize(
    "path", [[[0.0] * 12], [[0.0] * 13] * 2, [[math.nan, *[0.0] * 12]], "away", [[0.0, 1e9, *[0.0] * 11]]]
)
def test_a_start_with_invalid_knots_is_refused_and_nothing_has_changed(path):
    env = make(forms="form1")
    env.reset(seed=0)
    start = {"goals": [[0.0, 0.0, [0.0] * 16]], "position": [0.0] * 3, "rotation": [0.0] * 3, "path": path}
    before = env.path
    with pytest.raises(InvalidValueError):
        env.reset(options={"start": start})
    np.testing.assert_array_equal(env.path.pose_w, before.pose_w)


def test_a_hover_has_no_path():
    env = gymnasium.make(HOVER).unwrapped
    env.reset(seed=0)
    assert env.path is None
    assert isinstance(make(), PathEnv)
    assert Path(np.zeros(1), *np.zeros((3, 1, 4))).seconds == 0.0
