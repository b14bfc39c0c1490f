"""Courses and targets as records of the core."""

from typing import Any

from spidar_gym.control.course.gates import KINDS, Course, Gate
from spidar_gym.control.course.target import Target
from spidar_gym.control.crawl.pose2 import Pose2
from spidar_gym.native.structs import fill


def write_course(record: Any, course: Course) -> None:  # noqa: ANN401 - numpy's row
    """Write a course into an `sp_course`."""
    record["count"], record["dares"], record["gates"], record["tiles"] = len(course.gates), course.dares, 0, 0.0
    for row, gate in zip(record["gates"], course.gates, strict=False):
        row["kind"] = KINDS.index(gate.kind)
        for name in ("begin", "end", "size", "middle"):
            row[name] = getattr(gate, name)
    fill(record["goal"], course.goal)
    record["tiles"][: len(course.tiles)] = course.tiles


def read_course(record: Any) -> Course:  # noqa: ANN401 - numpy's row
    """Return the course in an `sp_course`."""
    names = ("begin", "end", "size", "middle")
    rows = record["gates"][: int(record["count"])]
    gates = tuple(Gate(KINDS[int(row["kind"])], *(row[name].item() for name in names)) for row in rows)
    n = sum(gate.tile_count for gate in gates)
    tiles = tuple(record["tiles"][:n].tolist())
    return Course(gates, Pose2(*record["goal"].tolist()), tiles, bool(record["dares"]))


def read_target(record: Any) -> Target | None:  # noqa: ANN401 - numpy's row
    """Return the target that an `sp_pilot` follows; None without one."""
    if not record["has_target"]:
        return None
    last = record["last"]
    names = ("x", "y", "z", "yaw", "speed", "narrow", "sweep")
    return Target(bool(last["flies"]), *(last[name].item() for name in names))
