"""Generates the tables for sampling normal numbers, bit for bit numpy's: a ziggurat of 256 layers of equal area.

A layer is a horizontal strip under f(x) = exp(−x²/2) from x = 0 to its edge; the lowest one includes the tail beyond r
[Marsaglia2000]. numpy's tables were computed in double precision. So this module repeats that arithmetic, with
exponentials and logarithms that are rounded correctly on every machine.
"""

import math
from decimal import Context, Decimal
from functools import cache
from itertools import pairwise

from spidar_gym.native.codegen.header import array, define, header, hex_float

LAYERS = 256
"""Number of layers: that of the tail first, then from the top down."""
EDGE = 3.6541528853610087963519472518
"""Edge r of the lowest layer, where the tail begins."""
AREA = 0.0049286732339746519
"""Area v of each layer."""
PLACES = 2**52
"""Number of places on the width of a layer, of which one is sampled."""
ROUNDED_UP = 38
"""Layer whose density numpy rounds up although the exact value is 0.498 of the last bit above the lower number."""
_PRECISE = Context(prec=40)


def _exp(x: float) -> float:
    return float(_PRECISE.exp(Decimal(x)))


def _log(x: float) -> float:
    return float(_PRECISE.ln(Decimal(x)))


@cache
def ziggurat() -> tuple[list[int], list[float], list[float]]:
    """Compute for each layer: places below which a point is under the curve, distance of two places, f at its edge.

    For the lowest layer the distance of two places is that of a rectangle of the same area.
    """
    edges, densities = [EDGE], [_exp(-0.5 * EDGE * EDGE)]
    for layer in range(LAYERS - 2, 0, -1):
        x = math.sqrt(-2.0 * _log(densities[-1] + AREA / edges[-1]))
        density = _exp(-0.5 * x * x)
        edges.append(x)
        densities.append(math.nextafter(density, 1.0) if layer == ROUNDED_UP else density)
    edges.reverse()
    densities.reverse()
    inside = [
        EDGE * densities[-1] / AREA,
        0.0,
        *(inner / outer for inner, outer in pairwise(edges)),
    ]
    widths = [AREA / densities[-1], *edges]
    return [round(share * PLACES) for share in inside], [width / PLACES for width in widths], [1.0, *densities]


def ziggurat_header() -> str:
    """Generate spidar_ziggurat.h."""
    inside, distance, density = ziggurat()
    lines = [
        define("ZIGGURAT_EDGE", EDGE, "where the tail begins"),
        "/* For each layer: number of places surely under the curve, distance of two places, density at its edge. */",
        *array("uint64_t", "SP_ZIGGURAT_INSIDE", [f"{places}u" for places in inside]),
        *array("double", "SP_ZIGGURAT_DISTANCE", list(map(hex_float, distance))),
        *array("double", "SP_ZIGGURAT_DENSITY", list(map(hex_float, density))),
    ]
    return header("SPIDAR_ZIGGURAT", "tables for sampling normal numbers.", lines)
