"""Pins the films: real time, 30 pictures a second, 1280 × 720, a camera that shows the sink, two side by side."""

import ctypes.util
import re
import subprocess
from itertools import pairwise

import numpy as np
import pytest

from spidar_gym import viz
from spidar_gym.cli.main import main
from spidar_gym.control.flight.controller import CONTROL_RATE
from spidar_gym.errors import UnknownNameError
from spidar_gym.native.plant import Plant
from spidar_gym.robot import FORMS
from spidar_gym.sim.ground import TILES, GroundConfig
from spidar_gym.sim.stage import Stage, between, extent, hidden, standing
from spidar_gym.tasks.hover import hover_height
from spidar_gym.viz import reel
from spidar_gym.viz.film import FPS, SIZE, STRIP, flight_phase, tick_at

pytestmark = pytest.mark.skipif(
    not (ctypes.util.find_library("EGL") or ctypes.util.find_library("OSMesa")), reason="no OpenGL library"
)
WINDOW = 0.1, 0.9, 0.2, 0.8


def qpos_at(height, form="form2"):
    plant = Plant()
    plant.reset(np.array([0.0, 0.0, height]), joint_position=FORMS[form])
    return plant.data.qpos.copy()


@pytest.fixture(scope="module")
def sinking():
    """Return a take of a robot that sinks by 0.4 m in a fifth of a second."""
    ticks = 8
    first, last = qpos_at(hover_height() + 0.5), qpos_at(hover_height() + 0.1)
    qpos = np.array([between(first, last, k / (ticks - 1)) for k in range(ticks)])
    time = np.arange(1, ticks + 1) / CONTROL_RATE
    error = np.zeros((ticks, 3))
    return viz.Take("one", time, qpos, np.full((ticks, 8), 20.0), ["hover"] * ticks,
                    viz.flight_traces(qpos, error, error))  # fmt: skip


def read(path):
    """Read a film: frames per second, width and height, and frames (n, height, width, 3)."""
    ffmpeg = pytest.importorskip("imageio_ffmpeg").get_ffmpeg_exe()
    command = [ffmpeg, "-i", str(path), "-f", "rawvideo", "-pix_fmt", "rgb24", "-fps_mode", "passthrough", "-"]
    done = subprocess.run(command, capture_output=True, check=True)
    (size, fps) = re.search(r"Video: .*?, (\d+x\d+)\D.*?([\d.]+) fps", done.stderr.decode()).groups()
    width, height = map(int, size.split("x"))
    return (
        float(fps),
        (width, height),
        np.frombuffer(done.stdout, np.uint8).reshape(-1, height, width, 3).astype(np.int16),
    )


def dark_rows(frame):
    """Return the mean row of the dark pixels above the strip [px from the top], which are the robot's rods and fans."""
    picture = frame[80 : SIZE[1] - STRIP - 10]
    return np.argwhere(picture.max(axis=2) < 70)[:, 0].mean()


def test_a_film_is_in_real_time_and_the_sink_goes_down_in_it(sinking, tmp_path):
    viz.film_take(sinking, tmp_path / "film.mp4")
    fps, size, frames = read(tmp_path / "film.mp4")
    assert fps == FPS == 30
    assert size == SIZE == (1280, 720)
    assert len(frames) == round(FPS * float(sinking.time[-1]))
    heights = [dark_rows(frame) for frame in frames]
    assert all(later > earlier + 5.0 for earlier, later in pairwise(heights))
    # The time mark moves through the plots of the strip from left to right.
    marks = [next(x for x in range(62, SIZE[0]) if (frame[-100, x] < 90).all()) for frame in frames]
    assert all(later > earlier for earlier, later in pairwise(marks))
    assert [path.name for path in tmp_path.iterdir()] == ["film.mp4"]


def test_two_takes_stand_side_by_side_and_the_film_lasts_as_long_as_the_longer_one(sinking, tmp_path):
    short = viz.Take("two", sinking.time[:2], sinking.qpos[:2], sinking.thrust[:2], ["hover"] * 2,
                     {name: trace[:2] for name, trace in sinking.traces.items()})  # fmt: skip
    with viz.Film(tmp_path / "film.mp4") as film:
        film.shoot(sinking, short)
    _, size, frames = read(tmp_path / "film.mp4")
    assert size == SIZE
    assert len(frames) == round(FPS * float(sinking.time[-1]))
    left, right = frames[:, :, : SIZE[0] // 2], frames[:, :, SIZE[0] // 2 :]
    assert dark_rows(left[-1]) - dark_rows(left[0]) > 30.0
    assert abs(dark_rows(right[-1]) - dark_rows(right[1])) < 2.0
    # Both have the same camera: at equal heights the pictures differ in their captions only.
    below = slice(90, SIZE[1] - STRIP - 10), slice(8, -8)
    assert np.abs(left[0] - right[0])[below].mean() < 2.0 < np.abs(left[0] - left[-1])[below].mean()


@pytest.mark.parametrize("fails", ["render", "close"])
def test_an_interrupted_film_leaves_no_file(sinking, tmp_path, monkeypatch, fails):
    def interrupt(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(Stage, fails, interrupt)
    with pytest.raises(KeyboardInterrupt):
        viz.film_take(sinking, tmp_path / "film.mp4")
    assert list(tmp_path.iterdir()) == []


def test_what_is_drawn_anew_gives_the_same_picture_as_drawing_all_of_it(sinking):
    camera = standing(extent(sinking.qpos), 4 / 3, WINDOW)
    stage = Stage(camera, 320, 240)
    contacts = np.array([[0.3, 0.2, 0.0, 5.0, 0.0, 60.0]])
    try:
        for form, height in (("form1", 1.2), ("form3", 0.9), ("form2", 2.0), ("form1", 9.0)):
            for forces in (None, contacts):
                qpos = qpos_at(height, form)
                part = stage.render(qpos, thrust=np.full(8, 30.0), contacts=forces).astype(int)
                whole = stage.render(qpos, thrust=np.full(8, 30.0), contacts=forces, whole=True).astype(int)
                # Edges may fall on one side of a sample or the other.
                assert (np.abs(part - whole).max(axis=2) > 8).mean() < 1e-3, (form, height)
    finally:
        stage.close()
        stage.close()


@pytest.mark.parametrize("ground", [GroundConfig(slope=0.1, heading=0.5), GroundConfig(tiles=np.eye(TILES) * 0.02)])
def test_a_floor_that_slopes_or_has_tiles_does_not_lie_in_its_own_shadow(ground):
    stage = Stage(standing(np.array([[-2.0, -2.0, 0.0], [2.0, 2.0, 0.0]]), 4 / 3, WINDOW), 320, 240, ground)
    try:
        lit = stage.render(qpos_at(90.0)).astype(int)
        stage._model.light_castshadow[:] = 0
        unshaded = stage.render(qpos_at(90.0), whole=True).astype(int)
    finally:
        stage.close()
    assert np.abs(lit - unshaded).max() < 30  # a shadow is darker by 60 and more


def test_a_box_hides_a_point_only_between_it_and_the_eye():
    turn = np.array([[0.6, -0.8, 0.0], [0.8, 0.6, 0.0], [0.0, 0.0, 1.0]])
    eye, point = np.array([1.0, 2.0, 0.5]), np.array([[9.0, 2.0, 0.5]])
    places = {  # centre and half size of a box turned by 53° about z
        "between": ([5.0, 2.0, 0.5], [0.1, 0.1, 0.1]), "round the eye": ([1.0, 2.0, 0.5], [0.5, 0.5, 0.5]),
        "beyond": ([11.0, 2.0, 0.5], [0.5, 0.5, 0.5]), "behind the eye": ([-1.0, 2.0, 0.5], [0.5, 0.5, 0.5]),
        "beside": ([5.0, 3.0, 0.5], [0.9, 0.3, 1.0]), "below": ([5.0, 2.0, 0.0], [9.0, 9.0, 0.4]),
        "reached by its turned edge": ([5.0, 3.0, 0.5], [1.3, 0.3, 1.0]),
    }  # fmt: skip
    centre, half = (np.array(list(column)) for column in zip(*places.values(), strict=True))
    found = hidden(eye, point, centre, np.broadcast_to(turn, (len(places), 3, 3)), half)
    assert {name for name, hides in zip(places, found, strict=True) if hides} == {
        "between", "round the eye", "reached by its turned edge",
    }  # fmt: skip


def test_pieces_become_one_animated_picture_at_their_pace(sinking, tmp_path):
    from PIL import Image

    cuts = [reel.Cut("one", sinking, 0.0, 0.2, 0.5), reel.Cut("two", sinking, 0.1, 0.2, 0.25, "side")]
    reel.write_reel(cuts, tmp_path / "film.gif")
    with Image.open(tmp_path / "film.gif") as film:
        assert film.size == reel.SIZE
        assert film.n_frames == 2 * 4  # 0.2 s at half the pace, and 0.1 s at a quarter, are 0.4 s each
        assert film.info["loop"] == 0
        assert film.info["duration"] == 1000.0 / reel.FPS
        pictures = []
        for k in range(film.n_frames):
            film.seek(k)
            pictures.append(np.asarray(film.convert("RGB")).astype(int))
    heights = [dark_rows(p).mean() for p in pictures[:4]]
    assert heights == sorted(heights)
    assert heights[-1] > heights[0] + 5.0  # it sinks


def test_a_box_that_hides_the_robot_from_a_camera_that_follows_fades_and_comes_back():
    boxes = np.zeros_like(GroundConfig().boxes)
    boxes[0, :6] = -1.0, -0.9, 1.5, 0.05, 1.5, 1.5
    feet = []
    for ground in (GroundConfig(), GroundConfig(boxes=boxes)):
        stage = Stage("chase", 320, 180, ground)
        try:
            here, away = qpos_at(1.0), qpos_at(1.0) + np.eye(len(qpos_at(1.0)))[0] * 6.0
            stage.render(away)
            pictures = [stage.render(here).astype(int) for _ in range(60)]
            for _ in range(60):
                stage.render(away)
            pictures.append(stage.render(here).astype(int))
        finally:
            stage.close()
        # The feet are the only orange things; a wall before them takes their colour away.
        feet.append([int(((p[..., 0] - p[..., 2]) > 60).sum()) for p in (pictures[0], pictures[-2], pictures[-1])])
    (clear, *others), (at_first, faded, later) = feet
    assert others == [clear, clear]
    assert clear > 20
    assert max(at_first, later) < 0.5 * clear
    assert faded > 0.8 * clear


def test_the_camera_that_stands_sees_the_whole_way_as_near_as_the_window_allows():
    rng = np.random.Generator(np.random.PCG64(5))
    for _ in range(5):
        points = rng.uniform(-2.0, 2.0, (40, 3)) + rng.uniform(-5.0, 5.0, 3)
        camera = standing(points, 16 / 9, WINDOW)
        stage = Stage(camera, 320, 180)
        try:
            stage.render(qpos_at(1.0))
            eye = stage._picture.camera[0], stage._picture.camera[1]
            place = (np.array(eye[0].pos, float) + eye[1].pos) / 2.0
            ahead, up = np.array(eye[0].forward, float), np.array(eye[0].up, float)
        finally:
            stage.close()
        seen = points - place
        scale = 1.0 / np.tan(np.radians(30.0) / 2.0) / (seen @ ahead)
        across = 0.5 + 0.5 * scale * (seen @ np.cross(ahead, up)) * 9 / 16
        upwards = 0.5 + 0.5 * scale * (seen @ up)
        left, right, bottom, top = WINDOW
        for values, low, high in ((across, left, right), (upwards, bottom, top)):
            assert low - 1e-3 <= values.min()
            assert values.max() <= high + 1e-3
        # In one direction the window is filled: a nearer camera would cut the path off.
        assert np.ptp(across) > right - left - 2e-3 or np.ptp(upwards) > top - bottom - 2e-3


def test_between_two_ticks_the_robot_turns_at_one_speed():
    first, second = qpos_at(1.0), qpos_at(1.2, "form3")
    second[3:7] = np.cos(1.0), 0.0, 0.0, np.sin(1.0)
    middle = between(first, second, 0.5)
    np.testing.assert_allclose(middle[3:7], (np.cos(0.5), 0.0, 0.0, np.sin(0.5)), atol=1e-12)
    np.testing.assert_allclose(middle[:3], (first[:3] + second[:3]) / 2.0, atol=1e-12)
    np.testing.assert_allclose(between(first, second, 0.0), first, atol=1e-12)
    np.testing.assert_allclose(between(first, second, 1.0), second, atol=1e-12)


def test_the_flights_phases_are_named_from_its_windows(sinking):
    named = {time: flight_phase(time) for time in (0.025, 4.0, 4.1, 12.0, 28.5, 28.6, 30.0, 30.1, 35.1, 36.6)}
    assert [time for time, phase in named.items() if "dropped" in phase] == [28.6, 30.0, 35.1]
    assert [time for time, phase in named.items() if "→" in phase] == [4.1]
    assert [tick_at(sinking, time) for time in (0.0, 0.025, 0.05, 0.2, 9.0)] == [0, 0, 1, 7, 7]


def test_a_stage_without_its_camera_is_refused():
    with pytest.raises(UnknownNameError, match="chase"):
        Stage("back", 64, 48)


def test_two_policies_play_the_same_episode_into_one_film(tmp_path, monkeypatch, capsys):
    (tmp_path / "mine.py").write_text(
        "import numpy as np\n"
        "class Still:\n    name = 'still'\n    def reset(self, seed):\n        pass\n"
        "    def act(self, observation):\n        return np.zeros(6)\n"
        "class Push(Still):\n    name = 'push'\n"
        "    def act(self, observation):\n        return np.array([0, 0, -1.0, 0, 0, 0])\n"
    )
    monkeypatch.chdir(tmp_path)
    main(["run", "--policy", "mine:Still", "--against", "mine:Push", "--seconds", "0.1", "--out", "two.mp4"])
    out = capsys.readouterr().out.splitlines()
    assert [line.split(",")[0] for line in out] == ["still", "push"]
    assert all("(seed 0)" in line for line in out)
    _, size, frames = read(tmp_path / "two.mp4")
    assert size == SIZE
    assert len(frames) == 3
