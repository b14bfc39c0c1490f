"""Parameter files for tests: edited ones with a right hash, and the compiled presets that C adds."""

import hashlib
import re

import numpy as np


def sealed(text):
    """Text of a file without its last line → file."""
    return text + b"sha256 " + hashlib.sha256(text).hexdigest().encode() + b"\n"


def edited(data, pattern, by):
    """A file in which every match of a pattern is replaced, with a right hash."""
    text, count = re.subn(pattern, by, data[:-72])
    assert count, pattern
    return sealed(text)


def with_compiled(record, compiled):
    """Parameters as C has them: those of a file, and the compiled presets that it lacks."""
    record = np.frombuffer(bytearray(record.tobytes()), record.dtype).reshape(())  # a copy with its padding
    for kind in ("flight", "crawl"):
        presets, count = record[f"{kind}s"], int(record[f"{kind}_count"])
        names = presets["name"][:count].tolist()
        for each in compiled[f"{kind}s"][: int(compiled[f"{kind}_count"])]:
            if each["name"].tolist() not in names:
                presets[count] = each
                count += 1
        record[f"{kind}_count"] = count
    return record
