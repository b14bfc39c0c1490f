"""`spidar assets`: everything that is generated, and the library that is compiled from it."""

from spidar_gym.cli.arguments import Flag
from spidar_gym.envs.docs import pages
from spidar_gym.errors import MissingDependencyError, StaleAssetError
from spidar_gym.files import refresh
from spidar_gym.native.codegen.committed import OSQP, committed_files, leftovers, other_osqp
from spidar_gym.native.compiler import compile_library
from spidar_gym.native.library import BUILD, core_path, load_core
from spidar_gym.native.recipe import GENERATED
from spidar_gym.onboard.policy import policy_header
from spidar_gym.robot.description import assets_dir, generated_files


def assets(check: Flag = False) -> None:
    """Write the generated files: MJCF, URDF, tables, C, in a checkout the environments' pages; compile the library.

    Args:
        check: Write nothing; fail when a committed file or the compiled library is stale.
    """
    root = assets_dir()
    files = {root / name: text for name, text in generated_files().items()}
    guide = root.parent / "docs"
    if (guide / "conf.py").is_file():  # an installed wheel has no guide
        files |= {guide / name: text for name, text in pages().items()}
    written = refresh(files, BUILD, check=check)  # first: what follows is generated from the MJCF
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
