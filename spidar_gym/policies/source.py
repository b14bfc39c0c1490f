"""Where a policy's name leads: the file that would run, found without running any, and whether it is our own."""

import importlib
import importlib.util
import sys
from importlib.machinery import ModuleSpec, PathFinder
from pathlib import Path
from types import ModuleType

from spidar_gym.committed import BASELINES, LEARNED, PACKAGE, ROOT, artifact_patterns, committed
from spidar_gym.errors import InvalidValueError, SpidarError

ARTIFACT = ".npz"
"""A policy whose name ends like this is the artifact of a learned one: numbers and JSON, no code."""
ZIP = ".zip"
"""A policy whose name ends like this is a model that Stable-Baselines3 saved, with pickles, which are code."""


class PolicyError(SpidarError):
    """A policy that is not found, raised, took too long, or answered with something that is no action."""


def module_of(spec: str) -> tuple[str, str]:
    """Module and class of a specification `module:Class`."""
    return split_name("policy", spec, f"module:Class, or the path of an artifact *{ARTIFACT} or of a model *{ZIP}")


def split_name(what: str, name: str, valid: str = "module:Class") -> tuple[str, str]:
    """Module and class of `module:Class`, the name of `what` (`InvalidValueError` for anything else)."""
    module, _, own = name.partition(":")
    if not all(part.isidentifier() for part in (*module.split("."), own)):
        raise InvalidValueError(what, name, valid)
    return module, own


def is_own(spec: str) -> bool:
    """Whether nothing but our own code runs for it: the package's, a committed baseline's, or none, for an artifact."""
    if spec.endswith(ZIP):
        return False
    return spec.endswith(ARTIFACT) or _home(module_of(spec)[0].split(".")[0]) is not None


def _home(package: str) -> Path | None:
    """Folder that a package of our own lies in; None for one of anybody else."""
    if package == PACKAGE.name:
        return PACKAGE.parent
    ours = (ROOT / "assets").is_dir() and (ROOT / BASELINES / "__init__.py").is_file()
    return ROOT if package == BASELINES and ours else None


def artifact_file(path: Path) -> Path:
    """The file of an artifact: that of the working folder, or else the committed one of that name.

    Raises:
        PolicyError: For a name of a committed one that there is not.
    """
    found = committed(path)
    if found.parts[:2] == tuple(LEARNED.split("/")) and not found.exists():
        raise PolicyError(f"policy {path}: no such artifact is committed; valid: {', '.join(artifact_patterns())}")
    return found


def source_file(spec: str) -> Path:
    """The file that a policy comes from; nothing of it, and of the packages that it lies in, is run.

    Raises:
        PolicyError: When there is none.
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
    """A module and the packages that it lies in, the outermost first, found without importing any.

    Our own are taken from where they lie (`spidar_gym.committed`), whatever folder one works in has the same name;
    others from the working folder first, then from where Python looks.

    Raises:
        PolicyError: When there is none.
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
    """A top-level module that only an import hook finds, as those of some editable installations."""
    try:
        return importlib.util.find_spec(name)
    except (ImportError, ValueError):
        return None


def load_module(name: str) -> ModuleType:
    """Import a module from just the file that `source_file` names.

    Where it lies in the working folder, that folder is looked through from then on, as Python does for a script.

    Raises:
        PolicyError: When there is none, or another one of that name has been imported before.
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
