# SPDX-License-Identifier: Apache-2.0
"""Counts what an application's author writes, and keeps the table of docs/tutorial.md true.

Usage: application_lines.py [--check]     --check only tells whether the table is up to date
Counted are lines of code: no blank lines, comments and docstrings.
"""

import ast
import io
import sys
import tokenize
from pathlib import Path
from typing import Iterator, Set

WORKSPACE = Path(__file__).resolve().parent.parent
PAGE = WORKSPACE / "docs" / "tutorial.md"
BEGIN, END = "<!-- lines: made by tools/application_lines.py -->", "<!-- end of lines -->"
RESTAURANT = WORKSPACE / "src" / "merlin_restaurant" / "src" / "merlin_restaurant"
READY = WORKSPACE / "src" / "merlin_actions" / "src" / "merlin_actions" / "actions"
ROWS = (
    ("domain", WORKSPACE / "pddl" / "restaurant" / "domain.pddl"),
    ("problem, without the distances", WORKSPACE / "pddl" / "restaurant" / "problem.pddl"),
    ("action `navigate` (comes with MERLIN)", READY / "navigate.py"),
    *(
        (f"action `{name}`", RESTAURANT / "actions" / f"{name}.py")
        for name in (
            "check_table",
            "take_order",
            "order_to_barman",
            "load_order",
            "deliver_order",
            "return_order",
            "check_entrance",
            "greet_client",
            "guide_client",
        )
    ),
    ("what actions share: menu and grammars", RESTAURANT / "menu.py"),
    ("what actions share: table states", RESTAURANT / "table_state.py"),
    ("what actions share: orders", RESTAURANT / "orders.py"),
    ("who follows: tracker", RESTAURANT / "person_tracker.py"),
    ("who follows: states", RESTAURANT / "follower_watch.py"),
    ("mission", RESTAURANT / "evening.py"),
    ("launch file", WORKSPACE / "launch" / "restaurant.launch"),
)


def lines_of(path: Path) -> int:
    """Lines of code of a Python, PDDL or launch file."""
    text = path.read_text()
    if path.suffix == ".py":
        return len(_code_lines(text))
    if path.suffix == ".pddl":
        kept = (line.split(";")[0].strip() for line in text.splitlines())
        return sum(bool(line) and not line.startswith("(= (distance") for line in kept)
    return sum(bool(line.strip()) and not line.strip().startswith("<!--") for line in text.splitlines())


def _code_lines(text: str) -> Set[int]:
    skipped = (tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT)
    docstrings = set(_docstring_lines(text))
    found: Set[int] = set()
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type not in skipped and token.type != tokenize.ENDMARKER:
            found.update(range(token.start[0], token.end[0] + 1))
    return found - docstrings


def _docstring_lines(text: str) -> Iterator[int]:
    for node in ast.walk(ast.parse(text)):
        if (
            isinstance(node, ast.Expr)
            and isinstance(node.value, ast.Constant)
            and isinstance(node.value.value, str)
        ):
            yield from range(node.lineno, (node.end_lineno or node.lineno) + 1)


def table() -> str:
    """The table as Markdown."""
    rows = [(name, path.relative_to(WORKSPACE), lines_of(path)) for name, path in ROWS]
    body = "\n".join(f"| {name} | [{path.name}](../{path}) | {count} |" for name, path, count in rows)
    return f"{BEGIN}\n| | file | lines |\n|---|---|---|\n{body}\n{END}"


def replaced(page: str) -> str:
    """The page with the table of now."""
    before, _, rest = page.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not end:
        raise SystemExit(f"{PAGE} has no place for the table: {BEGIN} … {END}")
    return before + table() + after


def main() -> int:
    """Writes or checks the table; returns the exit code."""
    page = PAGE.read_text()
    new = replaced(page)
    if "--check" in sys.argv[1:]:
        if page == new:
            return 0
        print(f"{PAGE} is not up to date; run: python tools/application_lines.py", file=sys.stderr)
        return 1
    PAGE.write_text(new)
    return 0


if __name__ == "__main__":
    sys.exit(main())
