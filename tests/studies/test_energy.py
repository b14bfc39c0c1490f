"""Energy of flight and crawl: physics of the runs, length at which flight takes less, and the command."""

import json
from types import SimpleNamespace

import numpy as np
import pytest

from spidar_gym.errors import UnknownNameError
from spidar_gym.native.formulas import electrical_power
from spidar_gym.robot import N_JOINTS, N_ROTORS, ROBOT
from spidar_gym.studies import energy
from spidar_gym.studies.__main__ import main
from spidar_gym.studies.energy import WAY, Run, break_even, energy_lines, energy_study, play


def row(gait: str, per_m: float | None, total: float = 1.0) -> dict:
    """A row in which all robots have the same figures."""
    same = {"median": total, "least": total, "most": total}
    metre = None if per_m is None else {"median": per_m, "least": per_m, "most": per_m}
    return {
        "preset": "any", "gait": gait, "speed": 1.0, "robots": 1, "succeeded": 1, "missed": [], "time_s": same,
        "energy_wh": same, "wh_per_m": metre, "m_per_s": metre,
    }  # fmt: skip


def test_flight_is_better_where_crawl_and_flight_with_its_hop_take_the_same():
    rows = [row("crawl", 3.0), row("crawl", 0.5), row("fly", 2.0), row("fly", 1.0), row("hop", None, 8.0)]
    length = break_even(rows[0], rows)
    assert 3.0 * length == pytest.approx(8.0 + 1.0 * length)
    assert break_even(rows[1], rows) == float("inf")
    assert [cells[-1] for cells in energy_lines(rows)[1:]] == ["4.0 m", "never", "–", "–", "–"]


def test_a_flight_takes_the_power_of_a_hover_and_a_faster_crawl_less_energy_a_metre():
    flown = play(Run("tuned", "fly", 1.0, 0))
    assert flown["missed"] == ""
    assert flown["distance_m"] == pytest.approx(flown["time_s"])
    hop = play(Run("tuned", "hop", 0.0, 0))
    assert hop["missed"] == ""
    # Inclined rotors, forces across the robot and wakes take more than the bare weight does; a hop is in the air for
    # less than its whole time.
    level = electrical_power(np.full(N_ROTORS, ROBOT.weight / N_ROTORS), np.zeros(N_JOINTS), np.zeros(N_JOINTS))
    power = 3600.0 * flown["energy_wh"] / flown["time_s"]
    assert 0.95 * level < power < 1.4 * level
    assert 0.5 * power < 3600.0 * hop["energy_wh"] / hop["time_s"] < power
    slow, fast = (play(Run("robust_overlapped", "crawl", speed, 0)) for speed in (0.4, 0.8))
    assert fast["energy_wh"] < 0.75 * slow["energy_wh"]
    assert slow["distance_m"] == WAY


@pytest.mark.parametrize(
    ("ticks", "failure", "missed", "seconds"),
    [(800, "", "", 16.0), (640, "tilt", "tilt", 12.0), (160, "tilt", "tilt", 4.0), (1, "tilt", "tilt", 0.025),
     (799, "", "duration", 15.975)],
)  # fmt: skip
def test_energy_distance_and_time_of_a_flight_cover_the_same_ticks(monkeypatch, ticks, failure, missed, seconds):
    steps = [SimpleNamespace(info={"energy_wh": 0.1 * (k + 1), "failure": ""}) for k in range(ticks)]
    steps[-1].info["failure"] = failure
    monkeypatch.setattr(energy, "rollout", lambda *_, **__: steps)
    flown = play(Run("steady", "fly", 0.5, 0))
    # A flight that ends before it is measured, 4 s after its start, is a miss with the figures of all of it.
    assert flown["time_s"] == pytest.approx(seconds)
    assert flown["energy_wh"] == pytest.approx(0.1 * 40.0 * seconds)
    assert flown["distance_m"] == pytest.approx(0.5 * seconds)
    assert flown["missed"] == missed


def test_a_row_in_which_every_flight_ends_early_counts_as_misses(monkeypatch):
    monkeypatch.setattr(energy, "JOINT_SPEEDS", ())
    monkeypatch.setattr(energy, "SPEEDS", (1.0,))
    short = [SimpleNamespace(info={"energy_wh": 0.1, "failure": "tilt"})]
    monkeypatch.setattr(energy, "rollout", lambda *_, **__: short)
    flown, _ = energy_study(["robust"], "steady", 2)
    assert (flown["gait"], flown["succeeded"], flown["missed"]) == ("fly", 0, ["tilt"])


def test_unknown_presets_are_refused_before_anything_runs():
    for crawlers, flight in ((["trot"], "steady"), (["robust"], "glide")):
        with pytest.raises(UnknownNameError):
            energy_study(crawlers, flight, 1)


def test_the_command_writes_rows_and_picture_and_prints_json(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(
        "spidar_gym.studies.energy.play",
        lambda run: {"energy_wh": 1.0 + run.speed, "distance_m": 0.5, "time_s": 2.0, "missed": ""},
    )
    main(["energy", "--crawlers", "robust", "--robots", "2", "--workers", "1", "--out", str(tmp_path), "--json"])
    rows = json.loads(capsys.readouterr().out)["energy"]
    assert len(rows) == 3 + 4 + 1
    assert rows == json.loads((tmp_path / "energy.json").read_text())["energy"]
    assert (tmp_path / "energy.png").stat().st_size > 10_000
