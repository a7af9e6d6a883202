# SPDX-License-Identifier: Apache-2.0
"""Facts and goals that stand literally in Python: where they are, and whether a domain knows them."""

import ast
import contextlib
import gc
import inspect
import re
import textwrap
from pathlib import Path
from typing import Iterator, List, Mapping, NamedTuple, Sequence, Tuple

from merlin_pddl.domain import Domain
from merlin_pddl.formula_reader import ARITHMETIC, COMPARISONS, FormulaReader, number_of
from merlin_pddl.text_reader import Expression, Node, PddlError, Word, read_expression, simple_goals
from merlin_pddl.type_hierarchy import OBJECT

#: Stands for any object, where a value is put in when the program runs.
ANY = "?any"
_FILLED = re.compile(r"[^\s()]*\{[^{}]*\}[^\s()]*")


class Literal(NamedTuple):
    """PDDL text with variables for what is put in, and where it stands."""

    where: str
    """`file.py, line 3`, or the state's path."""
    text: str


def literals_of(kind: type, methods: Mapping[str, int], bases: Tuple[type, ...]) -> List[Literal]:
    """The PDDL that the source of a class gives to methods.

    :param kind: the class; what it inherits is read too, up to `bases`.
    :param methods: name -> place of the argument that is PDDL; -1: all of its arguments.
    :return: in the order of the source; none for a class without one. A text that is computed is not seen.
    """
    found: List[Literal] = []
    for file, first, method, call in _calls(kind, bases):
        if method in methods:
            place = methods[method]
            given = call.args[place : place + 1] if place >= 0 else call.args
            for part in (*given, *(word.value for word in call.keywords if word.arg in _KEYWORDS)):
                found += [Literal(f"{file}, line {first + line - 1}", text) for line, text in _texts(part)]
    return list(dict.fromkeys(found))


def calls_of(kind: type, method: str, bases: Tuple[type, ...]) -> bool:
    """Whether the source of a class calls a method; `kind` and `bases` as of :func:`literals_of`."""
    return any(method == called for _, _, called, _ in _calls(kind, bases))


def _calls(kind: type, bases: Tuple[type, ...]) -> Iterator[Tuple[str, int, str, ast.Call]]:
    """The calls of methods in a class: file, line of the class, name of the method, call."""
    for each in kind.__mro__:
        if each is object or any(each in base.__mro__ for base in bases):
            continue
        try:
            with _no_collection():
                lines, first = inspect.getsourcelines(each)
                tree = ast.parse(textwrap.dedent("".join(lines)))
        except (OSError, TypeError, SyntaxError):
            continue
        file = Path(inspect.getsourcefile(each) or "").name
        for node in ast.walk(tree):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
                yield file, first, node.func.attr, node


@contextlib.contextmanager
def _no_collection() -> Iterator[None]:
    """The parser of Python before 3.11.5 fails where a collection of garbage lets another thread parse.

    Python's own tracebacks parse too, so any thread may (python/cpython issue 106905).
    """
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()


#: Arguments that are PDDL where they are named.
_KEYWORDS = ("goals", "add", "remove")


def _texts(node: ast.AST) -> Iterator[Tuple[int, str]]:
    """The literal texts of an expression; in braces what is put in."""
    if isinstance(node, (ast.List, ast.Tuple)):
        for part in node.elts:
            yield from _texts(part)
    elif isinstance(node, (ast.ListComp, ast.GeneratorExp)):
        yield from _texts(node.elt)
    elif isinstance(node, ast.IfExp):
        yield from _texts(node.body)
        yield from _texts(node.orelse)
    elif isinstance(node, ast.JoinedStr):
        text = "".join(str(part.value) if isinstance(part, ast.Constant) else "{_}" for part in node.values)
        yield node.lineno, text
    elif isinstance(node, ast.Constant) and isinstance(node.value, str):
        yield node.lineno, node.value


def renamed(text: str, keys: Mapping[str, str]) -> str:
    """A text with other names for the keys in braces."""
    return re.sub(r"\{(\w+)\}", lambda match: f"{{{keys.get(match.group(1), match.group(1))}}}", text)


def with_variables(text: str, parameters: Sequence[str] = ()) -> str:
    """A text with `{key}` in it as PDDL: `?key` for a parameter, and `?any` for anything else.

    :param parameters: of the operator that runs, without `?`.
    """

    def variable(match: "re.Match[str]") -> str:
        key = match.group()[1:-1]
        return f"?{key}" if key in parameters else ANY

    return _FILLED.sub(variable, text)


def literal_fault(
    text: str,
    domain: Domain,
    objects: Mapping[str, Tuple[str, ...]],
    operator: str = "",
    adds_objects: bool = False,
) -> str:
    """What is wrong with facts or goals; empty: nothing that can be known before they are complete.

    :param text: conditions in PDDL, with `{key}` for what is put in.
    :param objects: of the problem -> their types.
    :param operator: whose parameters `{key}` may name.
    :param adds_objects: whether there may be further objects when it runs.
    """
    known = domain.operators.get(operator.lower())
    scope = {} if known is None else {variable.name: variable.types for variable in known.parameters}
    text = with_variables(text, [name[1:] for name in scope])
    try:
        if f"({ANY}" in text.replace(" ", "") or not text.lstrip().startswith("("):
            return ""  # which predicate it is is computed, too
        reader = FormulaReader(domain, dict(objects))
        for goal, _ in simple_goals(read_expression(text)):
            reader.condition(_with_numbers(goal), {**scope, ANY: (OBJECT,)})
    except PddlError as error:
        return "" if adds_objects and error.message.startswith("unknown object") else error.message
    return ""


def _with_numbers(node: Node) -> Node:
    """What is put in where a number has to stand, as one."""
    if isinstance(node, Expression):
        number = node.head in (*COMPARISONS, *ARITHMETIC)
        for at, part in enumerate(node[1:], 1):
            if number and isinstance(part, Word) and part != ANY and number_of(part) is None:
                raise part.error(f"{part.written!r} is neither a number nor a function")
            node[at] = Word("0") if number and part == ANY else _with_numbers(part)
    return node
