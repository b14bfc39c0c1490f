"""The engine's C text from Python: its structs and tables, and the digest that a compiled library answers to."""

from functools import cache
from pathlib import Path

from spidar_gym.native import draws
from spidar_gym.native.codegen.header import define, header, interface_digest, interface_hash, struct
from spidar_gym.native.codegen.ziggurat import ziggurat_header
from spidar_gym.native.engine_structs import ENGINE_STRUCTS

ENGINE = Path(__file__).resolve().parents[1] / "engine"
"""Sources of the engine."""
DRAWS = ("SEED_POOL", "SEED_START", "SEED_FACTOR", "SEED_LEFT", "SEED_RIGHT", "STATE_START", "STATE_FACTOR")
"""Numbers of the mixing of seeds."""


def _engine_lines() -> list[str]:
    """Text of spidar_engine_structs.h but for its digest."""
    numbers = [define(name, getattr(draws, name), draws.__name__) for name in DRAWS]
    return [*numbers, "", *(line for each in ENGINE_STRUCTS for line in struct(each))][:-1]


@cache
def library_hash() -> str:
    """Digest of everything that a compiled library has to agree on: the core, and the engine's structs and sources.

    The robot's own interface, `interface_hash`, has no part of the engine: its logs outlive a change of the simulator.
    """
    return interface_digest("\n".join([interface_hash(), *_engine_lines(), ziggurat_header()]).encode(), ENGINE)


def engine_header() -> str:
    """spidar_engine_structs.h."""
    lines = [f'#define SP_LIBRARY "{library_hash()}"', "", *_engine_lines()]
    doc = "numbers and structs of the simulated world."
    return header("SPIDAR_ENGINE_STRUCTS", doc, lines, ("<stdint.h>", '"spidar_structs.h"'))


def engine_files() -> dict[str, bytes]:
    """Path → content of what a library has beside the files that are exported."""
    files = {f"engine/{source.name}": source.read_bytes() for source in sorted(ENGINE.glob("*.[ch]"))}
    generated = {"engine_structs": engine_header(), "ziggurat": ziggurat_header()}
    return files | {f"generated/spidar_{name}.h": text.encode() for name, text in generated.items()}
