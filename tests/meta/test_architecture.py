"""Pins the architecture: imports of the package, the docstrings of its files, and its random generators."""

import ast
import subprocess
import sys
from pathlib import Path

import spidar_gym

PACKAGE = Path(spidar_gym.__file__).parent
MODULES = sorted(PACKAGE.rglob("*.py"))


def test_the_package_imports_without_learning_frameworks_and_without_drawing_anything():
    heavy = ("torch", "stable_baselines3", "matplotlib", "tyro")
    code = f"import spidar_gym.envs.env, sys; print([m for m in {heavy} if m in sys.modules])"
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert result.stdout.strip() == "[]"


def test_every_module_states_its_purpose_in_its_first_line_and_every_docstring_stands_alone():
    """Docstrings become help texts and comments of the C header, where they have no context."""
    for path in MODULES:
        tree = ast.parse(path.read_text(encoding="utf-8"))
        docstring = ast.get_docstring(tree)
        assert docstring, path
        assert docstring.splitlines()[0].rstrip().endswith((".", ",", ";")) or len(docstring.splitlines()) > 1, path
        for node in ast.walk(tree):
            match node:
                case ast.Expr(value=ast.Constant(value=str(words))):
                    assert not words.lstrip().startswith(("…", "Of ")), (path, node.lineno)


def test_random_numbers_come_from_generators_that_are_passed_in():
    for path in MODULES:
        text = path.read_text(encoding="utf-8")
        assert "np.random.seed" not in text, path
        assert "import random" not in text, path
        if "default_rng(" in text:
            assert path.name == "bench.py", path  # the benchmark's states are fixed by their seed
