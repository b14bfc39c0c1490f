"""Pins the figures: a sink points down, axes contain the data, no text covers a curve."""

import itertools

import numpy as np
import pytest

pytest.importorskip("matplotlib")
from spidar_gym import viz
from spidar_gym.paper.crawl import LEGS_UP, TORSO_PHASES, CrawlLog
from spidar_gym.paper.flight import FLIGHT_TICKS, PAPER_FLIGHT, UNRESTRICTED, FlightLog
from spidar_gym.viz import style

SINK = 0.35


def flight_log(noise=False, wobble=4e-4):
    """Return a flight that sinks by `SINK` where the constraint is dropped, with a varying attitude error."""
    time = np.arange(1, FLIGHT_TICKS + 1) / 40.0
    rng = np.random.Generator(np.random.PCG64(3))

    def slow(columns):
        return np.cumsum(rng.standard_normal((len(time), columns)), axis=0) / 40.0

    error = 0.002 * slow(3)
    for start, _ in UNRESTRICTED:
        error[:, 2] += SINK * np.exp(-(((time - start - 1.6) / 0.6) ** 2))
    return FlightLog(
        preset="paper", time=time, position_error=error, attitude_error=wobble * slow(3), joint_position=slow(16),
        joint_torque=slow(16), vectoring=slow(16).reshape(-1, 8, 2), thrust=20.0 + slow(8), solve_time=time,
        status=time, air_force=slow(3), power=time, qpos=slow(39), noise=noise,
    )  # fmt: skip


def crawl_log():
    """Return a crawl of two cycles; all signals end near zero."""
    phase = np.repeat([*LEGS_UP, *TORSO_PHASES, "settle"] * 2, 40)
    time = np.arange(1, len(phase) + 1) / 40.0
    wave = np.sin(time[:, None] * np.arange(1, 17)) * np.minimum(1.0, time[::-1, None])
    return CrawlLog(
        preset="published", joint_speed=0.2, noise=True, time=time, phase=phase, position_w=wave[:, :3],
        euler=wave[:, 3:6], joint_position=wave, joint_torque=wave, vectoring=wave.reshape(-1, 8, 2),
        thrust=wave[:, :8], thrust_command=wave[:, :8], power=time, solve_time=time, status=time, qpos=wave,
        contacts=[], goal_error=np.zeros(3), info={},
    )  # fmt: skip


def data_lines(axis):
    """Return the lines of data, without the leader lines of their names."""
    return [line for line in axis.lines if line.get_transform() == axis.transData and len(line.get_xdata()) > 2]


def check_nothing_is_covered(figure):
    """Check that no two texts of a figure overlap, and that none leaves the figure or lies on a curve."""
    figure.canvas.draw()
    words = [text for axis in figure.axes for text in (*axis.texts, axis.title, axis._left_title, axis.xaxis.label)]
    words += [axis.yaxis.label for axis in figure.axes] + [figure._suptitle]
    boxes = [(text.get_text(), text.get_window_extent()) for text in words if text is not None and text.get_text()]
    for (first, a), (second, b) in itertools.combinations(boxes, 2):
        assert not (a.shrunk(0.98, 0.9).overlaps(b.shrunk(0.98, 0.9))), (first, second)
    for word, box in boxes:
        assert figure.bbox.x0 <= box.x0, word
        assert box.x1 <= figure.bbox.x1, word
        assert figure.bbox.y0 <= box.y0, word
        assert box.y1 <= figure.bbox.y1, word
    for axis in figure.axes:
        for line in data_lines(axis):
            points = axis.transData.transform(np.column_stack((line.get_xdata(), line.get_ydata())))
            for word, box in boxes:
                inside = (points > (box.x0, box.y0)) & (points < (box.x1, box.y1))
                assert not inside.all(axis=1).any(), f"{word} lies on a curve of {axis.get_title(loc='left')}"


def check_axes_hold_their_data(figure):
    for axis in figure.axes:
        low, high = axis.get_ylim()
        values = np.concatenate([line.get_ydata() for line in data_lines(axis)])
        assert low <= values.min()
        assert values.max() <= high
        assert np.ptp(values) > 0.5 * (high - low), axis.get_title(loc="left")


@pytest.mark.parametrize("noise", [False, True])
def test_in_the_flights_figure_a_sink_goes_down(kept, tmp_path, noise):
    viz.flight_figure(flight_log(noise, wobble=0.02 if noise else 4e-4), tmp_path / "flight.png")
    (figure,) = kept
    position, attitude = figure.axes[:2]
    for axis in (position, attitude):
        assert "actual − desired" in axis.get_title(loc="left")
    z = data_lines(position)[2]
    assert z.get_ydata().min() == pytest.approx(-SINK, abs=0.02)
    assert 28.5 < z.get_xdata()[np.argmin(z.get_ydata())] < 38.5
    check_axes_hold_their_data(figure)
    check_nothing_is_covered(figure)
    # The paper's RMSE is a band where the axis reaches it, and a note where it does not.
    rmse = 1e3 * max(PAPER_FLIGHT["rmse_attitude_rad"])
    (mark,) = [text.get_text() for text in attitude.texts if "RMSE" in text.get_text()]
    assert f"{rmse:g} mrad" in mark
    assert ("off scale" in mark) == (max(map(abs, attitude.get_ylim())) < rmse) == (not noise)


def test_the_crawls_figure_covers_nothing_and_names_the_phases(kept, tmp_path):
    viz.crawl_figure(crawl_log(), tmp_path / "crawl.png")
    (figure,) = kept
    check_axes_hold_their_data(figure)
    check_nothing_is_covered(figure)
    named = [text.get_text() for text in figure.axes[0].texts]
    assert named[:4] == ["legs", "legs", "torso", "torso"]


def test_the_figure_over_joint_speeds_names_its_lines(kept, tmp_path):
    rows = [
        {"condition": condition, "controller": name, "joint_speed": speed, "position_mm": 9.0 * speed / (1 + k),
         "attitude_mrad": 20.0 * speed / (1 + k)}
        for condition in ("nominal", "randomised") for k, name in enumerate(("paper", "tuned"))
        for speed in (0.2, 0.6, 1.0)
    ]  # fmt: skip
    viz.speed_figure(rows, tmp_path / "speeds.png")
    (figure,) = kept
    check_nothing_is_covered(figure)
    for axis in figure.axes:
        paper, tuned = data_lines(axis)
        colors = {text.get_text(): text.get_color() for text in axis.texts}
        assert colors == {"paper": paper.get_color(), "tuned": tuned.get_color()}
        assert (paper.get_ydata() > tuned.get_ydata()).all()


def curve(steps, run, k):
    """Return a learning curve that improves, with a validation every `run` minutes."""
    values = 1e-3 * k * np.exp(-steps / 5e5 / run)
    return viz.Curve(steps.tolist(), (steps / 5e4 * run).tolist(), values.tolist())


def test_learning_curves_are_over_ticks_and_minutes_and_cover_nothing(kept, tmp_path):
    steps = np.arange(10) * 5e4
    panels = {
        metric: {row: [curve(steps, run, k) for run in (1, 2, 3)]
                 for k, row in ((5, "ppo_paper"), (4, "supervised_paper"), (1, "ppo_tuned"))}
        for metric in ("position_rms_m", "attitude_rms_rad")
    }  # fmt: skip
    lines = {"qp": dict.fromkeys(panels, 5e-3), "qp_tuned": dict.fromkeys(panels, 1e-3)}
    viz.learning_curves(panels, lines, "title", tmp_path / "curves.png")
    (figure,) = kept
    assert len(figure.axes) == 4
    check_nothing_is_covered(figure)
    over_ticks, over_minutes = (data_lines(figure.axes[k]) for k in (0, 2))
    np.testing.assert_allclose(over_ticks[1].get_xdata(), steps / 1e6)
    np.testing.assert_allclose(over_minutes[1].get_xdata(), steps / 2.5e4)
    np.testing.assert_array_equal(over_ticks[1].get_ydata(), over_minutes[1].get_ydata())


@pytest.mark.parametrize(("kind", "begins"), [("png", b"\x89PNG"), ("pdf", b"%PDF"), ("svg", b"<?xml")])
def test_a_figure_has_the_format_of_its_name_and_is_the_same_twice(kind, begins, tmp_path):
    for name in ("one", "other"):
        viz.flight_figure(flight_log(), tmp_path / f"{name}.{kind}")
    one, other = ((tmp_path / f"{name}.{kind}").read_bytes() for name in ("one", "other"))
    assert one == other
    assert one.startswith(begins)


def test_a_figure_that_cannot_be_drawn_leaves_no_file(tmp_path, monkeypatch):
    from matplotlib.figure import Figure

    monkeypatch.setattr(Figure, "savefig", lambda self, path, **_: path.write_bytes(b"half") and 1 / 0)
    with pytest.raises(ZeroDivisionError):
        viz.flight_figure(flight_log(), tmp_path / "flight.png")
    assert list(tmp_path.rglob("*")) == []


def test_colours_of_lines_differ_for_every_eye_and_in_grey():
    """Colours differ in lightness or hue, also without perception of red or green (Machado 2009, severity 1)."""
    plt = style.pyplot()
    from matplotlib.colors import to_rgb

    cycle = plt.rcParams["axes.prop_cycle"]
    linear = np.array([to_rgb(entry["color"]) for entry in cycle]) ** 2.2
    no_red = np.array(
        [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]]
    )
    no_green = np.array(
        [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]]
    )
    for eye in (np.eye(3), no_red, no_green):
        seen = np.clip(linear @ eye.T, 0.0, 1.0) ** (1 / 2.2)
        for a, b in itertools.combinations(seen, 2):
            assert np.linalg.norm(a - b) > 0.2
    # Colours that are similar in grey have different line styles.
    grey = linear @ (0.2126, 0.7152, 0.0722)
    strokes = [entry["linestyle"] for entry in cycle]
    for (a, first), (b, second) in itertools.combinations(zip(grey.tolist(), strokes, strict=True), 2):
        assert first != second or abs(a ** (1 / 2.2) - b ** (1 / 2.2)) > 0.05


def test_names_keep_their_order_and_their_distance():
    rng = np.random.Generator(np.random.PCG64(1))
    for _ in range(100):
        wanted = rng.uniform(0.0, 10.0, rng.integers(1, 8))
        places = style.spread(wanted, 1.0)
        order = np.argsort(wanted)
        assert (np.diff(places[order]) >= 1.0 - 1e-9).all()
        assert places.mean() == pytest.approx(wanted.mean())
    np.testing.assert_allclose(style.spread(np.array([3.0, 0.0, 9.0]), 1.0), [3.0, 0.0, 9.0])
