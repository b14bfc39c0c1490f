"""Paths of committed files: beside the package in a checkout, inside the package in an installed wheel."""

from pathlib import Path

PACKAGE = Path(__file__).resolve().parent
"""Folder of the package."""
ROOT = PACKAGE if (PACKAGE / "assets").is_dir() else PACKAGE.parent
"""Folder that contains `assets` and `baselines`."""
BASELINES = "baselines"
"""Folder of committed policies, their artifacts and rows; also the name of the package of its modules."""
LEARNED = f"{BASELINES}/learned"
"""Folder of the committed artifacts, with one folder per policy and one file per training run."""


def committed(path: Path) -> Path:
    """Resolve a path: if it does not exist and begins with `baselines/`, return the committed file of that name."""
    if path.exists() or path.parts[:1] != (BASELINES,):
        return path
    found = ROOT / path
    return found if found.exists() else path


def committed_artifacts() -> list[str]:
    """Return the paths of the committed artifacts as every command accepts them, in a checkout and elsewhere."""
    return sorted(str(path.relative_to(ROOT)) for path in (ROOT / LEARNED).glob("*/*.npz"))


def artifact_patterns() -> list[str]:
    """Return the paths of the committed artifacts with one pattern for all runs of a policy, for messages."""
    return list(dict.fromkeys(str(Path(name).with_name("seed*.npz")) for name in committed_artifacts()))
