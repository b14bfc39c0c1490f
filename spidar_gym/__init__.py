"""SPIDAR in simulation: Gymnasium environments whose zero action is the paper's controller.

Importing this package registers the environments: `gymnasium.make("spidar_gym/Hover-v0")`; a process that has not
imported it does so by `gymnasium.make("spidar_gym:spidar_gym/Hover-v0")`.
"""

import importlib
import importlib.util
import sys
from collections.abc import Iterable
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType

__version__ = "0.1.0"


class _Registration(MetaPathFinder):
    """Registers the environments as soon as there is Gymnasium: who allocates thrust on a robot never imports it."""

    def find_spec(
        self, fullname: str, path: Iterable[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Have the environments registered once Gymnasium is imported; whoever else looks finds nothing here."""
        if fullname != "gymnasium":
            return None
        sys.meta_path.remove(self)
        spec = importlib.util.find_spec(fullname)
        if spec is not None and spec.loader is not None:
            execute = spec.loader.exec_module

            def execute_and_register(module: ModuleType) -> None:
                execute(module)
                _register()

            spec.loader.exec_module = execute_and_register
        return spec


def _register() -> None:
    importlib.import_module("spidar_gym.envs.registry")


if "gymnasium" in sys.modules:
    _register()
else:
    sys.meta_path.insert(0, _Registration())
