"""Environments to learn in: of the tracks' kinds, with seeds that no scenario has, as a learner sees them."""

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
"""Tracks of flights at three speeds, on the robot of the description."""
FLIGHTS = (*NOMINAL, "flight-randomised")
"""The same, and flights of drawn robots with real sensors."""
ERRORS = ("position_error", "velocity_error", "attitude_error", "angular_velocity_error")
"""Pieces of the observation that have traces."""
FIRST_SEED = 2**31
"""Training draws its seeds from here on; those of the scenarios lie below."""


def training_seed(*words: int) -> int:
    """A seed of an environment or a learner, from nothing but the given numbers: run, segment, place."""
    entropy = [zlib.crc32(b"train"), *words]
    return FIRST_SEED + int(np.random.SeedSequence(entropy).generate_state(1)[0] >> 2)


def generator_words(rng: np.random.Generator) -> np.ndarray:
    """State of a generator on PCG64 as (6,) whole numbers of 64 bits."""
    found: Any = rng.bit_generator.state
    long = [found["state"][name] for name in ("state", "inc")]
    halves = [half for word in long for half in (word & 2**64 - 1, word >> 64)]
    return np.array([*halves, found["has_uint32"], found["uinteger"]], np.uint64)


def set_generator(rng: np.random.Generator, words: np.ndarray) -> None:
    """Let a generator on PCG64 go on from `generator_words`."""
    low, high, low_step, high_step, has, left = (int(word) for word in words)
    rng.bit_generator.state = {
        "bit_generator": "PCG64", "state": {"state": low | high << 64, "inc": low_step | high_step << 64},
        "has_uint32": has, "uinteger": left,
    }  # fmt: skip


@dataclass(frozen=True)
class EnvConfig:
    """Where an agent learns, what it sees, and what its actions do."""

    env_id: str
    """Environment, with version."""
    tracks: tuple[str, ...]
    """Tracks in whose kinds of environments it learns, and on whose validation scenarios it is evaluated."""
    base: str
    """Preset of the controller that it adds to, or that it is compared with."""
    action_mode: str
    """What the action means; `direct` has no controller."""
    first_tracks: tuple[str, ...] = ()
    """Those of the first `first_steps` ticks."""
    sees: tuple[str, ...] = ()
    """Pieces of the observation that the actor sees, by name, while the critic sees all; all if none is given."""
    still: tuple[int, ...] = ()
    """Entries of the action that stay 0."""
    hold: int = 1
    """Ticks for which the learner holds an action."""
    washout: float = 0.0
    """Time constant with which a constant residual wrench fades [s]; 0 lets it stay."""
    torso: bool = False
    """See and command in the torso's axes, as `spidar_gym.policies.torso` does; only `direct` flights."""
    trace_times: tuple[float, ...] = ()
    """Time constants of the traces of the errors that are seen in the torso's axes [s]."""

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
        """Whether there is a controller to add to."""
        return self.action_mode != "direct"

    @property
    def mode(self) -> ActionMode:
        """What the action means."""
        return find_action_mode(self.action_mode, ACTION_MODES if self.env_id == HOVER else CRAWL_MODES)

    @property
    def fields(self) -> tuple[Field, ...]:
        """Pieces of the observation."""
        return (layout if self.env_id == HOVER else crawl_layout)(self.mode.size)

    @property
    def traced(self) -> np.ndarray:
        """Entries of the observation that have traces."""
        return torso.entries(*ERRORS) if self.trace_times else np.zeros(0, int)

    def hidden_entries(self) -> np.ndarray:
        """Mask of the numbers shown that the actor does not see (`UnknownNameError` for an unknown piece)."""
        if self.torso:
            return np.zeros(torso.FEATURES + len(self.traced) * len(self.trace_times), bool)
        for name in self.sees:
            require_name("piece of the observation", name, [field.name for field in self.fields])
        return np.concatenate([np.full(f.size, bool(self.sees) and f.name not in self.sees) for f in self.fields])

    def shown_turn(self) -> Turn:
        """What becomes of the numbers shown in the torso's axes when the robot is turned by 90°."""
        return torso.shown_turn(len(self.traced) * len(self.trace_times))

    def enlarge_errors(self, scaling: "Scaling", factor: float) -> "Scaling":
        """A scaling of what is shown in the torso's axes of which errors come out larger, and as 0 where they are 0.

        Args:
            scaling: Whose errors are those of falls.
            factor: How many times as large errors and their integrals are. So are traces, which are scaled as the
                errors that they are of: in units of their own a lasting error would soon be out of range. Three times
                as much of everything is let through.
        """
        errors, integrals = torso.kept_entries(*ERRORS), torso.kept_entries("position_integral", "attitude_integral")
        entries = np.concatenate([errors, integrals])
        mean, variance = scaling.mean.copy(), scaling.variance.copy()
        mean[entries], mean[torso.FEATURES :] = 0.0, 0.0
        variance[entries] /= factor**2
        variance[torso.FEATURES :] = np.tile(variance[errors], len(self.trace_times))
        return replace(scaling, mean=mean, variance=variance, clip=3.0 * scaling.clip)

    def still_entries(self) -> np.ndarray:
        """Mask of the action's entries that stay 0 (`InvalidValueError` for an entry that there is not)."""
        size = self.mode.size
        for entry in self.still:
            if not 0 <= entry < size:
                raise InvalidValueError("still", entry, f"entries within 0 … {size - 1}")
        return np.isin(np.arange(size), self.still)

    def washout_times(self) -> np.ndarray:
        """Time constant of every entry of the action [s]: only a wrench has integrals that own its constant part."""
        channels = self.mode.channels
        return np.concatenate([np.full(c.size, self.washout if c.name == "wrench" else 0.0) for c in channels])


def make_track_env(track: str, arguments: Mapping[str, Any], control: str) -> gymnasium.Env:
    """An environment of a track's kind, which draws its episodes from its seed; what scenarios vary is drawn too.

    Args:
        track: Track whose forms, speed, sensors, randomisation and length it has.
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
    """How observations enter a network; the same numbers as in the artifact."""

    mean: np.ndarray
    """Mean of the baseline's observations."""
    variance: np.ndarray
    """Variance of the baseline's observations, above 0."""
    clip: float = 10.0
    """Bound of a scaled observation."""

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        """(o − mean) / √variance, clipped, float32."""
        x = (observation - self.mean) / np.sqrt(self.variance)
        return np.minimum(np.maximum(x, -self.clip), self.clip).astype(np.float32)

    def alike(self, turn: Turn) -> "Scaling":
        """That which scales what is turned alike: means over all four ways in which the robot can stand."""
        means, variances = [self.mean], [self.variance]
        for _ in range(N_LEGS - 1):
            means.append(turn(means[-1]))
            variances.append(variances[-1][turn.places])
        return Scaling(np.mean(means, axis=0), np.mean(variances, axis=0), self.clip)


def scaling_of(observations: np.ndarray, bounds: np.ndarray) -> Scaling:
    """Mean and variance of observations (number, size), of at least a thousandth of the bound.

    Entries that never change, such as the previous action of the base, are scaled by their bound.
    """
    o, bound = observations.astype(float), bounds.astype(float)
    deviation = o.std(axis=0)
    idle = deviation < 1e-6 * bound
    return Scaling(np.where(idle, 0.0, o.mean(axis=0)), np.where(idle, bound, np.maximum(deviation, 1e-3 * bound)) ** 2)
