"""Generates the engine's C text: numbers, enumerations, structs and tables."""

from spidar_gym.native import draws
from spidar_gym.native.codegen.header import define, enumeration, header, struct
from spidar_gym.native.codegen.ziggurat import ziggurat_header
from spidar_gym.native.configurations import configuration_structs
from spidar_gym.native.engine_structs import (
    ENGINE_ENUMERATIONS,
    ENGINE_NUMBERS,
    ENGINE_SIZES,
    ENGINE_STRUCTS,
)

DRAWS = ("SEED_POOL", "SEED_START", "SEED_FACTOR", "SEED_LEFT", "SEED_RIGHT", "STATE_START", "STATE_FACTOR")
"""Constants of the mixing of seeds."""


def engine_header() -> str:
    """Generate spidar_engine_structs.h: numbers, enumerations, structs."""
    lines = [define(name, value, "engine_structs") for name, value in ENGINE_SIZES.items()]
    lines += [define(name, getattr(draws, name), draws.__name__) for name in DRAWS]
    for prefix, place, names in ENGINE_NUMBERS:
        lines += [define(f"{prefix}{n}".upper(), getattr(place, n), f"{place.__name__}.{n}") for n in names]
    lines += ["", *(line for each in ENGINE_ENUMERATIONS for line in enumeration(each))]
    lines += [line for each in (*configuration_structs(), *ENGINE_STRUCTS) for line in struct(each)][:-1]
    doc = "numbers and structs of the simulated world."
    return header("SPIDAR_ENGINE_STRUCTS", doc, lines, ("<stdint.h>", '"spidar_structs.h"'))


def engine_headers() -> dict[str, str]:
    """Generate the headers of the library alone: name → text."""
    return {"spidar_engine_structs.h": engine_header(), "spidar_ziggurat.h": ziggurat_header()}
