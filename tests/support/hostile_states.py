"""Corrupted saved robots and states with a valid checksum; run as a program, since some once ended the process.

`python -m support.hostile_states CASE SEED WAY:KIND:TRIES …` prints the outcomes as JSON. A refused try changes
nothing. After an accepted try the simulation continues, no tick takes a second, and the good bytes can be restored.
"""

import hashlib
import json
import logging
import sys
import time
import warnings
from collections import Counter
from collections.abc import Iterator
from typing import Any

import gymnasium
import numpy as np

import spidar_gym  # noqa: F401 - registers the environments
from spidar_gym.border import pack, unpack
from spidar_gym.control.crawl.pose2 import Pose2
from spidar_gym.control.grasp.scene import GraspScene
from spidar_gym.envs.registry import COURSE, CRAWL, GRASP, HOVER, PATH
from spidar_gym.envs.serialization import fleets
from spidar_gym.envs.serialization.environments import TITLE
from spidar_gym.errors import SpidarError
from spidar_gym.native.limits import member_at, numbers_of

ROUGH = {"randomization": 1.0, "sensors": True, "disturbances": {"wind": 2.0, "lost_rotor": 3, "fault_time": 0.0}}
CASES: dict[str, tuple[str, dict[str, Any]]] = {
    "hover": (HOVER, {"action_mode": "residual", **ROUGH}),
    "path": (PATH, {"preset": "tuned"}),
    "crawl": (CRAWL, {"randomization": 1.0, "steps": 0.01, "sensors": True}),
    "course": (COURSE, {"hold": 1, "disturbances": {"push": 20.0}}),
    "grasp": (GRASP, {"hold": 1, "joint_speed": 0.6, "scene": GraspScene(start=Pose2(0.3), goal=Pose2(1.5))}),
}
"""Environments by name, with arguments."""
BEFORE = {"grasp": 480}
"""Ticks before the state is saved, elsewhere 8; the feet press then."""
WAYS = ("vector", "core", "python")
"""`restore` of a vector, and `restore_state` of an environment with either controller."""
KINDS = ("integers", "floats", "words")
"""What is changed: integers, floats, or the JSON part of a saved state."""
FLOATS = (np.nan, np.inf, -np.inf, 1e308, -1e308, 1e18, 1e14, -1e14, 1e5, -1e3, 1e-308, -1.0, 0.0)
WORDS = (None, True, -1, 0, 1, 3, 2**31, -(2**62), 0.5, 1e300, "", "abc", "nan", [], [0], [10**6], {}, {"a": 1})
TICKS = 3
"""Ticks simulated after an accepted try."""


# ---- one number of a record ----


def numbers(struct: str, *, whole: bool) -> dict[str, tuple[str, np.ndarray]]:
    """Dtype and byte offsets of each integer or float member of a struct; the entries of an array are one member."""
    found: dict[str, tuple[str, list[int]]] = {}
    for kind, own in numbers_of(struct).items():
        for at in own.at.tolist() if (np.dtype(kind).kind != "f") == whole else ():
            name = "".join(
                part.partition("]")[2] if k else part for k, part in enumerate(member_at(struct, at).split("["))
            )
            found.setdefault(name, (kind, []))[1].append(at)
    return {name: (kind, np.array(at)) for name, (kind, at) in found.items()}


def values(struct: str, kind: str, at: int, rng: np.random.Generator) -> list[Any]:
    """New values of a number."""
    if np.dtype(kind).kind == "f":
        return [FLOATS[rng.integers(len(FLOATS))] if rng.random() < 0.7 else rng.normal() * 10 ** rng.uniform(0, 16)]
    own, info = numbers_of(struct)[kind], np.iinfo(kind)
    k = int(np.flatnonzero(own.at == at)[0])
    low, high = int(own.low[k]), int(own.high[k])
    wild = {low - 1, high + 1, -1, info.max, info.min, int(rng.integers(-5, 300))}
    return sorted(value for value in wild if info.min <= value <= info.max)


def changes(struct: str, kind: str, rng: np.random.Generator) -> Iterator[tuple[int, bytes, str]]:
    """Yield offset, new bytes and description of a change: all members in turn, without end."""
    members = list(numbers(struct, whole=kind == "integers").items())
    while True:
        for k in rng.permutation(len(members)):
            name, (dtype, places) = members[k]
            at = int(rng.choice(places))
            for value in values(struct, dtype, at, rng):
                yield at, np.array(value).astype(dtype).tobytes(), f"{name} = {value}"


def sealed(robots: bytes, at: int, number: bytes) -> bytes:
    """Saved robots with replaced bytes in their records and a valid checksum."""
    body = bytearray(robots[: -fleets.CHECKSUM])
    at += body.index(b"\n", len(fleets.MAGIC)) + 1
    body[at : at + len(number)] = number
    return bytes(body) + hashlib.sha256(body).digest()


# ---- one word of a state ----


def places(value: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Yield the path to every item of a JSON value."""
    if isinstance(value, list) and path:
        yield path
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, each in items:
        yield from places(each, (*path, key))
    if not isinstance(value, dict | list):
        yield path


def reworded(words: Any, ways: list[tuple[Any, ...]], rng: np.random.Generator) -> tuple[Any, str]:
    """A copy of the words with one item changed, removed or duplicated, and a description of the change."""
    words = json.loads(json.dumps(words))
    path = ways[rng.integers(len(ways))]
    owner = words
    for key in path[:-1]:
        owner = owner[key]
    old, fate = owner[path[-1]], rng.random()
    if isinstance(old, list) and old and fate < 0.3:
        del old[rng.integers(len(old))]
    elif isinstance(old, list) and old and fate < 0.5:
        old.append(old[rng.integers(len(old))])
    elif isinstance(old, list) and len(old) == 1 and fate < 0.7:
        old[0] = int(rng.integers(len(words["nodes"])))
    elif isinstance(old, int | float) and fate < 0.5:
        owner[path[-1]] = [old + 1, -old, 2 * old, old + 0.5, 1e308][rng.integers(5)]
    else:
        owner[path[-1]] = WORDS[rng.integers(len(WORDS))]
    return words, f"{path}: {str(old)[:50]}"


# ---- a vector or an environment that restores them ----


class Subject:
    """A vector or an environment which is restored repeatedly."""

    def __init__(self, case: str, way: str) -> None:
        name, options = CASES[case]
        self.is_vector, self.way = way == "vector", way
        if self.is_vector:
            self.env: Any = gymnasium.make_vec(name, 2, **options).unwrapped
        else:
            self.env = gymnasium.make(name, control=way, **options).unwrapped
        self.action = np.zeros(self.env.action_space.shape)
        self.env.reset(seed=1)
        for _ in range(BEFORE.get(case, 8)):
            self.env.step(self.action)
        for _ in range(2):  # the second save may store a shared object in another place
            self.good = self.save()
            self.restore(self.good)

    def save(self) -> bytes:
        return self.env.save() if self.is_vector else self.env.save_state()

    def restore(self, saved: bytes) -> None:
        self.env.restore(saved) if self.is_vector else self.env.restore_state(saved)

    def moment(self) -> tuple[Any, ...]:
        """The complete state, for comparison."""
        fleet = self.env.fleet
        return self.save(), fleet and (fleet.rules.tobytes(), fleet.goals.shape, fleet.knots.shape)

    def tries(self, kind: str, rng: np.random.Generator) -> Iterator[tuple[bytes, str]]:
        """Yield corrupted bytes and the description of the corruption, without end."""
        if self.is_vector:
            records = self.env.fleet.robots
            for at, number, what in changes(f"{self.env.fleet.kind}_robot", kind, rng):
                yield sealed(self.good, at + int(rng.integers(2)) * records.itemsize, number), what
        told, arrays = unpack(TITLE, self.good, sealed=True)
        if kind == "words":
            words = json.loads(arrays["words"].tobytes())
            ways = list(places(words))
            while True:
                other, what = reworded(words, ways, rng)
                packed = np.frombuffer(json.dumps(other).encode(), np.uint8)
                yield pack(TITLE, told, arrays | {"words": packed}, sealed=True), what
        for place, number, what in self._in_the_state(arrays, kind, rng):
            robot = arrays[place].tobytes()
            at, content = number
            changed = (
                sealed(robot, at, content) if place == "robot" else robot[:at] + content + robot[at + len(content) :]
            )
            yield pack(TITLE, told, arrays | {place: np.frombuffer(changed, np.uint8)}, sealed=True), what

    def _in_the_state(
        self, arrays: dict[str, np.ndarray], kind: str, rng: np.random.Generator
    ) -> Iterator[tuple[str, tuple[int, bytes], str]]:
        # The state of a Python controller is stored as bytes in `numbers`: every second float is changed there.
        for at, number, what in changes(f"{self.env.fleet.kind}_robot", kind, rng):
            yield "robot", (at, number), what
            if self.way == "python" and kind == "floats":
                yield "numbers", (8 * int(rng.integers(arrays["numbers"].size // 8)), number), f"some number, as {what}"


def outcome(subject: Subject, saved: bytes, *, begins: bool) -> str:
    """Restore corrupted bytes and return the outcome; raise if it is not permitted.

    Args:
        subject: Vector or environment that restores them.
        saved: Corrupted bytes.
        begins: Whether to begin another episode after the ticks, which takes long on tiles.
    """
    before = subject.moment()
    try:
        subject.restore(saved)
    except SpidarError as error:
        message = str(error)
        assert "\n" not in message
        assert len(message) < 1500
        assert subject.moment() == before, "the refusal changed the state"
        return "refused"
    went = "accepted"
    try:
        for _ in range(TICKS):
            began = time.process_time()
            subject.env.step(subject.action)
            assert time.process_time() - began < 1.0, "a tick of more than a second"
        if begins:
            subject.env.reset(seed=2)
            subject.env.step(subject.action)
    except SpidarError:
        went = "accepted, and stopped later"
    subject.restore(subject.good)
    assert subject.save() == subject.good, "the good bytes were not restored"
    return went


def tried(case: str, way: str, kind: str, count: int, rng: np.random.Generator) -> tuple[Counter[str], list[str]]:
    """Count the outcomes of the tries and list the failures; prints each try first, since some ended the process."""
    subject, found, wrong = Subject(case, way), Counter[str](), list[str]()
    for _, (saved, what) in zip(range(count), subject.tries(kind, rng), strict=False):
        print(case, way, what, file=sys.stderr, flush=True)
        try:
            found[outcome(subject, saved, begins=rng.random() < 0.2)] += 1
        except Exception as error:
            wrong.append(f"{way}: {what}: {type(error).__name__}: {str(error)[:100]}")
            subject = Subject(case, way)
    return found, wrong


def main(case: str, seed: str, *plans: str) -> None:
    """Run the plans and print the outcomes."""
    logging.disable(logging.CRITICAL)
    warnings.simplefilter("ignore")
    rng, told = np.random.default_rng(int(seed)), {}
    wrong: list[str] = []
    for plan in plans:
        way, kind, count = plan.split(":")
        told[plan], more = tried(case, way, kind, int(count), rng)
        wrong += more
    print(json.dumps({"found": told, "wrong": wrong}))


if __name__ == "__main__":
    main(*sys.argv[1:])
