"""Pins the pictures: shape and type, the robot in every camera's view, depth in metres, refusals, closing."""

import ctypes.util
import math
import os
import subprocess
import sys
import threading

import gymnasium
import numpy as np
import pytest

from spidar_gym.errors import SpidarError, UnknownNameError
from spidar_gym.native.plant import Plant
from spidar_gym.robot import FORMS
from spidar_gym.robot.description import CAMERAS
from spidar_gym.sim.renderer import OffscreenRenderer, Window, require_display
from spidar_gym.tasks.hover import hover_height

HOVER = "spidar_gym/Hover-v0"
WIDTH, HEIGHT = 64, 48
drawing = pytest.mark.skipif(
    not (ctypes.util.find_library("EGL") or ctypes.util.find_library("OSMesa")), reason="no OpenGL library"
)


@pytest.fixture(scope="module")
def plant() -> Plant:
    plant = Plant()
    plant.reset(np.array([0.0, 0.0, hover_height()]), joint_position=FORMS["form2"])
    return plant


@pytest.fixture
def no_display(monkeypatch):
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)


@drawing
@pytest.mark.parametrize("mode", ["rgb_array", "depth_array"])
def test_an_environment_renders_pictures_of_the_requested_size_without_a_display(mode, no_display):
    env = gymnasium.make(HOVER, render_mode=mode, width=WIDTH, height=HEIGHT)
    env.reset(seed=0)
    image = env.render()
    env.close()
    env.close()
    if mode == "rgb_array":
        assert (image.shape, image.dtype) == ((HEIGHT, WIDTH, 3), np.uint8)
    else:
        assert (image.shape, image.dtype) == ((HEIGHT, WIDTH), np.float32)
        assert np.all(image > 0.0)


@drawing
@pytest.mark.parametrize(
    ("first", "named"),
    [
        ("mujoco", {}),
        ("spidar_gym.cli.bench", {}),
        ("spidar_gym", {"DISPLAY": ":99", "MUJOCO_GL": ""}),
        ("spidar_gym", {"DISPLAY": "", "WAYLAND_DISPLAY": "nowhere-0"}),
    ],
)
def test_pictures_need_no_display_whatever_was_imported_first(first, named):
    script = (
        f"import {first}, gymnasium, spidar_gym\n"
        f"env = gymnasium.make('{HOVER}', render_mode='rgb_array', width=32, height=24)\n"
        "env.reset(seed=0)\n"
        "print(env.render().shape)\n"
    )
    unset = {"DISPLAY", "WAYLAND_DISPLAY", "MUJOCO_GL", "PYOPENGL_PLATFORM"}
    environment = {name: value for name, value in os.environ.items() if name not in unset} | named
    done = subprocess.run([sys.executable, "-c", script], env=environment, capture_output=True, text=True, check=False)
    assert done.stdout == "(24, 32, 3)\n", done.stderr


@drawing
@pytest.mark.parametrize("camera", CAMERAS)
def test_every_camera_shows_the_robot_in_the_middle_and_follows_it(camera, plant):
    renderer = OffscreenRenderer(camera, WIDTH, HEIGHT)
    depth = renderer.render(plant.data.qpos, depth=True)
    picture = renderer.render(plant.data.qpos).astype(int)
    away = np.linalg.norm(np.array(CAMERAS[camera][0].split(), float))
    robot = np.zeros_like(depth, bool)
    robot[HEIGHT // 4 : 3 * HEIGHT // 4, WIDTH // 4 : 3 * WIDTH // 4] = True
    robot &= depth < away + 0.35  # the floor is farther away
    assert depth[robot].min() > away - 1.5
    assert 0.01 < robot.mean() < 0.25
    assert np.ptp(picture[robot], axis=0).max() > 60
    state = plant.state()
    try:
        plant.reset(state.position_w + (7.0, -4.0, 0.0), joint_position=FORMS["form2"])
        np.testing.assert_allclose(renderer.render(plant.data.qpos, depth=True)[robot], depth[robot], rtol=0, atol=0.02)
        plant.reset(state.position_w, joint_position=FORMS["form1"])
        assert np.abs(renderer.render(plant.data.qpos) - picture).max() > 60
    finally:
        plant.reset(state.position_w, joint_position=FORMS["form2"])
        renderer.close()
        renderer.close()


@drawing
def test_depth_is_the_distance_to_the_floor_in_metres(plant):
    renderer = OffscreenRenderer("top", WIDTH, HEIGHT)
    depth = renderer.render(plant.data.qpos, depth=True)
    renderer.close()
    up = plant.data.camera("top").xpos[2]
    assert abs(up - plant.data.subtree_com[plant.model.body("torso").id][2] - 3.6) < 0.1
    np.testing.assert_allclose([depth[0, 0], depth[-1, -1]], up, rtol=0, atol=0.02)


@drawing
def test_a_returned_picture_does_not_change_with_the_next(plant):
    renderer = OffscreenRenderer("side", WIDTH, HEIGHT)
    first = renderer.render(plant.data.qpos)
    before = first.copy()
    plant.data.qpos[2] += 0.5
    second = renderer.render(plant.data.qpos)
    plant.data.qpos[2] -= 0.5
    renderer.close()
    assert np.array_equal(first, before)
    assert not np.array_equal(first, second)


@drawing
def test_rendering_changes_nothing_of_the_flight():
    plain = gymnasium.make(HOVER, forms="form1")
    filmed = gymnasium.make(HOVER, forms="form1", render_mode="rgb_array", width=WIDTH, height=HEIGHT)
    for env in (plain, filmed):
        env.reset(seed=0)
    for _ in range(3):
        filmed.render()
        ours, theirs = (env.step(np.zeros(6))[0] for env in (plain, filmed))
        assert np.array_equal(ours, theirs)
    filmed.close()


@drawing
def test_a_picture_larger_than_the_buffer_is_refused_with_the_largest(plant):
    with pytest.raises(SpidarError, match="1920 × 1080"):
        OffscreenRenderer("chase", 4000, HEIGHT)


def test_an_unknown_camera_is_refused_with_the_names_of_all():
    with pytest.raises(UnknownNameError, match=", ".join(CAMERAS)):
        OffscreenRenderer("back", WIDTH, HEIGHT)


@pytest.mark.parametrize("screen", ["", ":99", "nonsense"])
def test_a_window_without_a_display_is_refused_with_the_modes_that_need_none(screen, no_display, monkeypatch):
    monkeypatch.setenv("DISPLAY", screen)
    env = gymnasium.make(HOVER, render_mode="human")
    for attempt in (require_display, lambda: Window(0.025), lambda: env.reset(seed=0)):
        with pytest.raises(SpidarError, match=f"{screen}.*; valid .*rgb_array"):
            attempt()
    env.close()


def test_rendering_without_a_mode_warns_with_the_valid_ones():
    env = gymnasium.make(HOVER).unwrapped
    env.reset(seed=0)
    with pytest.warns(UserWarning, match="human, rgb_array, depth_array"):
        assert env.render() is None


@pytest.mark.parametrize("camera", CAMERAS)
def test_cameras_look_at_the_robot_with_the_horizon_level(camera, plant):
    found = plant.model.camera(camera)
    R = plant.data.camera(camera).xmat.reshape(3, 3)
    position, target = (np.array(text.split(), float) for text in CAMERAS[camera])
    line = (target - position) / math.hypot(*(target - position))
    np.testing.assert_allclose(-R[:, 2], line, rtol=0, atol=1e-6)
    assert abs(R[2, 0]) < 1e-9
    assert R[2, 1] > -1e-9
    assert found.bodyid[0] == plant.model.body("torso").id


@drawing
def test_the_same_state_gives_the_same_bytes_from_the_first_picture_on_and_from_any_thread():
    ids = ("spidar_gym/Hover-v0", "spidar_gym/Path-v0", "spidar_gym/Crawl-v0", "spidar_gym/Course-v0")
    envs = [gymnasium.make(name, render_mode="rgb_array", width=WIDTH, height=HEIGHT) for name in ids]
    vector = gymnasium.make_vec("spidar_gym/Course-v0", 2, render_mode="rgb_array", width=WIDTH, height=HEIGHT)
    drawn: list[list[bytes]] = []

    def draw():
        own = [np.asarray(env.render()).tobytes() for env in envs]
        drawn.append(own + [picture.tobytes() for picture in vector.render()])

    for seed in (0, 1):
        for env in (*envs, vector):
            env.reset(seed=seed)
        drawn.clear()
        draw()
        threads = [threading.Thread(target=draw) for _ in range(3)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert drawn == [drawn[0]] * 4
        assert len({*drawn[0]}) > 2
    closer = threading.Thread(target=lambda: [env.close() for env in (*envs, vector)])
    closer.start()
    closer.join()
    for env in (*envs, vector):
        with pytest.raises(SpidarError, match="is closed"):
            env.render()
