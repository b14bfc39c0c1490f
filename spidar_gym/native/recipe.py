"""How the library is compiled: sources, flags, compilers, digest. The build hook needs the standard library alone."""

import hashlib
import importlib.util
import os
import platform
import shlex
import shutil
import sys
from collections.abc import Mapping
from pathlib import Path

NATIVE = Path(__file__).resolve().parent
"""Folder of the native sources."""
LIBRARY = "libspidar" + {"darwin": ".dylib", "win32": ".dll"}.get(sys.platform, ".so")
"""Name of the compiled library in that folder."""
GENERATED = NATIVE / "generated"
"""Folder of the committed C that `spidar assets` generates: headers, and a folder with OSQP's solvers."""
SOURCES = (NATIVE / "core", NATIVE / "engine", GENERATED / "osqp")
"""Folders of C sources; a missing folder counts as empty."""
SHARED_HEADERS = (
    "spidar_constants.h", "spidar_structs.h", "spidar_modes.h", "spidar_engine_structs.h", "spidar_ziggurat.h",
)  # fmt: skip
"""Generated headers on which Python and C must agree."""
FLAGS = ("-std=c99", "-O2", "-ffp-contract=off")
"""Compiler flags for the robot; without contraction every machine rounds alike."""
LIBRARY_FLAGS = ("-std=c99", "-O3", "-ffp-contract=off")
"""Compiler flags of the simulator's library: the same results in a fifth less time."""
ZIG = "ziglang>=0.13"
"""Requirement that `pip` installs where there is no compiler: a wheel with clang, headers and libraries."""
SEAL = hashlib.sha256().digest_size
"""Number of bytes at the end of a compiled library that hold the hash of the bytes before."""


def find_compiler() -> list[str]:
    """Return the command of a C compiler: CC with its arguments, cc, gcc, clang or ziglang's; empty if none exists.

    Raises:
        ValueError: When CC is not a command.
    """
    given = os.environ.get("CC", "").strip()
    if given:
        try:
            words = shlex.split(given)
        except ValueError:  # an unclosed quotation
            words = []
        if not words or not shutil.which(words[0]):
            raise ValueError(given)
        return words
    found = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
    if found:
        return [found]
    if not importlib.util.find_spec("ziglang"):
        return []
    # With a target zig compiles for all processors of the architecture and an old glibc, else for this machine only.
    target = ["-target", f"{platform.machine()}-linux-gnu.2.17"] if sys.platform == "linux" else ["-mcpu=baseline"]
    return [sys.executable, "-m", "ziglang", "cc", *target]


def source_bytes(path: Path) -> bytes:
    """Read a text file for a digest, with LF as the end of lines on every platform."""
    return path.read_bytes().replace(b"\r\n", b"\n")


def library_digest(headers: Mapping[str, bytes] | None = None) -> str:
    """Compute the digest of a library's sources; a compiled library returns its own from `sp_interface`.

    Args:
        headers: Texts of `SHARED_HEADERS`; the committed ones by default.
    """
    texts = headers or {name: source_bytes(GENERATED / name) for name in SHARED_HEADERS}
    digest = hashlib.sha256()
    for name in SHARED_HEADERS:
        digest.update(name.encode() + b"\0" + texts[name])
    for folder in SOURCES:
        for file in sorted(folder.glob("*.[ch]")):
            digest.update(f"{folder.name}/{file.name}".encode() + b"\0" + source_bytes(file))
    return digest.hexdigest()[:32]


def interface_header(digest: str) -> str:
    """Generate spidar_interface.h: the digest that a compiled core reports."""
    return f'/* Generated: digest of the sources. */\n#define SP_INTERFACE "{digest}"\n'


def sources() -> list[str]:
    """Return the paths of the library's C sources."""
    return [str(path) for folder in SOURCES for path in sorted(folder.glob("*.c"))]


def includes(folder: Path) -> list[str]:
    """Return compiler arguments for the folders of the library's headers; `folder` comes first."""
    return [f"-I{place}" for place in (folder, GENERATED, *SOURCES)]


def compile_words(folder: Path) -> list[str]:
    """Return compiler arguments for the library, without the output; headers are searched in `folder` first."""
    return [*LIBRARY_FLAGS, "-g0", "-DSPIDAR_SHARED", "-fPIC", "-shared", *includes(folder), *sources(), "-lm"]


def seal(path: Path) -> None:
    """Append its hash to a compiled library; the dynamic loader ignores trailing bytes."""
    digest = hashlib.sha256(path.read_bytes()).digest()
    with path.open("ab") as file:
        file.write(digest)
