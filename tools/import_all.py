# SPDX-License-Identifier: Apache-2.0
"""Imports each module and compiles each script of what is built here, with the Python of the workspace.

Names those that cannot be, and why; ends with 1 when there is one. Libraries of other profiles and those for
newer Pythons only may be missing.

Usage: tools/in_workspace.sh python tools/import_all.py
"""

import importlib
import pkgutil
import sys
from pathlib import Path
from typing import Iterator, List

ROOT = Path(__file__).resolve().parent.parent
BUILT = ROOT / "devel" / "lib" / f"python{sys.version_info.major}" / "dist-packages"
#: For tests of applications (profile all), and for Python 3.10 and newer (requirements.txt).
OPTIONAL = ("pytest", "kairos")


def modules(package: str) -> Iterator[str]:
    """The names of a package and of all its modules, without those that are programs."""
    yield package
    paths = [str(path) for path in importlib.import_module(package).__path__]
    for module in pkgutil.walk_packages(paths, f"{package}.", onerror=lambda name: None):
        if not module.name.endswith(".__main__"):
            yield module.name


def scripts(source: Path) -> Iterator[Path]:
    """The executables of a package that are Python."""
    for path in sorted(source.glob("scripts/*")):
        if path.is_file() and b"python" in path.read_bytes().split(b"\n", 1)[0]:
            yield path


def main() -> int:
    """Runs the command; returns the exit code."""
    problems: List[str] = []
    count = 0
    for package in sorted(path.name for path in BUILT.iterdir() if (path / "__init__.py").exists()):
        for name in modules(package):
            count += 1
            try:
                importlib.import_module(name)
            except Exception as error:
                if not (isinstance(error, ModuleNotFoundError) and error.name in OPTIONAL):
                    problems.append(f"{name}: {type(error).__name__}: {error}")
    for manifest in sorted({*ROOT.glob("src/*/package.xml"), *ROOT.glob("src/*/*/package.xml")}):
        if (ROOT / "build" / manifest.parent.relative_to(ROOT / "src")).is_dir():
            for path in scripts(manifest.parent):
                count += 1
                try:
                    compile(path.read_bytes(), str(path), "exec")
                except SyntaxError as error:
                    problems.append(f"{path.relative_to(ROOT)}: {error}")
    print(
        *problems,
        f"Python {sys.version.split()[0]}: {count} modules and scripts, {len(problems)} fail",
        sep="\n",
    )
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main())
