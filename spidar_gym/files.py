"""Atomic writing of files and folders: a file appears complete or not at all."""

import contextlib
import errno
import fcntl
import json
import os
import shutil
import tempfile
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Any

from spidar_gym.errors import SpidarError, StaleAssetError

BEFORE, AFTER = ".spidar.", ".part"
"""Prefix and suffix of the names of writers' temporary folders."""
FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS, errno.EIO)
"""Error numbers of a disk that cannot be written to any more."""


@contextlib.contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Yield a path to write to; its file or folder is moved to `path` when the context ends without an error.

    Until then it lies in a temporary folder beside the target, on the same disk. Each writer has its own folder, so
    several may write at once, with any library or compiler; the last one to finish wins. If the target is a link, the
    link itself is replaced, not the file that it points to.

    Args:
        path: The target; its folders are created if needed.

    Raises:
        SpidarError: If writing to the disk fails.
    """
    try:
        with own_folder(output_folder(path.parent)) as folder:
            made = folder / path.name
            yield made
            # Written to the disk, not only to the operating system's cache.
            for inner in made.rglob("*"):
                _sync(inner)
            _sync(made)
            _replace(path, made)
            _sync(path.parent)
    except OSError as error:
        raise cannot_write(path, error) from error


@contextlib.contextmanager
def scratch_folder() -> Iterator[Path]:
    """Yield a new temporary folder, removed afterwards (`SpidarError` if the disk is full or not writable)."""
    made = False
    try:
        with own_folder(Path(tempfile.gettempdir())) as folder:
            made = True
            yield folder
    except OSError as error:
        if made and error.errno not in FULL and not isinstance(error, shutil.Error):
            raise  # caused by the body of the context, not by the folder
        raise SpidarError(
            f"no room for temporary files: {_reason(error)}; valid: a TMPDIR that is writable and has room"
        ) from error


@contextlib.contextmanager
def own_folder(parent: Path) -> Iterator[Path]:
    """Yield a new folder inside `parent` for one writer, removed afterwards; folders of killed writers are removed too.

    The folder is locked while its writer runs. A folder that is not locked belongs to a writer that was killed.

    Raises:
        OSError: If the folder cannot be created.
    """
    _sweep(parent.absolute())
    folder, lock = _locked_folder(parent)
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)
        os.close(lock)


def _locked_folder(parent: Path) -> tuple[Path, int]:
    while True:
        folder = Path(tempfile.mkdtemp(AFTER, BEFORE, parent))
        with contextlib.suppress(FileNotFoundError):  # swept before it was locked: try again
            lock = os.open(folder, os.O_RDONLY)
            with contextlib.suppress(OSError):  # a disk without locks, where nothing is swept
                fcntl.flock(lock, fcntl.LOCK_EX)
            if folder.exists():
                return folder, lock
            os.close(lock)


@cache
def _sweep(parent: Path) -> None:
    """Remove writers' folders that are not locked; once per process, because it lists all of `parent`."""
    for folder in parent.glob(f"{BEFORE}*{AFTER}"):
        with contextlib.suppress(OSError):  # another user's, a link, locked, or already removed
            lock = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                shutil.rmtree(folder)
            finally:
                os.close(lock)


def _replace(target: Path, made: Path) -> None:
    """Move the new file or folder to the target; an existing target is moved away first if a folder replaces it."""
    old = made.with_name(f".{made.name}")
    try:
        if made.is_dir() and target.exists():
            os.replace(target, old)
        os.replace(made, target)
    except OSError:
        if old.exists():
            os.replace(old, target)
        raise


def _sync(path: Path) -> None:
    """Wait until a file or folder is on the disk."""
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    except OSError as error:
        if error.errno not in (errno.EINVAL, errno.EBADF):  # some network disks cannot sync a folder
            raise
    finally:
        os.close(handle)


def cannot_write(path: Path, error: OSError) -> SpidarError:
    """Return the error to raise when a file or folder cannot be written."""
    return SpidarError(
        f"cannot write {path}: {_reason(error)}; valid: a path in a writable folder, on a disk with room"
    )


def _reason(error: OSError) -> str:
    """Return the system's error text without the paths."""
    if isinstance(error, shutil.Error) and error.args and error.args[0]:
        return str(error.args[0][0][-1]).partition("] ")[2].partition(": ")[0]  # that of the first of many files
    return error.strerror or str(error)


def output_folder(path: Path) -> Path:
    """Return the folder, creating it if needed (`SpidarError` if that fails)."""
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise SpidarError(f"cannot write into {path}: {error.strerror}; valid: a writable folder") from error
    return path


def json_text(result: dict[str, Any]) -> str:
    """Format one JSON object as text."""
    return json.dumps(result, indent=2, ensure_ascii=False)


def refresh(files: Mapping[Path, str], command: str, *, check: bool) -> int:
    """Write the generated files that are missing or differ, and return their number.

    Args:
        files: Expected text of each file.
        command: The command that writes the files, for the message.
        check: Whether to write nothing and raise instead.

    Raises:
        StaleAssetError: With `check`, if files are missing or differ; names them.
    """
    stale = [p for p, text in files.items() if not (p.is_file() and p.read_text(encoding="utf-8") == text)]
    if stale and check:
        raise StaleAssetError(", ".join(map(str, stale)), command)
    for path in stale:
        write_text(path, files[path])
    return len(stale)


def write_text(path: Path, text: str) -> None:
    """Write a text file atomically."""
    write_bytes(path, (text if text.endswith("\n") else text + "\n").encode())


def write_bytes(path: Path, data: bytes) -> None:
    """Write a file atomically."""
    with whole_file(path) as part:
        part.write_bytes(data)
