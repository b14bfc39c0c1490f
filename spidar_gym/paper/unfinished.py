"""Long work that goes on where it was interrupted: its finished pieces lie in files until all of it is done."""

import dataclasses
import hashlib
import json
import shutil
from collections.abc import Callable, Iterable
from functools import cache
from pathlib import Path
from typing import Any

from spidar_gym.files import write_text
from spidar_gym.processes import Pool


@cache
def _code() -> str:
    """Digest of the package's code: another code's pieces are none of ours."""
    root = Path(__file__).resolve().parents[1]
    digest = hashlib.sha256()
    for file in sorted(root.rglob("*.py")):
        digest.update(str(file.relative_to(root)).encode() + b"\0" + file.read_bytes())
    return digest.hexdigest()


def _digest(*words: Any) -> str:  # noqa: ANN401 - JSON and dataclasses
    text = json.dumps(words, default=dataclasses.asdict, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()


def finish(
    call: Callable[[Any], Any],
    items: Iterable[Any],
    *,
    workers: int = 1,
    folder: Path | None = None,
    on_done: Callable[[], object] = lambda: None,
) -> list[Any]:
    """Do what is not done yet.

    Args:
        call: A piece of the work, whose result is JSON; it and the items must be picklable.
        items: What it is done on, each made of dataclasses and JSON.
        workers: Processes.
        folder: Where finished pieces are kept until `forget`; nowhere if None.
        on_done: Called after every piece, for progress.

    Returns:
        Results in the order of the items, the same whether they were kept or have just been made.

    Raises:
        LostWorkerError: When a worker has been killed.
    """
    items = list(items)
    files = [
        None if folder is None else folder / f"{_digest(call.__qualname__, item, _code())[:24]}.json" for item in items
    ]
    results: dict[int, Any] = {}
    for k, file in enumerate(files):
        if file is not None and (found := _kept(file)) is not None:
            results[k] = found["result"]
            on_done()
    rest = [k for k in range(len(items)) if k not in results]
    with Pool(workers) as pool:
        for place, made in pool.as_done(call, [items[k] for k in rest], lambda place: f"piece {rest[place] + 1}"):
            k = rest[place]
            result = json.loads(json.dumps(made))
            if (file := files[k]) is not None:
                write_text(file, json.dumps({"result": result, "sha256": _digest(file.stem, result)}))
            results[k] = result
            on_done()
    return [results[k] for k in range(len(items))]


def _kept(file: Path) -> dict[str, Any] | None:
    """A piece with its result; None where there is none, or none that is whole and as it was written."""
    try:
        found = json.loads(file.read_text(encoding="utf-8"))
        return found if found["sha256"] == _digest(file.stem, found["result"]) else None
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return None


def forget(folder: Path) -> None:
    """Remove the pieces of work that is done."""
    shutil.rmtree(folder, ignore_errors=True)
