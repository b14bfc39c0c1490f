"""Pins settings in groups: every field has a unique name, on the command line and in a checkpoint."""

import dataclasses
import json
import re
import shlex
import sys
from pathlib import Path

import pytest

pytest.importorskip("stable_baselines3", reason="the extra `train` is not installed")
from spidar_gym.errors import InvalidValueError, UnknownNameError
from train import course, distill, gait, memory, residual, supervised
from train.lib.config import OutputConfig, flatten, override, parse

pytestmark = pytest.mark.train
ROOT = Path(__file__).resolve().parents[3]
RECIPES = {
    "residual": residual, "supervised": supervised, "gait": gait, "distill": distill, "memory": memory,
    "course": course,
}  # fmt: skip
PRESETS = [(recipe, name) for recipe, module in RECIPES.items() for name in module.PRESETS]


def fields(settings):
    """Yield the names of all fields, in every group."""
    for field in dataclasses.fields(settings):
        value = getattr(settings, field.name)
        yield from fields(value) if dataclasses.is_dataclass(value) else [field.name]


def committed():
    """Yield the commands of all committed learning curves, each with its settings."""
    for path in sorted((ROOT / "train" / "curves").glob("*.json")):
        for run in json.loads(path.read_text(encoding="utf-8"))["runs"]:
            yield run["command"], run["settings"]


@pytest.mark.parametrize(("recipe", "name"), PRESETS)
def test_every_field_has_a_unique_name(recipe, name):
    settings = RECIPES[recipe].PRESETS[name]
    names = list(fields(settings))
    assert len(set(names)) == len(names)
    assert set(flatten(settings, OutputConfig)) == set(names) - set(fields(OutputConfig()))


def test_no_help_of_an_option_needs_that_of_another_one():
    for path in sorted((ROOT / "train").rglob("*.py")):
        assert not re.findall(r'^ *"""(?:…|Of ).*', path.read_text(encoding="utf-8"), re.MULTILINE), path


def test_every_command_of_a_committed_curve_reproduces_its_settings(monkeypatch):
    for command, settings in committed():
        _, _, module, *options = shlex.split(command)
        recipe = RECIPES[module.removeprefix("train.")]
        monkeypatch.setattr(sys, "argv", [module, *options])
        args = parse(recipe.PRESETS, module, recipe.__doc__)
        found = json.loads(json.dumps(flatten(args, OutputConfig)))
        left_out = ("control", "workers", "threads")
        assert {k: found[k] for k in settings if k not in left_out} == {
            k: v for k, v in settings.items() if k not in left_out
        }
        # Settings added after the curve was recorded have values without effect.
        later = {k: v for k, v in found.items() if k not in {*settings, *left_out}}
        assert {k for k, v in later.items() if v} <= {"activation", "action_scale", "enlarged"}
        assert later.get("activation", "tanh") == "tanh"
        assert (later.get("action_scale", 1.0), later.get("enlarged", 1.0)) == (1.0, 1.0)
        assert not args.output.row


def test_an_override_finds_the_group_and_changes_nothing_else():
    settings = residual.PRESETS["hover-paper-ppo"]
    changed = override(settings, hold=3, clip_range=0.1, seed=7, row=False)
    assert (changed.env.hold, changed.learner.ppo.clip_range, changed.seed, changed.output.row) == (3, 0.1, 7, False)
    assert flatten(settings) | {"hold": 3, "clip_range": 0.1, "seed": 7, "row": False} == flatten(changed)
    with pytest.raises(UnknownNameError, match=r"unknown setting 'holds'; valid: .*did you mean hold"):
        override(settings, holds=3)
    with pytest.raises(InvalidValueError, match="n_steps = 0 is not valid"):
        override(settings, n_steps=0)


def test_options_are_the_fields_names_without_their_groups(monkeypatch):
    options = ["--clip-range", "0.1", "--reward-scale", "2", "--no-select", "--tracks", "flight-fast3", "--out", "x"]
    monkeypatch.setattr(sys, "argv", ["residual", "hover-tuned-ppo", *options])
    args = parse(residual.PRESETS, "train.residual", None)
    expected = override(
        residual.PRESETS["hover-tuned-ppo"], clip_range=0.1, reward_scale=2.0, select=False, tracks=("flight-fast3",),
        out=Path("x"),
    )  # fmt: skip
    assert args == expected
