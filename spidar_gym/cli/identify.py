"""`spidar identify`: a robot's parameters from its logs."""

from pathlib import Path
from typing import Annotated

import tyro

from spidar_gym.arguments import JsonArg
from spidar_gym.console import drawn, kept, progress
from spidar_gym.errors import SpidarError, require_least, require_name, require_within
from spidar_gym.files import json_text, output_folder, write_text
from spidar_gym.identify.identify import identify
from spidar_gym.identify.robot_file import BASE, robot_text
from spidar_gym.logs.open import read_log
from spidar_gym.onboard.messages import NAMESPACE
from spidar_gym.processes import cpu_count
from spidar_gym.robot import ROBOT, RobotSpec
from spidar_gym.sim.worlds import world_names
from spidar_gym.viz.identified import draw_report

LogsArg = Annotated[
    tyro.conf.Positional[tuple[Path, ...]],
    tyro.conf.arg(
        metavar="LOG [LOG ...]",
        help="Logs of the tests bench and thrust, of the runner or as MCAP.",
        help_behavior_hint="",
    ),
]


def identify_(
    logs: LogsArg,
    out: Path = Path("out/identified/robot.toml"),
    mass: float | None = None,
    mass_deviation: float = 0.02,
    world: str = BASE,
    robot: Path | None = None,
    namespace: str = NAMESPACE,
    threads: int = cpu_count(),
    json: JsonArg = False,
) -> None:
    """Identify a robot from the logs of its tests: joint servos from bench, modules and balance from thrust.

    Every number has a 95 % interval; what the logs do not tell is listed with what would. Beside the robot's file are
    written: report.md, report.json and report.png.

    Args:
        logs: Logs.
        out: File of the identified robot, for --world of sitl, --robots of eval and tune, --robot of export and
            parameters.
        mass: Mass of the robot by a scale [kg]; the described mass if not given: a flight tells gain over mass only.
        mass_deviation: Standard deviation of that mass [kg].
        world: Calibrated world whose ranges are kept for whatever the logs do not tell.
        robot: TOML file of the described robot; the nominal one if not given.
        namespace: Namespace of the robot's topics in MCAP and bags.
        threads: Threads that simulate the bench test.
    """
    if not logs:
        raise SpidarError("no log; valid: the logs of the tests bench and thrust")
    if out.suffix != ".toml":
        raise SpidarError(f"{out} is no file of a robot; valid: a name that ends in .toml")
    require_least(1, threads=threads)
    if out.is_dir():
        raise SpidarError(f"{out} is a folder; valid: the name of a file that ends in .toml")
    require_name("world", world, world_names())
    spec = ROBOT if robot is None else RobotSpec.parse(robot)
    require_within(1e-4, 1.0, "kg", mass_deviation=mass_deviation)
    if mass is not None:
        require_within(0.5 * spec.total_mass, 2.0 * spec.total_mass, "kg", mass=mass)
    folder = output_folder(out.parent)
    with progress(total=len(logs), unit="log", desc="identify", bar_format=BAR) as bar, kept(lambda: "nothing written"):
        records = [(path.name, read_log(path, namespace=namespace)) for path in logs]
        shares = dict.fromkeys((name for name, _ in records), 0.0)

        def on_share(name: str, share: float) -> None:
            shares[name] = share
            bar.set_postfix_str(name)
            bar.update(sum(shares.values()) - bar.n)

        report = identify(
            records, mass=mass, mass_deviation=mass_deviation, robot=spec, threads=threads, on_share=on_share
        )  # fmt: skip
    write_text(out, robot_text(report.found, spec, world))
    write_text(folder / "report.json", json_text(report.facts()))
    write_text(folder / "report.md", report.text())
    picture = folder / "report.png"
    written = [out, folder / "report.md", folder / "report.json"]
    written += [picture] if drawn("figure", lambda: draw_report(report, picture, spec)) else []
    print(json_text(report.facts()) if json else report.text())
    if not json:
        print(f"written: {', '.join(map(str, written))}")


BAR = "{desc}: {percentage:3.0f} %|{bar}| {elapsed} {postfix}"
"""Format of the progress bar, whose number of logs is not whole."""
