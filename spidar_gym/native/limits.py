"""Validates bytes from outside before the library uses them: bounds of numbers, and relations between numbers.

The tables of the structs define the bounds. An integer without bounds is an error, so that no member can be forgotten.
The configuration of a controller must equal that of the controller which the bytes are loaded into.
"""

import operator
from collections.abc import Callable, Iterator
from functools import cache, reduce
from typing import Any, NamedTuple

import numpy as np

from spidar_gym.control.course import gates
from spidar_gym.control.locomotion import orders
from spidar_gym.native.configurations import configuration_structs
from spidar_gym.native.constants import ENUMERATIONS, PROGRAMS, ROWS, SIZES, STEPS, program_modes
from spidar_gym.native.core_structs import CORE_STRUCTS
from spidar_gym.native.engine_structs import (
    ENGINE_ENUMERATIONS,
    ENGINE_STRUCTS,
    MAX_PENDING,
    N_DOFS,
    engine_layouts,
)
from spidar_gym.native.structs import USUAL, Bounds, CStruct, border_structs
from spidar_gym.sim.ground import BOXES
from spidar_gym.sim.scene import TIMESTEP

_GROUND = PROGRAMS.index("rest")
"""Index of the first program of the crawl."""
FARTHEST = 1e12
"""Sum of squared positions and velocities above which a robot has diverged; as in `sp_plant_step`."""


class Numbers(NamedTuple):
    """Numbers of one kind in a struct."""

    at: np.ndarray
    """Byte offset of each."""
    low: np.ndarray
    """Least value of each."""
    high: np.ndarray
    """Largest value of each."""


@cache
def _tables() -> dict[str, CStruct]:
    structs = (*border_structs(), *CORE_STRUCTS, *configuration_structs(), *ENGINE_STRUCTS)
    return {each.name: each for each in structs}


@cache
def _words() -> dict[str, Bounds]:
    """Return the least and largest number of every enumeration."""
    found = (*ENUMERATIONS.values(), *ENGINE_ENUMERATIONS)
    return {each.name: (min(each.numbers.values()), max(each.numbers.values())) for each in found}


def _members(struct: str) -> Iterator[tuple[str, str, Any]]:
    """Yield name, kind and bounds of each member of a struct; bounds are None where the table has none."""
    for names, kind, _, _, *given in _tables()[struct].rows:
        stated: Any = given[0] if given else _words().get(kind)
        each = isinstance(stated, tuple) and any(isinstance(part, tuple | str) for part in stated)
        for k, name in enumerate(names.split()):
            bounds = stated[k] if each else stated
            yield name, kind, _words()[bounds] if isinstance(bounds, str) else bounds


@cache
def numbers_of(struct: str) -> dict[str, Numbers]:
    """Return all numbers of a struct and of its nested structs, by numpy's name of their kind.

    Raises:
        LookupError: For an integer whose table has no bounds.
    """
    found: dict[str, list[tuple[np.ndarray, ...]]] = {}
    layout: Any = engine_layouts()[struct].fields
    for name, kind, bounds in _members(struct):
        member, at = layout[name][:2]
        starts = at + member.base.itemsize * np.arange(np.prod(member.shape, dtype=int))
        if kind in _tables():
            for inner, own in numbers_of(kind).items():
                places = (starts[:, None] + own.at).ravel()
                found.setdefault(inner, []).append((places, *(np.tile(each, len(starts)) for each in own[1:])))
            continue
        if bounds is None and member.base.kind != "f":
            raise LookupError(f"{struct}.{name} is an integer without bounds")
        own = np.dtype("u1") if member.base.kind == "b" else member.base
        low, high = bounds or USUAL
        if own.kind != "f":
            low, high = max(low, np.iinfo(own).min), min(high, np.iinfo(own).max)
        limits = (np.full(len(starts), limit, own) for limit in (low, high))
        found.setdefault(own.str[1:], []).append((starts, *limits))
    return {kind: Numbers(*map(np.concatenate, zip(*parts, strict=True))) for kind, parts in found.items()}


def member_at(struct: str, at: int) -> str:
    """Return the name of the member at a byte offset in a struct."""
    fields: Any = engine_layouts()[struct].fields
    for name, kind, _ in _members(struct):
        member, begin = fields[name][:2]
        if begin <= at < begin + member.itemsize:
            k, rest = divmod(at - begin, member.base.itemsize)
            index = f"[{k}]" if member.shape else ""
            return f"{name}{index}" + (f".{member_at(kind, rest)}" if kind in _tables() else "")
    return ""


def _seen(records: np.ndarray, kind: str) -> np.ndarray:
    """View records as numbers of one kind, (robots, numbers)."""
    content = np.ascontiguousarray(records).reshape(-1).view(np.uint8)
    return content.reshape(-1, records.dtype.itemsize).view(kind)


def fault_of(struct: str, records: np.ndarray) -> str:
    """Describe the first invalid number or relation in records; return "" if all are valid.

    Results of MuJoCo and the sensors may be any number for a robot that has diverged.

    Args:
        struct: Name of the struct without `sp_`.
        records: Records of that struct, of any shape.
    """
    records = records.reshape(-1)
    if not records.size:
        return ""
    for kind, own in numbers_of(struct).items():
        seen, at = _seen(records, kind), own.at // np.dtype(kind).itemsize
        # Check the least and largest of each number first, which takes a fifth of the time.
        least, largest = (edge(axis=0)[at] for edge in (seen.min, seen.max))
        if ((least >= own.low) & (largest <= own.high)).all():
            continue
        values = seen[:, at]
        wrong = ~((values >= own.low) & (values <= own.high) | _may_be_anything(struct, records, kind, own.at))
        if wrong.any():
            robot, k = np.argwhere(wrong)[0]
            low, value, high = (number.item() for number in (own.low[k], values[robot, k], own.high[k]))
            return f"{member_at(struct, int(own.at[k]))} = {value:n}, expected {low:n} … {high:n}"
    for path, words, fits in _relations(struct):
        owner: Any = records
        for name in path:
            owner = owner[name]
        if not np.all(fits(owner)):
            return ".".join((*path, words))
    return ""


def _may_be_anything(struct: str, records: np.ndarray, kind: str, at: np.ndarray) -> np.ndarray:
    """Return which numbers may have any value as their robot has diverged, (robots, numbers)."""
    plant, begin = engine_layouts()["plant"], 0
    if kind != "f8":
        return np.zeros((len(records), len(at)), bool)
    if struct != "plant":
        fields: Any = records.dtype.fields
        if "plant" not in fields:
            return np.zeros((len(records), len(at)), bool)
        records, begin = records["plant"], fields["plant"][1]
    own: Any = plant.fields
    inside = (at >= begin + own["floor_R"][1]) & (at < begin + plant.itemsize)
    return (records["diverged"] != 0)[:, None] & inside


def differs(struct: str, records: np.ndarray, settled: np.ndarray, kinds: tuple[str, ...] = ()) -> str:
    """Return the first member of records that differs from the expected one, or "" if none does.

    Args:
        struct: Name of the struct without `sp_`.
        records: Records of that struct, (robots,).
        settled: Expected records, one for all or one for each.
        kinds: Kinds of numbers that are compared; all if not given.
    """
    for kind, own in numbers_of(struct).items():
        if kinds and kind not in kinds:
            continue
        at = own.at // np.dtype(kind).itemsize
        wrong = _seen(records, kind)[:, at] != _seen(settled, kind)[:, at]
        if wrong.any():
            return member_at(struct, int(own.at[np.argwhere(wrong)[0, 1]]))
    return ""


# ---- relations between numbers ----

Fits = Callable[[Any], Any]
"""Function that returns which records are valid."""


@cache
def _relations(struct: str) -> list[tuple[tuple[str, ...], str, Fits]]:
    """Return the relations of a struct and of its nested structs: path of names, error message, check."""
    found = [((), words, fits) for words, fits in RELATIONS.get(struct, ())]
    for name, kind, _ in _members(struct):
        if kind in _tables() and not engine_layouts()[struct][name].shape:
            found += [((name, *path), words, fits) for path, words, fits in _relations(kind)]
    return found


@cache
def _modes() -> np.ndarray:
    """Return a row for every program: `feet_carry`, unknowns, rows, kinds of its blocks of rows."""
    found = []
    for mode in program_modes().values():
        rows = [ROWS.index(type(each)) + 1 for each in mode.constraints]
        rows += [0] * (SIZES["MODE_ROWS"] - len(rows))
        found.append([int(mode.feet_carry), mode.size, len(mode.pattern), *rows])
    return np.array(found)


def _are_modes(modes: Any, kinds: Any) -> Any:  # noqa: ANN401 - numpy's records
    """Return whether allocation modes match their kinds, as their sizes determine how far the solver writes."""
    sizes = np.stack([modes["feet_carry"], modes["n"], modes["m"]], axis=-1)
    given = np.concatenate([sizes, modes["rows"]["kind"]], axis=-1)
    return (modes["kind"] == kinds) & (given == _modes()[kinds]).all(axis=-1)


def _is_in_a_phase(gait: Any) -> Any:  # noqa: ANN401 - numpy's records
    """Return whether a gait's phase belongs to its present step."""
    longest = max(map(len, STEPS.values()))
    words = list(ENUMERATIONS["phase"].words)
    phases = np.array([[*map(words.index, each), *[-1] * (longest - len(each))] for each in STEPS.values()])
    step = gait["steps"][np.arange(len(gait)), gait["first"]]
    runs = (gait["count"] > 0) & (phases[step["phases"], gait["index"]] == gait["phase"])
    return runs | (gait["phase"] == words.index("done"))


def _is_on_a_path(manager: Any) -> Any:  # noqa: ANN401 - numpy's records
    """Return whether a manager in a moving phase has a path."""
    moving = [orders.PHASES.index(word) for word in ("climb", "hover", "form", "fly")]
    return (manager["knot_count"] > 0) | ~np.isin(manager["memory"]["phase"], moving)


def _has_room(course: Any) -> Any:  # noqa: ANN401 - numpy's records
    """Return whether the boxes and tiles of a course fit into the arrays."""
    course_gates = course["gates"]
    kind, counts = course_gates["kind"], np.arange(gates.MAX_GATES) < course["count"][:, None]
    rows = np.rint((course_gates["end"] - course_gates["begin"]) / gates.ROW)
    tiled = counts & (kind == gates.KINDS.index("tiles"))
    boxes = np.where(tiled, gates.TILE_COLUMNS * rows, 1 + (kind == gates.KINDS.index("slot")))
    fits = ~tiled | ((rows >= 0) & (rows <= gates.TILE_ROWS))
    return fits.all(axis=1) & ((boxes * counts).sum(axis=1) < BOXES)


def _draws(generator: Any) -> Any:  # noqa: ANN401 - numpy's records
    """Return whether a random stream has an odd increment; with an even one its period is short."""
    return generator["increment_low"] & 1 == 1


def _is_set(generator: Any) -> Any:  # noqa: ANN401 - numpy's records
    """Return whether a random stream exists; a robot without noise and weather may have none."""
    words = ("state_high", "state_low", "increment_high", "increment_low")
    return reduce(operator.or_, (generator[word] for word in words)) != 0


def _is_somewhere(plant: Any) -> Any:  # noqa: ANN401 - numpy's records
    """Return whether a robot's state is finite at a time ≥ 0, or the robot is marked as diverged."""
    row = plant["row"]
    with np.errstate(over="ignore", invalid="ignore"):
        near = (row[:, 1 : 2 + 2 * N_DOFS] ** 2).sum(axis=1) < FARTHEST
    return (near & (row[:, 0] >= 0.0)) | (plant["diverged"] != 0)


RELATIONS: dict[str, tuple[tuple[str, Fits], ...]] = {
    "plant": (
        ("row has diverged or has a negative time", _is_somewhere),
        ("is_stuck without a lost rotor", lambda p: (p["is_stuck"] == 0) | (p["disturbances"]["lost_rotor"] > 0)),
        ("vectoring_delay with the jitter is too long",
         lambda p: (p["delay"] <= p["vectoring_delay"])
         & (p["vectoring_delay"] + np.rint(p["config"]["actuators"]["jitter"] / TIMESTEP)
            <= (MAX_PENDING - 2) * p["config"]["substeps"].astype(np.int64))),
        ("generator has an even increment", lambda p: _draws(p["generator"]) | ~_is_set(p["generator"])),
    ),
    "episode": (("generator has an even increment", lambda e: _draws(e["generator"])),),
    "flight": (
        ("mode differs from config's", lambda f: _are_modes(f["mode"], f["config"]["allocation"])),
        ("dt differs from config's", lambda f: f["dt"] == 1.0 / f["config"]["rate_hz"]),
    ),
    "crawl": (
        ("modes differ from the allocation's",
         lambda c: _are_modes(c["modes"][:, _GROUND:], np.arange(_GROUND, len(PROGRAMS)))),
        ("dt differs from config's", lambda c: c["dt"] == 1.0 / c["config"]["rate_hz"]),
    ),
    "gait_memory": (("phase is not one of the present step's", _is_in_a_phase),),
    "manager": (
        ("knot_count is 0 on a path", _is_on_a_path),
        ("flight.config differs from config's",
         lambda m: not differs("controller_config", m["flight"]["config"], m["config"]["flight"])),
        ("crawl.config differs from config's",
         lambda m: not differs("crawler_config", m["crawl"]["config"], m["config"]["crawl"])),
    ),
    "info": (("qp_status_code is no status", lambda i: i["qp_status_code"] <= _words()["status"][1]),),
    "course": (("gates do not fit into the boxes and tiles", _has_room),),
    "hover_robot": (("current is not one of the goals", lambda h: h["current"] < h["goals"]),),
}  # fmt: skip
"""Relations between numbers of a struct: error message, and check vectorised over robots."""
