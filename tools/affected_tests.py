# SPDX-License-Identifier: Apache-2.0
"""Prints the unit tests that a change concerns: those of the changed modules and of all that imports them.

`tools/affected_tests.py [REVISION]`: changed since the revision, by default since the branch left its
upstream, and what is not committed. A changed file that is not Python concerns the tests that mention it.
"""

import ast
import re
import subprocess
import sys
from pathlib import Path
from typing import Dict, Iterable, Iterator, List, Set

ROOT = Path(__file__).resolve().parents[1]
UNIT = ("test/unit", "test/execution")
_DOTTED = re.compile(r"\b[A-Za-z_]\w*(?:\.[A-Za-z_]\w*)+")


def git(*words: str) -> List[str]:
    """The lines that git prints; none when it refuses."""
    done = subprocess.run(["git", "-C", str(ROOT), *words], capture_output=True, text=True, check=False)
    return done.stdout.splitlines() if done.returncode == 0 else []


def changed(revision: str) -> List[str]:
    """Files that differ from a revision, those that git does not know yet included."""
    return [*git("diff", "--name-only", revision), *git("ls-files", "--others", "--exclude-standard")]


def start_of_branch() -> str:
    """Where the branch left its upstream; without one, the last commit."""
    return (git("merge-base", "HEAD", "@{upstream}") or ["HEAD"])[0]


def sources() -> List[Path]:
    """Python files of packages, benchmarks, tools and tests, scripts without an ending included."""
    known = [ROOT / name for name in git("ls-files", "--cached", "--others", "--exclude-standard")]
    return [
        path for path in known if path.is_file() and (path.suffix == ".py" or path.parent.name == "scripts")
    ]


def module_name(path: Path) -> str:
    """The name under which a file is imported: below its package's src, bench or tools, else its own."""
    parts = path.relative_to(ROOT).with_suffix("").parts
    if "src" in parts[1:]:
        parts = parts[len(parts) - parts[::-1].index("src") :]
    elif parts[0] in ("bench", "tools"):
        parts = parts[1:]
    else:
        parts = parts[-1:]
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def mentioned(path: Path) -> Iterator[str]:
    """Names that may be modules: of imports, and dotted names in texts, with which processes start."""
    try:
        tree = ast.parse(path.read_text(encoding="utf-8"))
    except (SyntaxError, UnicodeDecodeError):
        return  # a shell script, or a test's wrong one
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            yield from _DOTTED.findall(node.value)


def importers(files: List[Path]) -> Dict[Path, Set[Path]]:
    """File → the files of the project that import it."""
    by_name: Dict[str, Set[Path]] = {}
    for path in files:
        by_name.setdefault(module_name(path), set()).add(path)
    found: Dict[Path, Set[Path]] = {}
    known = set(files)
    for path in files:
        targets: Set[Path] = set()
        for name in mentioned(path):
            parts = name.split(".")
            for count in range(1, len(parts) + 1):  # importing a.b imports a
                targets |= by_name.get(".".join(parts[:count]), set())
        targets |= {parent / "conftest.py" for parent in path.parents}
        for target in targets & known - {path}:
            found.setdefault(target, set()).add(path)
    return found


def concerned(change: Iterable[str], files: List[Path], importing: Dict[Path, Set[Path]]) -> Set[Path]:
    """The changed files and all that imports them or mentions them, directly or through others.

    :param importing: what :func:`importers` finds in the files.
    """
    begin = [ROOT / name for name in change]
    waiting = list(begin)
    other = {path.name for path in begin if path.suffix != ".py"}
    for path in files if other else ():
        text = path.read_text(encoding="utf-8", errors="replace")
        if (ROOT / "test") in path.parents and any(name in text for name in other):
            waiting.append(path)
    reached: Set[Path] = set()
    while waiting:
        path = waiting.pop()
        if path in reached:
            continue
        reached.add(path)
        # All tests run with conftest.py; what it imports is about how they run, not about what they test.
        if path.name != "conftest.py" or path in begin:
            waiting += importing.get(path, ())
    return reached


def main(words: List[str]) -> int:
    """Prints a file per line; returns the exit code."""
    revision = words[0] if words else start_of_branch()
    files = sources()
    for path in sorted(concerned(changed(revision), files, importers(files))):
        name = str(path.relative_to(ROOT))
        if path.is_file() and path.name.startswith("test_") and name.startswith(UNIT):
            print(name)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
