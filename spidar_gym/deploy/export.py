"""`spidar export`: the onboard core as a folder that compiles with nothing installed, the same bytes every time."""

import hashlib
import json
import os
import shutil
import subprocess
import tempfile
from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path
from types import MappingProxyType

import spidar_gym
from spidar_gym.benchmark.artifact import read_artifact
from spidar_gym.control.core import core_path
from spidar_gym.control.layout import CORE
from spidar_gym.control.structs import interface_hash, structs_header
from spidar_gym.deploy.golden import golden_files
from spidar_gym.deploy.header import model_header, presets_header
from spidar_gym.deploy.policy import RATE, policy_header
from spidar_gym.deploy.solvers import generate_solvers
from spidar_gym.errors import MissingDependencyError, SpidarError
from spidar_gym.files import output_folder

ONBOARD = CORE.parent
"""Sources of everything that runs on the robot."""
PARTS = {"core": "*.[ch]", "runner": "*.[ch]*", "msg": "*.msg"}
"""Folders of hand-written sources, and which of their files."""
NOTHING: Mapping[str, bytes] = MappingProxyType({})
"""No further files."""
PAGES = ("CMakeLists.txt", "package.xml", "README.md")
"""Files beside them."""
FLAGS = ("-std=c99", "-O2", "-ffp-contract=off")
"""Compiler flags: without contraction every machine rounds alike."""


def export_files(
    *, golden: bool = True, residual: Path | None = None, rate: float = RATE, extra: Mapping[str, bytes] = NOTHING
) -> dict[str, bytes]:
    """Path → content of the exported folder, the same at every call.

    Args:
        golden: With recorded inputs and the reference's outputs.
        residual: Artifact of a learned policy that adds to the controller.
        rate: Largest change of every entry of its action in a second [1/s].
        extra: Further files that are to lie in the folder.

    Raises:
        SpidarError: For an artifact that cannot be read, or that adds to no controller.
    """
    files: dict[str, bytes] = dict(extra)
    artifact, origin = None, None
    if residual is not None:
        artifact = read_artifact(residual)
        origin = {
            "name": artifact.name,
            "sha256": hashlib.sha256(residual.read_bytes()).hexdigest(),
            "env_id": artifact.env_id,
            "arguments": dict(artifact.arguments),
            "rate": rate,
        }
    files["generated/spidar_policy.h"] = policy_header(artifact, rate).encode()
    for part, pattern in PARTS.items():
        for source in sorted((ONBOARD / part).glob(pattern)):
            files[f"{part}/{source.name}"] = source.read_bytes()
    for name in PAGES:
        files[name] = (ONBOARD / name).read_bytes()
    files["generated/spidar_structs.h"] = structs_header().encode()
    files["generated/spidar_model.h"] = model_header().encode()
    files["generated/spidar_presets.h"] = presets_header().encode()
    files |= {f"osqp/{name}": text.encode() for name, text in generate_solvers().items()}
    if golden:
        files |= golden_files()
    manifest = {
        "interface": interface_hash(),
        "versions": {
            "spidar-gym": spidar_gym.__version__,
            **{name: version(name) for name in ("osqp", "pin", "numpy")},
        },
        "residual": origin,
        "sha256": {name: hashlib.sha256(data).hexdigest() for name, data in sorted(files.items())},
    }
    files["MANIFEST.json"] = (json.dumps(manifest, indent=1) + "\n").encode()
    return files


def export(
    folder: Path, *, residual: Path | None = None, rate: float = RATE, extra: Mapping[str, bytes] = NOTHING
) -> list[str]:
    """Write the folder, whole or not at all; the names of its files (`SpidarError` where something else is there).

    `residual`, `rate` and `extra` are as for `export_files`.
    """
    if folder.exists() and any(folder.iterdir()) and not (folder / "MANIFEST.json").is_file():
        raise SpidarError(f"{folder} holds something else; valid: a new or empty folder, or one exported before")
    files = export_files(residual=residual, rate=rate, extra=extra)
    parent = output_folder(folder.resolve().parent)
    with tempfile.TemporaryDirectory(dir=parent, prefix=f".{folder.name}.") as scratch:
        made = Path(scratch) / "made"
        write_files(files, made)
        if folder.exists():
            os.replace(folder, Path(scratch) / "old")
        os.replace(made, folder)
    return sorted(files)


def write_files(files: dict[str, bytes], folder: Path) -> None:
    """Write path → content under a folder."""
    for name, data in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)


def compiler() -> str:
    """A C compiler (`MissingDependencyError` when there is none)."""
    found = os.environ.get("CC") or shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
    if not found:
        raise MissingDependencyError("a C compiler", "apt-get install gcc")
    return found


def build(path: Path | None = None, *, residual: Path | None = None, rate: float = RATE) -> Path:
    """Compile the core as a shared library for `control="core"`; where it lies.

    `residual`, `rate` and `extra` are as for `export_files`.

    Raises:
        MissingDependencyError: Without a C compiler.
        SpidarError: When it does not compile; with the compiler's first words.
    """
    path = path or core_path()
    output_folder(path.parent)
    with tempfile.TemporaryDirectory() as scratch:
        folder, made = Path(scratch), path.with_name(f".{path.name}.{os.getpid()}")
        write_files(export_files(golden=False, residual=residual, rate=rate), folder)
        sources = [str(p) for part in ("core", "osqp") for p in sorted((folder / part).glob("*.c"))]
        includes = [f"-I{folder / part}" for part in ("core", "osqp", "generated")]
        command = [
            compiler(),
            *FLAGS,
            "-DSPIDAR_SHARED",
            "-fPIC",
            "-shared",
            *includes,
            *sources,
            "-lm",
            "-o",
            str(made),
        ]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode != 0:
            made.unlink(missing_ok=True)
            raise SpidarError(f"the core does not compile: {done.stderr.strip()[:300]}; valid: a C99 compiler in CC")
        os.replace(made, path)
    return path
