"""SPIDAR in simulation: Gymnasium environments whose zero action is the paper's controller.

Importing this package registers the environments: `gymnasium.make("spidar_gym/Hover-v0")`. In a process that has not
imported the package, `gymnasium.make("spidar_gym:spidar_gym/Hover-v0")` imports it first.
"""

import copy
import importlib
import sys
from collections.abc import Iterable
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType

__version__ = "0.1.0"


class _Registration(MetaPathFinder):
    """Import hook that registers the environments when Gymnasium is imported, so that spidar_gym does not import it."""

    def find_spec(
        self, fullname: str, _path: Iterable[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Return Gymnasium's specification, with a loader that also registers the environments when it executes."""
        finders = [*sys.meta_path]
        if fullname != "gymnasium" or self not in finders:
            return None
        # The finders after this one; a reload of this package may have left another `_Registration` among them.
        found = (finder.find_spec(fullname, None, target) for finder in finders[finders.index(self) + 1 :])
        spec = next(filter(None, found), None)
        if spec is not None and spec.loader is not None:
            loader = spec.loader = copy.copy(spec.loader)  # a zip file has one loader for all of its modules
            execute = loader.exec_module

            def execute_and_register(module: ModuleType) -> None:
                execute(module)
                if self in sys.meta_path:
                    sys.meta_path.remove(self)
                _register()

            loader.exec_module = execute_and_register
        return spec


def _register() -> None:
    importlib.import_module("spidar_gym.envs.registry")


if "gymnasium" in sys.modules:
    _register()
else:
    sys.meta_path.insert(0, _Registration())
