"""`spidar parameters`: write robot, gains and limits to a file that the runner on the robot reads at start."""

from pathlib import Path

from spidar_gym.arguments import Flag
from spidar_gym.cli.export import PresetsArg
from spidar_gym.errors import InvalidValueError
from spidar_gym.files import whole_file
from spidar_gym.margins import require_margins
from spidar_gym.onboard.export import exported
from spidar_gym.onboard.parameters import digest_of, parameters_record, parameters_text
from spidar_gym.robot import RobotSpec
from spidar_gym.robot.description import model_hash


def parameters(out: Path, robot: Path | None = None, presets: PresetsArg = None, fragile: Flag = False) -> None:
    """Write robot, gains and limits for `spidar-runner … --parameters FILE`, which then needs no new compilation.

    Args:
        out: Text file to write.
        robot: TOML file of a custom robot; the nominal robot if not given.
        presets: Flight presets of the file; those of an export if not given. It holds all crawl presets. Those whose
            worst margins over robots of the calibrated world are too small are refused, as by `spidar export`.
        fragile: Write presets whatever their margins are.
    """
    spec = RobotSpec.parse(robot)
    names = exported(spec) if presets is None else tuple(dict.fromkeys(presets))
    if not names:
        raise InvalidValueError("presets", list(names), "at least one flight preset")
    if not fragile:
        require_margins(names, spec)
    text = parameters_text(parameters_record(spec, names))
    with whole_file(out) as made:
        made.write_bytes(text)
    print(f"{out}: parameters {digest_of(text)} of the robot {model_hash(spec)}")
