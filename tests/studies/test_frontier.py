"""The frontier of error against margin: scaled gains, flights of rivals as themselves, the figure, and the command."""

import itertools
import json
from dataclasses import replace

import numpy as np
import pytest
from support.commands import refused

pytest.importorskip("matplotlib")
from matplotlib.colors import to_rgba

from spidar_gym import viz
from spidar_gym.benchmark.evaluate import play
from spidar_gym.benchmark.scenario import load_scenarios
from spidar_gym.benchmark.track import CALIBRATED, FLIGHT, TRACKS
from spidar_gym.control.presets import controller_config
from spidar_gym.errors import InvalidValueError, SpidarError, UnknownNameError
from spidar_gym.margins import LegMargins, law_of
from spidar_gym.policies.load import load_policy
from spidar_gym.studies import frontier
from spidar_gym.studies.__main__ import main
from spidar_gym.studies.frontier import Point, frontier_lines, frontier_study, measure
from spidar_gym.tune.flight import scaled
from spidar_gym.viz import figures

TRACK = "flight-calibrated-fast"
"""A track of the study, in whose first scenario the avoidance of interference matters."""
MARGINS = LegMargins(2.0, "a", 0.05, "b", 0.1, "c", 1.0, "d")


def gains(config):
    """Return the gains of a controller, position then attitude: axes × (P, I, D)."""
    c = config.centroidal
    return np.array([*c.position_gains, *c.attitude_gains])


def with_gains_of(config, other):
    """Return the controller `other` with the gains of `config`."""
    own = config.centroidal
    centroidal = replace(other.centroidal, position_gains=own.position_gains, attitude_gains=own.attitude_gains)
    return replace(other, centroidal=centroidal)


def row(controller: str, scale: float, failed: float, **own: float) -> dict:
    """A row of the study."""
    fixed = {"gain": 1.5 + scale, "delay": 0.05, "ringing": 1.0, "error": 0.3 * scale, "error_described": 0.2}
    return {"controller": controller, "scale": scale, **fixed, "failed": failed, **own}


@pytest.mark.parametrize("factor", [0.6, 1.0, 1.7])
@pytest.mark.parametrize("name", ["steady", "as_flown"])
def test_a_faster_controller_has_other_gains_by_their_powers_and_nothing_else(name, factor):
    config = controller_config(name)
    faster = scaled(config, factor)
    np.testing.assert_allclose(gains(faster), gains(config) * [factor**2, factor**3, factor], rtol=1e-12)
    back = scaled(faster, 1.0 / factor)
    np.testing.assert_allclose(gains(back), gains(config), rtol=1e-12)
    assert with_gains_of(config, back) == with_gains_of(config, faster) == config


def test_a_rival_at_scale_1_flies_as_itself(monkeypatch):
    judged, name = [], "baselines.compensation:Compensation"
    monkeypatch.setattr(frontier, "SCENARIOS", 1)
    monkeypatch.setattr(frontier, "TRACKS", {TRACK: TRACKS[TRACK]})
    monkeypatch.setattr(frontier, "leg_margins", lambda law, *_, **__: judged.append(law) or MARGINS)
    found = measure(Point(name, 1.0))
    (flown,) = play(load_policy(name), TRACK, load_scenarios(TRACK, "validation")[0][:1])
    assert found["error"] == pytest.approx(flown["metrics"]["error"], rel=1e-9)
    assert found["error_described"] == pytest.approx(flown["metrics"]["error"], rel=1e-9)
    assert found["failed"] == flown["metrics"]["failed"]
    # Its margins are those of the same controller.
    (law,) = judged
    own = law_of(name)
    assert (type(law), law.config) == (type(own), own.config)
    assert (found["gain"], found["delay"], found["ringing"]) == (MARGINS.gain, MARGINS.delay, MARGINS.ringing)


@pytest.mark.parametrize(
    ("name", "scale", "others"),
    [
        ("steady", 1.0, {}),
        ("baselines.adrc:Adrc", 1.2, {}),
        ("baselines.compensation:Compensation", 0.8, {"avoid_interference": False}),
    ],
)
def test_every_argument_of_a_rival_is_kept_and_errors_are_means_over_tracks(name, scale, others, monkeypatch):
    asked = []

    def recorded(policy, track, scenarios, **_):
        asked.append((track, policy.arguments(TRACKS[track].env_id)))
        error = 0.1 if track == TRACK else 0.4
        # Described robots, which have even numbers, do better.
        return [{"metrics": {"error": error * (1.0 + k % 2), "failed": k == 3}} for k, _ in enumerate(scenarios)]

    monkeypatch.setattr(frontier, "SCENARIOS", 4)
    monkeypatch.setattr(frontier, "play", recorded)
    monkeypatch.setattr(frontier, "leg_margins", lambda *_, **__: MARGINS)
    found = measure(Point(name, scale))
    tracks = [track for track, own in TRACKS.items() if own.group == CALIBRATED[FLIGHT]]
    assert asked == [(track, {**others, "controller": scaled(law_of(name).config, scale)}) for track in tracks]
    assert found["error"] == pytest.approx(1.5 * np.sqrt(0.1 * 0.4))
    assert found["error_described"] == pytest.approx(np.mean([0.1, 0.4]))
    assert found["failed"] == 0.25


def test_the_study_measures_every_controller_at_every_scale_in_order(monkeypatch):
    monkeypatch.setattr(frontier, "measure", lambda point: row(point.controller, point.scale, 0.0))
    seen = []
    rows = frontier_study(("steady", "paper"), (0.8, 1.0), on_done=lambda: seen.append(1))
    assert [(one["controller"], one["scale"]) for one in rows] == [*itertools.product(("steady", "paper"), (0.8, 1.0))]
    assert len(seen) == 4


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("glide", UnknownNameError),
        ("baselines.adrc:Nothing", SpidarError),
        ("baselines.walking:Walking", InvalidValueError),
        ("baselines.course:CourseRule", InvalidValueError),
        ("baselines.course_steady:SteadyRule", InvalidValueError),
        ("baselines.hold:Hold", InvalidValueError),
        ("baselines.mpc:MPC", InvalidValueError),
    ],
)
def test_controllers_that_do_not_exist_or_do_not_fly_are_refused_before_anything_runs(name, kind, monkeypatch):
    monkeypatch.setattr(frontier, "finish", lambda *_, **__: pytest.fail("it ran"))
    with pytest.raises(kind, match=r"valid|expected"):
        frontier_study(("steady", name), (1.0,))


def test_the_table_has_a_line_for_each_row():
    rows = [row("steady", 1.0, 0.0), row("paper", 0.6, 0.25, gain=0.851, delay=0.0123, error=1.0, error_described=0.5)]
    first, second, third = frontier_lines(rows)
    assert len(first) == len(second) == len(third)
    assert second[:2] == ["steady", "× 1"]
    assert third == ["paper", "× 0.6", "0.85", "12 ms", "1.000", "0.500", "25%"]


def test_points_of_the_figure_are_filled_where_no_robot_has_fallen_and_large_at_scale_1(tmp_path, monkeypatch):
    drawn, save = [], figures.save
    monkeypatch.setattr(figures, "save", lambda figure, path: (drawn.append(figure), save(figure, path)))
    rows = [
        row("steady", 0.8, 0.0), row("steady", 1.0, 0.0), row("steady", 1.2, 0.1),
        row("baselines.adrc:Adrc", 1.0, 0.5, gain=1.1, error=4.0), row("baselines.adrc:Adrc", 0.6, 0.0, gain=1.2),
    ]  # fmt: skip
    viz.frontier_figure(rows, tmp_path / "frontier.png")
    assert (tmp_path / "frontier.png").stat().st_size > 10_000
    (figure,) = drawn
    (axis,) = figure.axes
    points = {
        (line.get_xdata()[0], line.get_ydata()[0]): line
        for line in axis.lines
        if len(line.get_xdata()) == 1 and line.get_transform() == axis.transData
    }
    assert set(points) == {(one["gain"], one["error"]) for one in rows}
    sizes = {1.0: set(), 0.0: set()}
    for one in rows:
        point = points[one["gain"], one["error"]]
        face = to_rgba(point.get_markerfacecolor())
        assert face == (to_rgba("white") if one["failed"] else to_rgba(point.get_color())), one
        assert to_rgba(point.get_color()) != to_rgba("white")
        sizes[float(one["scale"] == 1.0)].add(point.get_markersize())
    assert min(sizes[1.0]) > max(sizes[0.0])
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["steady", "adrc"]


def test_the_command_measures_each_point_once_and_writes_rows_and_picture(tmp_path, capfd, monkeypatch):
    monkeypatch.setattr(frontier, "measure", lambda point: row(point.controller, point.scale, 0.0))
    arguments = ["--controllers", "steady", "paper", "steady", "--scales", "1", "0.8", "1.0", "--workers", "1"]
    main(["frontier", *arguments, "--out", str(tmp_path), "--json"])
    rows = json.loads(capfd.readouterr().out)["frontier"]
    assert [(one["controller"], one["scale"]) for one in rows] == [*itertools.product(("steady", "paper"), (1.0, 0.8))]
    assert rows == json.loads((tmp_path / "frontier.json").read_text())["frontier"]
    assert (tmp_path / "frontier.png").stat().st_size > 10_000


def test_the_command_refuses_an_unknown_controller_and_writes_nothing(tmp_path, capfd):
    line = refused(
        capfd, "frontier", "--controllers", "glide", "--out", str(tmp_path / "o"), command=main,
        prog="python -m spidar_gym.studies",
    )  # fmt: skip
    assert "unknown preset 'glide'; valid: paper" in line
    assert not (tmp_path / "o").exists()
