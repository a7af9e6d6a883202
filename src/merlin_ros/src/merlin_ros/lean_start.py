"""Starts a node without what it does not use: a third sooner, and up to 20 MB smaller.

Importing one message imports every message of its package and of the packages those mention, and `genpy`
imports numpy for the names of its number types. Both are put off here until something asks for them.
"""

import importlib
import re
import sys
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec, PathFinder
from pathlib import Path
from types import ModuleType
from typing import Any, Dict, Optional, Sequence

_IMPORT = re.compile(r"from \._(\w+) import \*")


def run(module: str, function: str = "main", *args: Any) -> None:
    """Prepares the process, imports a module and ends the process with what its function returns.

    :param module: absolute name; whatever it imports must not have been imported before.
    """
    importlib.import_module("merlin_ros.early_end")  # SIGINT ends the process while it imports the rest
    prepare()
    sys.exit(getattr(importlib.import_module(module), function)(*args))


def prepare() -> None:
    """Makes later imports lean; to be called before anything of ROS is imported, once or more often."""
    if any(isinstance(finder, LazyMessages) for finder in sys.meta_path):
        return
    sys.meta_path.insert(0, LazyMessages())
    if "numpy" not in sys.modules and "genpy" not in sys.modules:
        # genpy can do without: it knows fewer types of numbers when it says what is wrong with a message.
        sys.modules["numpy"] = None  # type: ignore[assignment]
        try:
            importlib.import_module("genpy")
        finally:
            del sys.modules["numpy"]


class LazyMessages(MetaPathFinder, Loader):
    """Finds generated packages ``x.msg`` and ``x.srv``, and imports a message when it is first asked for."""

    def find_spec(
        self, fullname: str, path: Optional[Sequence[str]] = None, target: Optional[ModuleType] = None
    ) -> Optional[ModuleSpec]:
        """The package, if its ``__init__`` does nothing but import its messages."""
        if path is None or fullname.count(".") != 1 or not fullname.endswith((".msg", ".srv")):
            return None
        spec = PathFinder.find_spec(fullname, path)
        if spec is None or spec.origin is None or not spec.submodule_search_locations:
            return None
        modules = _generated(Path(spec.origin))
        if not modules:
            return None
        spec.loader, spec.loader_state = self, modules
        return spec

    def exec_module(self, module: ModuleType) -> None:
        """Fills the package."""
        assert module.__spec__ is not None
        modules: Dict[str, str] = module.__spec__.loader_state

        def find(name: str) -> Any:
            if name == "__all__":  # for an import of everything
                return list(modules)
            if name not in modules:
                raise AttributeError(f"module '{module.__name__}' has no attribute '{name}'")
            found = getattr(importlib.import_module(modules[name]), name)
            setattr(module, name, found)
            return found

        module.__getattr__ = find  # type: ignore[method-assign]
        module.__dir__ = lambda: [*vars(module), *modules]  # type: ignore[method-assign]

    def create_module(self, spec: ModuleSpec) -> None:
        """The usual kind of module."""


def _generated(init: Path) -> Dict[str, str]:
    """Class -> module, of what catkin has generated; nothing for what was written by hand."""
    try:
        lines = init.read_text().split("\n")
    except (OSError, UnicodeDecodeError):
        return {}
    found: Dict[str, str] = {}
    package, kind = init.parent.parent.name, init.parent.name
    for line in filter(None, map(str.strip, lines)):
        match = _IMPORT.fullmatch(line)
        if match is None:
            return {}
        name = match.group(1)
        endings = ("", "Request", "Response") if kind == "srv" else ("",)
        found.update({f"{name}{ending}": f"{package}.{kind}._{name}" for ending in endings})
    return found
