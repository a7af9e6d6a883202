# SPDX-License-Identifier: Apache-2.0
"""Starts a node without what it does not use: in half the time, and up to 20 MB smaller.

Importing one message imports every message of its package and of the packages those mention, `genpy`
imports numpy for the names of its number types, and rospy and what it stands on import modules of which
hardly a node uses anything (:data:`LAZY`). All are put off here until something asks for them.

Nor does Python look for garbage while it imports: it would look through all that is imported again and again.
"""

import atexit
import contextlib
import gc
import importlib
import os
import re
import signal
import sys
import threading
from functools import partial
from importlib.machinery import ModuleSpec, PathFinder
from types import FrameType, ModuleType
from typing import Any, Dict, Iterator, Optional, Sequence

#: Modules that are imported when something of them is first used → functions that do not count as that: each
#: has a twin in a module that costs nothing; "": in its place is one that imports when it is called.
LAZY: Dict[str, Dict[str, str]] = {
    "ast": {},  # of genmsg
    "calendar": {},  # of email, which reads the headers of XML-RPC
    "catkin.find_in_workspaces": {"find_in_workspaces": ""},  # of roslib
    "catkin_pkg.packages": {"find_packages": __name__},  # of that; with pyparsing and unittest
    "ctypes": {},  # of what starts processes
    "difflib": {},  # of the reader of PDDL
    "diagnostic_updater": {},
    "email.header": {},
    "hashlib": {"md5": "_md5", "sha256": "_sha256"},  # of rospy and ours; with OpenSSL
    "html": {},  # of the XML-RPC server, as the next
    "inspect": {"currentframe": __name__, "signature": ""},  # of rospy's log, dataclasses, others; with dis
    "mimetypes": {},
    "rosclean": {},  # of roslaunch; with distutils, in whose place setuptools comes
    "shutil": {},
    "tempfile": {},  # of the problem interface; with random
    "ipaddress": {},  # of urllib
    "pickle": {},  # of rospy
    "platform": {"release": __name__, "system": __name__},  # of rosgraph
    "pprint": {},  # of genmsg
    "pydoc": {"HTMLDoc": __name__},  # of the XML-RPC server
    "random": {},  # of rospy
    "sqlite3": {},  # of the knowledge base
    "ssl": {},  # of the XML-RPC client
    "roslib.packages": {},  # with subprocess
    "textwrap": {},  # of traceback
    "tokenize": {},  # of linecache
    "xml.dom.minidom": {},  # of rospkg
    "xml.etree.ElementTree": {"ElementTree": ""},  # of rospkg, by one of the two names
    "xml.etree.cElementTree": {"ElementTree": ""},
    "yaml": {},  # of rospy and genpy
}

_LOG_FILE = "ROS_PYTHON_LOG_CONFIG_FILE"
_IMPORT = re.compile(r"from \._(\w+) import \*")


#: Nice value at which a node that can wait imports what it needs: a tenth of what others get.
PATIENT = 10


def run(module: str, function: str = "main", *args: Any, patient: bool = False) -> None:
    """Prepares the process, imports a module and ends the process with what its function returns.

    :param module: absolute name; whatever it imports must not have been imported before.
    :param patient: let the nodes that start at the same time go first.
    """
    importlib.import_module("merlin_ros.early_end")  # SIGINT ends the process while it imports the rest
    with importing():
        prepare()
        _print_without_failing()
        if patient:
            _import_patiently(module)
        found = importlib.import_module(module)
    sys.exit(getattr(found, function)(*args))


def command(module: str, function: str = "main") -> None:
    """Likewise for a command of a terminal; what it does not do about Ctrl-C, the signal does."""
    usual = signal.getsignal(signal.SIGINT)
    if usual is signal.default_int_handler:  # a shell may have begun it deaf to Ctrl-C
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    with importing():
        prepare()
        _print_without_failing()
        found = importlib.import_module(module)
    try:
        signal.signal(signal.SIGINT, usual)
        sys.exit(getattr(found, function)())
    except KeyboardInterrupt:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
        signal.raise_signal(signal.SIGINT)


@contextlib.contextmanager
def importing() -> Iterator[None]:
    """Python does not look for garbage meanwhile, and takes what was imported for old; may be nested."""
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_enabled:
            gc.freeze()
            gc.unfreeze()  # into the oldest generation, without looking through it
            gc.enable()


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

    from merlin_ros.work.threads import start_thread  # with what is lazy

    start_thread("imports", work).join()


def _print_without_failing() -> None:
    from merlin_ros.processes.screen import print_without_failing  # with what is lazy

    print_without_failing()


def prepare() -> None:
    """Makes later imports lean; to be called before anything of ROS is imported, once or more often."""
    if any(isinstance(finder, LazyMessages) for finder in sys.meta_path):
        return
    for name in ("ROS_HOME", "ROS_LOG_DIR"):  # empty, as the launch files take them; else: the current folder
        if not os.environ.get(name):
            os.environ.pop(name, None)
    sys.meta_path[:0] = [LazyMessages(), LazyModules()]
    if "numpy" not in sys.modules and "genpy" not in sys.modules:
        # genpy can do without: it knows fewer types of numbers when it says what is wrong with a message.
        sys.modules["numpy"] = None  # type: ignore[assignment]
        try:
            importlib.import_module("genpy")
        finally:
            del sys.modules["numpy"]


@contextlib.contextmanager
def log_configured() -> Iterator[None]:
    """While rospy configures its log, it finds the file that it would find, without a look at every package.

    It goes through all folders of ROS_PACKAGE_PATH, for a file that it takes only where no other is. And it
    finds the log's folder: of two nodes that make it at once, the second one would have no log.
    """
    import rospkg
    from rosgraph.roslogging import makedirs_with_parent_perms

    with contextlib.suppress(OSError):  # the other node has made it, or rospy says what is wrong
        makedirs_with_parent_perms(rospkg.get_log_dir())
    folders = (os.path.join(rospkg.get_ros_home(), "config"), rospkg.get_etc_ros_dir())
    files = [os.path.join(folder, f"python_logging.{end}") for folder in folders for end in ("conf", "yaml")]
    found = next(filter(os.path.isfile, files), None)
    if found is None or os.environ.get(_LOG_FILE):
        yield
        return
    os.environ[_LOG_FILE] = found
    try:
        yield
    finally:
        del os.environ[_LOG_FILE]


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


def currentframe() -> FrameType:
    """What `inspect.currentframe` returns."""
    return sys._getframe(1)


def system() -> str:
    """What `platform.system` returns."""
    return os.uname().sysname


def release() -> str:
    """What `platform.release` returns."""
    return os.uname().release


def find_packages(basepath: str, *args: Any, **options: Any) -> Dict[str, Any]:
    """What `catkin_pkg.packages.find_packages` returns; of each package only the name is read.

    More is not asked for where roslib looks for a node, and catkin reads all that each package.xml has.
    """
    if args or options:
        whole = importlib.import_module("catkin_pkg.packages")
        vars(whole)  # imports it
        return whole.find_packages(basepath, *args, **options)
    from rospkg.rospack import list_by_path

    found: Dict[str, str] = {}
    list_by_path("package.xml", basepath, found)
    return {os.path.relpath(folder, basepath): _Package(name, folder) for name, folder in found.items()}


class _Package:
    """A package, of which all but the name is read when it is asked for."""

    def __init__(self, name: str, folder: str) -> None:
        self.name, self._folder = name, folder

    def __getattr__(self, name: str) -> Any:
        return getattr(importlib.import_module("catkin_pkg.package").parse_package(self._folder), name)


class HTMLDoc:
    """In place of pydoc's, of which the XML-RPC server derives a class that hardly a process uses."""

    def __getattr__(self, name: str) -> Any:
        return getattr(importlib.import_module("pydoc").HTMLDoc, name).__get__(self)


class LazyMessages:
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
        modules = _generated(spec.origin)
        if not modules:
            return None
        spec.loader, spec.loader_state = self, modules  # type: ignore[assignment]
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


class LazyModules:
    """Finds the modules of :data:`LAZY`, and imports one when something of it is first used."""

    _LOADING = "lazy module "  # beginning of a name whose import is the import of what it stands for

    def __init__(self) -> None:
        self._modules: Dict[str, _LazyModule] = {}

    def find_spec(
        self, fullname: str, path: Optional[Sequence[str]] = None, target: Optional[ModuleType] = None
    ) -> Optional[ModuleSpec]:
        """The module; another loader has to have found it."""
        if fullname in self._modules:
            return ModuleSpec(fullname, self)  # type: ignore[arg-type]
        if fullname not in LAZY or target is not None:  # a target is to be imported again
            return None
        spec = PathFinder.find_spec(fullname, path)
        if spec is not None and spec.loader is not None:
            name = f"{self._LOADING}{len(self._modules)}"
            spec.loader, spec.loader_state = self, (name, spec.loader)  # type: ignore[assignment]
        return spec

    def exec_module(self, module: ModuleType) -> None:
        """Makes a module lazy; or, for the name of its import, imports it."""
        assert module.__spec__ is not None
        if module.__spec__.name in self._modules:
            self._modules[module.__spec__.name]._import()
            return
        module.__class__ = _LazyModule
        self._modules[module.__spec__.loader_state[0]] = module  # type: ignore[assignment]
        for function, twin in LAZY[module.__spec__.name].items():
            setattr(module, function, _stand_in(module, function, twin))

    def create_module(self, spec: ModuleSpec) -> None:
        """The usual kind of module."""


class _LazyModule(ModuleType):
    """A module whose first use imports it: once, however many threads use it, as Python's imports do."""

    def __getattribute__(self, name: str) -> Any:
        get = partial(ModuleType.__getattribute__, self)  # no super(): it may have become a usual one
        spec, content = get("__spec__"), get("__dict__")
        known = name in content and (name.startswith("__") or name in LAZY[spec.name])
        if not known and name not in ("__class__", "__path__"):
            importlib.import_module(spec.loader_state[0])  # or waits until another thread has done so
        return get(name)

    def _import(self) -> None:
        content = super().__getattribute__("__dict__")
        spec: ModuleSpec = content["__spec__"]
        loader = spec.loader_state[1]
        found = {name: value for name, value in content.items() if not name.startswith("__")}
        for name in LAZY[spec.name]:
            content.pop(name, None)
        try:
            loader.exec_module(self)
        except BaseException:
            content.update(found)
            raise
        # What was set from outside stays.
        content.update({name: value for name, value in found.items() if name not in LAZY[spec.name]})
        spec.loader = content["__loader__"] = loader
        self.__class__ = ModuleType  # type: ignore[assignment]


def _stand_in(module: ModuleType, function: str, twin: str) -> Any:
    """The same function of another module; or one that imports the module and calls its function."""
    if twin:
        with contextlib.suppress(ImportError, AttributeError):
            return getattr(importlib.import_module(twin), function)

    def call(*args: Any, **options: Any) -> Any:
        vars(module)  # imports it
        return getattr(module, function)(*args, **options)

    return call


def _generated(init: str) -> Dict[str, str]:
    """Class -> module of generated messages; empty for a module that was written by hand."""
    try:
        with open(init, encoding="utf-8") as file:
            lines = file.read().split("\n")
    except (OSError, UnicodeDecodeError):
        return {}
    found: Dict[str, str] = {}
    package, kind = init.split(os.sep)[-3:-1]
    for line in filter(None, map(str.strip, lines)):
        match = _IMPORT.fullmatch(line)
        if match is None:
            return {}
        name = match.group(1)
        endings = ("", "Request", "Response") if kind == "srv" else ("",)
        found.update({f"{name}{ending}": f"{package}.{kind}._{name}" for ending in endings})
    return found
