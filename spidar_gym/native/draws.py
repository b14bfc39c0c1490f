"""numpy's generators as plain records that the engine draws from, and back: the same numbers from either."""

from collections.abc import Iterable
from typing import Any

import numpy as np

from spidar_gym.errors import InvalidValueError
from spidar_gym.native.engine_structs import engine_layouts

SEED_POOL = 4
"""Words of 32 bits in which numpy's SeedSequence mixes a seed."""
SEED_START, SEED_FACTOR = 0x43B0D7E5, 0x931E8875
"""First constant of the mixing, and the factor from each to the next."""
SEED_LEFT, SEED_RIGHT = 0xCA01F9DD, 0x4973F715
"""Factors with which two words become one."""
STATE_START, STATE_FACTOR = 0x8B51F9DD, 0x58F38DED
"""Constants with which the pool becomes the state of a bit generator."""
_BITS, _WORDS = 2**32, 2**64
_UNLEFT = pow(SEED_LEFT, -1, _BITS)
_MOST_WORDS = 10_000
"""Seeds and spawn keys of more words than this are not looked for."""
_VALID = "a numpy Generator of PCG64 with a SeedSequence of 4 words, such as env.np_random or numpy.random.default_rng"


def from_numpy(generator: np.random.Generator) -> np.ndarray:
    """A generator as the engine's struct `generator`; it draws and spawns the same from here on.

    The record is a copy: what is drawn from it does not move `generator`.

    Raises:
        InvalidValueError: For another bit generator than PCG64, or seeds that were mixed otherwise.
    """
    bits = getattr(generator, "bit_generator", None)
    seeds = getattr(bits, "seed_seq", None)
    if type(bits) is not np.random.PCG64 or type(seeds) is not np.random.SeedSequence or seeds.pool_size != SEED_POOL:
        raise InvalidValueError("generator", generator, _VALID)
    record, drawn = np.zeros((), engine_layouts()["generator"]), bits.state
    for name, value in (("state", drawn["state"]["state"]), ("increment", drawn["state"]["inc"])):
        record[f"{name}_high"], record[f"{name}_low"] = divmod(value, _WORDS)
    record["has_half"], record["half"] = drawn["has_uint32"], drawn["uinteger"]
    words = max(_count(seeds.entropy), SEED_POOL) + _count(seeds.spawn_key)
    record["pool"], record["hash"], record["spawned"] = seeds.pool, _constant(4 * words), seeds.n_children_spawned
    return record


def to_numpy(record: np.ndarray | np.void) -> np.random.Generator:
    """The generator that a record of the engine stands for; it draws and spawns the same from here on.

    Its `seed_seq.entropy` is the seed itself where that has up to 128 bits and the generator is nobody's child.
    Elsewhere it is another seed that mixes to the same pool: every child is the same, too.

    Raises:
        InvalidValueError: For a record that neither `from_numpy` nor the engine has made.
    """
    hash_, increment = int(record["hash"]), _wide(record, "increment")
    words = next((n for n in range(SEED_POOL, _MOST_WORDS) if _constant(4 * n) == hash_), 0)
    if not words or increment % 2 == 0:
        raise InvalidValueError("record", record, "one that `from_numpy` or the engine has made")
    seeds = np.random.SeedSequence(
        _seed(list(map(int, record["pool"])), words), spawn_key=(0,) * (words - SEED_POOL),
        n_children_spawned=int(record["spawned"]),
    )  # fmt: skip
    bits = np.random.PCG64(seeds)
    bits.state = {
        "bit_generator": "PCG64",
        "state": {"state": _wide(record, "state"), "inc": increment},
        "has_uint32": int(record["has_half"]),
        "uinteger": int(record["half"]),
    }
    return np.random.Generator(bits)


def take_back(rng: np.random.Generator, record: np.ndarray | np.void) -> None:
    """Let a generator of numpy go on where the library's, made of it by `from_numpy`, has come to."""
    bits, seeds = rng.bit_generator, rng.bit_generator.seed_seq
    state: Any = bits.state
    state["state"]["state"] = _wide(record, "state")
    state["has_uint32"], state["uinteger"] = int(record["has_half"]), int(record["half"])
    bits.state = state
    seeds.spawn(int(record["spawned"]) - seeds.n_children_spawned)  # pyright: ignore[reportAttributeAccessIssue] - numpy's stub lacks it


def _wide(record: np.ndarray | np.void, name: str) -> int:
    return int(record[f"{name}_high"]) * _WORDS + int(record[f"{name}_low"])


def _count(seed: Any) -> int:  # noqa: ANN401 - whatever numpy takes: numbers, their text, sequences of either
    """How many words of 32 bits a seed has."""
    if isinstance(seed, str):
        seed = int(seed, 16 if seed.startswith("0x") else 10)
    if isinstance(seed, Iterable):
        return sum(map(_count, seed))
    return max(1, -(-int(seed).bit_length() // 32))


def _constant(steps: int) -> int:
    """The constant of the mixing after a number of steps."""
    return SEED_START * pow(SEED_FACTOR, steps, _BITS) % _BITS


def _seed(pool: list[int], words: int) -> int:
    """The seed of 128 bits that mixes to a pool when zeros fill it up to `words` words: each step taken back."""
    steps = 4 * words

    def stirred(word: int) -> int:
        word = (word ^ _constant(steps)) * _constant(steps + 1) % _BITS
        return word ^ word >> 16

    for source in (*[None] * (words - SEED_POOL), *reversed(range(SEED_POOL))):
        for k in reversed(range(SEED_POOL)):
            if k != source:
                steps -= 1
                mixed = pool[k] ^ pool[k] >> 16
                other = SEED_RIGHT * stirred(0 if source is None else pool[source])
                pool[k] = (mixed + other) * _UNLEFT % _BITS
    for k in reversed(range(SEED_POOL)):
        steps -= 1
        word = (pool[k] ^ pool[k] >> 16) * pow(_constant(steps + 1), -1, _BITS) % _BITS
        pool[k] = word ^ _constant(steps)
    return sum(word << 32 * k for k, word in enumerate(pool))
