"""Resumable computations: the results of finished items are stored in files with digests."""

import dataclasses
import hashlib
import json
from collections.abc import Callable, Hashable, Iterable, Iterator, Sequence
from functools import cache
from itertools import groupby
from pathlib import Path
from typing import Any

from spidar_gym.benchmark.cluster import cluster
from spidar_gym.errors import SpidarError
from spidar_gym.files import write_text
from spidar_gym.processes import Pool

PACKAGE = Path(__file__).resolve().parents[1]
"""Folder of the package's code."""
CODE = (".py", ".c", ".h")
"""Suffixes of the code files."""


@cache
def code_digest(*names: str) -> str:
    """Return the digest of files and folders of the package, by default of the whole package.

    The digest is part of the names of stored results, so that results of other code are not used.
    """
    digest = hashlib.sha256()
    for path in [PACKAGE / name for name in names] or [PACKAGE]:
        files = (file for file in path.rglob("*") if file.suffix in CODE) if path.is_dir() else (path,)
        for file in sorted(files):
            digest.update(str(file.relative_to(PACKAGE)).encode() + b"\0" + file.read_bytes())
    return digest.hexdigest()


def digest_of(*words: Any) -> str:  # noqa: ANN401 - JSON and dataclasses
    """Return the digest of values made of dataclasses and JSON."""
    text = json.dumps(words, default=dataclasses.asdict, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()


def finish(
    call: Callable[[Any], Any],
    items: Iterable[Any],
    *,
    workers: int = 1,
    ray: str | None = None,
    folder: Path | None = None,
    name: Callable[[Any], str] | None = None,
    check: Callable[[Any, Any], object] = lambda item, result: None,
    label: Callable[[int], str] = lambda k: f"piece {k + 1}",
    on_done: Callable[[int, Any], object] = lambda k, result: None,
    together: Sequence[Hashable] | None = None,
) -> list[Any]:
    """Apply a function to all items without a stored result, in any order.

    Args:
        call: Function of one item whose result is JSON; the function and the items must be picklable.
        items: Items, each made of dataclasses and JSON.
        workers: Number of processes, or of workers of a local Ray cluster.
        ray: Address of a Ray cluster that does the work, `local` for one on this machine.
        folder: Folder for the results; they are not stored if None.
        name: Item → name of its file without suffix; must change with everything that changes the result. By default
            a digest of function, item and the package's code.
        check: Called with an item and its stored result; raises if the result is not valid for the item.
        label: Index of an item → name of the item in error messages.
        on_done: Called with the index and result of each item as soon as it is available.
        together: Key of each item. Neighbouring items with the same key may be processed together: `call` then
            receives lists of items, short enough to leave work for all workers, and returns a list of results, each
            equal to the result of a list of one.

    Returns:
        Results in the order of the items; stored and new results are equal.

    Raises:
        LostWorkerError: When a worker was killed.
        SpidarError: When no cluster can be reached.
    """
    items, results = list(items), dict[int, Any]()
    files = dict[int, Path]()
    if folder is not None:
        name = name or (lambda item: digest_of(call.__qualname__, item, code_digest())[:24])
        files = {k: folder / f"{name(item)}.json" for k, item in enumerate(items)}
    for k, file in files.items():
        try:
            results[k] = _read(file)
            check(items[k], results[k])
        except (OSError, ValueError, KeyError, TypeError, RecursionError, SpidarError):
            results.pop(k, None)  # missing, incomplete or changed: computed again
        else:
            on_done(k, results[k])
    rest = {k: item for k, item in enumerate(items) if k not in results}
    lists = [[k] for k in rest] if together is None else _lists(list(rest), together, workers)
    work = {ks[0]: items[ks[0]] if together is None else [items[k] for k in ks] for ks in lists}
    members = {ks[0]: ks for ks in lists}
    for first, made in _on_ray(call, work, workers, ray) if ray else _in_processes(call, work, workers, label):
        for k, own in zip(members[first], [made] if together is None else made, strict=True):
            if k in files:
                # The digest binds the result to this file.
                write_text(files[k], json.dumps({"result": own, "sha256": digest_of(files[k].stem, own)}))
            results[k] = json.loads(json.dumps(own))
            on_done(k, results[k])
    return [results[k] for k in range(len(items))]


def _lists(ks: Sequence[int], together: Sequence[Hashable], workers: int) -> list[list[int]]:
    """Group neighbouring items with the same key, split into lists so that each worker receives a share."""
    lists = []
    for _, group in groupby(ks, key=lambda k: together[k]):
        own = list(group)
        most = -(-len(own) // workers)
        lists += [own[at : at + most] for at in range(0, len(own), most)]
    return lists


def _read(file: Path) -> Any:  # noqa: ANN401 - JSON
    """Read a stored result; raises for any other content."""
    found = json.loads(file.read_text(encoding="utf-8"))
    if found["sha256"] != digest_of(file.stem, found["result"]):
        raise ValueError("its digest does not match")
    return found["result"]


_Done = Iterator[tuple[int, Any]]


def _in_processes(call: Callable[[Any], Any], rest: dict[int, Any], workers: int, label: Callable[[int], str]) -> _Done:
    numbers = list(rest)
    with Pool(workers) as pool:
        for place, result in pool.as_done(call, rest.values(), lambda place: label(numbers[place])):
            yield numbers[place], result


def _on_ray(call: Callable[[Any], Any], rest: dict[int, Any], workers: int, address: str) -> _Done:
    if not rest:
        return
    with cluster(address, workers) as ray:
        remote = ray.remote(call)
        waiting = {remote.remote(item): k for k, item in rest.items()}
        while waiting:
            done, _ = ray.wait(list(waiting), num_returns=1)
            for reference in done:
                try:
                    yield waiting.pop(reference), ray.get(reference)
                except ray.exceptions.RayTaskError as error:
                    raise (error.cause if isinstance(error.cause, SpidarError) else error) from None
