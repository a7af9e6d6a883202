# SPDX-License-Identifier: Apache-2.0
"""Checks the map of docs/architecture.md: which package and which sub-package may import which.

Checked are all packages below src, extras and examples: imports between packages and between the
sub-packages of one, and that each manifest names every imported package. In benchmarks, tests and tools
too: how many modules a folder holds, how long a file is, and that an imported module of the project exists.
Ends non-zero at any finding.
"""

import ast
import re
import sys
from collections import Counter
from pathlib import Path
from typing import Collection, Dict, Iterator, List, NamedTuple, Set, Tuple

SRC = Path(__file__).resolve().parent.parent / "src"

#: Beside src: packages that are built when asked for. None below src imports one.
BESIDE = ("extras", "examples")

#: Most modules in one folder.
MOST_MODULES = 15

#: Most lines in one file, tests included.
MOST_LINES = 500

#: Package → the packages of MERLIN that it may import.
MAY_IMPORT: Dict[str, Tuple[str, ...]] = {
    "merlin_pddl": (),
    "merlin_ros": ("merlin_msgs",),
    "merlin_planning": ("merlin_msgs", "merlin_pddl", "merlin_ros"),
    "merlin_sm": ("merlin_msgs", "merlin_pddl", "merlin_ros", "merlin_planning"),
    "merlin_guard": ("merlin_msgs", "merlin_ros"),
    "merlin_actions": ("merlin_msgs", "merlin_pddl", "merlin_ros", "merlin_planning", "merlin_sm"),
    "merlin_executor": ("merlin_msgs", "merlin_pddl", "merlin_ros", "merlin_planning", "merlin_sm"),
    "merlin_rosplan": ("merlin_msgs", "merlin_pddl", "merlin_ros", "merlin_planning"),
    "merlin_fleet": (
        "merlin_msgs",
        "merlin_pddl",
        "merlin_ros",
        "merlin_planning",
        "merlin_rosplan",
        "merlin_executor",
        "merlin_monitor",
    ),
    "merlin_reactive": ("merlin_msgs", "merlin_ros"),
    "merlin_sim": ("merlin_msgs", "merlin_ros", "merlin_reactive"),
    "merlin_monitor": (
        "merlin_msgs",
        "merlin_pddl",
        "merlin_ros",
        "merlin_planning",
        "merlin_sm",
        "merlin_executor",
    ),
    "merlin_explain": (
        "merlin_msgs",
        "merlin_pddl",
        "merlin_ros",
        "merlin_planning",
        "merlin_rosplan",
        "merlin_monitor",
    ),
    "merlin_home": ("merlin_msgs", "merlin_ros", "merlin_sm", "merlin_actions", "merlin_executor"),
    "merlin_restaurant": (
        "merlin_msgs",
        "merlin_ros",
        "merlin_planning",
        "merlin_sm",
        "merlin_actions",
        "merlin_executor",
        "merlin_monitor",
    ),
    "merlin_guests": ("merlin_msgs", "merlin_ros", "merlin_reactive", "merlin_sim", "merlin_restaurant"),
    "merlin_experiment": (
        "merlin_msgs",
        "merlin_ros",
        "merlin_planning",
        "merlin_sm",
        "merlin_reactive",
        "merlin_sim",
        "merlin_executor",
        "merlin_home",
    ),
    "deliberation": (
        "merlin_msgs",
        "merlin_ros",
        "merlin_planning",
        "merlin_sm",
        "merlin_actions",
        "merlin_executor",
    ),
    "merlin": (
        "merlin_msgs",
        "merlin_ros",
        "merlin_pddl",
        "merlin_planning",
        "merlin_sm",
        "merlin_actions",
        "merlin_executor",
        "merlin_monitor",
        "merlin_explain",
    ),
    # What test suites share; no package imports it.
    "merlin_test": ("merlin_msgs", "merlin_ros"),
    # The underlay's nodes of these names are those of merlin_rosplan.
    "rosplan_knowledge_base": ("merlin_ros", "merlin_rosplan"),
    "rosplan_planning_system": ("merlin_ros", "merlin_actions", "merlin_rosplan"),
}

#: Package → its sub-packages, lowest first; those of one text do not import each other; "." is the modules
#: beside them, of which one may be named by itself. A package that is missing here has no sub-packages.
LAYERS: Dict[str, Tuple[str, ...]] = {
    "merlin_pddl": (".", "analysis", "checks"),
    "merlin_ros": ("work", "alarms robot_values", "processes", "master ports", ".", "actions"),
    "merlin_planning": (".", "over_rosplan", "dispatch_client"),
    "merlin_sm": (".", "states", "holding trees", "breakpoint_client state_factory"),
    "merlin_rosplan": (
        "knowledge planning dispatch",
        "storage supervision rest",
        "messages transport",
        "dispatcher",
        "nodes",
    ),
    "merlin_reactive": (".", "localization navigation speech listening recognition"),
    "merlin_sim": ("world", "robot people", "rendering", "engine", "node"),
    "merlin_actions": ("core", ".", "actions nodes testing"),
    "merlin_executor": ("core goals errands", ".", "mission node"),
    "merlin_fleet": ("core", ".", "page node", "commands"),
    "merlin_monitor": (
        "text drawing access",
        "history truth",
        "state",
        "listeners",
        "panels",
        ".",
        "bag",
        "web terminal rviz",
    ),
    "merlin_explain": ("claims", "core", "execution", "node", "."),
    "merlin": ("new", ".", "doctor replay services testing why"),
    "merlin_home": (".", "actions"),
    "merlin_restaurant": (".", "actions"),
    "merlin_experiment": ("records oracle", "mission"),
}

#: Package → its sub-packages that import neither ROS nor what does; "*" is the whole package.
WITHOUT_ROS: Dict[str, str] = {
    "merlin_pddl": "*",
    "merlin_actions": "core",
    "merlin_executor": "core goals errands",
    "merlin_explain": "core",
    "merlin_fleet": "core",
    "merlin_monitor": "access history truth",
    "merlin_rosplan": "knowledge planning dispatch storage supervision rest",
}
#: Likewise, package → those of its modules and sub-packages that such a one may import.
MODULES_WITHOUT_ROS: Dict[str, str] = {
    "merlin_planning": "dispatch_progress",
    "merlin_ros": "alarms robot_values work processes",
}
ROS = re.compile(r"(ros\w+|actionlib|smach\w*|tf2_ros|diagnostic_updater|bondpy|\w+_msgs|\w+_srvs)\Z")

#: Imported name → what a manifest calls it.
KEYS = {
    "aiohttp": "python3-aiohttp",
    "cv2": "python3-opencv",
    "google": "python3-protobuf",
    "grpc": "python3-grpcio",
    "jinja2": "python3-jinja2",
    "jsonschema": "python3-jsonschema",
    "matplotlib": "python3-matplotlib",
    "numpy": "python3-numpy",
    "_pytest": "python3-pytest",
    "pytest": "python3-pytest",
    "rospkg": "python3-rospkg",
    "scipy": "python3-scipy",
    "yaml": "python3-yaml",
}
#: Comes from requirements.txt: rosdep has no key for it.
FROM_PIP = {
    "kairos",
    "panda3d",
    "playwright",
    "pocketsphinx",
    "py_trees",
    "pyastar2d",
    "pybullet",
    "pybullet_utils",
    "pyrobosim",
    "rdflib",
    "shapely",
}


class Import(NamedTuple):
    """One import: the module that is imported, and where."""

    module: str
    file: Path
    line: int

    @property
    def package(self) -> str:
        """The package of the module."""
        return self.module.split(".")[0]

    def finding(self, text: str) -> str:
        """A line about it."""
        return f"{self.file.relative_to(SRC.parent)}:{self.line}: imports {self.module}; {text}"


def packages() -> List[Path]:
    """The folders of all packages below src and beside it."""
    # merlin_test is a link, which `**` does not follow.
    found = {path.parent for pattern in ("*/", "**/") for path in SRC.glob(f"{pattern}package.xml")}
    beside = (path for folder in BESIDE for path in (SRC.parent / folder).glob("*/package.xml"))
    return sorted(found | {path.parent for path in beside})


def home_of(package: str) -> Path:
    """The folder of a package, which may not exist."""
    homes = [SRC.parent / folder / package for folder in BESIDE]
    return next((home for home in homes if home.is_dir()), SRC / package)


def imports_of(package: Path) -> Iterator[Import]:
    """What the modules and scripts of a package import, inside functions too."""
    scripts = [path for path in package.glob("scripts/*") if path.is_file()]
    for path in sorted([*package.glob("src/**/*.py"), *scripts]):
        text = path.read_text(encoding="utf-8")
        if path.suffix != ".py" and not text.startswith("#!/usr/bin/env python3"):
            continue
        for node in ast.walk(ast.parse(text, str(path))):
            if isinstance(node, ast.Import):
                yield from (Import(alias.name, path, node.lineno) for alias in node.names)
            elif isinstance(node, ast.ImportFrom):
                module = _absolute(node, package, path)
                # What is imported may be a sub-package or a module of it: then that is what counts.
                parts = [f"{module}.{alias.name}" for alias in node.names]
                yield from (Import(part if _exists(part) else module, path, node.lineno) for part in parts)


def _absolute(node: ast.ImportFrom, package: Path, path: Path) -> str:
    module = node.module or ""
    if not node.level:
        return module
    above = path.relative_to(package / "src").parts[: -node.level]
    return ".".join([*above, *([module] if module else [])])


def _exists(module: str) -> bool:
    path = home_of(module.split(".")[0]) / "src" / Path(*module.split("."))
    return path.is_dir() or path.with_suffix(".py").is_file()


def wrong_package(package: str, found: Import) -> Iterator[str]:
    """An import of a package of MERLIN that is not below the importing one."""
    allowed = MAY_IMPORT.get(package, ())
    if re.match(r"merlin(_|\Z)", found.package) and found.package not in (package, *allowed):
        yield found.finding(f"{package} may import {', '.join(allowed) or 'no package of MERLIN'}")


def wrong_layer(package: str, root: Path, found: Import) -> Iterator[str]:
    """An import of a sub-package that is not below the importing one."""
    layers = {room: level for level, rooms in enumerate(LAYERS.get(package, ())) for room in rooms.split()}
    if found.package != package or "src" not in found.file.relative_to(root).parts:
        return
    if not layers:
        if package in MAY_IMPORT and len(found.file.relative_to(root / "src").parts) > 2:
            yield found.finding(f"{package} has no layers yet; give it some in {Path(__file__).name}")
        return
    room, target = _room(root, found.file, layers), _room_of(root, found.module, layers)
    for name in (room, target):
        if name not in layers:
            yield found.finding(f"{package}/{name} has no layer yet; give it one in {Path(__file__).name}")
            return
    if target != room and layers[target] >= layers[room]:
        yield found.finding(f"{package}/{target} is not below {package}/{room}")


def ros_in_a_core(package: str, root: Path, found: Import) -> Iterator[str]:
    """An import of ROS, or of a package that imports ROS, in a sub-package that runs without it."""
    rooms = [*WITHOUT_ROS.get(package, "").split(), *MODULES_WITHOUT_ROS.get(package, "").split()]
    if not rooms or "src" not in found.file.relative_to(root).parts:
        return
    room = _room(root, found.file, rooms)
    foreign = (
        found.package.startswith("merlin_")
        and WITHOUT_ROS.get(found.package) != "*"
        and not set(found.module.split(".")[1:2]) & set(MODULES_WITHOUT_ROS.get(found.package, "").split())
    )
    if (room in rooms or "*" in rooms) and (
        ROS.match(found.package) or (foreign and found.package != package)
    ):
        yield found.finding(f"{package}/{room} runs without ROS")


def _room(root: Path, file: Path, named: Collection[str] = ()) -> str:
    parts = file.relative_to(root / "src").with_suffix("").parts
    return parts[1] if len(parts) > 2 or parts[-1] in named else "."


def _room_of(root: Path, module: str, named: Collection[str]) -> str:
    parts = module.split(".")
    if len(parts) > 1 and (parts[1] in named or (root / "src" / parts[0] / parts[1]).is_dir()):
        return parts[1]
    return "."


def missing_in_manifest(root: Path, imports: List[Import]) -> Iterator[str]:
    """Imported packages that the manifest does not name."""
    manifest = (root / "package.xml").read_text(encoding="utf-8")
    named = set(re.findall(r"<(?:exec_|run_)?depend[^>]*>([^<]+)<", manifest))
    named |= {root.name, *FROM_PIP}
    reported: Set[str] = set()
    for found in imports:
        name = found.package
        if name in sys.stdlib_module_names or KEYS.get(name, name) in named or name in reported:
            continue
        reported.add(name)
        yield found.finding(f"{root.name}/package.xml does not name {KEYS.get(name, name)}")


def modules(*folders: str) -> List[Path]:
    """All modules in these folders of the project."""
    return sorted(path for folder in folders for path in (SRC.parent / folder).glob("**/*.py"))


def full_folders() -> Iterator[str]:
    """Folders that hold more modules than a reader can keep in mind."""
    own_names = ("__init__.py", "__main__.py", "conftest.py")
    found = modules("src", *BESIDE, "bench", "test", "tools")
    counts = Counter(path.parent for path in found if path.name not in own_names)
    for folder, count in sorted(counts.items()):
        if count > MOST_MODULES:
            yield f"{folder.relative_to(SRC.parent)}: {count} modules; {MOST_MODULES} is the most"


def long_files() -> Iterator[str]:
    """Files that hold more than one idea."""
    for path in modules("src", *BESIDE, "bench", "test", "tools"):
        count = len(path.read_text(encoding="utf-8").splitlines())
        if count > MOST_LINES:
            yield f"{path.relative_to(SRC.parent)}: {count} lines; {MOST_LINES} is the most"


def gone_modules() -> Iterator[str]:
    """Modules of MERLIN and of bench that are imported and do not exist."""
    for path in modules("src", *BESIDE, "bench", "test", "tools"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"), str(path))):
            if isinstance(node, ast.Import):
                names = [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom) and not node.level:
                names = [node.module or ""]
            else:
                continue
            for name in names:
                if _is_missing(name):
                    place = f"{path.relative_to(SRC.parent)}:{node.lineno}"
                    yield f"{place}: imports {name}, which does not exist"


def _is_missing(module: str) -> bool:
    top = module.split(".")[0]
    if (home_of(top) / "setup.py").is_file():
        return not _exists(module)
    bench = SRC.parent / "bench"
    path = bench / Path(*module.split("."))
    return (bench / top / "__init__.py").is_file() and not (
        path.is_dir() or path.with_suffix(".py").is_file()
    )


def main() -> int:
    """Prints what is wrong; returns the exit code."""
    findings: List[str] = [*gone_modules(), *long_files(), *full_folders()]
    for root in packages():
        imports = list(imports_of(root))
        for found in imports:
            findings += [
                *wrong_package(root.name, found),
                *wrong_layer(root.name, root, found),
                *ros_in_a_core(root.name, root, found),
            ]
        findings += missing_in_manifest(root, imports)
    for finding in dict.fromkeys(findings):
        print(finding, file=sys.stderr)
    return 1 if findings else 0


if __name__ == "__main__":
    sys.exit(main())
