"""Parameters of the runner, as a record of `sp_parameters` and as the text file that the runner reads at start."""

import hashlib
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from spidar_gym.border import BorderError, read_file
from spidar_gym.control.estimator import EstimatorConfig
from spidar_gym.control.flight.controller import ControllerConfig
from spidar_gym.control.locomotion.orders import ManagerConfig
from spidar_gym.errors import InvalidValueError
from spidar_gym.native.codegen.header import capped_presets
from spidar_gym.native.robot import robot as robot_record
from spidar_gym.native.structs import fill
from spidar_gym.onboard.fields import (
    ELSEWHERE,
    LEAST_MOMENT,
    LONGEST,
    MODEL,
    MOST_BYTES,
    PARAMETERS,
    PRESETS,
    ROUNDING,
    SECTIONS,
    STRUCTURE,
    Field,
    fields_of,
)
from spidar_gym.onboard.limits import Limits
from spidar_gym.onboard.runner_header import runner_hash
from spidar_gym.onboard.runner_structs import MOST_PRESETS, NAME, log_layouts
from spidar_gym.robot import GIMBAL_NAMES, JOINT_NAMES, ROBOT, RobotSpec
from spidar_gym.robot.description import model_hash

_NUMBER, _DIGEST = re.compile(rb"[-+.0-9eE]+"), re.compile(rb"[0-9a-f]{64}")
_PRESET = re.compile(r"[a-z0-9_]+")


def parameters_record(
    robot: RobotSpec = ROBOT,
    presets: Sequence[str] = ("steady",),
    *,
    limits: Limits | None = None,
    own: Mapping[str, ControllerConfig] | None = None,
) -> np.ndarray:
    """Return the parameters for a robot, a record of `sp_parameters` without the hash of its file.

    Args:
        robot: The robot.
        presets: Names of the flight presets; the crawl presets are all.
        limits: Thresholds of the runner; the default ones if None.
        own: Further flight controllers by name: lower-case letters, digits and underscores.

    Raises:
        UnknownNameError: For a preset that does not exist.
        InvalidValueError: For too many presets, numbers out of the runner's range, and robots whose legs cannot reach
            the poses of a preset.
    """
    record = np.zeros((), log_layouts()["parameters"])
    _put_text(record, "model", model_hash(robot).encode())
    record["robot"] = robot_record(robot)
    for section, config in (("limits", limits or Limits()), ("estimator", EstimatorConfig()),
                            ("manager", ManagerConfig())):  # fmt: skip
        fill(record[section], config)
    for struct, name in ELSEWHERE:
        assert SECTIONS["manager"] == struct
        record["manager"][name] = np.zeros((), record["manager"].dtype[name])
    if len(presets) + len(own or {}) > MOST_PRESETS:
        raise InvalidValueError("presets", [*presets, *(own or {})], f"at most {MOST_PRESETS} flight presets")
    for kind, found in zip(PRESETS, capped_presets(presets, robot, own).values(), strict=True):
        for name, config in found.items():
            fill(_new_preset(record, kind, name), config)
    for name, field, owner in _lines(record):
        if _refused(field, values := field.values(owner).tolist()):
            raise InvalidValueError(name, values, _valid(field))
    if why := _impossible(record["robot"]):
        raise InvalidValueError("robot", model_hash(robot), why)
    return record


def parameters_text(record: np.ndarray) -> bytes:
    """Return the parameter file of a record of `sp_parameters`; numbers are the shortest that read back bit for bit."""
    lines = [f"{PARAMETERS} interface {runner_hash()}", f"{MODEL} sha256 {text_of(record['model'])}"]
    body = -1
    for name, field, owner in _lines(record):
        if field.keys[0] == "tree" and field.keys[1] != body:
            body = int(field.keys[1])
            lines.append(f"# body {body}: {_carried(record['robot']['tree'][body])}")
        values = field.values(owner).tolist()
        words = [field.words[value] for value in values] if field.words else map(repr, values)
        lines.append(f"{name} {field.unit} {' '.join(words)}")
    text = "".join(f"{line}\n" for line in lines).encode()
    return text + f"sha256 {hashlib.sha256(text).hexdigest()}\n".encode()


def digest_of(text: bytes) -> str:
    """Return the SHA-256 in the last line of a parameter file."""
    return text[-65:-1].decode()


def parameters_of(data: bytes) -> np.ndarray:
    """Read a parameter file's bytes into a record of `sp_parameters`, with the checks of the runner.

    Raises:
        BorderError: For bytes that are no such file, of another interface, cut, edited, or with other fields, units or
            numbers than valid ones.
    """
    front, line, rest = data.partition(b"\n")
    head = f"{PARAMETERS} interface ".encode()
    if len(data) > MOST_BYTES or b"\0" in data or not front.startswith(head) or not line:
        raise BorderError(f"no parameters; valid: a file that `spidar parameters` wrote, with {PARAMETERS} in line 1")
    if front != head + runner_hash().encode():
        raise BorderError(f"the parameters are of another interface; valid: {runner_hash()}, that of this version")
    at = data.rfind(b"\n", 0, len(data) - 1) + 1
    if not re.fullmatch(rb"sha256 [0-9a-f]{64}\n", data[at:]):
        raise BorderError("the parameters are cut; valid: a whole file, with its sha256 in the last line")
    digest = hashlib.sha256(data[:at]).hexdigest().encode()
    if data[at + 7 : -1] != digest:
        raise BorderError("the parameters were edited; valid: a file as `spidar parameters` wrote it")
    record = _read_lines(rest[: at - len(front) - 1].split(b"\n")[:-1])
    if why := _impossible(record["robot"]):
        raise BorderError(f"the parameters describe no possible robot; valid: {why}")
    _put_text(record, "sha256", digest)
    return record


def read_parameters(path: Path) -> np.ndarray:
    """Read a parameter file into a record of `sp_parameters` (`BorderError` for one that the runner refuses)."""
    try:
        return parameters_of(read_file(path, MOST_BYTES))
    except BorderError as error:
        raise BorderError(f"{path}: {error}") from error


def flight_presets(path: Path) -> list[str]:
    """Return the names of a file's flight presets (`BorderError` for a file that the runner refuses)."""
    return _names(read_parameters(path), "flight")


def text_of(characters: np.ndarray) -> str:
    """Return the text of a zero-terminated array of characters."""
    return characters.tobytes().partition(b"\0")[0].decode("ascii", "replace")


def _put_text(record: Any, name: str, text: bytes) -> None:  # noqa: ANN401 - a record
    record[name] = np.frombuffer(text.ljust(record[name].size, b"\0"), np.uint8)


def _new_preset(record: np.ndarray, kind: str, name: str) -> Any:  # noqa: ANN401 - a record
    """Append a preset to a record; returns its configuration, a view."""
    count, presets = int(record[f"{kind}_count"]), record[f"{kind}s"]
    record[f"{kind}_count"] = count + 1
    _put_text(presets[count], "name", name.encode())
    return presets[count]["config"]


def _names(record: np.ndarray, kind: str) -> list[str]:
    """Return the names of a record's presets."""
    return [text_of(each["name"]) for each in record[f"{kind}s"][: int(record[f"{kind}_count"])]]


def _lines(record: np.ndarray) -> Iterator[tuple[str, Field, Any]]:
    """Yield name, field and owning record of each line of a file, in order, from that of the robot on."""
    for section, struct in SECTIONS.items():
        for field in fields_of(struct):
            yield f"{section}.{field.path}", field, record[section]
    for kind, struct in PRESETS.items():
        for k, name in enumerate(_names(record, kind)):
            for field in fields_of(struct):
                yield f"{kind}.{name}.{field.path}", field, record[f"{kind}s"][k]["config"]


def _carried(body: Any) -> str:  # noqa: ANN401 - a record
    """Return what a body is, for readers of the file."""
    return f"behind {(*JOINT_NAMES, *GIMBAL_NAMES)[body['joint']]}" if body["axis"].any() else "the torso"


def _refused(field: Field, values: Sequence[int | float]) -> bool:
    """Return whether a value is out of the field's range."""
    return not all(field.least <= value <= field.most for value in values)


def _valid(field: Field) -> str:
    """Return what a field's values may be."""
    return (
        f"one of {', '.join(field.words)}"
        if field.words
        else f"{field.count} numbers within {field.least:g} … {field.most:g}"
    )


@dataclass
class _Reader:
    """The lines of a file between the first and the last, one after the other."""

    lines: list[tuple[int, list[bytes]]]
    """Number and words of the lines with words, the next one last."""
    end: int
    """Number of the last line."""

    @classmethod
    def begin(cls, lines: Sequence[bytes]) -> "_Reader":
        """Split lines into words, without comments; a line that is too long becomes a word that no field has."""
        found = []
        for k, line in enumerate(lines, 2):
            text = re.split(rb"[#\r]", line)[0] if len(line) <= LONGEST else b"\0"
            found.append((k, [word for word in text.replace(b"\t", b" ").split(b" ") if word]))
        return cls([each for each in found if each[1]][::-1], len(lines) + 1)

    def next(self) -> list[bytes]:
        """Return the words of the next line; none at the end."""
        return self.lines[-1][1] if self.lines else []

    def refuse(self, valid: str) -> BorderError:
        """Return the error for the next line."""
        return BorderError(f"parameters, line {self.lines[-1][0] if self.lines else self.end}; valid: {valid}")

    def take(self, prefix: str, struct: str, owner: Any) -> None:  # noqa: ANN401 - a record
        """Take the fields of a section in their order, and write them into its record."""
        for field in fields_of(struct):
            words, front = self.next(), [f"{prefix}.{field.path}".encode(), field.unit.encode()]
            values = [_value(field, word) for word in words[2:]]
            found = [value for value in values if value is not None]
            if words[:2] != front or not len(found) == len(values) == field.count or _refused(field, found):
                raise self.refuse(f"{prefix}.{field.path} {field.unit} and {_valid(field)}")
            field.put(owner, found)
            self.lines.pop()


def _read_lines(lines: Sequence[bytes]) -> np.ndarray:
    """Read the lines between the first and the last into a record."""
    record, reader = np.zeros((), log_layouts()["parameters"]), _Reader.begin(lines)
    words = reader.next()
    if words[:2] != [MODEL.encode(), b"sha256"] or len(words) != 3 or not _DIGEST.fullmatch(words[2]):
        raise reader.refuse(f"{MODEL} sha256 and 64 digits")
    _put_text(record, "model", words[2])
    reader.lines.pop()
    record["robot"] = robot_record()  # its structure; the other numbers are overwritten
    for section, struct in SECTIONS.items():
        reader.take(section, struct, record[section])
    while reader.lines:
        kind, _, rest = reader.next()[0].decode("latin-1").partition(".")
        name, dot, _ = rest.partition(".")
        is_new = kind in PRESETS and dot and _PRESET.fullmatch(name) and len(name) < NAME
        if not is_new or name in (known := _names(record, kind)) or len(known) == MOST_PRESETS:
            raise reader.refuse("the first field of a new flight or crawl preset, or the end")
        reader.take(f"{kind}.{name}", PRESETS[kind], _new_preset(record, kind, name))
    return record


def _value(field: Field, word: bytes) -> int | float | None:
    """Convert a word of a line to a number of its field; None if it is not valid."""
    text = word.decode("latin-1")
    if field.words:
        return field.words.index(text) if text in field.words else None
    try:
        value = float(text) if _NUMBER.fullmatch(word) else np.nan
    except ValueError:
        return None
    return None if not np.isfinite(value) or (field.whole and value != int(value)) else value


def _impossible(robot: Any) -> str:  # noqa: ANN401 - a record of `sp_robot`
    """Return what a possible robot has and this one has not, or "" for a possible one; as `sp_refuse_robot` in C."""
    tree, nominal = robot["tree"], robot_record()
    fixed = [(robot[n], nominal[n]) for struct, n in STRUCTURE if struct == "robot"]
    fixed += [(tree[n], nominal["tree"][n]) for struct, n in STRUCTURE if struct == "body"]
    if not all(np.array_equal(ours, theirs) for ours, theirs in fixed):
        return "bodies and joints in the order of this version"
    for inertia in tree["inertia"].reshape(-1, 3, 3):
        trace = float(np.trace(inertia))
        minors = (inertia[0, 0], np.linalg.det(inertia[:2, :2]), np.linalg.det(inertia))
        positive = all(minor > LEAST_MOMENT * trace**n for n, minor in enumerate(minors, 1))
        if not (positive and trace > 0.0 and np.abs(inertia - inertia.T).max() <= ROUNDING * trace):
            return "a symmetric, positive definite inertia of every body"
    rotations = tree["rotation"].reshape(-1, 3, 3)
    if (
        np.abs(rotations @ rotations.transpose(0, 2, 1) - np.eye(3)).max() > ROUNDING
        or (np.linalg.det(rotations) < 0).any()
    ):
        return "attitudes of joints that are rotations"
    if np.abs((tree["axis"][1:] ** 2).sum(axis=1) - 1.0).max() > ROUNDING:
        return "axes of joints of length 1"
    weight = float(tree["mass"].sum() * robot["gravity"])
    if (
        not abs(weight - robot["weight"]) <= ROUNDING * weight
        or not abs(weight - 8.0 * robot["hover_thrust"]) <= ROUNDING * weight
    ):
        return "a weight, and a thrust in a hover, of the bodies' masses"
    return "" if weight < 8.0 * robot["max_thrust"] else "a weight below the thrust of its rotors"
