"""Pins the presets that `spidar export` takes: without repetitions, never an empty list, and a help that names them."""

import json

import pytest
from support.commands import files, refused

from spidar_gym.cli.main import main
from spidar_gym.onboard.export import EXPORTED


def test_presets_that_are_named_twice_are_exported_once(here, capfd):
    main(["export", "--out", "onboard", "--presets", "steady", "paper", "steady"])
    assert json.loads((here / "onboard/MANIFEST.json").read_text())["presets"]["flight"] == ["steady", "paper"]


def test_missions_fly_exported_presets(here, capfd):
    main(["export", "--out", "onboard", "--presets", "tuned", "retuned", "--fragile"])
    heads = {path.stem: path.read_text().split()[:2] for path in (here / "onboard/missions").glob("*.txt")}
    assert heads.pop("crawl") == ["crawl", "published"]
    assert heads.pop("bench")[0] == "bench"
    assert {preset for _, preset in heads.values()} == {"tuned"}
    assert heads.keys() == {"first_flight", "flight", "hover", "course", "course_gates", "thrust", "legs", "forms"}


def test_an_empty_list_of_presets_is_refused_and_writes_nothing(here, capfd):
    line = refused(capfd, "export", "--out", "onboard", "--presets")
    assert "presets = [] is not valid; expected at least one flight preset" in line
    assert not files(here)


def test_the_help_names_the_default_presets(capfd):
    with pytest.raises(SystemExit):
        main(["export", "--help"])
    text = " ".join(capfd.readouterr().out.replace("│", " ").split())
    assert f"(default: {' '.join(EXPORTED)})" in text
    assert "(default: )" not in text
