"""Files that appear whole or not at all."""

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
"""How the name of a writer's own folder begins and ends."""
FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS, errno.EIO)
"""What a disk says that takes nothing more."""


@contextlib.contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """A path to write to, whose file or folder appears under its own name when the context ends without an error.

    Until then it lies in a folder of the writer's own beside the target, on the same disk, and no two writers share
    one: each may write as it likes, with any library or compiler, and the last to finish is read. A target that is a
    link is replaced itself, not what it points at.

    Args:
        path: The target; its folders are made if needed.

    Raises:
        SpidarError: Where the disk refuses something.
    """
    try:
        with own_folder(output_folder(path.parent)) as folder:
            made = folder / path.name
            yield made
            # On the disk, and not only in memory.
            for inner in made.rglob("*"):
                _sync(inner)
            _sync(made)
            _replace(path, made)
            _sync(path.parent)
    except OSError as error:
        raise cannot_write(path, error) from error


@contextlib.contextmanager
def scratch_folder() -> Iterator[Path]:
    """A new folder among the temporary ones, gone afterwards (`SpidarError` where they have no room for it)."""
    made = False
    try:
        with own_folder(Path(tempfile.gettempdir())) as folder:
            made = True
            yield folder
    except OSError as error:
        if made and error.errno not in FULL and not isinstance(error, shutil.Error):
            raise  # of something else that was done meanwhile
        raise SpidarError(
            f"no room for temporary files: {_reason(error)}; valid: a TMPDIR that is writable and has room"
        ) from error


@contextlib.contextmanager
def own_folder(parent: Path) -> Iterator[Path]:
    """A new folder in another for one writer, gone afterwards; what killed writers have left there goes as well.

    It is locked while its writer lives: that is how a folder without one is known.

    Raises:
        OSError: Where it cannot be made.
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
        with contextlib.suppress(FileNotFoundError):  # swept before it was locked: another one
            lock = os.open(folder, os.O_RDONLY)
            with contextlib.suppress(OSError):  # a disk without locks, where nothing is swept
                fcntl.flock(lock, fcntl.LOCK_EX)
            if folder.exists():
                return folder, lock
            os.close(lock)


@cache
def _sweep(parent: Path) -> None:
    """Remove writers' folders that nobody has locked; once in a process, for it lists all of `parent`."""
    for folder in parent.glob(f"{BEFORE}*{AFTER}"):
        with contextlib.suppress(OSError):  # somebody else's, a link, locked, or already gone
            lock = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                shutil.rmtree(folder)
            finally:
                os.close(lock)


def _replace(target: Path, made: Path) -> None:
    """Move what was made into its place; a folder that is there makes way first, for none is replaced that is full."""
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
        if error.errno not in (errno.EINVAL, errno.EBADF):  # shared disks that cannot sync a folder
            raise
    finally:
        os.close(handle)


def cannot_write(path: Path, error: OSError) -> SpidarError:
    """What to raise where the disk refuses a file or folder."""
    return SpidarError(
        f"cannot write {path}: {_reason(error)}; valid: a path in a writable folder, on a disk with room"
    )


def _reason(error: OSError) -> str:
    """What the system said, without the paths."""
    if isinstance(error, shutil.Error) and error.args and error.args[0]:
        return str(error.args[0][0][-1]).partition("] ")[2].partition(": ")[0]  # of many files the first
    return error.strerror or str(error)


def output_folder(path: Path) -> Path:
    """The folder, made if needed (`SpidarError` where it cannot be)."""
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise SpidarError(f"cannot write into {path}: {error.strerror}; valid: a writable folder") from error
    return path


def json_text(result: dict[str, Any]) -> str:
    """One JSON object as text."""
    return json.dumps(result, indent=2, ensure_ascii=False)


def refresh(files: Mapping[Path, str], command: str, *, check: bool) -> int:
    """Write the generated files that are missing or differ, and say how many they are.

    Args:
        files: File → the text that it should hold.
        command: What writes them.
        check: Write nothing, and raise instead.

    Raises:
        StaleAssetError: With `check`, names the files that are stale.
    """
    stale = [p for p, text in files.items() if not (p.is_file() and p.read_text(encoding="utf-8") == text)]
    if stale and check:
        raise StaleAssetError(", ".join(map(str, stale)), command)
    for path in stale:
        write_text(path, files[path])
    return len(stale)


def write_text(path: Path, text: str) -> None:
    """Write a text file whole or not at all."""
    write_bytes(path, (text if text.endswith("\n") else text + "\n").encode())


def write_bytes(path: Path, data: bytes) -> None:
    """Write a file whole or not at all."""
    with whole_file(path) as part:
        part.write_bytes(data)
