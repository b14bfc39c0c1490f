"""Robots of a fleet as bytes, and back: into another place, another vector, another process, where they go on."""

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
"""What saved robots begin with; a line of JSON that says what they are follows, their numbers, and a checksum."""
ROOMS = ("goals", "knots")
"""Arrays of a fleet of which a robot has more or fewer entries."""
_WORDS = "environment", "robot", "task", "version", "set of options"
"""What the head says in words."""
_CONTROLLERS = {
    "hover": ("flight", "controller", "controller_config"), "crawl": ("crawl", "controller", "crawler_config"),
    "course": ("manager", "manager", "manager_config"),
}  # fmt: skip
"""Who controls robots, where the rules say how, and the struct of that."""
CHECKSUM = hashlib.sha256().digest_size


def save(fleet: Fleet, ids: Sequence[int]) -> bytes:
    """All that there is of some robots.

    Args:
        fleet: Where they are.
        ids: Which ones.
    """
    rooms = {name: getattr(fleet, name).shape[1] for name in ROOMS}
    head = json.dumps(_description(fleet, ids) | {"robots": len(ids), **rooms}).encode() + b"\n"
    body = b"".join(part[k].tobytes() for part in _parts(fleet) for k in ids)
    content = MAGIC + head + body
    return content + hashlib.sha256(content).digest()


def restore(fleet: Fleet, saved: bytes, ids: Sequence[int]) -> None:
    """Let robots be those that were saved, in their order.

    Args:
        fleet: Where they are to be.
        saved: What `save` gave, of any fleet of the same environment and options; how episodes follow each other may
            differ.
        ids: Which robots become the saved ones.

    Raises:
        SpidarError: For bytes that are no saved robots, are damaged, of another version, another environment or other
            options, and nothing has changed.
        InvalidValueError: For another number of robots than were saved, and nothing has changed.
    """
    told, body = _opened(fleet, saved, ids)
    rows = _rows(fleet, body, len(ids), {name: told[name] for name in ROOMS})
    if fault := _fault(fleet, rows, list(ids)):
        raise SpidarError(f"the saved robots cannot be: {fault}; valid: the bytes that save() gave")
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
    """Head and body of saved robots that fit here; errors as of `restore`."""
    if not (isinstance(saved, bytes) and saved.startswith(MAGIC)):
        raise SpidarError("these are no saved robots; valid: the bytes that save() gave")
    content, checksum = saved[:-CHECKSUM], saved[-CHECKSUM:]
    if hashlib.sha256(content).digest() != checksum:
        raise SpidarError("the saved robots are damaged; valid: the bytes that save() gave, all of them")
    head, _, body = content[len(MAGIC) :].partition(b"\n")
    try:
        told = parse_json(head)
        require_form(told, dict.fromkeys(_WORDS, str) | dict.fromkeys(("robots", *ROOMS), int), "head")
    except BorderError as error:
        raise SpidarError(f"the saved robots are damaged: {error}; valid: the bytes that save() gave") from error
    for name, here in _description(fleet, ids).items():
        if told[name] != here:
            raise SpidarError(f"the saved robots are of another {name}: {shown(told[name])}; valid here: {here}")
    if told["robots"] != len(ids):
        raise InvalidValueError("ids", list(ids), f"{told['robots']} robots, as many as were saved")
    return told, body


def _rows(fleet: Fleet, body: bytes, robots: int, rooms: dict[str, int]) -> list[np.ndarray]:
    """Arrays of saved robots, one for each of `_parts` (`SpidarError` for a body of another size)."""
    shapes = []
    for part in _parts(fleet):
        name = next((name for name in ROOMS if part is getattr(fleet, name)), None)
        shapes.append((robots, *(part.shape[1:] if name is None else (rooms[name],))))
    sizes = [part.dtype.itemsize * math.prod(shape) for part, shape in zip(_parts(fleet), shapes, strict=True)]
    if min(rooms.values()) < 0 or sum(sizes) != len(body):
        raise SpidarError(f"the saved robots have {len(body)} bytes; valid: {sum(sizes)}, the bytes that save() gave")
    ends, whole = np.cumsum(sizes).tolist(), memoryview(body)
    return [
        np.frombuffer(whole[end - size : end], part.dtype).reshape(shape)
        for part, shape, size, end in zip(_parts(fleet), shapes, sizes, ends, strict=True)
    ]


def _fault(fleet: Fleet, rows: list[np.ndarray], ids: list[int]) -> str:
    """What of saved robots is out of bounds, does not fit together or not to the options, in words; else empty."""
    robots, goals, knots, observations, infos, quantities, *others = rows
    parts = ((f"{fleet.kind}_robot", robots), ("goal", goals), ("knot", knots), (f"{fleet.kind}_info", infos))
    for struct, records in parts:
        if fault := fault_of(struct, records):
            return fault
    if fleet.kind == "hover" and not ((robots["goals"] <= goals.shape[1]) & (robots["knots"] <= knots.shape[1])).all():
        return "more goals or knots than there is room for"
    if (
        not (robots["episode"]["failure"] < len(fleet.task.failures)).all()
        or not (infos["info"]["failure_code"] < len(fleet.task.failures)).all()
    ):
        return f"episode.failure, expected −1 … {len(fleet.task.failures) - 1}"
    rules = fleet.rules[ids] if fleet.rules.ndim else fleet.rules
    owner, member, struct = _CONTROLLERS[fleet.kind]
    fault = differs(struct, robots[owner]["config"], rules[member]) or differs(
        "plant_config", robots["plant"]["config"], rules["rules"]["plant"], ("i4",)
    )
    if fault:
        return f"config.{fault} is another than the options say"
    if fleet.has_own_copies and (fault := fleet.engine.fault_of_copies(others.pop())):
        return fault
    counted = np.ascontiguousarray(quantities).view(np.float64)
    plain = [observations, counted, *(part for part in others if part.dtype.kind == "f")]
    flags = [part.view(np.uint8) for part in others if part.dtype.kind == "b"]
    if not all(np.isfinite(part).all() for part in plain) or any((part > 1).any() for part in flags):
        return "a number that is none"
    return ""


def _parts(fleet: Fleet) -> list[np.ndarray]:
    """Arrays with an entry for every robot that are all that there is of them."""
    parts = [fleet.robots, fleet.goals, fleet.knots, *fleet.parts]
    # Where all robots are alike there is a single copy of what they are, and every fleet of these options has the same.
    return parts + [fleet.engine.copies] * fleet.has_own_copies


def _description(fleet: Fleet, ids: Sequence[int]) -> dict[str, Any]:
    """What has to be the same where robots are to go on."""
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
    """Bytes of a record without those between its members, which mean nothing."""
    if record.dtype.names is None:
        return record.tobytes()
    return b"".join(_content(record[name]) for name in record.dtype.names)
