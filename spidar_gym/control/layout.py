"""The onboard core's structs as numpy types: read from its own headers, so that nothing is written down twice."""

import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np

CORE = Path(__file__).resolve().parent.parent / "deploy" / "onboard" / "core"
"""Sources of the core."""
_PLAIN = {"double": "f8", "int32_t": "i4", "float": "f4", "char": "u1"}


def layouts(header: str, known: Mapping[str, np.dtype] | None = None) -> dict[str, np.dtype]:
    """Types of a header's structs by name without `sp_`, laid out as a C compiler does.

    Args:
        header: Text of the header; members are numbers, arrays of known length, or structs that came before.
        known: Structs of other headers.
    """
    text = re.sub(r"/\*.*?\*/", "", header, flags=re.S)
    numbers = {name: int(value) for name, value in re.findall(r"#define (SP_\w+) (\d+)\s", text)}
    for body in re.findall(r"enum \{(.*?)\}", text, flags=re.S):
        value = 0
        for item in filter(None, map(str.strip, body.split(","))):
            name, _, given = item.partition("=")
            value = int(given) if given else value
            numbers[name.strip()] = value
            value += 1
    for name, words in re.findall(r"#define (SP_\w+) (\(.+?\))\s*\n", text):
        numbers[name] = _value(words, numbers)
    kinds = set(re.findall(r"typedef enum \{.*?\} (sp_\w+);", text, flags=re.S))
    types = dict(known or {})
    for body, name in re.findall(r"typedef struct \{(.*?)\} sp_(\w+);", text, flags=re.S):
        fields = []
        for line in filter(None, map(str.strip, body.split(";"))):
            kind, _, names = line.partition(" ")
            base = "i4" if kind in kinds else _PLAIN.get(kind) or types.get(kind.removeprefix("sp_"))
            if base is None:
                break  # a struct of pointers is not of the border
            for member in names.split(","):
                word, *sizes = re.findall(r"[^\[\]]+", member.strip())
                shape = tuple(_value(size, numbers) for size in sizes)
                fields.append((word, base, shape) if shape else (word, base))
        else:
            types[name] = np.dtype(fields, align=True)
    return types


def _value(words: str, numbers: Mapping[str, int]) -> int:
    """A product or sum of whole numbers and names."""
    for name in sorted(numbers, key=len, reverse=True):
        words = re.sub(rf"\b{name}\b", str(numbers[name]), words)
    words = words.strip()
    if not re.fullmatch(r"[\d\s+*()]+", words):
        raise ValueError(f"{words!r} is no number")
    return int(eval(words, {"__builtins__": {}}))
