"""The engine's own structs, which become C text and numpy types: what a simulated robot is and remembers."""

from collections.abc import Sequence
from functools import cache

import numpy as np

from spidar_gym.native.core_structs import core_layouts
from spidar_gym.native.structs import CStruct, dtypes

ENGINE_STRUCTS: Sequence[CStruct] = (
    CStruct("generator", "A stream of random numbers: numpy's PCG64, and what spawns others from it.", (
        ("state_high state_low", "u8", (), "of PCG64"),
        ("increment_high increment_low", "u8", (), "odd; which of its streams"),
        ("has_half half", "u4", (), "whether the upper half of a draw is left over; that half"),
        ("pool", "u4", (4,), "the seed and the spawn key, mixed"),
        ("hash spawned", "u4", (), "constant that goes on mixing; how many were spawned"),
    )),
)  # fmt: skip
"""In the order of their definition: those inside others first."""


@cache
def engine_layouts() -> dict[str, np.dtype]:
    """The structs of the library, the core's included, as numpy types, by name."""
    return dtypes(ENGINE_STRUCTS, core_layouts())
