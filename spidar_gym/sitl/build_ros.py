"""The runner with the mode `ros1`, compiled from an exported folder against the ROS 1 of this machine."""

import shutil
import subprocess
import tempfile
from pathlib import Path

from spidar_gym.deploy.export import FLAGS, compiler
from spidar_gym.errors import MissingDependencyError, SpidarError
from spidar_gym.files import output_folder

GENERATOR = "lib/gencpp/gen_cpp.py"
TEMPLATES = "share/gencpp"
INSTALL = "apt-get install libroscpp-dev libsensor-msgs-dev libnav-msgs-dev python3-gencpp pkg-config g++ (Debian 12)"
WARNINGS = ("-Wall", "-Wextra")


def build_ros_runner(folder: Path, out: Path) -> Path:
    """Compile an exported folder; the runner's path.

    Args:
        folder: What `spidar export` wrote.
        out: File to write.

    Raises:
        MissingDependencyError: Without a compiler or ROS 1.
        SpidarError: When it does not compile; with the compiler's first words.
    """
    libraries = _pkg_config("--cflags", "--libs", "roscpp")
    folder = folder.resolve()
    out = output_folder(out.resolve().parent) / out.name
    includes = [f"-I{folder / part}" for part in ("core", "osqp", "generated", "runner")]
    with tempfile.TemporaryDirectory() as scratch:
        objects = []
        for part in ("core", "osqp", "runner"):  # a folder for each: their files may have the same names
            place = Path(scratch) / part
            place.mkdir()
            sources = [str(source) for source in sorted((folder / part).glob("*.c"))]
            _run([compiler(), *FLAGS, "-DSPIDAR_ROS1", *includes, "-c", *sources], place)
            objects += [str(path) for path in sorted(place.glob("*.o"))]
        headers = message_headers(folder / "msg", Path(scratch) / "spinal")
        link = [f"-isystem{headers}", str(folder / "runner" / "ros1.cpp"), *objects, *libraries, "-lm"]
        made = Path(scratch) / "runner-ros1"
        _run([_plus_plus(), "-O2", *WARNINGS, "-DSPIDAR_ROS1", *includes, *link, "-o", str(made)], Path(scratch))
        partial = out.with_name(f".{out.name}.part")
        shutil.copy2(made, partial)
        partial.replace(out)
    return out


def message_headers(messages: Path, folder: Path) -> Path:
    """C++ headers of the package `spinal` from its .msg files; the folder to include."""
    prefix = Path(_pkg_config("--variable=prefix", "roscpp")[0])
    generator = prefix / GENERATOR
    if not generator.is_file():
        raise MissingDependencyError(f"gencpp ({generator})", INSTALL)
    (folder / "spinal").mkdir(parents=True)
    for message in sorted(messages.glob("*.msg")):
        # The system's Python: a virtual environment does not know genmsg.
        command = ["/usr/bin/python3", str(generator), str(message), "-p", "spinal", "-o", str(folder / "spinal")]
        _run([*command, "-e", str(prefix / TEMPLATES), "-I", f"spinal:{messages}"], folder)
    return folder


def _plus_plus() -> str:
    found = shutil.which("g++") or shutil.which("clang++")
    if not found:
        raise MissingDependencyError("a C++ compiler", INSTALL)
    return found


def _pkg_config(*words: str) -> list[str]:
    """What pkg-config answers, word by word."""
    tool = shutil.which("pkg-config")
    done = subprocess.run([tool, *words], capture_output=True, text=True, check=False) if tool else None
    if done is None or done.returncode != 0:
        raise MissingDependencyError("roscpp", INSTALL)
    return done.stdout.split()


def _run(command: list[str], place: Path) -> None:
    done = subprocess.run(command, cwd=place, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        words = " ".join(done.stderr.split())
        at = max(words.find("error"), 0)
        raise SpidarError(f"the runner does not compile: {words[at:][:300]}; valid: ROS 1 and C99 and C++11 compilers")
