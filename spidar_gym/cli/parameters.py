"""`spidar parameters`: write robot, gains and limits to a file that the runner on the robot reads at start."""

from pathlib import Path

from spidar_gym.arguments import Flag
from spidar_gym.cli.export import PresetsArg
from spidar_gym.console import progress
from spidar_gym.errors import InvalidValueError
from spidar_gym.files import whole_file
from spidar_gym.margins import WORLD, require_margins
from spidar_gym.onboard.export import exported
from spidar_gym.onboard.parameters import digest_of, parameters_record, parameters_text
from spidar_gym.robot import RobotSpec
from spidar_gym.robot.description import model_hash
from spidar_gym.sim.randomize import margins_world
from spidar_gym.tune.search import found_controller

TUNED = "tuned_here"
"""Name of the preset that a search has found."""


def parameters(
    out: Path, robot: Path | None = None, presets: PresetsArg = None, tuned: Path | None = None, fragile: Flag = False
) -> None:
    """Write robot, gains and limits for `spidar-runner … --parameters FILE`, which then needs no new compilation.

    Args:
        out: Text file to write.
        robot: TOML file of a custom robot, or of an identified one; the nominal robot if not given.
        presets: Flight presets of the file; those of an export if not given. It holds all crawl presets. Those whose
            worst margins over robots of the calibrated world are too small are refused, as by `spidar export`; of an
            identified robot over robots of its own world, about a minute and a half of one core for each preset.
        tuned: Log of a search for a flight controller, of `spidar tune`; its result is the preset tuned_here.
        fragile: Write presets whatever their margins are.
    """
    spec = RobotSpec.parse(robot)
    names = exported(spec) if presets is None else tuple(dict.fromkeys(presets))
    own = {} if tuned is None else {TUNED: found_controller(tuned)}
    if not (names or own):
        raise InvalidValueError("presets", list(names), "at least one flight preset")
    if not fragile:
        with progress(total=len(names) + len(own), unit="preset", desc="margins") as bar:
            require_margins(names, spec, margins_world(robot, WORLD), own, bar.update)
    text = parameters_text(parameters_record(spec, names, own=own))
    with whole_file(out) as made:
        made.write_bytes(text)
    print(f"{out}: parameters {digest_of(text)} of the robot {model_hash(spec)}")
