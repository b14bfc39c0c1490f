"""Serialisation of a fleet's robots, which resume in another slot, vector or process."""

import hashlib
import json
import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from spidar_gym.border import BorderError, parse_json, require_form
from spidar_gym.envs.fleet import Fleet
from spidar_gym.errors import InvalidValueError, SpidarError, shown
from spidar_gym.native.library import version
from spidar_gym.native.limits import differs, fault_of
from spidar_gym.robot.description import model_hash

MAGIC = b"spidar robots\n"
"""First bytes of saved robots; a line of JSON that describes them, their numbers, and a checksum follow."""
ROOMS = ("goals", "knots")
"""Arrays of a fleet with a varying number of entries per robot."""
_WORDS = "environment", "robot", "task", "version", "set of options"
"""Entries of the head that are strings."""
_CONTROLLERS = {
    "hover": ("flight", "controller", "controller_config"), "crawl": ("crawl", "controller", "crawler_config"),
    "course": ("manager", "manager", "manager_config"), "grasp": ("manager", "manager", "manager_config"),
}  # fmt: skip
"""Member of a robot with its controller, member of the rules with the configuration, and the latter's struct."""
CHECKSUM = hashlib.sha256().digest_size


def save(fleet: Fleet, ids: Sequence[int]) -> bytes:
    """Return the complete state of some robots as bytes.

    Args:
        fleet: Fleet of the robots.
        ids: Indices of the robots.
    """
    rooms = {name: getattr(fleet, name).shape[1] for name in ROOMS}
    head = json.dumps(_description(fleet, ids) | {"robots": len(ids), **rooms}).encode() + b"\n"
    body = b"".join(part[k].tobytes() for part in _parts(fleet) for k in ids)
    content = MAGIC + head + body
    return content + hashlib.sha256(content).digest()


def restore(fleet: Fleet, saved: bytes, ids: Sequence[int]) -> None:
    """Replace robots by saved ones, in the order of the saved ones.

    Args:
        fleet: Fleet of the robots to replace.
        saved: Bytes from `save` of any fleet of the same environment and options; the autoreset mode may differ.
        ids: Indices of the robots to replace.

    Raises:
        SpidarError: For bytes that are not saved robots, are damaged, or of another version, environment or other
            options; the fleet is unchanged.
        InvalidValueError: For another number of robots than were saved; the fleet is unchanged.
    """
    told, body = _opened(fleet, saved, ids)
    rows = _rows(fleet, body, len(ids), {name: told[name] for name in ROOMS})
    if fault := _fault(fleet, rows, list(ids)):
        raise SpidarError(f"the saved robots cannot be: {fault}; valid: the bytes that save() returned")
    chosen = list(ids)
    with fleet.engine.turn.lock:
        fleet.make_room(*(told[name] for name in ROOMS))
        for part, row in zip(_parts(fleet), rows, strict=True):
            if part is fleet.goals or part is fleet.knots:
                part[chosen, : row.shape[1]] = row
            else:
                part[chosen] = row
        fleet.restored()


def _opened(fleet: Fleet, saved: bytes, ids: Sequence[int]) -> tuple[dict[str, Any], bytes]:
    """Return the head and the body of saved robots that match this fleet; errors as for `restore`."""
    if not (isinstance(saved, bytes) and saved.startswith(MAGIC)):
        raise SpidarError("these are no saved robots; valid: the bytes that save() returned")
    content, checksum = saved[:-CHECKSUM], saved[-CHECKSUM:]
    if hashlib.sha256(content).digest() != checksum:
        raise SpidarError("the saved robots are damaged; valid: the bytes that save() returned, all of them")
    head, _, body = content[len(MAGIC) :].partition(b"\n")
    try:
        told = parse_json(head)
        require_form(told, dict.fromkeys(_WORDS, str) | dict.fromkeys(("robots", *ROOMS), int), "head")
    except BorderError as error:
        raise SpidarError(f"the saved robots are damaged: {error}; valid: the bytes that save() returned") from error
    for name, here in _description(fleet, ids).items():
        if told[name] != here:
            raise SpidarError(f"the saved robots are of another {name}: {shown(told[name])}; valid here: {here}")
    if told["robots"] != len(ids):
        raise InvalidValueError("ids", list(ids), f"{told['robots']} robots, as many as were saved")
    return told, body


def _rows(fleet: Fleet, body: bytes, robots: int, rooms: dict[str, int]) -> list[np.ndarray]:
    """Return the arrays of saved robots, one for each of `_parts` (`SpidarError` for a body of another size)."""
    shapes = []
    for part in _parts(fleet):
        name = next((name for name in ROOMS if part is getattr(fleet, name)), None)
        shapes.append((robots, *(part.shape[1:] if name is None else (rooms[name],))))
    sizes = [part.dtype.itemsize * math.prod(shape) for part, shape in zip(_parts(fleet), shapes, strict=True)]
    if min(rooms.values()) < 0 or sum(sizes) != len(body):
        raise SpidarError(f"the saved robots have {len(body)} bytes; valid: {sum(sizes)}, as save() returned")
    ends, whole = np.cumsum(sizes).tolist(), memoryview(body)
    return [
        np.frombuffer(whole[end - size : end], part.dtype).reshape(shape)
        for part, shape, size, end in zip(_parts(fleet), shapes, sizes, ends, strict=True)
    ]


def _fault(fleet: Fleet, rows: list[np.ndarray], ids: list[int]) -> str:
    """Return which saved values are out of bounds, inconsistent or do not match the options, in words; else empty."""
    robots, goals, knots, observations, infos, quantities, *others = rows
    parts = ((f"{fleet.kind}_robot", robots), ("goal", goals), ("knot", knots), (f"{fleet.kind}_info", infos))
    for struct, records in parts:
        if fault := fault_of(struct, records):
            return fault
    if fleet.kind == "hover" and not ((robots["goals"] <= goals.shape[1]) & (robots["knots"] <= knots.shape[1])).all():
        return "more goals or knots than allocated"
    if (
        not (robots["episode"]["failure"] < len(fleet.task.failures)).all()
        or not (infos["info"]["failure_code"] < len(fleet.task.failures)).all()
    ):
        return f"episode.failure, expected −1 … {len(fleet.task.failures) - 1}"
    rules = fleet.rules[ids] if fleet.rules.ndim else fleet.rules
    owner, member, struct = _CONTROLLERS[fleet.kind]
    plants = robots["plant"]["config"].copy()
    if fleet.kind == "grasp":  # the object is the scene's, not the options'
        if not (plants["object"]["shape"] == robots["scene"]["shape"] + 1).all():
            return "config.object.shape differs from the scene"
        plants["object"]["shape"] = rules["rules"]["plant"]["object"]["shape"]
    fault = differs(struct, robots[owner]["config"], rules[member]) or differs(
        "plant_config", plants, rules["rules"]["plant"], ("i4",)
    )
    if fault:
        return f"config.{fault} differs from the options"
    if fleet.has_own_copies and (fault := fleet.engine.fault_of_copies(others.pop())):
        return fault
    counted = np.ascontiguousarray(quantities).view(np.float64)
    plain = [observations, counted, *(part for part in others if part.dtype.kind == "f")]
    flags = [part.view(np.uint8) for part in others if part.dtype.kind == "b"]
    if not all(np.isfinite(part).all() for part in plain) or any((part > 1).any() for part in flags):
        return "a number that is not finite, or a flag other than 0 or 1"
    return ""


def _parts(fleet: Fleet) -> list[np.ndarray]:
    """Return the arrays that hold the complete state of the robots, with an entry for each."""
    parts = [fleet.robots, fleet.goals, fleet.knots, *fleet.parts]
    # If all robots are alike, they share a single copy of their model, equal in every fleet of these options.
    return parts + [fleet.engine.copies] * fleet.has_own_copies


def _description(fleet: Fleet, ids: Sequence[int]) -> dict[str, Any]:
    """Return what must be equal in the fleet in which robots resume."""
    rules = fleet.rules.copy() if fleet.rules.ndim == 0 else fleet.rules[list(ids)]
    rules["rules"]["autoreset"] = 0
    return {
        "environment": fleet.kind,
        "robot": model_hash(fleet.engine.robot)[:16],
        "task": f"{type(fleet.task).__module__}.{type(fleet.task).__qualname__}",
        "version": version(),
        "set of options": hashlib.sha256(_content(rules)).hexdigest()[:16],
    }


def _content(record: np.ndarray) -> bytes:
    """Return the bytes of a record without the padding between its members."""
    if record.dtype.names is None:
        return record.tobytes()
    return b"".join(_content(record[name]) for name in record.dtype.names)
