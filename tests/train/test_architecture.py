"""Pins the structure of `train/`: recipes on top of a library, no import cycles, documented and short files."""

import ast
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

TRAIN = Path(__file__).resolve().parents[2] / "train"
FILES = {".".join(path.relative_to(TRAIN.parent).with_suffix("").parts): path for path in sorted(TRAIN.rglob("*.py"))}


LEARNING = {"train.lib.agent", "train.lib.symmetry", "train.lib.taught", "train.lib.vector"}
"""Modules that import torch or Stable-Baselines3 at their top level."""
FRAMEWORKS = {"torch", "stable_baselines3", "tensorboard", "ray"}


def imported(path, *packages):
    """Yield the modules of packages that a file imports, and whether the import is inside a function or condition."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module:
            names = [f"{node.module}.{alias.name}" for alias in node.names]
            names = [name for name in names if name in FILES] or [node.module]
        else:
            continue
        for name in names:
            if name.split(".")[0] in packages:
                yield name, node not in tree.body


def test_imports_have_no_cycles_and_the_library_imports_no_recipe():
    graph = {name: {module for module, _ in imported(path, "train")} for name, path in FILES.items()}
    assert graph["train.presets"] == {"train.residual"}
    TopologicalSorter(graph).prepare()  # raises for a cycle
    for name, modules in graph.items():
        if name.startswith("train.lib."):
            assert all(module.startswith("train.lib.") for module in modules), name


@pytest.mark.parametrize("name", FILES)
def test_every_file_is_documented_short_and_imports_at_the_top_level(name):
    text = FILES[name].read_text(encoding="utf-8")
    assert ast.get_docstring(ast.parse(text))
    assert len(text.splitlines()) <= 420
    assert {module for module, inside in imported(FILES[name], "train") if inside} <= LEARNING


@pytest.mark.parametrize("name", FILES)
def test_frameworks_are_imported_only_when_a_run_starts(name):
    loaded = {module for module, inside in imported(FILES[name], "train", *FRAMEWORKS) if not inside}
    assert name in LEARNING or not LEARNING & loaded
    assert name in LEARNING or not {module.split(".")[0] for module in loaded} & FRAMEWORKS
