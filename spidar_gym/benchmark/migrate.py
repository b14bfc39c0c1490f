"""Rows of an older format, or of policies whose imports have moved: the old hash is checked, and no metric changes."""

import hashlib
from pathlib import Path
from typing import Any

from spidar_gym.benchmark.content import RowError, check_content
from spidar_gym.benchmark.row import FORMAT, read_content, row_hash, row_of, row_text
from spidar_gym.errors import SpidarError
from spidar_gym.files import write_text
from spidar_gym.policies.provenance import file_digest
from spidar_gym.policies.source import PolicyError, source_file

MOVED = (
    (
        "from spidar_gym.control import Allocation, AllocationStatus, Allocator, Demand\n",
        "from spidar_gym.control.allocator import Allocation, AllocationStatus, Allocator\n"
        "from spidar_gym.control.qp import Demand\n",
    ),
    (
        "from spidar_gym.control.flight.observation import layout\n",
        "from spidar_gym.control.observation import layout\n",
    ),
)
"""Lines of import in a policy's file, as they are and as they were before the package's modules moved into folders."""


def migrate(path: Path) -> bool:
    """Bring the file of a row to the present format and to policies that differ in `MOVED` alone; whether it changed.

    Format 1 kept the processor's name beside the times, where no hash guarded it, and checked no types.

    Raises:
        RowError: When it was edited by hand, or holds what no evaluation has written.
    """
    content = read_content(path)
    try:
        new = content if content["format"] == FORMAT else _from_format_1(content)
        runs = zip(new["policies"], new["policies_sha256"], strict=True)
        new = {**new, "policies_sha256": [_moved(spec, digest) for spec, digest in runs]}
        if new == content:
            return False
        check_content(new)
    except SpidarError as error:
        raise RowError(f"{path}: {error}") from error
    except (KeyError, TypeError, ValueError) as error:
        raise RowError(
            f"{path} is no row of format 1 (lacks {error}); valid: a row that `spidar eval` wrote"
        ) from error
    write_text(path, row_text(row_of({**new, "sha256": row_hash(new)})))
    return True


def _from_format_1(content: dict[str, Any]) -> dict[str, Any]:
    timing = content["timing"]
    before = {key: value for key, value in content.items() if key not in ("timing", "sha256")}
    model, tracks = before.pop("model_sha256"), before.pop("tracks")
    # In the order in which an evaluation writes them.
    return {**before, "format": FORMAT, "processor": timing["processor"], "model_sha256": model, "tracks": tracks,
            "timing": timing["tracks"]}  # fmt: skip


def _moved(spec: str, digest: str) -> str:
    """Hash of the file of a policy that has only moved its imports since the row was made; else the row's own."""
    try:
        file = source_file(spec)
        text = file.read_text(encoding="utf-8")
    except (PolicyError, OSError, UnicodeDecodeError):
        return digest
    for now, before in MOVED:
        text = text.replace(now, before)
    return file_digest(file) if hashlib.sha256(text.encode()).hexdigest() == digest else digest
