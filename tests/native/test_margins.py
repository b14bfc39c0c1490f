"""Pins the presets' margins with legs that bend, and the export that refuses those with too small ones."""

import json

import pytest
from support.commands import refused

from spidar_gym import margins
from spidar_gym.control.estimator import EstimatorConfig
from spidar_gym.control.flight.controller import FlightController
from spidar_gym.control.presets import FORMER_PRESETS, PRESETS, controller_config
from spidar_gym.errors import SpidarError, UnknownNameError
from spidar_gym.margins import LegMargins, lacking, legs_shortfall, preset_margins, read_margins, require_margins
from spidar_gym.native.linear import Loop, behind_encoders, linear_law, linear_robot, settle
from spidar_gym.onboard.export import EVERY, EXPORTED, export_files
from spidar_gym.robot import FORMS
from spidar_gym.sim.config import PlantConfig
from spidar_gym.studies.margins import margin_study

FRAGILE = sorted(set(EVERY) - set(EXPORTED))


def test_the_stored_margins_are_those_of_the_present_presets():
    stored = read_margins()
    assert list(stored) == [*PRESETS, *FORMER_PRESETS]
    for name, known in stored.items():
        assert known["config"] == margins._digest(controller_config(name)), f"{name} has changed"


@pytest.mark.parametrize("name", ["steady", "as_flown"])
@pytest.mark.parametrize("key", ["gain", "delay"])
def test_a_stored_margin_is_the_worst_of_the_robots_of_its_kind_in_its_form(name, key):
    kind, form, *_ = read_margins()[name][f"{key}_at"].split(", ")
    hover = settle(FlightController(controller_config(name)), FORMS[form], PlantConfig())
    law = behind_encoders(linear_law(hover), EstimatorConfig().joint_bandwidth, 0.025)
    loops = [Loop(linear_robot(hover, robot), law) for own, robot in margins.robots_of(margins.WORLD) if own == kind]
    worst = min(loop.gain_margin()[0] if key == "gain" else loop.delay_margin() for loop in loops)
    assert worst == pytest.approx(getattr(preset_margins(name), key), rel=0.01)


@pytest.mark.slow
def test_margins_are_those_of_the_allocation_mode():
    policy = "baselines.compensation:Compensation"
    robots = [one for one in margins.robots_of(margins.WORLD, 6) if one[0] == "build-damped"]
    arguments = margins.arguments_of(policy)
    assert margins.flight_mode(arguments) == "flight_unrestricted"
    avoided, free = (
        margins.leg_margins(margins.law_of(policy), robots, mode=mode) for mode in ("flight", "flight_unrestricted")
    )
    (found,) = margin_study([policy], margins.WORLD, 6)
    assert avoided.gain != pytest.approx(free.gain, rel=0.05)
    assert found["gain"] <= free.gain * (1.0 + 1e-9)


def test_a_preset_that_has_changed_and_a_custom_robot_are_computed_anew(monkeypatch, tmp_path):
    computed = LegMargins(2.0, "a", 0.1, "b", 0.1, "c", 1.0, "d")
    monkeypatch.setattr(margins, "leg_margins", lambda *_: computed)
    stored = json.loads(margins.MARGINS.read_text())
    stored["paper"]["config"] = "0" * 64
    (tmp_path / "margins.json").write_text(json.dumps(stored))
    monkeypatch.setattr(margins, "MARGINS", tmp_path / "margins.json")
    assert preset_margins("paper") == computed
    assert preset_margins("tuned") != computed
    (tmp_path / "margins.json").write_text("{")
    with pytest.raises(SpidarError, match=r"damaged.*valid: the committed file"):
        preset_margins("paper")


def test_export_takes_presets_with_margins_and_refuses_the_others_in_one_line():
    require_margins(EXPORTED)
    assert all(lacking(preset_margins(name)) for name in FRAGILE)
    for name in FRAGILE:
        with pytest.raises(SpidarError, match=rf"preset {name} .*(gain|delay) margin .*--fragile"):
            export_files(golden=False, presets=("paper", name))
    files = export_files(golden=False, presets=("paper", *FRAGILE), fragile=True)
    manifest = json.loads(files["MANIFEST.json"])
    assert manifest["presets"] == {"flight": ["paper", *FRAGILE], "margins": "not checked"}
    assert b"SP_PRESET_RETUNED" in files["generated/spidar_presets.h"]
    assert b"SP_PRESET_RETUNED" not in export_files(golden=False)["generated/spidar_presets.h"]
    with pytest.raises(UnknownNameError, match=r"papr.*valid: paper"):
        export_files(golden=False, presets=("papr",))
    with pytest.raises(SpidarError, match="at least one flight preset"):
        export_files(golden=False, presets=())


def test_the_command_refuses_a_fragile_preset_in_one_line_and_writes_nothing(tmp_path, capfd):
    line = refused(capfd, "export", "--out", str(tmp_path / "onboard"), "--presets", "retuned")
    assert "gain margin 0.88 (build-damped, form2, 15 rad/s), at least 1.4 is required" in line
    assert not (tmp_path / "onboard").exists()


@pytest.mark.slow
def test_a_search_counts_the_growth_of_modes_that_its_margins_forbid():
    steady, tuned, paper = (FlightController(controller_config(name)) for name in ("steady", "tuned", "paper"))
    assert legs_shortfall(steady, margins.WORLD) == 0.0
    assert legs_shortfall(paper, margins.WORLD) == 0.0
    assert legs_shortfall(tuned, margins.WORLD) > 0.1
