"""Files that appear whole or not at all."""

import json
import os
from pathlib import Path
from typing import Any

from spidar_gym.errors import SpidarError


def replace_file(path: Path, temporary: Path) -> None:
    """Move a finished file into its place, so that an interrupted run leaves no half of it."""
    try:
        os.replace(temporary, path)
    except OSError as error:
        temporary.unlink(missing_ok=True)
        raise SpidarError(f"cannot write {path}: {error.strerror}; valid: a path in a writable folder") from error


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


def has_text(path: Path, text: str) -> bool:
    """Whether a file is there and holds just this text."""
    return path.is_file() and path.read_text(encoding="utf-8") == text


def write_text(path: Path, text: str) -> None:
    """Write a text file whole or not at all."""
    write_bytes(path, (text if text.endswith("\n") else text + "\n").encode())


def write_bytes(path: Path, data: bytes) -> None:
    """Write a file whole or not at all."""
    output_folder(path.parent)
    temporary = path.with_name(f".{path.name}.part")
    try:
        temporary.write_bytes(data)
    except OSError as error:
        temporary.unlink(missing_ok=True)
        raise SpidarError(f"cannot write {path}: {error.strerror}; valid: a path in a writable folder") from error
    replace_file(path, temporary)
