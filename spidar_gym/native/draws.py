"""Converts numpy's generators to records of the engine and back; both yield the same numbers."""

from collections.abc import Iterable
from typing import Any

import numpy as np

from spidar_gym.errors import InvalidValueError
from spidar_gym.native.engine_structs import engine_layouts

SEED_POOL = 4
"""Number of 32-bit words of the pool in which numpy's SeedSequence mixes a seed."""
SEED_START, SEED_FACTOR = 0x43B0D7E5, 0x931E8875
"""First constant of the mixing, and the factor from one constant to the next."""
SEED_LEFT, SEED_RIGHT = 0xCA01F9DD, 0x4973F715
"""Factors by which two words are combined into one."""
STATE_START, STATE_FACTOR = 0x8B51F9DD, 0x58F38DED
"""Constants by which the pool is expanded to the state of a bit generator."""
_BITS, _WORDS = 2**32, 2**64
_UNLEFT = pow(SEED_LEFT, -1, _BITS)
_MOST_WORDS = 10_000
"""Largest number of words of seed and spawn key that `to_numpy` searches."""
_VALID = "a numpy Generator of PCG64 with a SeedSequence of 4 words, such as env.np_random or numpy.random.default_rng"


def from_numpy(generator: np.random.Generator) -> np.ndarray:
    """Return a copy of a generator as the engine's struct `generator`; it draws and spawns the same from here on.

    Draws from the record do not advance `generator`.

    Raises:
        InvalidValueError: For another bit generator than PCG64, or a seed sequence of another kind or pool size.
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
    """Return the numpy generator of a record of the engine; it draws and spawns the same from here on.

    Its `seed_seq.entropy` is the original seed if that has up to 128 bits and the generator was not spawned. Otherwise
    it is another seed with the same pool, so that every child is the same, too.

    Raises:
        InvalidValueError: For a record that was made neither by `from_numpy` nor by the engine.
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
    """Advance a numpy generator to the state of a record that was made from it by `from_numpy`."""
    bits, seeds = rng.bit_generator, rng.bit_generator.seed_seq
    state: Any = bits.state
    state["state"]["state"] = _wide(record, "state")
    state["has_uint32"], state["uinteger"] = int(record["has_half"]), int(record["half"])
    bits.state = state
    seeds.spawn(int(record["spawned"]) - seeds.n_children_spawned)  # pyright: ignore[reportAttributeAccessIssue] - numpy's stub lacks it


def _wide(record: np.ndarray | np.void, name: str) -> int:
    return int(record[f"{name}_high"]) * _WORDS + int(record[f"{name}_low"])


def _count(seed: Any) -> int:  # noqa: ANN401 - numpy's seeds: numbers, their text, sequences of either
    """Return the number of 32-bit words of a seed."""
    if isinstance(seed, str):
        seed = int(seed, 16 if seed.startswith("0x") else 10)
    if isinstance(seed, Iterable):
        return sum(map(_count, seed))
    return max(1, -(-int(seed).bit_length() // 32))


def _constant(steps: int) -> int:
    """Return the constant of the mixing after a number of steps."""
    return SEED_START * pow(SEED_FACTOR, steps, _BITS) % _BITS


def _seed(pool: list[int], words: int) -> int:
    """Return the 128-bit seed that, padded with zeros to `words` words, mixes to a pool; inverts each step."""
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
