"""Limits of every number of a robot's record: what bytes from outside are held to before the library has them."""

from functools import cache
from typing import Any

import numpy as np

from spidar_gym.control.allocation.allocator import AllocationStatus
from spidar_gym.control.allocation.modes import ALLOCATIONS
from spidar_gym.control.course import gates
from spidar_gym.control.crawl.footsteps import STRIDES
from spidar_gym.control.crawl.phases import PHASES
from spidar_gym.control.locomotion import commands, orders
from spidar_gym.native.constants import (
    COSTS,
    MANAGER_KNOTS,
    MAX_M,
    MAX_N,
    MAX_STEPS,
    MAX_WAYPOINTS,
    PROGRAMS,
    ROWS,
    STEPS,
    program_modes,
)  # fmt: skip
from spidar_gym.native.engine_structs import (
    COURSE_FAILURES,
    CRAWL_FAILURES,
    FLIGHT_FAILURES,
    MAX_FRAMES,
    MAX_PENDING,
    SEQUENCES,
)  # fmt: skip
from spidar_gym.robot import N_ROTORS
from spidar_gym.sim.disturbances import FAULTS
from spidar_gym.sim.violations import VIOLATIONS
from spidar_gym.state import IMU_SAMPLES

TICKS = 2**40
"""More ticks or physics steps than any episode has."""
_ANY, _FLAG, _COUNT = (0, 2**64 - 1), (0, 1), (0, TICKS)
LIMITS: dict[str, tuple[int, int]] = {
    # of random streams any number is one
    **dict.fromkeys(
        ("generator.state_high", "generator.state_low", "generator.increment_high", "generator.increment_low",
         "generator.half", "generator.pool", "generator.hash", "generator.spawned"), _ANY,
    ),
    "generator.has_half": _FLAG,
    # words
    "allocation.status": (0, len(AllocationStatus) - 1),
    "config.allocation": (0, len(ALLOCATIONS) - 1), "flight.allocation": (0, len(ALLOCATIONS) - 1),
    "gait.stride": (0, len(STRIDES) - 1), "gait.phase": (0, len(PHASES) - 1),
    "memory.phase": (0, len(orders.PHASES) - 1), "steps.phases": (0, len(STEPS) - 1),
    "memory.mode": (0, len(PROGRAMS) - 1), "mode.kind": (0, len(PROGRAMS) - 1), "modes.kind": (0, len(PROGRAMS) - 1),
    "costs.kind": (0, len(COSTS)), "rows.kind": (0, len(ROWS)), "commands.kind": (0, len(commands.KINDS) - 1),
    "gates.kind": (0, len(gates.KINDS)), "disturbances.fault": (0, len(FAULTS) - 1), "reference.mode": (0, 1),
    "forms": (0, len(SEQUENCES) - 1),
    "episode.failure": (-1, max(map(len, (FLIGHT_FAILURES, CRAWL_FAILURES, COURSE_FAILURES))) - 1),
    # indices and counts
    "allocation.rows": (0, MAX_M), "memory.rows": (0, MAX_M), "allocation.active": (-1, 1), "memory.active": (-1, 1),
    "mode.n": (0, MAX_N), "modes.n": (0, MAX_N), "mode.m": (0, MAX_M), "modes.m": (0, MAX_M),
    "gait.first": (0, MAX_STEPS - 1), "gait.count": (0, MAX_STEPS),
    "gait.index": (0, max(len(phases) for phases in STEPS.values())),
    "manager.count": (0, MAX_WAYPOINTS), "manager.knot_count": (0, MANAGER_KNOTS), "course.count": (0, gates.MAX_GATES),
    "disturbances.lost_rotor": (0, N_ROTORS), "plant.pending_first": (0, MAX_PENDING - 1),
    "plant.pending_count": (0, MAX_PENDING), "sensors.frames": (0, MAX_FRAMES), "sensors.samples": (0, IMU_SAMPLES),
    "plant.violated": (0, 2 ** len(VIOLATIONS) - 1), "config.substeps": (0, 1000),
    "plant.delay": (0, MAX_PENDING * 1000), "plant.vectoring_delay": (0, MAX_PENDING * 1000),
    "compensation.observer_order": (0, 2), "allocator.max_iter": (0, 10**5),
    # ticks, and what is counted
    **dict.fromkeys(
        ("plant.clock", "pending.due", "pending.vectoring_due", "episode.ticks", "allocation.iterations",
         "gait.timeouts", "memory.failures", "rested", "flown", "crawled", "controls", "swing_ticks", "timeouts",
         "cycles"),
        _COUNT,
    ),
    "goals": _COUNT, "current": _COUNT, "knots": _COUNT,  # and held to the fleet's rooms
    # flags
    **dict.fromkeys(
        ("actuators.battery", "aero.wake", "commands.along", "commands.at_once", "commands.has_form",
         "compensation.has_momentum", "compensation.has_observed", "compensation.has_slow",
         "compensation.observer_beyond", "config.power", "config.sense", "course.dares", "crawl.power", "crawl.ticked",
         "demand.lifted", "demand.locked", "demand.lost", "demand.restricted", "episode.has_command", "episode.over",
         "episode.truncated", "flight.ticked", "gait.rested", "gait.rolling", "generator.has_half",
         "interference.restricted", "last.flies", "lock.active", "lock.vertical", "memory.rises", "mode.feet_carry",
         "modes.feet_carry", "pilot.has_target", "plant.diverged", "plant.falling", "plant.has_air",
         "plant.in_contact", "plant.is_stuck", "plant.senses", "reference.lost_thrust", "reference.lost_vectoring",
         "residual.has_forces_l", "residual.has_leg_forces_b", "steps.has_angle", "steps.has_height",
         "steps.has_target", "steps.legs", "touch.balls", "touch.ducts", "is_given", "lies", "duct_contact", "has_trim",
         "is_led", "reached"), _FLAG,
    ),
    "interference.side": (-1, 1),
}  # fmt: skip
"""Least and largest value by the struct's member and its own name; of a robot's own members by their name alone."""
INFINITE = frozenset(
    ("estimator.past_time", "rows.a", "demand.lower", "demand.upper", "interference.lower", "interference.upper",
     "weather.next_push", ".duct_clearance", "touch.duct_clearance")
)  # fmt: skip
"""Numbers that may be infinite."""
LARGEST = 1e15
"""No other number of a robot is as large, in SI units: what it leads to would be none."""


def limits_of(name: str, member: str) -> tuple[int, int] | None:
    """Least and largest value of a whole number (None where none is stated).

    Args:
        name: Of the member.
        member: Of what it is in; empty for a robot's own.
    """
    return LIMITS.get(f"{member}.{name}" if member else name)


@cache
def _modes() -> tuple[np.ndarray, np.ndarray]:
    """Unknowns and rows of every program (programs, 2); how many rows each kind of a block has."""
    sizes = [(mode.size, len(mode.pattern)) for mode in program_modes().values()]
    return np.array(sizes), np.array([0, *(len(kind.pattern) for kind in ROWS)])


def fault_of(records: np.ndarray, member: str = "", path: str = "", *, floats: bool = True) -> str:
    """What of robots is outside its limits, in words; empty where nothing is.

    Args:
        records: Records of robots, or of a member of theirs.
        member: Name of that member.
        path: Names that lead to it.
        floats: Whether numbers that are not whole are looked at.
    """
    for name in records.dtype.names or ():
        values, own = records[name], f"{path}{name}"
        if values.dtype.names:
            fault = fault_of(values, name, f"{own}.", floats=floats)
            if not fault and "feet_carry" in values.dtype.names:
                fault = _fault_of_modes(values, own)
        elif values.dtype.kind == "f":
            fault = _fault_of_floats(values, own, f"{member}.{name}") if floats else ""
        else:
            fault = _fault_of_integers(values, own, limits_of(name, member))
        if fault:
            return fault
    return ""


def _fault_of_floats(values: np.ndarray, path: str, name: str) -> str:
    fits = np.abs(values) <= LARGEST
    if name in INFINITE:
        fits |= np.isinf(values)
    return "" if fits.all() else f"{path} = {values[~fits].flat[0]:g}, expected a number within ± {LARGEST:g}"


def _fault_of_integers(values: np.ndarray, path: str, limits: tuple[int, int] | None) -> str:
    if limits is None or not values.size:
        return "" if limits else f"{path}, which has no limits"
    low, high = limits
    for value in (int(values.min()), int(values.max())):
        if not low <= value <= high:
            return f"{path} = {value}, expected {low} … {high}"
    return ""


def _fault_of_modes(modes: np.ndarray, path: str) -> str:
    """Whether a mode of the allocation is larger than what its kind has room for, or than its blocks."""
    sizes, counts = _modes()
    given = np.stack([modes["n"], modes["m"]], axis=-1)
    fits = (given <= sizes[modes["kind"]]).all(axis=-1) & (counts[modes["rows"]["kind"]].sum(axis=-1) <= MAX_M)
    return "" if fits.all() else f"{path} is none of the allocation's modes"


def fault_of_plants(plants: np.ndarray) -> str:
    """What of simulated robots does not fit together; empty where all does."""
    most = (MAX_PENDING - 2) * plants["config"]["substeps"].astype(np.int64)
    if np.any(plants["vectoring_delay"] > most) or np.any(plants["delay"] > plants["vectoring_delay"]):
        return "plant.delay is longer than there is room for"
    if np.any((plants["is_stuck"] != 0) & (plants["disturbances"]["lost_rotor"] < 1)):
        return "plant.is_stuck without a lost rotor"
    return ""


def fault_of_robots(robots: np.ndarray, rooms: dict[str, int]) -> str:
    """What of robots is outside its limits or does not fit together, in words; empty where all is well.

    Args:
        robots: Records of `sp_hover`, `sp_crawling` or `sp_coursing`.
        rooms: How many `goals` and `knots` there is room for.
    """
    flies = robots["plant"]["diverged"] == 0  # the numbers of another are none, and none of them is used
    found: Any = fault_of(robots[flies]) or fault_of(robots[~flies], floats=False) or fault_of_plants(robots["plant"])
    if found or "goals" not in (robots.dtype.names or ()):
        return found
    for name, room in rooms.items():
        if np.any(robots[name] > room):
            return f"{name} = {int(robots[name].max())}, expected up to {room}"
    if np.any(robots["current"] >= np.maximum(robots["goals"], 1)):
        return f"current = {int(robots['current'].max())}, expected one of the goals"
    return ""
