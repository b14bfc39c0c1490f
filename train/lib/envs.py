"""Training environments: built from the tracks, seeded apart from all scenarios, with scaled observations."""

import zlib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import gymnasium
import numpy as np

import spidar_gym.envs.registry
from spidar_gym.benchmark.scenario import OFFSET
from spidar_gym.benchmark.track import HOVER, find_track
from spidar_gym.control.crawl.observation import crawl_layout
from spidar_gym.control.flight.controller import CONTROL_RATE
from spidar_gym.control.flight.observation import Field, layout
from spidar_gym.envs.actions import ACTION_MODES, CRAWL_MODES, ActionMode, find_action_mode
from spidar_gym.errors import InvalidValueError, require_least, require_name
from spidar_gym.policies import torso
from spidar_gym.policies.torso import Turn
from spidar_gym.robot import N_LEGS

NOMINAL = ("flight-forms", "flight-fast3", "flight-fast5")
"""Flight tracks at three joint speeds, with the nominal robot."""
FLIGHTS = (*NOMINAL, "flight-randomised")
"""The nominal tracks, and flights of randomised robots with sensor models."""
ERRORS = ("position_error", "velocity_error", "attitude_error", "angular_velocity_error")
"""Pieces of the observation that have traces (low-passes)."""
FIRST_SEED = 2**31
"""Lowest training seed; all seeds of scenarios are below it."""


def training_seed(*words: int) -> int:
    """Return a seed for an environment or a learner that depends only on the given numbers: run, segment, index."""
    entropy = [zlib.crc32(b"train"), *words]
    return FIRST_SEED + int(np.random.SeedSequence(entropy).generate_state(1)[0] >> 2)


def generator_words(rng: np.random.Generator) -> np.ndarray:
    """Return the state of a PCG64 generator as six 64-bit integers (6,)."""
    found: Any = rng.bit_generator.state
    long = [found["state"][name] for name in ("state", "inc")]
    halves = [half for word in long for half in (word & 2**64 - 1, word >> 64)]
    return np.array([*halves, found["has_uint32"], found["uinteger"]], np.uint64)


def set_generator(rng: np.random.Generator, words: np.ndarray) -> None:
    """Restore the state of a PCG64 generator from `generator_words`."""
    low, high, low_step, high_step, has, left = (int(word) for word in words)
    rng.bit_generator.state = {
        "bit_generator": "PCG64", "state": {"state": low | high << 64, "inc": low_step | high_step << 64},
        "has_uint32": has, "uinteger": left,
    }  # fmt: skip


@dataclass(frozen=True)
class EnvConfig:
    """Training environments, observation and action of an agent."""

    env_id: str
    """Environment id, with version."""
    tracks: tuple[str, ...]
    """Tracks that define the training environments and the validation scenarios."""
    base: str
    """Preset of the controller that the action is added to, or that a `direct` policy is compared with."""
    action_mode: str
    """Action mode; `direct` has no controller."""
    first_tracks: tuple[str, ...] = ()
    """Tracks of the first `first_steps` ticks."""
    sees: tuple[str, ...] = ()
    """Names of the pieces of the observation that the actor receives; all if empty. The critic receives all."""
    still: tuple[int, ...] = ()
    """Indices of the action's entries that stay 0."""
    hold: int = 1
    """Number of control ticks for which an action is held."""
    washout: float = 0.0
    """Time constant of the high-pass (washout) of the residual wrench [s]; 0 is no washout."""
    torso: bool = False
    """Whether to observe and command in torso axes (`spidar_gym.policies.torso`); only for `direct` flights."""
    trace_times: tuple[float, ...] = ()
    """Time constants of the low-passes (traces) of the errors in torso axes [s]; only with `torso`."""

    def __post_init__(self) -> None:
        require_least(1, hold=self.hold)
        if self.torso and (self.adds or self.env_id != HOVER or self.sees or self.hold > 1):
            raise InvalidValueError("torso", True, "False but for direct flights, every tick of which is seen whole")
        if self.trace_times and not self.torso:
            raise InvalidValueError("trace_times", self.trace_times, "none but in the torso's axes")
        if not self.tracks:
            raise InvalidValueError("tracks", self.tracks, "at least one track")
        for track in (*self.tracks, *self.first_tracks):
            if find_track(track).env_id != self.env_id:
                raise InvalidValueError("tracks", track, f"tracks of {self.env_id}")

    @property
    def arguments(self) -> dict[str, Any]:
        """Arguments of `gym.make`."""
        return {"action_mode": self.action_mode, "preset": self.base}

    @property
    def adds(self) -> bool:
        """Whether the action is added to a controller."""
        return self.action_mode != "direct"

    @property
    def mode(self) -> ActionMode:
        """The action mode, with its channels."""
        return find_action_mode(self.action_mode, ACTION_MODES if self.env_id == HOVER else CRAWL_MODES)

    @property
    def fields(self) -> tuple[Field, ...]:
        """Pieces of the observation."""
        return (layout if self.env_id == HOVER else crawl_layout)(self.mode.size)

    @property
    def traced(self) -> np.ndarray:
        """Indices of the observation's entries that have traces."""
        return torso.entries(*ERRORS) if self.trace_times else np.zeros(0, int)

    def hidden_entries(self) -> np.ndarray:
        """Return the mask of inputs that the actor does not receive (`UnknownNameError` for an unknown piece)."""
        if self.torso:
            return np.zeros(torso.FEATURES + len(self.traced) * len(self.trace_times), bool)
        for name in self.sees:
            require_name("piece of the observation", name, [field.name for field in self.fields])
        return np.concatenate([np.full(f.size, bool(self.sees) and f.name not in self.sees) for f in self.fields])

    def shown_turn(self) -> Turn:
        """Return the effect of a rotation of the robot by 90° on the network's inputs in torso axes."""
        return torso.shown_turn(len(self.traced) * len(self.trace_times))

    def enlarge_errors(self, scaling: "Scaling", factor: float) -> "Scaling":
        """Return a scaling of the inputs in torso axes that enlarges errors and maps zero errors to zero.

        Traces are scaled like the errors they filter: with their own variances, a lasting error would soon exceed the
        clipping bound. The clipping bound of all inputs is tripled.

        Args:
            scaling: Scaling determined from flights with the large errors of falls.
            factor: Factor by which scaled errors and their integrals become larger.
        """
        errors, integrals = torso.kept_entries(*ERRORS), torso.kept_entries("position_integral", "attitude_integral")
        entries = np.concatenate([errors, integrals])
        mean, variance = scaling.mean.copy(), scaling.variance.copy()
        mean[entries], mean[torso.FEATURES :] = 0.0, 0.0
        variance[entries] /= factor**2
        variance[torso.FEATURES :] = np.tile(variance[errors], len(self.trace_times))
        return replace(scaling, mean=mean, variance=variance, clip=3.0 * scaling.clip)

    def still_entries(self) -> np.ndarray:
        """Return the mask of the action's entries that stay 0 (`InvalidValueError` for an index out of range)."""
        size = self.mode.size
        for entry in self.still:
            if not 0 <= entry < size:
                raise InvalidValueError("still", entry, f"entries within 0 … {size - 1}")
        return np.isin(np.arange(size), self.still)

    def washout_times(self) -> np.ndarray:
        """Return the washout time constant of each entry of the action [s]; 0 except for a wrench.

        The constant part of a wrench is left to the controller's integrals.
        """
        channels = self.mode.channels
        return np.concatenate([np.full(c.size, self.washout if c.name == "wrench" else 0.0) for c in channels])


def make_track_env(track: str, arguments: Mapping[str, Any], control: str) -> gymnasium.Env:
    """Make an environment with the options of a track; its seed determines everything that scenarios vary.

    Args:
        track: Track that defines forms, joint speed, sensors, randomisation and episode length.
        arguments: Action mode and controller.
        control: `python` or `core`.
    """
    spidar_gym.envs.registry.register()
    kind = find_track(track)
    own = {"perturbation": OFFSET} if kind.flies else {}
    return gymnasium.make(
        kind.env_id, **own, **kind.options, **arguments, control=control, horizon_s=kind.seconds,
        max_episode_steps=round(kind.seconds * CONTROL_RATE), disable_env_checker=True,
    )  # fmt: skip


@dataclass(frozen=True)
class Scaling:
    """Normalisation of a network's inputs, stored unchanged in the artifact."""

    mean: np.ndarray
    """Mean of the observations."""
    variance: np.ndarray
    """Variance of the observations, above 0."""
    clip: float = 10.0
    """Bound of a scaled observation."""

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        """Return (o − mean) / √variance, clipped, as float32."""
        x = (observation - self.mean) / np.sqrt(self.variance)
        return np.minimum(np.maximum(x, -self.clip), self.clip).astype(np.float32)

    def alike(self, turn: Turn) -> "Scaling":
        """Return the scaling averaged over the four rotations of the robot by 90°, so that it is equivariant."""
        means, variances = [self.mean], [self.variance]
        for _ in range(N_LEGS - 1):
            means.append(turn(means[-1]))
            variances.append(variances[-1][turn.places])
        return Scaling(np.mean(means, axis=0), np.mean(variances, axis=0), self.clip)


def scaling_of(observations: np.ndarray, bounds: np.ndarray) -> Scaling:
    """Compute mean and variance of observations (number, size); the deviation is at least a thousandth of the bound.

    Entries that never change, such as the previous action of the base, are scaled by their bound.
    """
    o, bound = observations.astype(float), bounds.astype(float)
    deviation = o.std(axis=0)
    idle = deviation < 1e-6 * bound
    return Scaling(np.where(idle, 0.0, o.mean(axis=0)), np.where(idle, bound, np.maximum(deviation, 1e-3 * bound)) ** 2)
