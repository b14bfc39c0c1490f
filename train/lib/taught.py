"""Robots that fly as a network says while a controller tells what it would command: what imitation learns from.

Where a robot is lost, the controller leads it until it is well again, so that most of what is seen is what a good
network will see, and the rest is how one gets out of trouble.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from spidar_gym.benchmark.track import find_track
from spidar_gym.border import BorderError, pack, read_file, unpack
from spidar_gym.files import write_bytes
from spidar_gym.policies import torso
from spidar_gym.policies.filters import Traces
from spidar_gym.robot import N_ROTORS
from train.lib.envs import ERRORS, generator_words, set_generator, training_seed
from train.lib.run import MOST_BYTES, CheckpointError
from train.lib.vector import draw_disturbances, make_vector

INTEGRALS = torso.entries("position_integral", "attitude_integral")
"""Entries that stay what they were when an episode began, where no controller integrates."""
LOST, FINE = (0.05, 0.06), (0.02, 0.025)
"""Errors [m], [rad] of which one makes a robot lost, and below which both are when it is well again."""
DEMAND = (0.1, 0.1)
"""A lesson at errors of this size [m], [rad] counts half of one at none."""
LESSONS = "lessons.json"
"""Part of a file of lessons that holds what is no array."""


@dataclass(frozen=True)
class Lessons:
    """What the controller would have said; a row of each array for every robot and tick."""

    inputs: np.ndarray
    """What the network saw: features and traces, (rows, inputs)."""
    answers: np.ndarray
    """What it would have had to say, (rows, 40)."""
    levers: np.ndarray
    """Rotor centres seen from the CoG, torso axes (rows, 8, 3) [m]."""
    weights: np.ndarray
    """How much they count, (rows,)."""

    def write(self, path: Path) -> None:
        """Write them, all or nothing."""
        write_bytes(path, pack(LESSONS, {"rows": len(self.weights)}, vars(self), sealed=True))

    @classmethod
    def read(cls, path: Path, inputs: int, rows: int) -> "Lessons":
        """Those of a file (`CheckpointError` for one that `write` did not write, or with other shapes)."""
        shapes = {
            "inputs": (rows, inputs),
            "answers": (rows, torso.ACTION),
            "levers": (rows, N_ROTORS, 3),
            "weights": (rows,),
        }
        try:
            _, arrays = unpack(LESSONS, read_file(path, MOST_BYTES), sealed=True)
        except BorderError as error:
            raise CheckpointError(
                f"{path} holds no lessons ({error}); valid: the file as it was, or another --out"
            ) from error
        found = {name: (array.dtype, array.shape) for name, array in arrays.items()}
        if found != {name: (np.dtype(np.float32), shape) for name, shape in shapes.items()}:
            raise CheckpointError(f"{path} holds other lessons; valid: {rows} of {inputs} inputs, or another --out")
        return cls(**arrays)


class TaughtFlights:
    """The robots of several tracks, each with an adviser."""

    def __init__(self, tracks: Sequence[str], preset: str, robots: int, seed: int, times: Sequence[float]) -> None:
        """Let them begin.

        Args:
            tracks: Tracks whose kinds of flights they fly; what scenarios of a track vary is drawn, wind included.
            preset: The controller that advises.
            robots: How many on each track.
            seed: Seed of their episodes.
            times: Time constants of the traces of `ERRORS` [s].
        """
        self._rng = np.random.Generator(np.random.PCG64(seed))
        self._tracks = list(tracks)
        self._vectors = [make_vector(t, {"action_mode": "direct", "preset": preset}, robots) for t in tracks]
        self._places = [slice(k * robots, (k + 1) * robots) for k in range(len(tracks))]
        self.count = robots * len(tracks)
        """How many robots."""
        self._traces = Traces(torso.entries(*ERRORS), np.array(times))
        self._traces.reset(self.count)
        self._joints = torso.Joints()
        self._joints.reset(self.count)
        self._integrals = np.zeros((self.count, len(INTEGRALS)))
        self.led = np.zeros(self.count, bool)
        """Whom the controller leads."""
        self.ticks = 0
        """Ticks of all robots together."""
        self._advised = np.zeros((self.count, torso.ACTION))
        for k, vector in enumerate(self._vectors):
            vector.fleet.ask_advice()
            self._begin(k, np.ones(robots, bool))
        self._seen = self._look()

    def _begin(self, k: int, mask: np.ndarray) -> None:
        """Let some robots of a track begin an episode."""
        track, vector = self._tracks[k], self._vectors[k]
        options: dict[str, object] = {"reset_mask": mask}
        if find_track(track).disturbances:
            options["disturbances"] = draw_disturbances(track, self._rng, len(mask))
        seeds = [training_seed(int(word)) for word in self._rng.integers(0, 2**32, len(mask))]
        vector.reset(seed=seeds, options=options)
        ids = np.arange(self.count)[self._places[k]][mask]
        self._traces.low_passed[ids], self._joints.position[ids] = 0.0, np.nan
        self._integrals[ids] = vector.buffers["observations"][mask][:, INTEGRALS]
        self.led[ids] = False

    def _look(self) -> np.ndarray:
        """What all robots see, traces behind it; their integrals are those of a flight that nobody advises."""
        seen = np.concatenate([vector.buffers["observations"] for vector in self._vectors])
        seen[:, INTEGRALS] = self._integrals
        return self._traces(self._joints(seen))

    def _gather(self, get: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
        return np.concatenate([get(vector.robots) for vector in self._vectors])

    def fly(self, say: Callable[[np.ndarray], np.ndarray] | None, ticks: int, rng: np.random.Generator) -> Lessons:
        """Fly, and return what there was to learn.

        Args:
            say: Inputs (robots, inputs) → what the network says (robots, 40). Without one the controller leads, but for
                every tenth tick of a robot, in which it does what was advised a tick before, disturbed.
            ticks: How long.
            rng: What those disturbances are drawn with.
        """
        found = [self._tick(say, rng) for _ in range(ticks)]
        columns = (np.concatenate(column) for column in zip(*found, strict=True))
        return Lessons(*(column.astype(np.float32) for column in columns))

    def _tick(
        self, say: Callable[[np.ndarray], np.ndarray] | None, rng: np.random.Generator
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        seen, traces = np.split(self._seen, [torso.SHOWN], axis=1)
        inputs = np.concatenate([torso.features(seen), traces], axis=1).astype(np.float32)
        if say is None:
            led = rng.random(self.count) > 0.1
            spread = np.repeat([0.1, 0.03, 0.01], [N_ROTORS, 2 * N_ROTORS, torso.ACTION - 3 * N_ROTORS])
            action = np.clip(self._advised + rng.normal(0.0, spread, self._advised.shape), -1.0, 1.0)
        else:
            led, action = self.led.copy(), torso.command(say(inputs), seen)
        for place, vector in zip(self._places, self._vectors, strict=True):
            vector.robots["is_led"] = led[place]
            vector.advance(action[place])
        self.ticks += self.count
        thrust, vectoring = (self._gather(lambda r, name=name: r["advice"][name]) for name in ("thrust", "vectoring"))
        answers = torso.answer(torso.forces(thrust, vectoring.reshape(self.count, N_ROTORS, 2), seen))
        self._advised = torso.command(answers, seen)
        levers = self._gather(lambda r: r["percept"]["snapshot"]["rotor_c"]).reshape(self.count, N_ROTORS, 3)
        wrong = [self._gather(lambda r, name=name: r[name]) for name in ("position_error", "attitude_error")]
        errors = np.linalg.norm(np.stack(wrong), axis=2)
        weights = 1.0 / (1.0 + (errors / np.array(DEMAND)[:, None]).sum(axis=0) ** 2)
        lost, fine = (errors > np.array(LOST)[:, None]).any(axis=0), (errors < np.array(FINE)[:, None]).all(axis=0)
        self.led = lost | (self.led & ~fine)
        for k, vector in enumerate(self._vectors):
            done = vector.buffers["terminated"] | vector.buffers["truncated"]
            if done.any():
                self._begin(k, done)
        self._seen = self._look()
        return inputs, answers, levers, weights

    def save(self) -> dict[str, Any]:
        """All robots, and what is remembered of them, as arrays by name, and how many ticks they flew."""
        robots = {f"robots/{k}": np.frombuffer(vector.save(), np.uint8) for k, vector in enumerate(self._vectors)}
        return robots | {
            "rng": generator_words(self._rng), "low_passed": self._traces.low_passed, "joints": self._joints.position,
            "integrals": self._integrals, "led": self.led.astype(np.uint8), "advised": self._advised,
            "seen": self._seen, "ticks": self.ticks,
        }  # fmt: skip

    def restore(self, saved: Mapping[str, Any]) -> None:
        """Go on from what `save` gave, of flights of the same settings, with the same bits."""
        for k, vector in enumerate(self._vectors):
            vector.restore(saved[f"robots/{k}"].tobytes())
        set_generator(self._rng, saved["rng"])
        self._traces.low_passed, self._joints.position = saved["low_passed"].copy(), saved["joints"].copy()
        self._integrals, self.led = saved["integrals"].copy(), saved["led"] > 0
        self._advised, self._seen, self.ticks = saved["advised"].copy(), saved["seen"].copy(), int(saved["ticks"])

    def close(self) -> None:
        """Let the engines go."""
        for vector in self._vectors:
            vector.close()
