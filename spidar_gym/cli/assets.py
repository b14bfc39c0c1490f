"""`spidar assets`: write all generated files and compile the library."""

from pathlib import Path

from spidar_gym.arguments import Flag
from spidar_gym.errors import InvalidValueError, MissingDependencyError, StaleAssetError
from spidar_gym.files import refresh, whole_file
from spidar_gym.native.codegen.committed import OSQP, committed_files, leftovers, other_osqp
from spidar_gym.native.compiler import compile_library
from spidar_gym.native.library import BUILD, core_path, load_core
from spidar_gym.native.recipe import GENERATED
from spidar_gym.onboard.policy import policy_header
from spidar_gym.robot import RobotSpec
from spidar_gym.robot.description import assets_dir, generated_files, robot_files


def assets(check: Flag = False, robot: Path | None = None, out: Path | None = None) -> None:
    """Write the generated files (MJCF, URDF, tables, C) and compile the C library.

    Args:
        check: Write nothing; fail if a committed file or the compiled library is stale.
        robot: TOML file of a custom robot; only its MJCF and URDF are written, into the folder --out.
        out: Folder for the MJCF and URDF of --robot.
    """
    if (robot is None) != (out is None) or (robot is not None and check):
        raise InvalidValueError(
            "robot, out, check", (robot, out, check), "--robot FILE and --out FOLDER together, alone"
        )
    if robot is not None and out is not None:
        files = robot_files(RobotSpec.parse(robot))
        for name, text in files.items():
            with whole_file(out / name) as path:
                path.write_text(text, encoding="utf-8")
        print(f"{', '.join(files)} in {out}")
        return
    root = assets_dir()
    files = {root / name: text for name, text in generated_files().items()}
    written = refresh(files, BUILD, check=check)  # first, since the C sources are generated from the MJCF
    native = committed_files() | {"spidar_policy.h": policy_header(None)}
    old = leftovers(native)
    if check and old:
        raise StaleAssetError(old[0], BUILD, "is not generated any more")
    for path in old:
        path.unlink()
    other = other_osqp() if check else ""
    sources = {GENERATED / n: text for n, text in native.items() if not (other and n.startswith(f"{OSQP}/"))}
    written += refresh(sources, BUILD, check=check)
    total = len(files) + len(sources)
    if check:
        load_core()
        print(f"{total} generated files and the compiled library are up to date in {root}")
        if other:
            print(other)
        return
    print(f"{written} of {total} files written in {root.parent}")
    try:
        load_core()
    except (MissingDependencyError, StaleAssetError):
        print(f"compiled: {compile_library(core_path())}")
