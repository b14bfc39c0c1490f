"""Pins the engine's random numbers to numpy's, bit for bit, and the conversion of generators in both directions."""

import ctypes
import math
import pickle

import gymnasium
import numpy as np
import pytest
from gymnasium.utils import seeding

from spidar_gym.errors import InvalidValueError
from spidar_gym.native.codegen.ziggurat import EDGE, LAYERS, PLACES, ziggurat
from spidar_gym.native.draws import from_numpy, to_numpy
from spidar_gym.native.engine_structs import engine_layouts
from spidar_gym.native.library import load_core, pointer

SEEDS = (0, 1, 2**31, 2**32 - 1, 2**32, 2**64 - 1, 2**64, 2**96 + 5, 2**128 - 1, 2**128, 2**160 - 1, 3**400)
"""Seeds of one to twenty words; numpy has no largest seed."""
MULTIPLIER = 2549297995355413924 << 64 | 4865540595714422341
INSIDE, DISTANCE, DENSITY = ziggurat()


@pytest.fixture(scope="module")
def library():
    library = load_core()
    results = {"next64": ctypes.c_uint64, "next32": ctypes.c_uint32, "integer": ctypes.c_int64}
    for name in ("next64", "next32", "random", "uniform", "normal", "integer"):
        getattr(library, f"sp_{name}").restype = results.get(name, ctypes.c_double)
    return library


class Stream:
    """The engine's generator with numpy's interface."""

    def __init__(self, library, record):
        self.library, self.record, self.at = library, record, pointer(record)

    def random(self):
        return self.library.sp_random(self.at)

    def uniform(self, low, high):
        return self.library.sp_uniform(self.at, ctypes.c_double(low), ctypes.c_double(high))

    def standard_normal(self):
        return self.library.sp_normal(self.at)

    def integers(self, low, high):
        return self.library.sp_integer(self.at, ctypes.c_int64(low), ctypes.c_int64(high))

    def spawn(self):
        child = np.zeros((), engine_layouts()["generator"])
        self.library.sp_spawn(self.at, pointer(child))
        return Stream(self.library, child)


def numpys(seed):
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence(seed)))


def seeded(library, seed):
    """Return the engine's generator for an integer seed."""
    words = np.array([seed >> 32 * k & 0xFFFFFFFF for k in range(max(1, -(-seed.bit_length() // 32)))], np.uint32)
    record = np.zeros((), engine_layouts()["generator"])
    library.sp_seed(pointer(words), len(words), pointer(record))
    return Stream(library, record)


def same_state(stream, generator):
    return stream.record.tobytes() == from_numpy(generator).tobytes()


def bits(numbers):
    return np.asarray(numbers, float).tobytes()


@pytest.mark.parametrize("seed", SEEDS)
def test_a_seed_gives_numpys_state(library, seed):
    assert same_state(seeded(library, seed), numpys(seed))


def test_gymnasiums_generator_is_that_of_the_seed_also_where_it_drew_one_itself(library):
    for seed in (0, 7, 2**70, None, None, None):
        generator, drawn = seeding.np_random(seed)
        assert same_state(seeded(library, drawn), generator)


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("draw", ["random", "standard_normal"])
def test_a_hundred_thousand_numbers_of_each_seed_are_the_same(library, draw, seed):
    generator, stream = numpys(seed), seeded(library, seed)
    one = getattr(stream, draw)
    assert bits([one() for _ in range(100_000)]) == bits(getattr(generator, draw)(100_000))
    assert same_state(stream, generator)


@pytest.mark.slow
def test_ten_million_normal_numbers_are_the_same(library):
    for seed in range(10):
        generator, stream = numpys(seed), seeded(library, seed)
        one = stream.standard_normal
        assert bits([one() for _ in range(1_000_000)]) == bits(generator.standard_normal(1_000_000))
        assert same_state(stream, generator)


def test_uniform_numbers_round_alike_for_numbers_and_arrays_of_bounds(library):
    bounds = np.random.default_rng(0).normal(0.0, 10.0 ** np.arange(-3, 5)[:, None], (8, 500))
    low, high = np.minimum(bounds, bounds[::-1]), np.maximum(bounds, bounds[::-1])
    for seed in (0, 5, 2**64):
        generator, stream = numpys(seed), seeded(library, seed)
        ours = [stream.uniform(*pair) for pair in zip(low.flat, high.flat, strict=True)]
        assert bits(ours) == bits(generator.uniform(low, high))
        assert bits([stream.uniform(-math.pi, 2.5) for _ in range(50_000)]) == bits(
            generator.uniform(-math.pi, 2.5, 50_000)
        )
        assert stream.uniform(1.0, 2.5) == generator.uniform(1.0, 2.5)
        assert same_state(stream, generator)


WHOLE = [
    (1, 4), (0, 1), (5, 6), (0, 2**31), (0, 3 * 2**30), (-7, 2**32 - 8), (0, 2**32 - 1), (0, 2**32), (0, 2**32 + 1),
    (-(2**40), 2**41), (0, 3 * 2**61), (-(2**63), 2**63 - 1),
]  # fmt: skip
"""Ranges: the paper's forms, single numbers, ranges with many rejected draws, ranges around 2^32, the widest."""


def test_whole_numbers_are_the_same_with_the_halves_that_they_leave(library):
    for seed in (0, 1, 2**100):
        generator, stream = numpys(seed), seeded(library, seed)
        for low, high in WHOLE:
            assert [stream.integers(low, high) for _ in range(3001)] == generator.integers(low, high, 3001).tolist()
            assert same_state(stream, generator), (low, high)
        assert [stream.integers(1, 4) for _ in range(20_000)] == [generator.integers(1, 4) for _ in range(20_000)]


def test_draws_of_all_kinds_in_any_order_leave_the_same_state(library):
    order = np.random.default_rng(1)
    for seed in (0, 3, 2**64 - 1):
        generator, stream = numpys(seed), seeded(library, seed)
        for kind in order.integers(0, 6, 30_000):
            if kind == 5:
                child, ours = generator.spawn(1)[0], stream.spawn()
                assert same_state(ours, child)
                continue
            low, high = WHOLE[order.integers(len(WHOLE))]
            name, arguments = (
                ("random", ()), ("uniform", (-1.0, 0.3)), ("standard_normal", ()), ("integers", (1, 4)),
                ("integers", (low, high)),
            )[kind]  # fmt: skip
            assert getattr(stream, name)(*arguments) == getattr(generator, name)(*arguments)
            if kind == 0:
                assert same_state(stream, generator)
        assert same_state(stream, generator)


def grown(generator, stream, depth):
    """Compare a tree of generators with three children each."""
    assert same_state(stream, generator)
    if depth:
        for child in generator.spawn(2):
            grown(child, stream.spawn(), depth - 1)
        generator.standard_normal(3)
        [stream.standard_normal() for _ in range(3)]
        grown(generator.spawn(1)[0], stream.spawn(), depth - 1)
    assert same_state(stream, generator)


@pytest.mark.parametrize("seed", [*SEEDS, *range(2, 100)])
def test_children_of_children_of_children_are_the_same(library, seed):
    grown(numpys(seed), seeded(library, seed), 3)


def test_the_child_after_many_is_the_same(library):
    generator, stream = numpys(0), seeded(library, 0)
    generator.spawn(5000)
    for _ in range(5000):
        stream.spawn()
    grown(generator, stream, 1)
    generator = np.random.Generator(np.random.PCG64(np.random.SeedSequence(4, n_children_spawned=2**32 - 2)))
    stream = Stream(library, from_numpy(generator))
    grown(generator.spawn(1)[0], stream.spawn(), 2)


# A generator whose next draws are given.


def before(draw, increment):
    """Return a state of PCG64 before a draw: one of the 2^64 that yield it next, without a rotation of its bits."""
    return (draw - increment) * pow(MULTIPLIER, -1, 2**128) % 2**128  # the upper half is 0, so no bit is rotated


def wished(draw, following=None):
    """Return numpy's generator that draws a given 64-bit word next, and the 53 bits `following` after it."""
    generator = numpys(0)
    increment = 1 if following is None else _increment(draw, following)
    state = {"state": before(draw, increment), "inc": increment}
    generator.bit_generator.state = {"bit_generator": "PCG64", "state": state, "has_uint32": 0, "uinteger": 0}
    return generator


def _increment(draw, following):
    """Return the odd increment that leads from the state `draw` to one whose word is about `following` / 2^53."""
    for low in range(4):  # the increment must be odd
        increment = ((following << 11 | low) - draw * MULTIPLIER) % 2**128
        if increment % 2:
            return increment
    raise AssertionError


def both(library, draw, following=None):
    """Check that numpy and the engine convert draws to the same normal number, bit for bit; return the number."""
    generator = wished(draw, following)
    stream = Stream(library, from_numpy(generator))
    words = np.random.PCG64(0)
    words.state = generator.bit_generator.state
    assert words.random_raw() == draw
    if following is not None:
        assert words.random_raw() >> 11 == following
    number = generator.standard_normal()
    assert bits([stream.standard_normal()]) == bits([number])
    assert same_state(stream, generator)
    return number


def drawn(layer, place, sign=0):
    return place << 9 | sign << 8 | layer


@pytest.mark.parametrize("sign", [0, 1])
def test_the_place_where_each_layer_ends_is_numpys(library, sign):
    for layer in range(LAYERS):
        for place in (0, 1, INSIDE[layer] - 1, INSIDE[layer], INSIDE[layer] + 1, PLACES // 2, PLACES - 1):
            if 0 <= place < PLACES:
                both(library, drawn(layer, place, sign), 2**52 + 12345)


def test_numpys_tables_are_these_to_the_last_bit():
    """They follow from numpy's draws: distances from places that are powers of two, limits from both sides."""
    for layer in range(LAYERS):
        places = [2**k for k in range(52) if 2**k < INSIDE[layer]]
        for place in places[-1:]:
            assert wished(drawn(layer, place)).standard_normal() == place * DISTANCE[layer]
        if INSIDE[layer]:
            assert draws_of(drawn(layer, INSIDE[layer] - 1)) == 1
        assert draws_of(drawn(layer, INSIDE[layer])) > 1


def draws_of(draw):
    """Return how many draws a normal number consumes that starts with this draw."""
    generator = wished(draw)
    count, words = 0, wished(draw).bit_generator
    generator.standard_normal()
    while words.state != generator.bit_generator.state:
        words.random_raw()
        count += 1
    return count


def test_the_wedge_of_each_layer_is_accepted_and_rejected_alike(library):
    """Tested on both sides of the deciding draw, which depends on the density at each layer's edge."""
    kept = refused = 0
    for layer in range(1, LAYERS):
        for place in np.linspace(INSIDE[layer], PLACES - 1, 5).astype(int).tolist():
            x = place * DISTANCE[layer]
            share = (math.exp(-0.5 * x * x) - DENSITY[layer]) / (DENSITY[layer - 1] - DENSITY[layer])
            limit = min(max(round(share * 2**53), 0), 2**53 - 1)
            for following in (0, 1, limit - 4096, limit - 2, limit - 1, limit, limit + 1, limit + 2, limit + 4096):
                if 0 <= following < 2**53:
                    number = both(library, drawn(layer, place, following % 2), following)
                    kept, refused = kept + (abs(number) == x), refused + (abs(number) != x)
    assert kept > 1000
    assert refused > 1000


def test_the_tail_is_the_same(library):
    order = np.random.default_rng(2)
    signs = set()
    for place in order.integers(INSIDE[0], PLACES, 3000).tolist():
        number = both(library, drawn(0, place, int(order.integers(2))), int(order.integers(2**53)))
        assert abs(number) > EDGE
        signs.add(number > 0.0)
    assert signs == {True, False}
    for following in (0, 1, 2**53 - 2, 2**53 - 1):
        assert abs(both(library, drawn(0, INSIDE[0]), following)) >= EDGE


def test_the_halves_of_a_draw_are_returned_one_after_the_other(library):
    generator = numpys(9)
    stream, words = Stream(library, from_numpy(generator)), numpys(9).bit_generator
    raw = [int(words.random_raw()) for _ in range(3)]
    halves = [library.sp_next32(stream.at), library.sp_next64(stream.at), library.sp_next32(stream.at)]
    assert halves == [raw[0] & 0xFFFFFFFF, raw[1], raw[0] >> 32]


# Between numpy and the engine.


@pytest.mark.parametrize(
    "entropy", [*SEEDS, [1, 2], [2**40, 0, 7], [], [0], ["0x1ffffffff", "12"], np.arange(9), (3, (4, 5))]
)
@pytest.mark.parametrize("key", [(), (0,), (3, 2**32 + 1), (0, 0, 0, 0, 9)])
def test_a_generator_survives_both_ways(entropy, key):
    seeds = np.random.SeedSequence(entropy, spawn_key=key, n_children_spawned=4)
    generator = np.random.Generator(np.random.PCG64(seeds))
    generator.integers(1, 4)
    record = from_numpy(generator)
    again = to_numpy(record)
    assert from_numpy(again).tobytes() == record.tobytes()
    assert again.bit_generator.state == generator.bit_generator.state
    kept = again.bit_generator.seed_seq
    assert kept.n_children_spawned == 4
    assert kept.generate_state(16).tobytes() == seeds.generate_state(16).tobytes()
    for ours, theirs in zip(again.spawn(2), generator.spawn(2), strict=True):
        assert ours.bit_generator.state == theirs.bit_generator.state
        for one, other in zip(ours.spawn(2), theirs.spawn(2), strict=True):
            assert one.standard_normal(4).tobytes() == other.standard_normal(4).tobytes()
    assert again.integers(1, 4, 9).tolist() == generator.integers(1, 4, 9).tolist()


@pytest.mark.parametrize("seed", [seed for seed in SEEDS if seed < 2**128])
def test_the_seed_itself_is_found_again_in_a_record(library, seed):
    again = to_numpy(seeded(library, seed).record)
    assert again.bit_generator.seed_seq.entropy == seed
    assert again.bit_generator.seed_seq.spawn_key == ()


def test_draws_from_a_record_advance_neither_the_generator_nor_another_copy(library):
    generator = numpys(1)
    stream, other = Stream(library, from_numpy(generator)), Stream(library, from_numpy(generator))
    numbers = [stream.random() for _ in range(5)]
    stream.spawn()
    assert [other.random() for _ in range(5)] == numbers
    assert generator.random(5).tolist() == numbers
    assert to_numpy(stream.record).random() == generator.random()


def test_an_environment_continues_with_the_generator_that_the_engine_has_advanced(library):
    envs = [gymnasium.make("spidar_gym/Hover-v0", horizon_s=1.0).unwrapped for _ in range(2)]
    for env in envs:
        env.reset(seed=11)
    stream = Stream(library, from_numpy(envs[0].np_random))
    numbers = [stream.random() for _ in range(3)]
    envs[0].np_random = to_numpy(stream.record)
    assert envs[1].np_random.random(3).tolist() == numbers
    first, second = (env.reset()[0] for env in envs)
    assert first.tobytes() == second.tobytes()


def test_a_generator_that_was_pickled_is_as_good(library):
    generator = numpys(6)
    generator.spawn(2)
    grown(pickle.loads(pickle.dumps(generator)), Stream(library, from_numpy(generator)), 1)


@pytest.mark.parametrize(
    "make",
    [
        lambda: np.random.Generator(np.random.PCG64DXSM(0)),
        lambda: np.random.Generator(np.random.MT19937(0)),
        lambda: np.random.Generator(np.random.PCG64(np.random.SeedSequence(0, pool_size=8))),
    ],
)
def test_other_generators_are_refused_in_one_line(make):
    with pytest.raises(InvalidValueError, match=r"generator = .* is not valid; expected a numpy Generator of PCG64"):
        from_numpy(make())


def test_an_invalid_record_is_refused():
    for spoil in ("hash", "increment_low"):
        record = from_numpy(numpys(0))
        record[spoil] = 2
        with pytest.raises(InvalidValueError, match="from_numpy"):
            to_numpy(record)
