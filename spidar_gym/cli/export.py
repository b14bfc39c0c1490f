"""`spidar export`: from the simulator to the robot."""

from pathlib import Path

from spidar_gym.onboard.export import export
from spidar_gym.onboard.policy import RATE
from spidar_gym.robot import ROBOT, RobotSpec
from spidar_gym.sitl.missions import (
    course_mission,
    crawl_mission,
    drawn_course,
    flight_mission,
    hover_mission,
    map_mission,
)

GATES_SEED = 1
"""At this one Course-v0 draws a beam, a slot, a wall and a platform."""


def export_(
    out: Path,
    residual: Path | None = None,
    residual_rate: float = RATE,
    robot: Path | None = None,
) -> None:
    """Export the controller as C that compiles with nothing installed but a compiler.

    Args:
        out: Folder to write: core, solver, runner, missions, recorded inputs with their answers, manifest of hashes.
        residual: Artifact of a learned policy that adds to the controller; it goes into the folder.
        residual_rate: Largest change of every entry of its action in a second [1/s]; from −1 to 1 it is 2.
        robot: TOML file of a robot of one's own; its missions are a flight, a crawl and a hover.
    """
    spec = RobotSpec.parse(robot)
    plans = (flight_mission(), crawl_mission(robot=spec), hover_mission())
    if spec == ROBOT:  # heights and slots of the others are made for its legs
        plans += (course_mission(), map_mission(drawn_course(3, GATES_SEED)))
    missions = {f"missions/{plan.name}.txt": plan.text.encode() for plan in plans}
    written = export(out, residual=residual, rate=residual_rate, extra=missions, robot=spec)
    print(f"{len(written)} files in {out}")
