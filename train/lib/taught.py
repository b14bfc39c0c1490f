"""Flights for imitation learning: a network flies the robots, and a controller computes the commands to imitate.

If the errors of a robot become large, the controller flies it until they are small again. So most recorded states are
those that a good network reaches, and the rest show how to recover.
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
"""Entries of the observation kept at their values at reset, as no controller integrates in a `direct` flight."""
LOST, FINE = (0.05, 0.06), (0.02, 0.025)
"""Errors [m], [rad]: the controller takes over if either exceeds `LOST`, until both are below `FINE`."""
DEMAND = (0.1, 0.1)
"""Errors [m], [rad]: a sample at either of them has half the weight of a sample without errors."""
LESSONS = "lessons.json"
"""Entry of a file of lessons that holds everything except arrays."""


@dataclass(frozen=True)
class Lessons:
    """Training samples of imitation; each array has a row for every robot and tick."""

    inputs: np.ndarray
    """Inputs of the network: features and traces, (rows, inputs)."""
    answers: np.ndarray
    """Outputs that correspond to the controller's commands, (rows, 40)."""
    levers: np.ndarray
    """Rotor centres relative to the CoG, torso axes, (rows, 8, 3) [m]."""
    weights: np.ndarray
    """Weights of the samples, (rows,)."""

    def write(self, path: Path) -> None:
        """Write the lessons to a file, atomically."""
        write_bytes(path, pack(LESSONS, {"rows": len(self.weights)}, vars(self), sealed=True))

    @classmethod
    def read(cls, path: Path, inputs: int, rows: int) -> "Lessons":
        """Read the lessons of a file (`CheckpointError` if it is damaged or has other shapes)."""
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
    """Robots of several tracks; for each of them the controller computes its own command, the advice."""

    def __init__(self, tracks: Sequence[str], preset: str, robots: int, seed: int, times: Sequence[float]) -> None:
        """Create and reset the robots.

        Args:
            tracks: Tracks that define the flights; everything that their scenarios vary is randomised, wind included.
            preset: Preset of the advising controller.
            robots: Number of robots on each track.
            seed: Seed of the episodes.
            times: Time constants of the traces of `ERRORS` [s].
        """
        self._rng = np.random.Generator(np.random.PCG64(seed))
        self._tracks = list(tracks)
        self._vectors = [make_vector(t, {"action_mode": "direct", "preset": preset}, robots) for t in tracks]
        self._places = [slice(k * robots, (k + 1) * robots) for k in range(len(tracks))]
        self.count = robots * len(tracks)
        """Number of robots."""
        self._traces = Traces(torso.entries(*ERRORS), np.array(times))
        self._traces.reset(self.count)
        self._joints = torso.Joints()
        self._joints.reset(self.count)
        self._integrals = np.zeros((self.count, len(INTEGRALS)))
        self.led = np.zeros(self.count, bool)
        """Mask of the robots that the controller flies."""
        self.ticks = 0
        """Control ticks flown, summed over all robots."""
        self._advised = np.zeros((self.count, torso.ACTION))
        for k, vector in enumerate(self._vectors):
            vector.fleet.ask_advice()
            self._begin(k, np.ones(robots, bool))
        self._seen = self._look()

    def _begin(self, k: int, mask: np.ndarray) -> None:
        """Reset some robots of a track."""
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
        """Return the observations of all robots, followed by the traces; the integrals are those at reset."""
        seen = np.concatenate([vector.buffers["observations"] for vector in self._vectors])
        seen[:, INTEGRALS] = self._integrals
        return self._traces(self._joints(seen))

    def _gather(self, get: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
        return np.concatenate([get(vector.robots) for vector in self._vectors])

    def fly(self, say: Callable[[np.ndarray], np.ndarray] | None, ticks: int, rng: np.random.Generator) -> Lessons:
        """Fly all robots and record the lessons.

        Args:
            say: The network: inputs (robots, inputs) → outputs (robots, 40). If None, the controller flies; with a
                probability of 0.1 per robot and tick, its previous command with added noise is flown instead.
            ticks: Number of control ticks.
            rng: Generator of this noise.
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
        """Return the state of all robots and their filters as arrays by name, and the number of ticks flown."""
        robots = {f"robots/{k}": np.frombuffer(vector.save(), np.uint8) for k, vector in enumerate(self._vectors)}
        return robots | {
            "rng": generator_words(self._rng), "low_passed": self._traces.low_passed, "joints": self._joints.position,
            "integrals": self._integrals, "led": self.led.astype(np.uint8), "advised": self._advised,
            "seen": self._seen, "ticks": self.ticks,
        }  # fmt: skip

    def restore(self, saved: Mapping[str, Any]) -> None:
        """Restore a state from `save` of flights with the same settings; the continuation is identical bit for bit."""
        for k, vector in enumerate(self._vectors):
            vector.restore(saved[f"robots/{k}"].tobytes())
        set_generator(self._rng, saved["rng"])
        self._traces.low_passed, self._joints.position = saved["low_passed"].copy(), saved["joints"].copy()
        self._integrals, self.led = saved["integrals"].copy(), saved["led"] > 0
        self._advised, self._seen, self.ticks = saved["advised"].copy(), saved["seen"].copy(), int(saved["ticks"])

    def close(self) -> None:
        """Close the engines."""
        for vector in self._vectors:
            vector.close()
