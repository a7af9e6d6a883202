"""Starts a node without what it does not use: a third sooner, and up to 20 MB smaller.

Importing one message imports every message of its package and of the packages those mention, `genpy`
imports numpy for the names of its number types, and `roslib` imports catkin's search for files and with it
pyparsing and unittest: half of what rospy costs. All three are put off here until something asks for them.
"""

import atexit
import contextlib
import gc
import importlib
import os
import re
import sys
import threading
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec, PathFinder
from pathlib import Path
from types import ModuleType
from typing import Any, Dict, Optional, Sequence

_IMPORT = re.compile(r"from \._(\w+) import \*")


#: Nice value at which a node that can wait imports what it needs: a tenth of what others get.
PATIENT = 10


def run(module: str, function: str = "main", *args: Any, patient: bool = False) -> None:
    """Prepares the process, imports a module and ends the process with what its function returns.

    :param module: absolute name; whatever it imports must not have been imported before.
    :param patient: let the nodes that start at the same time go first.
    """
    importlib.import_module("merlin_ros.early_end")  # SIGINT ends the process while it imports the rest
    prepare()
    if patient:
        _import_patiently(module)
    sys.exit(getattr(importlib.import_module(module), function)(*args))


def _import_patiently(module: str) -> None:
    """Imports a module at a low priority.

    In a thread of its own: Linux keeps a nice value for each, and only root may lower the one of the process
    again. The import that follows raises what goes wrong.
    """

    def work() -> None:
        with contextlib.suppress(OSError):
            patient = max(PATIENT, os.getpriority(os.PRIO_PROCESS, 0))
            os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), patient)
        with contextlib.suppress(Exception):
            importlib.import_module(module)

    worker = threading.Thread(target=work, name="imports", daemon=True)
    worker.start()
    worker.join()


def prepare() -> None:
    """Makes later imports lean; to be called before anything of ROS is imported, once or more often."""
    if any(isinstance(finder, LazyMessages) for finder in sys.meta_path):
        return
    sys.meta_path[:0] = [LazyMessages(), LazySearch()]
    if "numpy" not in sys.modules and "genpy" not in sys.modules:
        # genpy can do without: it knows fewer types of numbers when it says what is wrong with a message.
        sys.modules["numpy"] = None  # type: ignore[assignment]
        try:
            importlib.import_module("genpy")
        finally:
            del sys.modules["numpy"]


def end_lightly() -> None:
    """Spares this process what it would compute for nothing when it ends.

    Python looks through all objects of a node several times before it lets go of them: 0.15 s of computing
    that a launch of 15 nodes pays 15 times, all at once. And the thread of an XML-RPC server, as roslaunch
    has one, ends with its server (`merlin_ros.ports.xmlrpc_port`): rosgraph's own would look at the closed
    socket again and again, at full speed, until the last of the launch's nodes has ended.
    """
    atexit.register(gc.freeze)
    from merlin_ros.ports.xmlrpc_port import use_entrance

    use_entrance()


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


class LazySearch(MetaPathFinder, Loader):
    """Finds catkin's search for files, and imports it when it is first called.

    `rospy` imports it for ``roslib.packages``, which few nodes use.
    """

    _MODULE, _FUNCTION = "catkin.find_in_workspaces", "find_in_workspaces"

    def find_spec(
        self, fullname: str, path: Optional[Sequence[str]] = None, target: Optional[ModuleType] = None
    ) -> Optional[ModuleSpec]:
        """The module; another loader has to have found it."""
        if fullname != self._MODULE or path is None:
            return None
        spec = PathFinder.find_spec(fullname, path)
        if spec is None or spec.loader is None:
            return None
        spec.loader, spec.loader_state = self, spec.loader
        return spec

    def exec_module(self, module: ModuleType) -> None:
        """Puts in the place of the function one that imports it."""
        assert module.__spec__ is not None
        loader: Loader = module.__spec__.loader_state

        def load() -> Dict[str, Any]:
            content = vars(module)
            if content.pop("__getattr__", None) is not None:
                loader.exec_module(module)
            return content

        def find_in_workspaces(*args: Any, **options: Any) -> Any:
            return load()[self._FUNCTION](*args, **options)

        def find(name: str) -> Any:
            if name.startswith("__"):  # the import system asks for these
                raise AttributeError(name)
            if name not in load():
                raise AttributeError(f"module '{module.__name__}' has no attribute '{name}'")
            return load()[name]

        setattr(module, self._FUNCTION, find_in_workspaces)
        module.__getattr__ = find  # type: ignore[method-assign]

    def create_module(self, spec: ModuleSpec) -> None:
        """The usual kind of module."""


def _generated(init: Path) -> Dict[str, str]:
    """Class -> module of generated messages; empty for a module that was written by hand."""
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
