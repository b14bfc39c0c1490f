"""Compile the runner with the mode `ros1` from an exported folder, against the ROS 1 of this machine."""

import shutil
import subprocess
from pathlib import Path

from spidar_gym.errors import MissingDependencyError
from spidar_gym.files import output_folder, scratch_folder
from spidar_gym.native.compiler import compiler, run_tool
from spidar_gym.native.recipe import FLAGS
from spidar_gym.onboard.build import PARTS

GENERATOR = "lib/gencpp/gen_cpp.py"
TEMPLATES = "share/gencpp"
INSTALL = "apt-get install libroscpp-dev libsensor-msgs-dev libnav-msgs-dev python3-gencpp pkg-config g++ (Debian 12)"
WARNINGS = ("-Wall", "-Wextra")
RUNNER = "the runner for ROS 1"


def build_ros_runner(folder: Path, out: Path) -> Path:
    """Compile an exported folder; return the runner's path.

    Args:
        folder: Folder that `spidar export` wrote.
        out: File to write.

    Raises:
        MissingDependencyError: Without a compiler or ROS 1.
        SpidarError: When the folder does not compile; with the compiler's messages.
    """
    libraries = _pkg_config("--cflags", "--libs", "roscpp")
    folder = folder.resolve()
    out = output_folder(out.resolve().parent) / out.name
    includes = [f"-I{folder / part}" for part in (*PARTS, "generated")]
    sources = [str(source) for part in PARTS for source in sorted((folder / part).glob("*.c"))]
    with scratch_folder() as scratch:
        own = ["-DSPIDAR_ROS1", *includes]
        plain, headers = str(scratch / "plain.o"), message_headers(folder / "msg", scratch / "spinal")
        run_tool([*compiler(), *FLAGS, *own, "-r", "-nostdlib", *sources, "-o", plain], RUNNER)
        link = [f"-isystem{headers}", str(folder / "runner" / "ros1.cpp"), plain, *libraries, "-lm"]
        run_tool([_plus_plus(), "-O2", *WARNINGS, *own, *link, "-o", str(out)], RUNNER)
    return out


def message_headers(messages: Path, folder: Path) -> Path:
    """Generate the C++ headers of the package `spinal` from its .msg files; return the folder to include."""
    prefix = Path(_pkg_config("--variable=prefix", "roscpp")[0])
    generator = prefix / GENERATOR
    if not generator.is_file():
        raise MissingDependencyError(f"gencpp ({generator})", INSTALL)
    (folder / "spinal").mkdir(parents=True)
    for message in sorted(messages.glob("*.msg")):
        # The system's Python, because a virtual environment has no genmsg.
        command = ["/usr/bin/python3", str(generator), str(message), "-p", "spinal", "-o", str(folder / "spinal")]
        run_tool([*command, "-e", str(prefix / TEMPLATES), "-I", f"spinal:{messages}"], RUNNER, folder)
    return folder


def _plus_plus() -> str:
    found = shutil.which("g++") or shutil.which("clang++")
    if not found:
        raise MissingDependencyError("a C++ compiler", INSTALL)
    return found


def _pkg_config(*words: str) -> list[str]:
    """Return the output of pkg-config, split into words."""
    tool = shutil.which("pkg-config")
    done = subprocess.run([tool, *words], capture_output=True, text=True, check=False) if tool else None
    if done is None or done.returncode != 0:
        raise MissingDependencyError("roscpp", INSTALL)
    return done.stdout.split()
