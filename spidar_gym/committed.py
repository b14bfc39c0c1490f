"""Where what is committed lies: beside the package in a checkout, in the package where a wheel was installed."""

from pathlib import Path

PACKAGE = Path(__file__).resolve().parent
"""Folder of the package."""
ROOT = PACKAGE if (PACKAGE / "assets").is_dir() else PACKAGE.parent
"""Folder that `assets` and `baselines` lie in."""
BASELINES = "baselines"
"""Folder of committed policies, their artifacts and rows, and the package that its modules are in."""
LEARNED = f"{BASELINES}/learned"
"""Folder of the committed artifacts, a folder a policy, a file a training run."""


def committed(path: Path) -> Path:
    """What a path leads to: the working folder first, then, for `baselines/…`, what is committed; else as it is."""
    if path.exists() or path.parts[:1] != (BASELINES,):
        return path
    found = ROOT / path
    return found if found.exists() else path


def committed_artifacts() -> list[str]:
    """The paths by which every command knows the committed artifacts, in a checkout and anywhere else."""
    return sorted(str(path.relative_to(ROOT)) for path in (ROOT / LEARNED).glob("*/*.npz"))


def artifact_patterns() -> list[str]:
    """The same, the runs of a policy as one pattern, for people to read."""
    return list(dict.fromkeys(str(Path(name).with_name("seed*.npz")) for name in committed_artifacts()))
