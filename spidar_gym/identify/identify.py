"""Identification of a robot from logs: each log gives what it tells, and the rest is said to be untold."""

from collections.abc import Callable, Sequence
from itertools import count

import numpy as np

from spidar_gym.errors import SpidarError
from spidar_gym.identify.ahead import predict
from spidar_gym.identify.estimate import Estimate, UnfitLogError
from spidar_gym.identify.excitation import excitations_of
from spidar_gym.identify.hovers import fit_hovers, require_hovers
from spidar_gym.identify.report import Report, report_lines
from spidar_gym.identify.robot_file import Identified
from spidar_gym.identify.sensors import find_sensors
from spidar_gym.identify.servos import fit_servos
from spidar_gym.logs.record import Record
from spidar_gym.onboard.runner_structs import Excited
from spidar_gym.robot import ROBOT, RobotSpec

MASS_SPREAD = 0.5
"""Standard deviation of the described mass [kg] [chosen]."""
NO_DELAY = Estimate(np.array(0.03), np.array(0.02), np.array(0.05))
"""Delay of the commands without a bench test [s] [chosen]."""


def identify(
    logs: Sequence[tuple[str, Record]], *, mass: float | None = None, mass_deviation: float = 0.02,
    robot: RobotSpec = ROBOT, threads: int = 2, on_share: Callable[[str, float], object] = lambda what, share: None,
) -> Report:  # fmt: skip
    """Identify a robot from its logs.

    Args:
        logs: Name and record of each log: a bench test, a flight with swinging thrusts, or both, in any order.
        mass: Mass of the robot by a scale [kg]; the described mass if None.
        mass_deviation: Standard deviation of the scale's mass [kg].
        robot: The described robot.
        threads: Threads that simulate.
        on_share: Called with the name of a log and the share of its work that is done, for progress.

    Raises:
        UnfitLogError: For logs of which none is a bench test or a flight with swinging thrusts.
    """
    spread = MASS_SPREAD if mass is None else mass_deviation
    weighed = Estimate(np.array(mass or robot.total_mass), np.array(spread), np.array(MASS_SPREAD))
    kilograms = float(weighed.value)
    benches = [(name, record) for name, record in logs if record.properties.get("mission") == "bench"]
    flights = [(name, record) for name, record in logs if has_swings(record)]
    if not benches and not flights:
        raise UnfitLogError(
            "bench test and no swinging thrust",
            "logs of the tests bench and thrust, `spidar sitl tests` or missions/*.txt",
        )
    if len(benches) > 1 or len(flights) > 1:
        several = [name for name, _ in (benches if len(benches) > 1 else flights)]
        raise SpidarError(f"several logs of one test: {', '.join(several)}; valid: one of each test")
    for _, record in flights:
        require_hovers(record)  # before the minutes that a bench test takes
    servos = hovers = None
    for name, record in benches:
        steps = count(1)
        servos = fit_servos(
            record, kilograms, robot, threads=threads,
            on_step=lambda _, name=name, steps=steps: on_share(name, 1.0 - 0.75 ** next(steps)),
        )  # fmt: skip
        on_share(name, 1.0)
    delay = NO_DELAY if servos is None else servos.delay
    ahead = {}
    for name, record in flights:
        steps = count(1)
        hovers = fit_hovers(
            record, kilograms, delay, robot,
            on_step=lambda name=name, steps=steps: on_share(name, min(0.9, 0.05 * next(steps))),
        )  # fmt: skip
        own = (record, kilograms, float(delay.value))
        ahead[name] = (*predict(*own, servos, hovers, robot, threads), predict(*own, None, None, robot, threads)[0])
        on_share(name, 1.0)
    found = Identified(weighed, servos, hovers)
    sensors = find_sensors((flights or benches)[0][1])
    used = tuple(name for name, _ in (*benches, *flights))
    unused = tuple(name for name, _ in logs if name not in used)
    return Report(used, tuple(report_lines(found, sensors)), sensors, found, ahead, unused)


def has_swings(record: Record) -> bool:
    """Return whether thrusts swing in a log's mission."""
    try:
        return any(each.excited == Excited.THRUST for each in excitations_of(record))
    except UnfitLogError:
        return False
