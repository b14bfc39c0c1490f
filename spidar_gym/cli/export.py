"""`spidar export`: write the controller as C for the real robot."""

from pathlib import Path
from typing import Annotated

import tyro

from spidar_gym.arguments import Flag
from spidar_gym.margins import WORLD
from spidar_gym.onboard.export import EXPORTED, export
from spidar_gym.onboard.policy import RATE
from spidar_gym.robot import ROBOT, RobotSpec
from spidar_gym.sim.randomize import margins_world
from spidar_gym.sitl.missions import (
    ROBOT_TESTS,
    course_mission,
    crawl_mission,
    drawn_course,
    first_flight_mission,
    flight_mission,
    hover_mission,
    map_mission,
    robot_test,
)

GATES_SEED = 1
"""Seed at which Course-v0 samples a beam, a slot, a wall and a platform."""
PresetsArg = Annotated[
    tuple[str, ...] | None,
    tyro.conf.arg(metavar="PRESET [PRESET ...]", help_behavior_hint=f"(default: {' '.join(EXPORTED)})"),
]


def export_(
    out: Path,
    residual: Path | None = None,
    residual_rate: float = RATE,
    robot: Path | None = None,
    presets: PresetsArg = None,
    fragile: Flag = False,
) -> None:
    """Export the controller as C sources that require only a C compiler.

    Args:
        out: Output folder: core, solver, runner, missions, parameter file, recorded inputs with expected outputs,
            manifest of hashes.
        residual: Artifact of a learned policy whose actions are added to the controller; exported with it.
        residual_rate: Limit of the rate of every entry of the residual action, which is within −1 … 1 [1/s].
        robot: TOML file of a custom robot, or of an identified one; its missions are a flight, a crawl, a hover and
            the tests, without courses.
        presets: Flight presets that missions can name; the written missions whose preset is not among them fly the
            first. For a custom robot, steady is no default. Export refuses those whose worst margins over robots of the
            calibrated world, with legs that bend, are too small, and says which.
        fragile: Export presets whatever their margins are: for simulations, and for robots whose damping is known.
    """
    spec = RobotSpec.parse(robot)
    chosen = None if presets is None else tuple(dict.fromkeys(presets))  # an empty list is refused, not the default

    def exported(preset: str) -> str:
        """Return the preset with which a mission flies: the runner knows only exported ones."""
        return preset if not chosen or preset in chosen else chosen[0]

    flown, steady = exported("as_flown"), exported("steady")
    plans = (flight_mission(flown), crawl_mission(robot=spec), hover_mission(flown))
    if spec == ROBOT:  # heights and slots of the courses fit only the nominal legs
        plans += (
            first_flight_mission(exported("first_flight")),
            course_mission(preset=steady),
            map_mission(drawn_course(3, GATES_SEED), preset=steady),
        )
    plans += tuple(robot_test(name, flown) for name in ROBOT_TESTS)
    missions = {f"missions/{plan.name}.txt": plan.text.encode() for plan in plans}
    written = export(
        out,
        residual=residual,
        rate=residual_rate,
        extra=missions,
        robot=spec,
        presets=chosen,
        fragile=fragile,
        world=margins_world(robot, WORLD),
        **({} if robot is None else {"name": robot.stem}),
    )
    print(f"{len(written)} files in {out}")
