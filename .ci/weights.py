"""Size and import time of a package and its dependencies; run by the Python in which it is installed."""

import json
import re
import subprocess
import sys
from importlib.metadata import Distribution, distribution, distributions
from pathlib import Path
from statistics import median

MODULES = {"pin": "pinocchio", "scipy": "scipy.linalg, scipy.sparse", "spidar-gym": "gymnasium, spidar_gym"}
"""Modules to import, where they differ from the package's name; ours registers environments with Gymnasium."""
TIMED = "import time{first}; start = time.process_time(); import {module}; print(time.process_time() - start)"


def plain(name: str) -> str:
    """Normalise a package's name as package indexes do."""
    return re.sub(r"[-_.]+", "-", name).lower()


def needed(found: Distribution) -> list[str]:
    """Return the names of the packages that a package requires, without those of its extras."""
    lines = [line for line in found.requires or [] if "extra ==" not in line]
    return [plain(re.match(r"[\w.-]+", line)[0]) for line in lines]  # pyright: ignore[reportOptionalSubscript]


def weight(found: Distribution) -> float:
    """Return the size of a package's files [MB]."""
    paths = (Path(str(file.locate())) for file in found.files or [])
    return sum(path.stat().st_size for path in paths if path.is_file() and not path.is_symlink()) / 1e6


def import_time(name: str) -> float:
    """Return the median CPU time of five imports of a package [ms], without NumPy, which all of them import."""
    first = "" if name == "numpy" else ", numpy"
    code = TIMED.format(first=first, module=MODULES.get(name, name.replace("-", "_")))
    command = [sys.executable, "-c", code]
    return 1e3 * median(float(subprocess.run(command, capture_output=True, check=True).stdout) for _ in range(5))


def closure(name: str, there: dict[str, Distribution], others: set[str]) -> set[str]:
    """Return a package and its transitive dependencies, without the packages in `others`."""
    found, new = set[str](), {name}
    while new:
        found |= new
        new = {n for k in new for n in needed(there[k]) if n in there} - found - others
    return found


def table(name: str) -> list[list[str]]:
    """Return the lines of a table, the largest first: package, its dependencies, MB, ms."""
    there = {plain(found.metadata["Name"]): found for found in distributions()}
    direct = {n for n in needed(distribution(name)) if n in there}
    parts = {n: closure(n, there, direct - {n}) for n in direct} | {plain(name): {plain(name)}}
    megabytes = {n: sum(weight(there[part]) for part in own) for n, own in parts.items()}
    lines = [["package", "brings", "installed", "imported in"]]
    for n in sorted(parts, key=lambda n: -megabytes[n]):
        brings = ", ".join(sorted(parts[n] - {n})) or "–"
        lines.append([f"`{n}`", brings, f"{megabytes[n]:.1f} MB", f"{import_time(n):.0f} ms"])
    whole = set[str]().union(*parts.values())
    return [*lines, ["all of it", "", f"{sum(weight(there[n]) for n in whole):.0f} MB", ""]]


if __name__ == "__main__":
    print(json.dumps(table(sys.argv[1])))
