"""`spidar export`: write the controller as C for the real robot."""

from pathlib import Path

from spidar_gym.arguments import Flag
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
"""Seed at which Course-v0 samples a beam, a slot, a wall and a platform."""


def export_(
    out: Path,
    residual: Path | None = None,
    residual_rate: float = RATE,
    robot: Path | None = None,
    presets: tuple[str, ...] = (),
    fragile: Flag = False,
) -> None:
    """Export the controller as C sources that require only a C compiler.

    Args:
        out: Output folder: core, solver, runner, missions, recorded inputs with expected outputs, manifest of hashes.
        residual: Artifact of a learned policy whose actions are added to the controller; exported with it.
        residual_rate: Limit of the rate of every entry of the residual action, which is within −1 … 1 [1/s].
        robot: TOML file of a custom robot; its missions are a flight, a crawl and a hover, without courses.
        presets: Flight presets that missions can name; paper, as_flown, as_flown_quasi and steady if not given, for a
            custom robot without steady. Export refuses those whose worst margins over robots of the
            calibrated world, with legs that bend, are too small, and says which.
        fragile: Export presets whatever their margins are: for simulations, and for robots whose damping is known.
    """
    spec = RobotSpec.parse(robot)
    plans = (flight_mission(), crawl_mission(robot=spec), hover_mission())
    if spec == ROBOT:  # heights and slots of the courses fit only the nominal legs
        plans += (course_mission(), map_mission(drawn_course(3, GATES_SEED)))
    missions = {f"missions/{plan.name}.txt": plan.text.encode() for plan in plans}
    written = export(
        out, residual=residual, rate=residual_rate, extra=missions, robot=spec, presets=presets or None, fragile=fragile
    )
    print(f"{len(written)} files in {out}")
