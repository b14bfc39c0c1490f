"""How the library is made: its sources, flags, compilers and digest. The build hook has only the standard library."""

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
"""Folder of everything that is compiled."""
LIBRARY = "libspidar" + {"darwin": ".dylib", "win32": ".dll"}.get(sys.platform, ".so")
"""Name of the compiled library, which lies in that folder."""
GENERATED = NATIVE / "generated"
"""The committed C that `spidar assets` generates: headers, and OSQP's solvers in a folder of their own."""
SOURCES = (NATIVE / "core", NATIVE / "engine", GENERATED / "osqp")
"""Folders of C sources; one that is not there has none."""
SHARED_HEADERS = (
    "spidar_constants.h", "spidar_structs.h", "spidar_modes.h", "spidar_engine_structs.h", "spidar_ziggurat.h",
)  # fmt: skip
"""Generated headers with what Python and C have to agree on."""
FLAGS = ("-std=c99", "-O2", "-ffp-contract=off")
"""Compiler flags of what goes to the robot: without contraction every machine rounds alike."""
LIBRARY_FLAGS = ("-std=c99", "-O3", "-ffp-contract=off")
"""Those of the library that simulates: the same bits, a fifth of the time less."""
ZIG = "ziglang>=0.13"
"""What `pip` installs where there is no other compiler: a wheel that has clang, headers and libraries with it."""
SEAL = hashlib.sha256().digest_size
"""Bytes at the end of a compiled library: the hash of those before."""


def find_compiler() -> list[str]:
    """Words that call a C compiler: CC with its arguments, cc, gcc or clang, or ziglang's; none if there is none.

    Raises:
        ValueError: When CC is no command.
    """
    given = os.environ.get("CC", "").strip()
    if given:
        try:
            words = shlex.split(given)
        except ValueError:  # a quotation that does not end
            words = []
        if not words or not shutil.which(words[0]):
            raise ValueError(given)
        return words
    found = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
    if found:
        return [found]
    if not importlib.util.find_spec("ziglang"):
        return []
    # With a target it compiles for every processor of the kind and for an old glibc, without one for this machine only.
    target = ["-target", f"{platform.machine()}-linux-gnu.2.17"] if sys.platform == "linux" else ["-mcpu=baseline"]
    return [sys.executable, "-m", "ziglang", "cc", *target]


def source_bytes(path: Path) -> bytes:
    """Content of a text file that goes into a digest: with LF as the end of lines, whatever ends them on this disk."""
    return path.read_bytes().replace(b"\r\n", b"\n")


def library_digest(headers: Mapping[str, bytes] | None = None) -> str:
    """Digest of what a library is compiled from; it says its own when `sp_interface` is asked.

    Args:
        headers: `SHARED_HEADERS` with their texts; the committed ones by default.
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
    """spidar_interface.h: what a compiled core answers when it is asked what it was made for."""
    return f'/* Generated: what this was compiled from. */\n#define SP_INTERFACE "{digest}"\n'


def sources() -> list[str]:
    """The library's C sources."""
    return [str(path) for folder in SOURCES for path in sorted(folder.glob("*.c"))]


def includes(folder: Path) -> list[str]:
    """Words that tell a compiler where the library's headers are; `folder` comes first."""
    return [f"-I{place}" for place in (folder, GENERATED, *SOURCES)]


def compile_words(folder: Path) -> list[str]:
    """Words that tell a compiler to make the library, its headers searched in `folder` first, but for its output."""
    return [*LIBRARY_FLAGS, "-g0", "-DSPIDAR_SHARED", "-fPIC", "-shared", *includes(folder), *sources(), "-lm"]


def seal(path: Path) -> None:
    """Append its hash to a compiled library; a loader of libraries does not look behind what it loads."""
    digest = hashlib.sha256(path.read_bytes()).digest()
    with path.open("ab") as file:
        file.write(digest)
