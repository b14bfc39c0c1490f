"""`spidar export`: from the simulator to the robot."""

from pathlib import Path

from spidar_gym.onboard.export import export
from spidar_gym.onboard.policy import RATE
from spidar_gym.sitl.missions import course_mission, crawl_mission, flight_mission, hover_mission


def export_(
    out: Path,
    residual: Path | None = None,
    residual_rate: float = RATE,
) -> None:
    """Export the controller as C that compiles with nothing installed but a compiler.

    Args:
        out: Folder to write: core, solver, runner, missions, recorded inputs with their answers, manifest of hashes.
        residual: Artifact of a learned policy that adds to the controller; it goes into the folder.
        residual_rate: Largest change of every entry of its action in a second [1/s]; from −1 to 1 it is 2.
    """
    plans = (flight_mission(), crawl_mission(), hover_mission(), course_mission())
    missions = {f"missions/{plan.name}.txt": plan.text.encode() for plan in plans}
    print(f"{len(export(out, residual=residual, rate=residual_rate, extra=missions))} files in {out}")
