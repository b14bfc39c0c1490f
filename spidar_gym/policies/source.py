"""Resolution of a policy's name to its file, without running any code, and whether that code is the package's."""

import importlib
import importlib.util
import sys
from importlib.machinery import ModuleSpec, PathFinder
from pathlib import Path
from types import ModuleType

from spidar_gym.committed import BASELINES, LEARNED, PACKAGE, ROOT, artifact_patterns, committed
from spidar_gym.errors import InvalidValueError, SpidarError

ARTIFACT = ".npz"
"""Suffix of the artifact of a learned policy: numbers and JSON, no code."""
ZIP = ".zip"
"""Suffix of a model that Stable-Baselines3 saved, with pickles, which are code."""


class PolicyError(SpidarError):
    """A policy that is not found, raises an error, exceeds its time limit, or returns an invalid action."""


def module_of(spec: str) -> tuple[str, str]:
    """Return the module and the class of a specification `module:Class`."""
    return split_name("policy", spec, f"module:Class, or the path of an artifact *{ARTIFACT} or of a model *{ZIP}")


def split_name(what: str, name: str, valid: str = "module:Class") -> tuple[str, str]:
    """Return the module and the class of `module:Class`, the name of `what` (`InvalidValueError` for another form)."""
    module, _, own = name.partition(":")
    if not all(part.isidentifier() for part in (*module.split("."), own)):
        raise InvalidValueError(what, name, valid)
    return module, own


def is_own(spec: str) -> bool:
    """Return whether a policy runs only code of the package or a committed baseline, or none, as an artifact."""
    if spec.endswith(ZIP):
        return False
    return spec.endswith(ARTIFACT) or _home(module_of(spec)[0].split(".")[0]) is not None


def _home(package: str) -> Path | None:
    """Return the folder that contains a top-level package of this repository; None for other packages."""
    if package == PACKAGE.name:
        return PACKAGE.parent
    ours = (ROOT / "assets").is_dir() and (ROOT / BASELINES / "__init__.py").is_file()
    return ROOT if package == BASELINES and ours else None


def artifact_file(path: Path) -> Path:
    """Return the file of an artifact: that in the working folder, or else the committed one of that name.

    Raises:
        PolicyError: For the name of a committed artifact that does not exist.
    """
    found = committed(path)
    if found.parts[:2] == tuple(LEARNED.split("/")) and not found.exists():
        raise PolicyError(f"policy {path}: no such artifact is committed; valid: {', '.join(artifact_patterns())}")
    return found


def source_file(spec: str) -> Path:
    """Return the file of a policy, without running code of it or its packages.

    Raises:
        PolicyError: When there is no such file.
    """
    if spec.endswith(ARTIFACT):
        return artifact_file(Path(spec))
    if spec.endswith(ZIP):
        return Path(spec)
    origin = find_module(module_of(spec)[0])[-1].origin
    if origin is None:
        raise PolicyError(f"policy {spec}: a folder without code; valid: module:Class")
    return Path(origin)


def find_module(name: str) -> list[ModuleSpec]:
    """Find a module and its packages, the outermost first, without importing any.

    Packages of this repository are found at their own location (`spidar_gym.committed`), even if the working folder has
    a folder of the same name. Others are searched in the working folder first, then in Python's path.

    Raises:
        PolicyError: When there is no such module.
    """
    importlib.invalidate_caches()
    package = name.split(".")[0]
    home = _home(package)
    where: list[str] = [str(Path.cwd()), *sys.path] if home is None else [str(home)]
    chain: list[ModuleSpec] = []
    for k in range(1, name.count(".") + 2):
        part = ".".join(name.split(".")[:k])
        found = PathFinder.find_spec(part, where)
        if found is None and k == 1 and home is None:
            found = _hooked(part)
        if found is None:
            raise PolicyError(f"policy: No module named {part!r}; valid: module:Class, importable")
        chain.append(found)
        where = list(found.submodule_search_locations or [])
    return chain


def _hooked(name: str) -> ModuleSpec | None:
    """Find a top-level module by import hooks, as some editable installations need."""
    try:
        return importlib.util.find_spec(name)
    except (ImportError, ValueError):
        return None


def load_module(name: str) -> ModuleType:
    """Import a module from exactly the file that `source_file` returns.

    The folder of a module from outside this repository is added to `sys.path`, as Python does for a script.

    Raises:
        PolicyError: When there is no such module, or another one of that name is already imported.
    """
    chain = find_module(name)
    origin, package = chain[0].origin, chain[0].submodule_search_locations is not None
    if origin is not None and _home(chain[0].name) is None:
        folder = str(Path(origin).parents[1 if package else 0])
        if folder not in sys.path:
            sys.path.insert(0, folder)
    module, parent = None, None
    for spec in chain:
        module = _load(spec)
        if parent is not None:
            setattr(parent, spec.name.rpartition(".")[2], module)
        parent = module
    assert module is not None
    return module


def _load(spec: ModuleSpec) -> ModuleType:
    known = sys.modules.get(spec.name)
    if known is not None:
        origin = getattr(known.__spec__, "origin", None)
        if origin != spec.origin:
            raise PolicyError(f"policy: {spec.name} is loaded from {origin}, not {spec.origin}; valid: another name")
        return known
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    try:
        if spec.loader is not None:
            spec.loader.exec_module(module)
    except BaseException:
        sys.modules.pop(spec.name, None)
        raise
    return module
