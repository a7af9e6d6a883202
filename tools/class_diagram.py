"""Draws the class diagrams of docs/classes.md (the paper's Figures 2 and 4) from the code.

Usage: class_diagram.py [--check]     --check only tells whether the page is up to date
"""

import ast
import sys
from pathlib import Path
from typing import Dict, List, Tuple

WORKSPACE = Path(__file__).resolve().parent.parent
PAGE = WORKSPACE / "docs" / "classes.md"
DIAGRAMS = (
    (
        "State machines and their states (paper, Figure 2)",
        ("merlin_sm", ("merlin_sm", "rosplan_assistant", "state_factory", "states/*")),
    ),
    (
        "Actions (paper, Figure 4)",
        (
            "merlin_actions",
            ("action_interface", "merlin_action", "naive_action", "merlin_action_sm", "merlin_action_server"),
        ),
    ),
    (
        "Executor and missions (paper, Figure 3)",
        ("merlin_executor", ("executor", "executor_sm", "executor_client", "goal_state", "goal_dispatcher")),
    ),
)


def classes(package: str, patterns: Tuple[str, ...]) -> Dict[str, Tuple[List[str], List[str]]]:
    """Public classes of modules: name → (bases, public methods), in the order of the files."""
    found: Dict[str, Tuple[List[str], List[str]]] = {}
    root = WORKSPACE / "src" / package / "src" / package
    for pattern in patterns:
        for path in sorted(root.glob(f"{pattern}.py")):
            for node in ast.parse(path.read_text()).body:
                if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                    bases = [ast.unparse(base).rsplit(".", 1)[-1] for base in node.bases]
                    methods = [
                        item.name
                        for item in node.body
                        if isinstance(item, ast.FunctionDef) and not item.name.startswith("_")
                    ]
                    found[node.name] = bases, methods
    return found


def diagram(package: str, patterns: Tuple[str, ...]) -> str:
    """One Mermaid class diagram."""
    lines = ["```mermaid", "classDiagram"]
    for name, (bases, methods) in classes(package, patterns).items():
        lines += [f"  {base} <|-- {name}" for base in bases if base not in ("NamedTuple", "Enum")]
        lines.append(f"  class {name} {{")
        lines += [f"    +{method}()" for method in methods]
        lines.append("  }")
    return "\n".join([*lines, "```"])


def page() -> str:
    """The whole page."""
    parts = ["# Classes", "", "Made from the code by `python tools/class_diagram.py`."]
    for title, (package, patterns) in DIAGRAMS:
        parts += ["", f"## {title}", "", diagram(package, patterns)]
    return "\n".join(parts) + "\n"


def main() -> int:
    """Writes or checks the page; returns the exit code."""
    text = page()
    if "--check" in sys.argv[1:]:
        if PAGE.exists() and PAGE.read_text() == text:
            return 0
        print(f"{PAGE} is not up to date; run: python tools/class_diagram.py", file=sys.stderr)
        return 1
    PAGE.write_text(text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
