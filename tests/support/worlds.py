"""A small calibrated world in place of the committed one."""

from pathlib import Path

import pytest

from spidar_gym.sim import randomize, worlds
from spidar_gym.sim.worlds import find_world, read_world

WORLD = "calibrated_1"
"""Name of the world of the calibrated tracks."""
_TEXT = """doc = "Robots of a test."
sensors = true
trimmed = false
floor_steps = 0.001
[mixtures]
wake = "eddies"
build = "unequal rotors"
[variants]
described = "as described"
damped = "badly damped"
"""
_ROW = '[[row]]\nfield = "{}"\norigin = "chosen"\nsource = "of a test"\nlog = {}\nranges = {}\n'
ROWS = (
    ("recirculation.flow_xy", "false", "{ wake = [0.01, 0.02], build = [0.0, 0.0] }"),
    ("recirculation.flow_z", "false", "{ wake = [0.03, 0.04], build = [0.0, 0.0] }"),
    ("recirculation.turn_xy", "false", "{ wake = [0.04, 0.05], build = [0.0, 0.0] }"),
    ("recirculation.turn_z", "false", "{ wake = [0.01, 0.02], build = [0.0, 0.0] }"),
    ("actuators.module_gain", "false", "{ wake = [1.0, 1.0], build = [0.95, 1.05] }"),
    ("actuators.joint_kd", "true", "{ described = [8.0, 8.0], damped = [0.6, 1.4] }"),
    ("actuators.joint_damping", "false", "{ described = [0.9, 0.9], damped = [0.0, 0.0] }"),
    ("actuators.joint_friction", "false", "{ described = [0.0, 0.0], damped = [0.0, 0.5] }"),
    ("actuators.delay", "false", "{ all = [0.01, 0.04] }"),
    ("actuators.thrust_lag", "false", "{ all = [0.02, 0.05] }"),
    ("actuators.vectoring_backlash", "false", "{ all = [0.0, 0.01] }"),
    ("body.peg_friction", "false", "{ all = [0.2, 0.8] }"),
)
"""Field, whether its logarithm is sampled, and ranges of each row."""


def pinned_world(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Write the world with its pin to a folder from which the package reads."""
    path = folder / f"{WORLD}.toml"
    path.write_text(_TEXT + "".join(_ROW.format(*row) for row in ROWS))
    (folder / worlds.PINS).write_text(f"{read_world(path).digest}  {path.name}\n")
    monkeypatch.setattr(worlds, "FOLDER", folder)
    monkeypatch.setattr(randomize, "find_world", find_world.__wrapped__)  # without the cache
    return path
