"""`spidar export`: from the simulator to the robot."""

from pathlib import Path

from spidar_gym.cli.arguments import Flag
from spidar_gym.errors import InvalidValueError
from spidar_gym.onboard.build import build_core
from spidar_gym.onboard.export import export
from spidar_gym.onboard.policy import RATE
from spidar_gym.sitl.missions import crawl_mission, flight_mission, hover_mission


def export_(
    out: Path | None = None,
    build: Flag = False,
    residual: Path | None = None,
    residual_rate: float = RATE,
) -> None:
    """Export the controller as C that compiles with nothing installed, or compile it for control="core".

    Args:
        out: Folder to write: core, solver, runner, missions, recorded inputs with their answers, manifest of hashes.
        build: Compile the core for this machine, where environments with control="core" find it.
        residual: Artifact of a learned policy that adds to the controller; it goes into the folder.
        residual_rate: Largest change of every entry of its action in a second [1/s]; from −1 to 1 it is 2.
    """
    if out is None and not build:
        raise InvalidValueError("out", out, "--out FOLDER, --build, or both")
    if out is None and residual is not None:
        raise InvalidValueError("residual", str(residual), "--out FOLDER with it: environments bring their own policy")
    if out is not None:
        plans = (flight_mission(), crawl_mission(), hover_mission())
        missions = {f"missions/{plan.name}.txt": plan.text.encode() for plan in plans}
        print(f"{len(export(out, residual=residual, rate=residual_rate, extra=missions))} files in {out}")
    if build:
        print(f"compiled: {build_core()}")
